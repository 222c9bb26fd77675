"""Finding of one recording: facts, open questions, faults; findings as a table and as JSON."""

import json
import os
import re
import textwrap
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.core.errors import PipelineError
from pipeline.core.typed_yaml import read_yaml

_TEXTS = read_yaml(Path(__file__).with_name("texts.yaml"))
QUESTIONS: dict[str, dict[str, str]] = _TEXTS["questions"]
REASONS: dict[str, str] = _TEXTS["reasons"]  # why a file is of no known format
# kinds in addition to pipeline.formats.format.Kind
UNKNOWN = "unknown"
ROBOT = "robot"
NUMBER = re.compile(r"\d+")
WIDTH = 100  # greatest number of characters in a line of facts
LISTED = 4  # number of printed names of a longer list
PRINTED_FACTS = """bodies markers columns rows columns_without_numbers width height
    points organised share_without_position viewpoint share_not_above_zero recordings samples
    steps
    first_frame rate_from times row_distance commanded_joints commanded_rows robot joints
    time row_numbers signals joint_names command
    wrong_command joints_that_stand_still motions topics passed_over fx separator decimal
    serial frames""".split()  # in their order


class Question(NamedTuple):
    """Open question about a file, the option that answers the question, and a likely value."""

    question: str
    option: str
    suggested: str | None = None

    def __str__(self) -> str:
        value = "" if self.suggested is None else f"; suggested is {self.suggested}"
        return f"{self.question}{value}: {self.option}"


@dataclass
class Finding:
    """Facts and faults of one recording (file or folder); None for a value that is not stated."""

    file: Path
    format: str = UNKNOWN
    kind: str = UNKNOWN
    option: str | None = None  # name of the format in options of the dataset
    version: str | None = None
    rate: float | None = None  # Hz
    duration: float | None = None  # s, from the first sample to the last
    # quantity → unit stated in the file
    units: dict[str, str] = field(default_factory=dict)
    # counts of missing or repaired samples
    gaps: dict[str, int] = field(default_factory=dict)
    facts: dict[str, object] = field(default_factory=dict)  # further facts by name
    files: list[Path] = field(default_factory=list)  # frames of a sequence
    open: list[Question] = field(default_factory=list)
    # faults for which the stages raise an error
    stops: list[str] = field(default_factory=list)

    @property
    def suggested(self) -> dict[str, str]:
        """Last part of an option's key → suggested value."""
        values = {}
        for question in self.open:
            if question.suggested:
                values[question.option.rpartition(".")[2]] = question.suggested
        return values

    def count(self, counts: dict[str, int]) -> None:
        """Add the ``counts`` that are not zero; announced and found numbers are facts."""
        for name, number in counts.items():
            if name.startswith(("announced", "found")):
                self.facts[name] = number
            elif number:
                self.gaps[name] = number

    def ask(self, name: str, suggested: str | None = None, **values: object) -> None:
        """Add the question ``name`` of texts.yaml with the ``values`` in its braces."""
        text, option = (words.format(**values) for words in QUESTIONS[name].values())
        self.open.append(Question(text, option, suggested))

    def withdraw(self, name: str) -> None:
        """Remove the question ``name``, which another file answers."""
        option = QUESTIONS[name]["option"]
        self.open = [question for question in self.open if question.option != option]

    def timed(self, time: np.ndarray, lost: int = 0, digits: int = 3) -> None:
        """Add duration and rate of samples at ``time`` (N,) s, with ``lost`` ones in between."""
        self.duration = float(time[-1] - time[0])
        self.rate = round((len(time) - 1 + lost) / self.duration, digits)

    def refuse(self, error: PipelineError) -> "Finding":
        """Add a question if ``error`` names an option of the dataset, else a stop."""
        option = str(error.evidence.get("key", ""))
        if option.startswith("dataset."):
            self.open.append(Question(error.message, option))
            return self
        evidence = {**error.evidence}
        for name in ("file", "key"):
            evidence.pop(name, None)
        self.stops.append(str(PipelineError(error.message, **evidence)))
        return self


def printable_path(path: Path, folder: Path | None = None) -> str:
    """Return ``path``, relative to ``folder`` if inside, as text with undecodable bytes escaped."""
    path = path.relative_to(folder) if folder in path.parents else path
    return os.fsencode(path.as_posix()).decode("utf-8", "backslashreplace")


def as_json(findings: list[Finding]) -> str:
    """Return a JSON list, one object per recording, without the names of depth frames."""
    plain = []
    for finding in findings:
        values = {**vars(finding)}
        del values["files"]
        values["file"] = printable_path(finding.file)
        values["open"] = [question._asdict() for question in finding.open]
        plain.append(values)
    return json.dumps(plain, indent=2, ensure_ascii=False, default=str)


def as_table(findings: list[Finding], folder: Path) -> str:
    """Return the findings as text, grouped by name without numbers; ? is a question, ! a stop."""
    groups: dict[str, list[Finding]] = {}
    unrecognised: dict[str, list[str]] = {}
    for finding in findings:
        if finding.format == UNKNOWN and not finding.stops:
            names = unrecognised.setdefault(str(finding.facts["reason"]), [])
            names.append(printable_path(finding.file, folder))
        else:
            groups.setdefault(_group_key(finding), []).append(finding)
    lines = []
    for group in groups.values():
        lines += _fact_lines(group, folder)
        lines += [f"    ? {question}" for question in group[0].open]
        lines += [f"    ! {reason}" for reason in group[0].stops]
    for reason, names in unrecognised.items():
        lines.append(f"not recognised, {reason}: {_text(names)}")
    return "\n".join(_printable(line) for line in lines)


def _printable(line: str) -> str:
    """Return a ``line`` without control characters, since names come from the files."""
    return "".join(c if c.isprintable() else "\ufffd" for c in line)


def _group_key(finding: Finding) -> str:
    """Return a text that is equal for findings which differ only in a number of the name."""
    kind = [finding.format, finding.version, finding.units]
    named = ("markers", "bodies", "robot", "joints")
    kind += [finding.facts.get(name) for name in named]
    kind += [(question.option, question.suggested) for question in finding.open]
    name = str(finding.file)
    if not finding.stops:
        name = NUMBER.sub("*", name)
    return f"{name} {kind}"


def _fact_lines(group: list[Finding], folder: Path) -> list[str]:
    """Return the lines of a ``group``: ranges, sums, and other facts of the first recording."""
    first = group[0]
    place = printable_path(first.file, folder)
    if len(group) > 1:
        place = f"{NUMBER.sub('*', place)} ({len(group)})"
    head = " ".join(filter(None, [f"{place}:", first.format, first.version]))

    rates = [finding.rate for finding in group]
    durations = [finding.duration for finding in group]
    facts = [_range(rates, "Hz"), _range(durations, "s")]
    counts = sum((Counter(finding.gaps) for finding in group), Counter())
    facts += [f"{number} {name.replace('_', ' ')}" for name, number in counts.items()]
    if first.units:
        facts.append(f"unit {', '.join(dict.fromkeys(first.units.values()))}")
    values = {**first.facts}
    values["columns"] = values.get("labels") or values.get("columns")
    for name in PRINTED_FACTS:
        value = values.get(name)
        if value or value == 0:
            words = "clock" if name == "time" else name.replace("_", " ")
            facts.append(f"{words} {_text(value)}")

    # blanks that do not break keep a fact in one line
    joined = "; ".join(fact.replace(" ", "\xa0") for fact in facts if fact)
    wrapped = textwrap.wrap(
        joined,
        WIDTH,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [head, *(f"    {line}".replace("\xa0", " ") for line in wrapped)]


def _range(values: Sequence[float | None], unit: str) -> str:
    """Return the least and the greatest of the stated ``values``; "" if none is stated."""
    stated = [value for value in values if value is not None]
    if not stated:
        return ""
    ends = dict.fromkeys(f"{end(stated):.4g}" for end in (min, max))
    return f"{'–'.join(ends)} {unit}"


def _text(value: object) -> str:
    """Return a fact as text: long lists are shortened, a separator is quoted."""
    if isinstance(value, dict):
        value = [f"{name} ({_text(inner)})" for name, inner in value.items()]
    if isinstance(value, list) and len(value) > LISTED + 1:
        return f"{', '.join(map(str, value[:LISTED]))} … ({len(value)})"
    if isinstance(value, list):
        return ", ".join(map(str, value))
    if isinstance(value, str) and len(value) == 1:  # a separator
        return repr(value)
    return f"{value:g}" if isinstance(value, float) else str(value)
