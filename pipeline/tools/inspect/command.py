"""``python -m pipeline inspect FILE|FOLDER [--json]``: format, rate, units and counted faults of
recordings, the options that they leave open, and what would stop their analysis.
"""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path

from pipeline.core.bounds import Reading, within
from pipeline.tools.inspect.examine import inspect
from pipeline.tools.inspect.finding import UNKNOWN, Finding, shown

HEADINGS = ("recording", "format", "rate", "unit", "duration", "counts", "holds")
WIDEST = (64, 48, 12, 16, 16, 48, 5)  # characters up to which a column is padded
SHOWN = 4  # names of a list
NOTABLE = """unlabelled_markers width height points organised share_without_position viewpoint
    share_not_above_zero samples rows columns columns_without_numbers steps announced_frames
    first_frame rate_from rate_by_the_printed_times times robot joints signals command motions
    topics fx separator decimal serial frames""".split()  # facts in the table


def run(words: list[str]) -> None:
    """Print the findings as a table or as JSON."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline inspect", description=__doc__.partition(": ")[2]
    )
    parser.add_argument("place", type=Path, metavar="FILE|FOLDER", help="file or folder to inspect")
    parser.add_argument("--json", action="store_true", help="every fact, for programs")
    parser.add_argument(
        "--reading",
        nargs="+",
        default=[],
        metavar="NAME=VALUE",
        help="bounds of what a file may be, as in the section dataset.reading: file_mib=500",
    )
    arguments = parser.parse_args(words)
    reading = Reading(**dict(word.partition("=")[::2] for word in arguments.reading))
    findings = within(reading, inspect, arguments.place)
    print(as_json(findings) if arguments.json else as_table(findings, arguments.place))


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
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
    printed = lines[:2]
    for line, (first, *_) in zip(lines[2:], groups.values(), strict=True):
        printed += [line, *(f"    ? {question}: {option}" for question, option in first.open)]
        printed += [f"    ! {reason}" for reason in first.stops]
    printed += [f"not recognised, {reason}: {_listed(names)}" for reason, names in reasons.items()]
    # names come from the files: what a terminal would act on is not printed
    return "\n".join(
        "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in line)
        for line in printed
    )


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
    counts = {
        name: sum(one.gaps.get(name, 0) for one in group) for each in group for name in each.gaps
    }
    return (
        place if len(group) == 1 else f"{re.sub(r'[0-9]+', '*', place)} ({len(group)})",
        " ".join(filter(None, [first.format, first.version])),
        _range([finding.rate for finding in group], "Hz"),
        ", ".join(dict.fromkeys(first.units.values())),
        _range([finding.duration for finding in group], "s"),
        ", ".join(f"{number} {name.replace('_', ' ')}" for name, number in counts.items()),
        _held(first),
    )


def _held(finding: Finding) -> str:
    names = {"bodies": finding.bodies, "markers": finding.markers}
    names["columns"] = finding.facts.get("labels")
    parts = [f"{name} {_listed(held)}" for name, held in names.items() if held]
    for name in NOTABLE:
        value = finding.facts.get(name)
        if value in (None, "") or (value == 0 and name != "first_frame"):
            continue
        if name == "columns" and names["columns"]:
            continue
        if isinstance(value, dict):
            value = _listed([f"{key} ({_short(held)})" for key, held in value.items()])
        text = repr(value) if name in ("separator", "decimal") else _short(value)
        parts.append(f"{name.replace('_', ' ')} {text}")
    return "; ".join(parts)


def _short(value: object) -> str:
    if isinstance(value, dict):
        return " ".join(map(str, value.values()))
    if isinstance(value, list):
        return _listed(list(map(str, value)))
    return f"{value:g}" if isinstance(value, float) else str(value)


def _range(values: list[float | None], unit: str) -> str:
    known = [value for value in values if value is not None]
    if not known:
        return ""
    low, high = f"{min(known):.4g}", f"{max(known):.4g}"
    return f"{low} {unit}" if low == high else f"{low}–{high} {unit}"


def _listed(names: list[str]) -> str:
    more = f" … ({len(names)})" if len(names) > SHOWN + 1 else ""
    return f"{', '.join(names[:SHOWN] if more else names)}{more}"


def _below(file: Path, folder: Path) -> str:
    return shown(file.relative_to(folder) if folder in file.parents else file)
