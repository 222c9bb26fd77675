"""``python -m pipeline inspect FILE|FOLDER [--json]``: format, rate, units and counted faults of
recordings, the options that they leave open, and what would stop their analysis.

Each file is read by the stages' own reader of its format, in a process of its own
(:mod:`pipeline.core.bounds`), which bounds the time and memory that it takes.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path

from pipeline.core.bounds import Reading, Sandbox, within
from pipeline.core.errors import PipelineError, RecordingError
from pipeline.formats.depth.index import frame_endings
from pipeline.formats.format import is_bag
from pipeline.tools.inspect.finding import UNKNOWN, Finding, shown
from pipeline.tools.inspect.joints import compare_tables
from pipeline.tools.inspect.kinds import described, numbered_sequence

NUMBERED = re.compile(r"(.*?)(\d+)(\D*)")
INDEXES = (".txt", ".csv", "")  # endings of the names of indexes of frames
MAX_FILES = 100_000  # of a folder
HEADINGS = ("recording", "format", "rate", "unit", "duration", "counts", "holds")
WIDEST = (64, 48, 12, 16, 16, 48, 5)  # characters up to which a column is padded
LISTED = 4  # names of a list
NOTABLE = """unlabelled_markers width height points organised share_without_position viewpoint
    share_not_above_zero samples rows columns columns_without_numbers steps announced_frames
    first_frame rate_from rate_by_the_printed_times times robot joints signals command motions
    topics fx separator decimal serial frames""".split()  # facts in the table
BOUNDS = "bounds of what a file may be, as in the section dataset.reading: file_mib=500"
ARGUMENTS = {
    "place": {"type": Path, "metavar": "FILE|FOLDER", "help": "file or folder to inspect"},
    "--json": {"action": "store_true", "help": "every fact, for programs"},
    "--reading": {"nargs": "+", "default": [], "metavar": "NAME=VALUE", "help": BOUNDS},
}


def run(place: Path, json: bool, reading: Sequence[str]) -> None:
    """Print the findings as a table or as JSON."""
    bounds = Reading(**dict(word.partition("=")[::2] for word in reading))
    findings = within(bounds, inspect, place)
    print(as_json(findings) if json else as_table(findings, place))


def inspect(place: Path) -> list[Finding]:
    """Return the account of ``place``, or of every file below it; frames of one depth sequence, and
    the files of one bag, are one recording.

    A file that cannot be read is a finding too, with the reason in ``stops``. Raises RecordingError
    where ``place`` does not exist, and for a folder of more than MAX_FILES files.
    """
    if not os.path.exists(place):
        raise RecordingError("there is no such file or folder", file=place)
    with Sandbox() as sandbox:

        def read(file: Path, describe: Callable[[Path], Finding] = described) -> Finding:
            try:
                return sandbox.call(describe, file)
            except PipelineError as error:
                return Finding(file).refused(error)

        if is_bag(place) or not place.is_dir():
            return [read(place)]
        files, bags, findings = _files(place)
        indexes = [read(file) for file in files if file.suffix.lower() in INDEXES]
        findings += [*map(read, bags), *indexes]
        # an index may name depth/../depth/1.png
        placed = {os.path.normpath(p) for one in indexes for p in (one.file, *one.files)}
        others = [file for file in files if os.path.normpath(file) not in placed]
        sequences: dict[Path, set[Path]] = {}  # pattern → frames that differ in their last number
        for file in others:
            if file.suffix.lower() in frame_endings() and (parts := NUMBERED.fullmatch(file.stem)):
                pattern = file.with_name(f"{parts[1]}[0-9]*{parts[3]}{file.suffix}")
                sequences.setdefault(pattern, set()).add(file)
        for pattern, frames in sequences.items():
            if len(frames) > 1:
                findings.append(read(pattern, numbered_sequence))
                others = [file for file in others if file not in frames]
        findings += map(read, others)
    compare_tables(findings)
    return sorted(findings, key=lambda finding: str(finding.file))


def _files(folder: Path) -> tuple[list[Path], list[Path], list[Finding]]:
    """Return all files below ``folder`` but hidden ones and those of bags, the bags that are
    folders, and the folders that cannot be read; no link to a folder is followed.
    """
    files, bags, unread = [], [], []

    def closed(error: OSError) -> None:
        reason = f"the folder cannot be read ({error.strerror})"
        unread.append(Finding(Path(error.filename or folder), stops=[reason]))

    for place, folders, names in os.walk(folder, onerror=closed):
        below = [Path(place, name) for name in folders if not name.startswith(".")]
        bags += filter(is_bag, below)
        folders[:] = [path.name for path in below if not is_bag(path)]
        files += [Path(place, name) for name in names if not name.startswith(".")]
        if len(files) > MAX_FILES:
            message = f"more than {MAX_FILES} files; name a folder of recordings"
            raise RecordingError(message, file=folder)
    return sorted(files), sorted(bags), unread


def as_json(findings: list[Finding]) -> str:
    """Return a list of objects, one a recording, with every fact."""
    plain = [finding.plain() for finding in findings]
    return json.dumps(plain, indent=2, ensure_ascii=False, default=str)


def as_table(findings: list[Finding], folder: Path) -> str:
    """Return a line a recording, those alike but for their number in one; below each the questions
    (?) and the stops (!).
    """
    groups: dict[object, list[Finding]] = {}
    reasons: dict[str, list[str]] = {}
    for finding in findings:
        if finding.format == UNKNOWN and not finding.stops:
            reasons.setdefault(finding.facts["reason"], []).append(_below(finding.file, folder))
        else:
            groups.setdefault(_alike(finding), []).append(finding)
    rows = [HEADINGS, *(_row(group, folder) for group in groups.values())]
    columns = zip(*rows, WIDEST, strict=True)
    widths = [min(max(map(len, cells)), widest) for *cells, widest in columns]
    rows.insert(1, tuple("-" * width for width in widths))
    # a name that is longer than its column pushes the others, rather than being cut
    lines = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
    printed = lines[:2]
    for line, (first, *_) in zip(lines[2:], groups.values(), strict=True):
        printed += [line, *(f"    ? {question}: {option}" for question, option in first.open)]
        printed += [f"    ! {reason}" for reason in first.stops]
    printed += [f"not recognised, {reason}: {_listed(names)}" for reason, names in reasons.items()]
    # names come from the files: no control character reaches the terminal
    return "\n".join("".join(_printable(letter) for letter in line) for line in printed)


def _printable(letter: str) -> str:
    return letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}"


def _alike(finding: Finding) -> object:
    """Key that recordings share which differ in a number alone; a recording that stops has its own
    line.
    """
    if finding.stops:
        return str(finding.file)
    held = (finding.units, finding.markers, finding.bodies, finding.suggested)
    questions = [option for _, option in finding.open]
    name = re.sub(r"\d+", "*", str(finding.file))
    return name, finding.format, finding.version, str(held), str(questions)


def _row(group: list[Finding], folder: Path) -> tuple[str, ...]:
    first, place = group[0], _below(group[0].file, folder)
    counts: dict[str, int] = {}
    for name, number in (pair for one in group for pair in one.gaps.items()):
        counts[name] = counts.get(name, 0) + number
    names = {"bodies": first.bodies, "markers": first.markers, "columns": first.facts.get("labels")}
    parts = [f"{name} {_listed(held)}" for name, held in names.items() if held]
    for name in NOTABLE:
        value = first.facts.get(name)
        kept = value or (value == 0 and name == "first_frame")
        if kept and not (name == "columns" and names["columns"]):
            if isinstance(value, dict):
                value = [f"{key} ({_short(held)})" for key, held in value.items()]
            text = repr(value) if name in ("separator", "decimal") else _short(value)
            parts.append(f"{name.replace('_', ' ')} {text}")
    return (
        place if len(group) == 1 else f"{re.sub(r'[0-9]+', '*', place)} ({len(group)})",
        " ".join(filter(None, [first.format, first.version])),
        _range([finding.rate for finding in group], "Hz"),
        ", ".join(dict.fromkeys(first.units.values())),
        _range([finding.duration for finding in group], "s"),
        ", ".join(f"{number} {name.replace('_', ' ')}" for name, number in counts.items()),
        "; ".join(parts),
    )


def _short(value: object) -> str:
    if isinstance(value, dict):
        return " ".join(map(str, value.values()))
    if isinstance(value, list):
        return _listed(list(map(str, value)))
    return f"{value:g}" if isinstance(value, float) else str(value)


def _range(values: list[float | None], unit: str) -> str:
    known = [value for value in values if value is not None]
    ends = dict.fromkeys(f"{end(known):.4g}" for end in (min, max)) if known else {}
    return f"{'–'.join(ends)} {unit}" if ends else ""


def _listed(names: list[str]) -> str:
    more = f" … ({len(names)})" if len(names) > LISTED + 1 else ""
    return f"{', '.join(names[:LISTED] if more else names)}{more}"


def _below(file: Path, folder: Path) -> str:
    return shown(file.relative_to(folder) if folder in file.parents else file)
