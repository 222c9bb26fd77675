"""Findings as a table and as JSON."""

from __future__ import annotations

import json
import re
from pathlib import Path

from pipeline.tools.inspect.finding import UNKNOWN, Finding, shown

HEADINGS = ("recording", "format", "rate", "unit", "duration", "lost", "holds")
WIDEST = (64, 48, 12, 16, 16, 48, 5)  # characters up to which a column is padded
SHOWN = 4  # names of a list
NOTABLE = (
    "unlabelled_markers",
    "width",
    "height",
    "points",
    "organised",
    "share_without_position",
    "viewpoint",
    "surplus_bytes",
    "share_not_above_zero",
    "samples",
    "rows",
    "columns",
    "columns_without_numbers",
    "steps",
    "announced_frames",
    "first_frame",
    "stray_ids",
    "skipped_bones",
    "skipped_model_outputs",
    "skipped_labels",
    "skipped_analog_channels",
    "skipped_force_plates",
    "rate_from",
    "rate_by_the_printed_times",
    "times",
    "robot",
    "joints",
    "signals",
    "command",
    "motions",
    "topics",
    "fx",
    "separator",
    "decimal",
    "serial",
)


def as_json(findings: list[Finding]) -> str:
    """A list of objects, one a recording, with every fact."""
    return json.dumps(
        [finding.plain() for finding in findings], indent=2, ensure_ascii=False, default=str
    )


def as_table(findings: list[Finding], folder: Path) -> str:
    """A line a recording, those alike but for their number in one; below each what an option must
    settle (?) and what stops (!).
    """
    known, others = [], []
    for finding in findings:
        (known if finding.format != UNKNOWN or finding.stops else others).append(finding)
    groups: dict[object, list[Finding]] = {}
    for finding in known:
        groups.setdefault(_alike(finding), []).append(finding)
    rows = [(_row(group, folder), group[0]) for group in groups.values()]
    widths = [
        min(max([len(heading), *(len(row[i]) for row, _ in rows)]), WIDEST[i])
        for i, heading in enumerate(HEADINGS)
    ]
    lines = [_line(HEADINGS, widths), _line(tuple("-" * width for width in widths), widths)]
    for row, first in rows:
        lines += [_line(row, widths), *(f"    {remark}" for remark in _remarks(first))]
    reasons: dict[str, list[str]] = {}
    for finding in others:
        reasons.setdefault(finding.facts["reason"], []).append(_below(finding.file, folder))
    lines += [f"not recognised, {reason}: {_listed(names)}" for reason, names in reasons.items()]
    # names come from the files: what a terminal would act on is not printed
    return "\n".join(
        "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in line)
        for line in lines
    )


def _alike(finding: Finding) -> object:
    """What recordings share that differ in their numbers alone; what stops stands alone."""
    if finding.stops:
        return str(finding.file)
    name = re.sub(r"\d+", "*", str(finding.file))
    questions = tuple(option for _, option in finding.open)
    return (
        name,
        finding.format,
        finding.version,
        tuple(finding.units.items()),
        tuple(finding.markers),
        tuple(finding.bodies),
        questions,
        str(finding.facts.get("settings")),
    )


def _row(group: list[Finding], folder: Path) -> tuple[str, ...]:
    first = group[0]
    return (
        _name(group, folder),
        " ".join(filter(None, [first.format, first.version])),
        _range([finding.rate for finding in group], "Hz"),
        ", ".join(dict.fromkeys(first.units.values())),
        _range([finding.duration for finding in group], "s"),
        _lost(group),
        _held(first),
    )


def _name(group: list[Finding], folder: Path) -> str:
    place = _below(group[0].file, folder)
    return place if len(group) == 1 else f"{re.sub(r'[0-9]+', '*', place)} ({len(group)})"


def _held(finding: Finding) -> str:
    parts = []
    if finding.bodies:
        parts.append(f"bodies {_listed(finding.bodies)}")
    if finding.markers:
        parts.append(f"markers {_listed(finding.markers)}")
    if "labels" in finding.facts:
        parts.append(f"columns {_listed(finding.facts['labels'])}")
    for name in NOTABLE:
        value = finding.facts.get(name)
        if value in (None, "") or (value == 0 and name != "first_frame"):
            continue
        if name == "columns" and "labels" in finding.facts:
            continue
        if isinstance(value, dict):
            value = _listed([f"{key} ({_short(held)})" for key, held in value.items()])
        parts.append(
            f"{name.replace('_', ' ')} "
            f"{repr(value) if name in ('separator', 'decimal') else _short(value)}"
        )
    if "frames" in finding.facts:
        parts.append(f"{finding.facts['frames']} frames")
    return "; ".join(parts)


def _short(value: object) -> str:
    if isinstance(value, dict):
        return " ".join(map(str, value.values()))
    if isinstance(value, list):
        return _listed(list(map(str, value)))
    return f"{value:g}" if isinstance(value, float) else str(value)


def _lost(group: list[Finding]) -> str:
    """What is missing over the group."""
    names = dict.fromkeys(name for finding in group for name in finding.gaps)
    return ", ".join(
        f"{sum(finding.gaps.get(name, 0) for finding in group)} {name.replace('_', ' ')}"
        for name in names
    )


def _remarks(finding: Finding) -> list[str]:
    return [f"? {question}: {option}" for question, option in finding.open] + [
        f"! {reason}" for reason in finding.stops
    ]


def _range(values: list[float | None], unit: str) -> str:
    known = [value for value in values if value is not None]
    if not known:
        return ""
    low, high = f"{min(known):.4g}", f"{max(known):.4g}"
    return f"{low} {unit}" if low == high else f"{low}–{high} {unit}"


def _listed(names: list[str]) -> str:
    return (
        ", ".join(names)
        if len(names) <= SHOWN + 1
        else f"{', '.join(names[:SHOWN])} … ({len(names)})"
    )


def _below(file: Path, folder: Path) -> str:
    return shown(file.relative_to(folder) if folder in file.parents else file)


def _line(cells: tuple[str, ...], widths: list[int]) -> str:
    # a name that is longer than its column pushes the others, rather than being cut
    return "  ".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True)).rstrip()
