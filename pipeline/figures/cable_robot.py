"""Schematic of a planar cable robot.

Solid, blue: the nominal (mean) state, cables that pull at the platform with tensions T̲ᵢ in
directions θ̲ᵢ from the x axis. Dashed, orange: a perturbed state, 𝐓ᵢ and 𝛉ᵢ. The global frame is
x–y, the platform's local frame u–v; rᵢ, grey, points from the local origin to the attachment point
of cable i. No data: it defines the symbols of the wrench
W = Σ Tᵢ·(cos θᵢ, sin θᵢ, rᵢₓ sin θᵢ − rᵢᵧ cos θᵢ).
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Polygon

from pipeline.figures import style

TABLES = {}
# lengths without a scale: chosen so that no label meets a line
CORNERS = np.array([[2.0, 1.1], [-2.0, 1.1], [-2.0, -1.1], [2.0, -1.1]])
TILT = np.radians(10)
CABLES = (
    # attachment in the local frame; direction (degrees) and length of the tension's arrow, nominal
    # and perturbed
    (CORNERS[0], (38, 2.4), (56, 3.0)),
    (CORNERS[1], (142, 2.7), (124, 2.3)),
    (CORNERS[3], (292, 2.3), (274, 2.8)),
)
STATES = (  # symbol, radius of the angle's arc, line
    (r"\underline{{{}}}_{}", 0.65, {"color": style.BLUE, "linestyle": "-"}),
    (r"\boldsymbol{{{}}}_{}", 1.25, {"color": style.VERMILLION, "linestyle": "--"}),
)
CENTRED = {"ha": "center", "va": "center"}


def draw() -> Figure:
    """One drawing in the paper's notation: Fig. (MotivFig)."""
    figure, ((axes,),) = style.panels(style.ONE_COLUMN, 3.0)
    turn = np.array([[np.cos(TILT), -np.sin(TILT)], [np.sin(TILT), np.cos(TILT)]])
    outline = {"facecolor": "#EEEEEE", "edgecolor": style.BLACK, "linewidth": 0.8}
    axes.add_patch(Polygon(CORNERS @ turn.T, **outline))
    for origin, frame, names in (([-4.3, -3.7], np.eye(2), "xy"), ([0.0, 0.0], turn, "uv")):
        for direction, name in zip(frame.T, names, strict=True):
            style.arrow(axes, origin, origin + 0.75 * direction, style.BLACK, arrowstyle="->")
            axes.text(*(origin + 0.92 * direction), f"${name}$", **CENTRED)
    for i, (local, *states) in enumerate(CABLES, start=1):
        point = turn @ local
        style.arrow(axes, (0, 0), point, style.GREY)
        aside = np.array([-abs(point[1]), np.sign(point[1]) * point[0]]) / np.hypot(*point)
        axes.text(*(0.36 * point + 0.28 * aside), f"$r_{i}$", **CENTRED)
        level = np.column_stack([point, point + np.array([1.6, 0])])
        axes.plot(*level, color=style.GREY, linestyle=":", linewidth=0.7)
        for state, (symbol, radius, line) in zip(states, STATES, strict=True):
            _cable(axes, point, *state, radius, line, symbol, i)
        axes.plot(*point, "o", color=style.BLACK, markersize=3)
    axes.set(aspect="equal", xlim=(-4.9, 4.7), ylim=(-4.1, 4.6))
    axes.set_axis_off()
    return figure


def _cable(
    axes: Axes, point: np.ndarray, degrees, tension, radius, line: dict, symbol: str, number: int
) -> None:
    """Tension as an arrow from the attachment point, and its angle from the x axis as an arc."""
    along, color = _unit(degrees), line["color"]
    tip = point + tension * along
    axes.plot(*np.column_stack([point, tip]), **line)
    style.arrow(axes, tip, tip + 0.12 * along, color)
    size = {"width": 2 * radius, "height": 2 * radius, "theta2": degrees}
    axes.add_patch(Arc(point, **size, color=color, linewidth=0.7))
    # the label of a long arc stays clear of the platform
    middle = point + (radius + 0.3) * _unit(min(degrees / 2, 70))
    for place, name in ((tip + 0.45 * along, "T"), (middle, r"\theta")):
        axes.text(*place, f"${symbol.format(name, number)}$", color=color, **CENTRED)


def _unit(degrees: float) -> np.ndarray:
    return np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
