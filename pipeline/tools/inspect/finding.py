"""Finding of one recording: facts, open questions, faults; findings as a table and as JSON."""

import json
import os
import re
import textwrap
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.core.errors import PipelineError
from pipeline.core.typed_yaml import read_yaml

_TEXTS = read_yaml(Path(__file__).with_name("texts.yaml"))
QUESTIONS: dict[str, dict[str, str]] = _TEXTS["questions"]
REASONS: dict[str, str] = _TEXTS["reasons"]  # why a file is of no known format
UNKNOWN, ROBOT = "unknown", "robot"  # kinds in addition to pipeline.formats.format.Kind
WIDTH = 100  # greatest number of characters in a line of facts
LISTED = 4  # number of printed names of a longer list
PRINTED_FACTS = """bodies markers columns rows columns_without_numbers width height
    points organised share_without_position viewpoint share_not_above_zero samples steps
    first_frame rate_from times commanded_joints commanded_rows robot joints time row_numbers
    signals joint_names command
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
    units: dict[str, str] = field(
        default_factory=dict
    )  # quantity → unit stated in the file
    gaps: dict[str, int] = field(
        default_factory=dict
    )  # counts of missing or repaired samples
    facts: dict[str, object] = field(default_factory=dict)  # further facts by name
    files: list[Path] = field(default_factory=list)  # frames of a sequence
    open: list[Question] = field(default_factory=list)
    stops: list[str] = field(
        default_factory=list
    )  # faults for which the stages raise an error

    @property
    def suggested(self) -> dict[str, str]:
        """Last part of an option's key → suggested value."""
        return {
            one.option.rpartition(".")[2]: one.suggested
            for one in self.open
            if one.suggested
        }

    def count(self, counts: dict[str, int]) -> None:
        """Add the ``counts`` that are not zero; announced and found numbers are facts."""
        facts = {
            n: number
            for n, number in counts.items()
            if n.startswith(("announced", "found"))
        }
        self.facts |= facts
        self.gaps |= {
            n: number for n, number in counts.items() if number and n not in facts
        }

    def ask(self, name: str, suggested: str | None = None, **found: object) -> None:
        """Add the question ``name`` of texts.yaml about the values that were ``found``."""
        question, option = (text.format(**found) for text in QUESTIONS[name].values())
        self.open.append(Question(question, option, suggested))

    def withdraw(self, name: str) -> None:
        """Remove the question ``name``, which another file answers."""
        self.open = [
            one for one in self.open if one.option != QUESTIONS[name]["option"]
        ]

    def timed(self, time: np.ndarray, lost: int = 0, digits: int = 3) -> None:
        """Add duration and rate of samples at ``time`` (N,) s, with ``lost`` ones in between."""
        self.duration = float(time[-1] - time[0])
        self.rate = round((len(time) - 1 + lost) / self.duration, digits)

    def refuse(self, error: PipelineError) -> "Finding":
        """Add a question if ``error`` names an option of the dataset, else a stop."""
        option = str(error.evidence.get("key", ""))
        if option.startswith("dataset."):
            self.open.append(Question(error.message, option))
        else:
            evidence = {
                n: value
                for n, value in error.evidence.items()
                if n not in ("file", "key")
            }
            self.stops.append(str(PipelineError(error.message, **evidence)))
        return self


def printable_path(path: Path, folder: Path | None = None) -> str:
    """Return ``path``, relative to ``folder`` if inside, as text with undecodable bytes escaped."""
    path = path.relative_to(folder) if folder in path.parents else path
    return os.fsencode(path.as_posix()).decode("utf-8", "backslashreplace")


def as_json(findings: list[Finding]) -> str:
    """Return a JSON list, one object per recording, without the names of depth frames."""
    plain = [
        {name: value for name, value in vars(one).items() if name != "files"}
        | {
            "file": printable_path(one.file),
            "open": [each._asdict() for each in one.open],
        }
        for one in findings
    ]
    return json.dumps(plain, indent=2, ensure_ascii=False, default=str)


def as_table(findings: list[Finding], folder: Path) -> str:
    """Return the findings as text, grouped by name without numbers; ? is a question, ! a stop."""
    groups: dict[str, list[Finding]] = {}
    reasons: dict[str, list[str]] = {}
    for one in findings:
        if one.format == UNKNOWN and not one.stops:
            reason = str(one.facts["reason"])
            reasons.setdefault(reason, []).append(printable_path(one.file, folder))
            continue
        kind = [one.format, one.version, one.units, one.facts.get("markers")]
        kind += [
            one.facts.get("bodies"),
            one.facts.get("robot"),
            one.facts.get("joints"),
            *((each.option, each.suggested) for each in one.open),
        ]
        name = str(one.file) if one.stops else re.sub(r"\d+", "*", str(one.file))
        groups.setdefault(f"{name} {kind}", []).append(one)
    lines = []
    for group in groups.values():
        lines += _fact_lines(group, folder)
        lines += [f"    ? {question}" for question in group[0].open]
        lines += [f"    ! {reason}" for reason in group[0].stops]
    lines += [
        f"not recognised, {reason}: {_text(names)}" for reason, names in reasons.items()
    ]
    # replace control characters, since names come from the files
    return "\n".join(
        "".join(c if c.isprintable() else "\ufffd" for c in line) for line in lines
    )


def _fact_lines(group: list[Finding], folder: Path) -> list[str]:
    """Return the lines of a ``group``: ranges, sums, and other facts of the first recording."""
    first, place = group[0], printable_path(group[0].file, folder)
    if len(group) > 1:
        place = f"{re.sub(r'[0-9]+', '*', place)} ({len(group)})"
    facts = []
    for name, unit in (("rate", "Hz"), ("duration", "s")):
        known = [value for one in group if (value := getattr(one, name)) is not None]
        if known:
            ends = dict.fromkeys(f"{end(known):.4g}" for end in (min, max))
            facts.append(f"{'–'.join(ends)} {unit}")
    counts = sum((Counter(one.gaps) for one in group), Counter())
    facts += [f"{number} {name.replace('_', ' ')}" for name, number in counts.items()]
    if first.units:
        facts.append(f"unit {', '.join(dict.fromkeys(first.units.values()))}")
    values = first.facts | {
        "columns": first.facts.get("labels") or first.facts.get("columns")
    }
    for name in PRINTED_FACTS:
        if (value := values.get(name)) or value == 0:
            words = "clock" if name == "time" else name.replace("_", " ")
            facts.append(f"{words} {_text(value)}")
    head = " ".join(filter(None, [f"{place}:", first.format, first.version]))
    joined = "; ".join(
        fact.replace(" ", "\xa0") for fact in facts
    )  # no line ends inside a fact
    wrapped = textwrap.wrap(
        joined, WIDTH, break_long_words=False, break_on_hyphens=False
    )
    return [head, *(f"    {line}".replace("\xa0", " ") for line in wrapped)]


def _text(value: object) -> str:
    if isinstance(value, dict):
        value = [f"{name} ({_text(inner)})" for name, inner in value.items()]
    if isinstance(value, list):
        more = len(value) > LISTED + 1
        names = ", ".join(map(str, value[:LISTED] if more else value))
        return names + f" … ({len(value)})" * more
    if isinstance(value, str) and len(value) == 1:  # a separator
        return repr(value)
    return f"{value:g}" if isinstance(value, float) else str(value)
