"""Account of one recording: facts that the file states, open questions with the option that
answers each, and reasons for which the stages would refuse it; accounts as a table and as JSON.
"""

from __future__ import annotations

import json
import os
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from pipeline.core.errors import PipelineError

UNKNOWN, ROBOT = "unknown", "robot"
WIDTH = 100  # characters of a line of facts
LISTED = 4  # names of a list
NOTABLE = """unlabelled_markers width height points organised share_without_position viewpoint
    share_not_above_zero samples rows columns columns_without_numbers steps announced_frames
    first_frame rate_from rate_by_the_printed_times times robot joints signals command motions
    topics fx separator decimal serial frames""".split()  # facts in the table


@dataclass
class Finding:
    """Account of a file or of a folder that is one recording; None where it does not say."""

    file: Path
    format: str = UNKNOWN
    kind: str = UNKNOWN  # one of pipeline.formats.format.Kind, or of the two above
    option: str | None = None  # the name by which an option of the dataset chooses its reader
    version: str | None = None
    rate: float | None = None  # Hz
    duration: float | None = None  # s, from the first sample to the last
    units: dict[str, str] = field(default_factory=dict)  # quantity → unit as the file states it
    bodies: list[str] = field(default_factory=list)
    markers: list[str] = field(default_factory=list)
    gaps: dict[str, int] = field(default_factory=dict)  # missing, repeated or repaired, counted
    facts: dict[str, object] = field(default_factory=dict)  # everything else, by name
    files: list[Path] = field(default_factory=list)  # frames of a sequence
    open: list[tuple[str, str]] = field(default_factory=list)  # question, option that answers it
    stops: list[str] = field(default_factory=list)  # reasons for which the stages would refuse it

    @property
    def suggested(self) -> dict[str, str]:
        """Suggested value by key of dataset.joint_log."""
        return self.facts.get("settings", {})

    @property
    def timed(self) -> bool:
        """True of a table whose first column increases."""
        return self.facts.get("increasing_columns", [])[:1] == [0]

    def count(self, counts: dict[str, int]) -> None:
        """Add the ``counts`` that are not zero."""
        self.gaps |= {name: number for name, number in counts.items() if number}

    def ask(self, question: str, option: str, value: str | None = None) -> None:
        """Add a ``question`` that ``option`` answers, with the ``value`` that is suggested."""
        if value is not None:
            self.facts.setdefault("settings", {})[option.rpartition(".")[2]] = value
            question += f"; suggested is {value}"
        self.open.append((question, option))

    def refused(self, error: PipelineError) -> Finding:
        """Add a refusal: a question where it names the option that settles it, else a stop."""
        option = str(error.evidence.get("key", ""))
        if option.startswith("dataset."):
            self.ask(error.message, option)
        else:
            left = {n: value for n, value in error.evidence.items() if n not in ("file", "key")}
            self.stops.append(str(PipelineError(error.message, **left)))
        return self


def shown(path: Path, folder: Path | None = None) -> str:
    """Return ``path``, below ``folder`` if it lies there, as printable text."""
    path = path.relative_to(folder) if folder in path.parents else path
    return os.fsencode(path.as_posix()).decode("utf-8", "backslashreplace")


def as_json(findings: list[Finding]) -> str:
    """Return a list of objects, one a recording, with every fact but the names of the frames."""
    plain = [asdict(one) | {"file": shown(one.file)} for one in findings]
    for values in plain:
        del values["files"]
        values["open"] = [
            dict(zip(("question", "option"), one, strict=True)) for one in values["open"]
        ]
    return json.dumps(plain, indent=2, ensure_ascii=False, default=str)


def as_table(findings: list[Finding], folder: Path) -> str:
    """Return name and format of each recording, those alike but for their number in one; below it
    facts and counts, the questions (?) and the stops (!).
    """
    groups: dict[object, list[Finding]] = {}
    reasons: dict[str, list[str]] = {}
    for one in findings:
        if one.format == UNKNOWN and not one.stops:
            reasons.setdefault(one.facts["reason"], []).append(shown(one.file, folder))
            continue
        alike = (one.units, one.markers, one.bodies, one.suggested, one.format, one.version)
        key = re.sub(r"\d+", "*", str(one.file)), str(alike), str([o for _, o in one.open])
        groups.setdefault(one.file if one.stops else key, []).append(one)
    printed, asked = [], []
    for group in groups.values():
        first, again = group[0], group[0].open == asked
        asked = first.open
        printed += _lines(group, folder)
        printed += [f"    ? {question}: {option}" for question, option in asked if not again]
        printed += ["    ? as for the recording above"] * (again and bool(asked))
        printed += [f"    ! {reason}" for reason in first.stops]
    printed += [f"not recognised, {reason}: {_text(names)}" for reason, names in reasons.items()]
    # names come from the files: no control character reaches the terminal
    return "\n".join("".join(c if c.isprintable() else "\ufffd" for c in p) for p in printed)


def _lines(group: list[Finding], folder: Path) -> list[str]:
    first, place = group[0], shown(group[0].file, folder)
    if len(group) > 1:
        place = f"{re.sub(r'[0-9]+', '*', place)} ({len(group)})"
    counts = sum((Counter(one.gaps) for one in group), Counter())
    labels, stated = first.facts.get("labels"), ", ".join(dict.fromkeys(first.units.values()))
    facts = [
        _range([one.rate for one in group], "Hz"),
        _range([one.duration for one in group], "s"),
    ]
    facts += [f"{number} {name.replace('_', ' ')}" for name, number in counts.items()]
    names = {"unit": stated, "bodies": first.bodies, "markers": first.markers, "columns": labels}
    facts += [f"{name} {_text(held)}" for name, held in names.items() if held]
    for name in NOTABLE:
        value = first.facts.get(name)
        if (value or (value == 0 and name == "first_frame")) and not (name == "columns" and labels):
            if isinstance(value, dict):
                value = [f"{key} ({_text(held)})" for key, held in value.items()]
            text = repr(value) if name in ("separator", "decimal") else _text(value)
            facts.append(f"{name.replace('_', ' ')} {text}")
    lines = ["    "]
    for fact in filter(None, facts):
        if lines[-1].strip() and len(lines[-1]) + len(fact) > WIDTH:
            lines.append("    ")
        lines[-1] += f"{fact}; "
    lines[-1] = lines[-1].rstrip("; ")
    head = " ".join(filter(None, [f"{place}:", first.format, first.version]))
    return [head, *(line.rstrip() for line in lines if line.strip())]


def _text(value: object) -> str:
    if isinstance(value, dict):
        return " ".join(map(str, value.values()))
    if isinstance(value, list):
        more = len(value) > LISTED + 1
        names = ", ".join(map(str, value[:LISTED] if more else value))
        return names + f" … ({len(value)})" * more
    return f"{value:g}" if isinstance(value, float) else str(value)


def _range(values: Sequence[float | None], unit: str) -> str:
    known = [value for value in values if value is not None]
    ends = dict.fromkeys(f"{end(known):.4g}" for end in (min, max)) if known else {}
    return f"{'–'.join(ends)} {unit}" if ends else ""
