"""The stages of dvc.yaml, what each reads and writes, and the way of the data between them as a drawing in layers."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from itertools import pairwise

WIDTH, HEIGHT, ACROSS, DOWN = 104, 30, 26, 34  # px: a box, and the gaps beside and below it
PASSAGE = 14  # px, what an arrow past a row takes of it


@dataclass(frozen=True)
class Stage:
    """A stage with the comment beside its name, and the paths it reads and writes, * for the item of a matrix.

    ``after`` names the stages it follows directly.
    """

    name: str
    what: str
    reads: list[str]
    writes: list[str]
    after: list[str]


@dataclass(frozen=True)
class Box:
    """A stage's place in the drawing, px."""

    name: str
    x: float
    y: float


@dataclass(frozen=True)
class Drawing:
    """Boxes of one size, the paths (SVG) of the arrows between them, and the size of the whole, px."""

    boxes: list[Box]
    arrows: list[str]
    width: float
    height: float


def read_stages(text: str, definitions: Mapping[str, Mapping], dataset: str) -> list[Stage]:
    """Stages in the order of a dvc.yaml, of which ``text`` has the comments and ``definitions`` the entries of ``stages``."""
    comments = dict(re.findall(r"^  (\w+): *# *(.+)$", text, re.MULTILINE))
    params = {name: stage.get("params", []) for name, stage in definitions.items()}
    # a key that stands alone is one of params.yaml
    chosen = {name: ["params.yaml"] for name, keys in params.items() if any(isinstance(key, str) for key in keys)}
    reads = {name: _paths([*chosen.get(name, []), *stage.get("deps", [])], dataset) for name, stage in definitions.items()}
    writes = {name: _paths([*stage.get("outs", []), *stage.get("metrics", [])], dataset) for name, stage in definitions.items()}
    configured = {name for name, stage in definitions.items() if reads_configuration(stage)}
    before = {}
    for name in definitions:
        before[name] = {
            other
            for other in definitions
            if other != name and any(_touch(read, written) for read in reads[name] for written in writes[other])
        }
        # parameters are read from a file that a stage writes
        before[name] |= {other for other in definitions if name in configured and other != name and "data/config.yaml" in writes[other]}
    return [Stage(name, comments.get(name, ""), reads[name], writes[name], _direct(name, before)) for name in definitions]


def reads_configuration(stage: Mapping) -> bool:
    """Whether the entry ``stage`` of a dvc.yaml names sections of the composed configuration."""
    return any(isinstance(keys, Mapping) for keys in stage.get("params", []))


def _paths(entries: Sequence, dataset: str) -> list[str]:
    names = [next(iter(entry)) if isinstance(entry, Mapping) else entry for entry in entries]
    return [re.sub(r"\$\{item\.\w+\}", "*", name.replace("${dataset}", dataset)) for name in names]


def _touch(read: str, written: str) -> bool:
    """Whether one path is the other or a folder it lies in."""
    parts = [path.split("/") for path in (read, written)]
    return all(fnmatch(a, b) or fnmatch(b, a) for a, b in zip(*parts, strict=False))


def _direct(name: str, before: Mapping[str, set[str]]) -> list[str]:
    """Of the stages before ``name`` those that no other of them follows."""
    earlier = set().union(*(_all_before(other, before) for other in before[name])) if before[name] else set()
    return [other for other in before if other in before[name] - earlier]


def _all_before(name: str, before: Mapping[str, set[str]]) -> set[str]:
    found, waiting = set(), [name]
    while waiting:
        new = before[waiting.pop()] - found
        found |= new
        waiting += new
    return found


def draw(stages: Sequence[Stage]) -> Drawing:
    """Every stage one row above the first of those that follow it, each row in the order of what is above, arrows past the boxes."""
    row_of = _rows(stages)
    last = max(row_of.values())
    rows: list[list[str]] = [[stage.name for stage in stages if row_of[stage.name] == row] for row in range(last + 1)]
    above = {stage.name: [] for stage in stages}
    ways = []
    for stage in stages:
        for other in stage.after:
            # an arrow past a row takes a place in it, named by what it comes from and leads to
            way = [other, *(f"{other} → {stage.name}, row {row}" for row in range(row_of[other] + 1, row_of[stage.name])), stage.name]
            for row, name in enumerate(way[1:-1], start=row_of[other] + 1):
                rows[row].append(name)
            for before, name in pairwise(way):
                above.setdefault(name, []).append(before)
            ways.append(way)
    width_of = {name: WIDTH if name in row_of else PASSAGE for row in rows for name in row}
    widths = [sum(width_of[name] + ACROSS for name in row) - ACROSS for row in rows]
    middle: dict[str, float] = {}
    for row, taken in zip(rows, widths, strict=True):
        # sorted is stable: where nothing is above, the order of the file stays
        row.sort(key=lambda name: sum(middle[other] for other in above[name]) / max(len(above[name]), 1))
        left = (max(widths) - taken) / 2
        for name in row:
            middle[name] = left + width_of[name] / 2
            left += width_of[name] + ACROSS
    top = {name: row * (HEIGHT + DOWN) for row, names in enumerate(rows) for name in names}
    boxes = [Box(stage.name, middle[stage.name] - WIDTH / 2, top[stage.name]) for stage in stages]
    return Drawing(boxes, [_arrow(way, middle, top) for way in ways], max(widths), last * (HEIGHT + DOWN) + HEIGHT)


def _rows(stages: Sequence[Stage]) -> dict[str, int]:
    """The row of every stage, counted from the top."""
    following = {stage.name: [other.name for other in stages if stage.name in other.after] for stage in stages}
    from_below: dict[str, int] = {}
    waiting = list(following)
    while waiting:
        ready = [name for name in waiting if all(other in from_below for other in following[name])]
        from_below |= {name: 1 + max((from_below[other] for other in following[name]), default=-1) for name in ready}
        waiting = [name for name in waiting if name not in from_below]
    return {name: max(from_below.values()) - row for name, row in from_below.items()}


def _arrow(way: Sequence[str], middle: Mapping[str, float], top: Mapping[str, float]) -> str:
    """Down from box to box, straight through the rows between."""
    path = f"M{middle[way[0]]:g} {top[way[0]] + HEIGHT:g}"
    for before, name in pairwise(way):
        start, end = top[before] + HEIGHT, top[name] - (4 if name == way[-1] else 0)
        bend = (start + end) / 2
        path += f"C{middle[before]:g} {bend:g} {middle[name]:g} {bend:g} {middle[name]:g} {end:g}"
        if name != way[-1]:
            path += f"V{top[name] + HEIGHT:g}"
    return path
