"""Force of cooperating robots, measured and modelled.

One row per configuration. Left: the robots about the platform with the mean tension T̲ and
direction θ̲ of each cable; blue arrows are the tensions, the black one their sum, all to one scale;
the distance of the robots is not. Middle: kernel density of the measured force. Right: kernel
density of as many samples of the matrix model. All densities are on one colour scale, dark where
the force is often; the cross marks the nominal force. To look at: whether the model has the width
and the direction of the measured spread.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.figures.style import BLACK, BLUE, GREY, SKY, TWO_COLUMNS, panels

TABLES = {"force_density": "data/wrench"}
NEEDS = "force record of cables in a plane that meet in one point"

SOURCES = ("measured", "modelled")
ROBOTS = 1.45  # distance of the robots' circles from the platform, in greatest tensions


class Configuration(Protocol):
    """Drawn parts of a configuration: mean direction (rad) and mean tension (N) of every
    cable.
    """

    direction: list[float]
    tension: list[float]


def draw(force_density: pd.DataFrame, configurations: Mapping[str, Configuration]) -> Figure:
    """Fig. (WrenchExprmnt) of table ``force_density`` and the ``configurations`` of the dataset by
    name.

    One range and one colour scale for all densities.
    """
    figure, grid = panels(
        TWO_COLUMNS,
        0.4 + 1.75 * len(configurations),
        rows=len(configurations),
        columns=3,
        width_ratios=(1.3, 1, 1),
    )
    tension = max(max(configuration.tension) for configuration in configurations.values())
    greatest = force_density["density"].max()
    limits = [(force_density[c].min(), force_density[c].max()) for c in ("fx", "fy")]
    for row, (name, configuration) in zip(grid, configurations.items(), strict=True):
        pulls = np.multiply(
            configuration.tension,
            [np.cos(configuration.direction), np.sin(configuration.direction)],
        )
        _robots(row[0], configuration, pulls, ROBOTS * tension)
        row[0].set_title(name, loc="left", fontweight="bold")
        for axes, source in zip(row[1:], SOURCES, strict=True):
            rows = force_density[
                (force_density["configuration"] == name) & (force_density["source"] == source)
            ]
            density = rows.pivot(index="fy", columns="fx", values="density")
            cells = (density.columns, density.index, density.to_numpy())
            image = axes.pcolormesh(*cells, cmap="CMRmap_r", vmin=0, vmax=greatest, rasterized=True)
            axes.plot(*pulls.sum(axis=1), "+", color=SKY, markersize=6, markeredgewidth=1.0)
            axes.set(xlim=limits[0], ylim=limits[1], aspect="equal", anchor="N", ylabel="$F_y$ (N)")
    for axes in grid[-1, 1:]:
        axes.set_xlabel("$F_x$ (N)")
    for axes, title in zip(grid[0], ("robots", "measured force", "matrix model"), strict=True):
        axes.set_title(title)
    figure.colorbar(image, ax=grid[:, 1:], label="density (N$^{-2}$)", shrink=0.5, aspect=30)
    return figure


def _robots(axes: Axes, configuration: Configuration, pulls: np.ndarray, distance: float) -> None:
    """Cables from the platform to the robots, and the forces (2, m) in N they pull with."""
    for i, (direction, tension, pull) in enumerate(
        zip(configuration.direction, configuration.tension, pulls.T, strict=True), start=1
    ):
        robot = distance * np.array([np.cos(direction), np.sin(direction)])
        axes.plot(*np.column_stack([(0, 0), robot]), color=GREY, linewidth=0.8, zorder=1)
        axes.plot(*robot, "o", color=GREY, markersize=13, markerfacecolor="white", zorder=2)
        axes.text(*robot, str(i), ha="center", va="center")
        label = (
            rf"$\underline{{T}}_{i}$ = {tension:.2f} N"
            + "\n"
            + rf"$\underline{{\theta}}_{i}$ = {direction:.2f} rad"
        )
        side, alignment = (1, "left") if robot[0] >= 0 else (-1, "right")
        axes.annotate(
            label,
            robot,
            xytext=(10 * side, 0),
            textcoords="offset points",
            ha=alignment,
            va="center",
            fontsize=7,
        )
        _arrow(axes, pull, BLUE)
    _arrow(axes, pulls.sum(axis=1), BLACK)
    axes.set(
        aspect="equal",
        xlim=(-2 * distance, 2 * distance),
        ylim=(-1.2 * distance, 1.2 * distance),
        anchor="N",
    )
    axes.set_axis_off()


def _arrow(axes: Axes, force: np.ndarray, color: str) -> None:
    axes.annotate(
        "",
        force,
        (0, 0),
        arrowprops={
            "arrowstyle": "-|>",
            "color": color,
            "linewidth": 1.2,
            "shrinkA": 0,
            "shrinkB": 0,
        },
    )
