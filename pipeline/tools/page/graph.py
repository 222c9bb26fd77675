"""The way of the data between the stages as a drawing in layers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from pipeline.tools.page.stages import Stage

WIDTH, HEIGHT, ACROSS, DOWN = 104, 30, 26, 34  # px: a box, and the gaps beside and below it
PASSAGE = 14  # px, what an arrow past a row takes of it


@dataclass(frozen=True)
class Box:
    """A stage's place in the drawing, px."""

    name: str
    x: float
    y: float


@dataclass(frozen=True)
class Drawing:
    """Boxes of one size, the paths (SVG) of the arrows between them, and the size of the
    whole, px.
    """

    boxes: list[Box]
    arrows: list[str]
    width: float
    height: float


def draw(stages: Sequence[Stage]) -> Drawing:
    """Every stage one row above the first of those that follow it, each row in the order of what is
    above, arrows past the boxes.
    """
    row_of = _rows(stages)
    last = max(row_of.values())
    rows: list[list[str]] = [
        [stage.name for stage in stages if row_of[stage.name] == row] for row in range(last + 1)
    ]
    above = {stage.name: [] for stage in stages}
    ways = []
    for stage in stages:
        for other in stage.after:
            # an arrow past a row takes a place in it, named by what it comes from and leads to
            way = [
                other,
                *(
                    f"{other} → {stage.name}, row {row}"
                    for row in range(row_of[other] + 1, row_of[stage.name])
                ),
                stage.name,
            ]
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
        row.sort(
            key=lambda name: sum(middle[other] for other in above[name]) / max(len(above[name]), 1)
        )
        left = (max(widths) - taken) / 2
        for name in row:
            middle[name] = left + width_of[name] / 2
            left += width_of[name] + ACROSS
    top = {name: row * (HEIGHT + DOWN) for row, names in enumerate(rows) for name in names}
    boxes = [Box(stage.name, middle[stage.name] - WIDTH / 2, top[stage.name]) for stage in stages]
    return Drawing(
        boxes,
        [_arrow(way, middle, top) for way in ways],
        max(widths),
        last * (HEIGHT + DOWN) + HEIGHT,
    )


def _rows(stages: Sequence[Stage]) -> dict[str, int]:
    """The row of every stage, counted from the top."""
    following = {
        stage.name: [other.name for other in stages if stage.name in other.after]
        for stage in stages
    }
    from_below: dict[str, int] = {}
    waiting = list(following)
    while waiting:
        ready = [name for name in waiting if all(other in from_below for other in following[name])]
        from_below |= {
            name: 1 + max((from_below[other] for other in following[name]), default=-1)
            for name in ready
        }
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
