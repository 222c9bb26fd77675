"""Schematic of a planar cable robot.

Solid: the nominal (mean) state, cables that pull at the platform with tensions T̲ᵢ in directions
θ̲ᵢ from the x axis. Dashed: a perturbed state, 𝐓ᵢ and 𝛉ᵢ. The global frame is x–y, the platform's
local frame u–v; rᵢ points from the local origin to the attachment point of cable i. No data: it
defines the symbols of the wrench W = Σ Tᵢ·(cos θᵢ, sin θᵢ, rᵢₓ sin θᵢ − rᵢᵧ cos θᵢ).
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Polygon

from pipeline.figures.style import BLACK, BLUE, GREY, ONE_COLUMN, VERMILLION, panels

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
GLOBAL_ORIGIN = np.array([-4.3, -3.7])
ARCS = (0.65, 1.25)  # radii of the angles' arcs, nominal and perturbed


def draw() -> Figure:
    """One drawing in the paper's notation: Fig. (MotivFig)."""
    figure, ((axes,),) = panels(ONE_COLUMN, 3.0)
    turn = np.array([[np.cos(TILT), -np.sin(TILT)], [np.sin(TILT), np.cos(TILT)]])
    axes.add_patch(Polygon(CORNERS @ turn.T, facecolor="#EEEEEE", edgecolor=BLACK, linewidth=0.8))
    _frame(axes, GLOBAL_ORIGIN, np.eye(2), "xy")
    _frame(axes, np.zeros(2), turn, "uv")
    for i, (local, nominal, perturbed) in enumerate(CABLES, start=1):
        point = turn @ local
        axes.annotate(
            "",
            point,
            (0, 0),
            arrowprops={
                "arrowstyle": "-|>",
                "color": GREY,
                "linewidth": 0.8,
                "shrinkA": 0,
                "shrinkB": 0,
            },
        )
        aside = np.array([-abs(point[1]), np.sign(point[1]) * point[0]]) / np.hypot(*point)
        axes.text(*(0.36 * point + 0.28 * aside), f"$r_{i}$", ha="center", va="center")
        axes.plot(
            *np.column_stack([point, point + np.array([1.6, 0])]),
            color=GREY,
            linestyle=":",
            linewidth=0.7,
        )
        _cable(
            axes,
            point,
            nominal,
            ARCS[0],
            {"color": BLUE, "linestyle": "-"},
            rf"\underline{{{{{{}}}}}}_{i}",
        )
        _cable(
            axes,
            point,
            perturbed,
            ARCS[1],
            {"color": VERMILLION, "linestyle": "--"},
            rf"\boldsymbol{{{{{{}}}}}}_{i}",
        )
        axes.plot(*point, "o", color=BLACK, markersize=3)
    axes.set(aspect="equal", xlim=(-4.9, 4.7), ylim=(-4.1, 4.6))
    axes.set_axis_off()
    return figure


def _frame(axes: Axes, origin: np.ndarray, turn: np.ndarray, names: str) -> None:
    arrow = {"arrowstyle": "->", "color": BLACK, "linewidth": 0.8, "shrinkA": 0}
    for direction, name in zip(turn.T, names, strict=True):
        axes.annotate("", origin + 0.75 * direction, origin, arrowprops=arrow)
        axes.text(*(origin + 0.92 * direction), f"${name}$", ha="center", va="center")


def _cable(
    axes: Axes,
    point: np.ndarray,
    state: tuple[float, float],
    radius: float,
    line: dict,
    symbol: str,
) -> None:
    """Tension as an arrow from the attachment point, and its angle from the x axis as an arc;
    ``symbol`` marks both in the notation.
    """
    degrees, tension = state
    tip = point + tension * _unit(degrees)
    axes.plot(*np.column_stack([point, tip]), **line)
    head = {
        "arrowstyle": "-|>",
        "color": line["color"],
        "linewidth": 0.8,
        "shrinkA": 0,
        "shrinkB": 0,
    }
    axes.annotate("", tip + 0.12 * _unit(degrees), tip, arrowprops=head)
    axes.add_patch(
        Arc(point, 2 * radius, 2 * radius, theta2=degrees, color=line["color"], linewidth=0.7)
    )
    # the label of a long arc stays clear of the platform
    middle = point + (radius + 0.3) * _unit(min(degrees / 2, 70))
    for place, letter in ((tip + 0.45 * _unit(degrees), "T"), (middle, r"\theta")):
        axes.text(
            *place, f"${symbol.format(letter)}$", color=line["color"], ha="center", va="center"
        )


def _unit(degrees: float) -> np.ndarray:
    return np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
