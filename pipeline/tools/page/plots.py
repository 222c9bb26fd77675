"""Plots of the player as SVG: axes, bands and lines in panels one below or beside the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

TICKS, APART = 5, 30  # at most on an axis, and px between two
DASHES = {"-": "none", ":": "2 3", "--": "7 4", "-.": "8 3 2 3"}


@dataclass(frozen=True)
class Axis:
    """Values from ``low`` to ``high`` over ``length`` px; reversed where ``low`` is at the end."""

    low: float
    high: float
    length: float
    reversed: bool = False

    def place(self, values: np.ndarray | float) -> np.ndarray | float:
        """px of ``values`` from the axis' start."""
        share = (values - self.low) / (self.high - self.low)
        return self.length * (1 - share if self.reversed else share)

    @property
    def ticks(self) -> list[tuple[float, str]]:
        """Place in px and text of round values, few enough to be read."""
        most = min(TICKS, int(self.length // APART) + 1)
        power = 10.0 ** np.floor(np.log10((self.high - self.low) / most))
        for step in (power, 2 * power, 5 * power, 10 * power, 20 * power):
            first, last = np.ceil(self.low / step - 1e-9), np.floor(self.high / step + 1e-9)
            if last - first < most:
                break
        values = step * np.arange(int(first), int(last) + 1)
        return [(round(float(self.place(v)), 1), f"{v:.6g}".replace("-", "−")) for v in values]


@dataclass(frozen=True)
class Shape:
    """A path with its style."""

    path: str
    style: str


@dataclass(frozen=True)
class Panel:
    """A part of a plot with axes of its own; ``left`` and ``top`` in px of the plot. Letters stand
    at the axis x where ``titled``.
    """

    x: Axis
    y: Axis
    left: float
    top: float
    label: str
    shapes: Sequence[Shape] = field(default_factory=list)
    x_label: str = ""


@dataclass(frozen=True)
class Plot:
    """Panels in a drawing of ``width`` × ``height`` px."""

    width: float
    height: float
    panels: Sequence[Panel]


def line(panel_x: Axis, panel_y: Axis, x: np.ndarray, y: np.ndarray, style: str) -> Shape:
    """A line through the points (``x``, ``y``)."""
    return Shape(_path(panel_x.place(x), panel_y.place(y)), f"fill:none;{style}")


def band(
    panel_x: Axis, panel_y: Axis, x: np.ndarray, low: np.ndarray, high: np.ndarray, colour: str
) -> Shape:
    """The area between ``low`` and ``high``.

    Args:
        panel_x: axis of x.
        panel_y: axis of y.
        x: (K,) values along x.
        low: (K,) lower bound.
        high: (K,) upper bound.
        colour: of the area.
    """
    around = np.concatenate([x, x[::-1]])
    edge = np.concatenate([low, high[::-1]])
    return Shape(_path(panel_x.place(around), panel_y.place(edge)) + "z", f"fill:{colour}")


def dots(panel_x: Axis, panel_y: Axis, x: np.ndarray, y: np.ndarray, colour: str) -> Shape:
    """A dot at each point."""
    places = np.round(np.column_stack([panel_x.place(x), panel_y.place(y)]), 1)
    path = "".join(f"M{u:g} {v:g}h0" for u, v in places)
    return Shape(path, f"fill:none;stroke:{colour};stroke-width:4;stroke-linecap:round")


def stroke(colour: str, linestyle: object = "-", width: float = 1.5) -> str:
    """The style of a line of Matplotlib's ``linestyle``, a sign or an offset with lengths."""
    if isinstance(linestyle, str):
        dashes = DASHES[linestyle]
    else:
        dashes = " ".join(f"{width * length:g}" for length in linestyle[1])
    return f"stroke:{colour};stroke-width:{width:g};stroke-dasharray:{dashes}"


def _path(x: np.ndarray, y: np.ndarray) -> str:
    """Straight from point to point, in tenths of a px relative to the one before: few letters."""
    tenths = np.round(10 * np.column_stack([x, y])).astype(int)
    steps = np.diff(tenths, axis=0) / 10
    start = "M{:g} {:g}".format(*(tenths[0] / 10))
    return start + "l" + " ".join(f"{dx:g} {dy:g}" for dx, dy in steps)
