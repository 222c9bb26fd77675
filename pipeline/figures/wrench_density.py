"""Force of cooperating robots, measured and modelled.

One row per configuration. Left: the robots about the platform with the mean tension T̲ and
direction θ̲ of each cable; blue arrows are the tensions, the black one their sum, all to one scale;
the distance of the robots is not. Middle: kernel density of the measured force. Right: kernel
density of as many samples of the matrix model. All densities are on one colour scale, dark where
the force is often; the light blue cross marks the nominal force. To look at: whether the model has
the width and the direction of the measured spread.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.figures import style

TABLES = {"force_density": "data/wrench"}
NEEDS = "force record of cables in a plane that meet in one point"
ROBOTS = 1.45  # distance of the robots' circles from the platform, in greatest tensions


class DrawnConfiguration(Protocol):
    """Mean direction (rad) and mean tension (N) of every cable."""

    direction: list[float]
    tension: list[float]


def draw(force_density: pd.DataFrame, configurations: Mapping[str, DrawnConfiguration]) -> Figure:
    """Fig. (WrenchExprmnt): one range and one colour scale for all ``configurations`` by name."""
    height, count = 0.4 + 1.75 * len(configurations), len(configurations)
    layout = {"rows": count, "columns": 3, "width_ratios": (1.3, 1, 1)}
    figure, grid = style.panels(style.TWO_COLUMNS, height, **layout)
    tension = max(max(each.tension) for each in configurations.values())
    limits = [(force_density[c].min(), force_density[c].max()) for c in ("fx", "fy")]
    shades = {"cmap": "CMRmap_r", "vmin": 0, "vmax": force_density["density"].max()}
    for row, (name, each) in zip(grid, configurations.items(), strict=True):
        pulls = np.multiply(each.tension, [np.cos(each.direction), np.sin(each.direction)])
        _robots(row[0], each, pulls, ROBOTS * tension)
        row[0].set_title(name, loc="left", fontweight="bold")
        own = force_density[force_density["configuration"] == name]
        for axes, source in zip(row[1:], ("measured", "modelled"), strict=True):
            rows = own[own["source"] == source]
            density = rows.pivot(index="fy", columns="fx", values="density")
            cells = (density.columns, density.index, density.to_numpy())
            image = axes.pcolormesh(*cells, **shades, rasterized=True)
            cross = {"color": style.SKY, "markersize": 6, "markeredgewidth": 1.0}
            axes.plot(*pulls.sum(axis=1), "+", **cross)
            axes.set(xlim=limits[0], ylim=limits[1], aspect="equal", anchor="N", ylabel="$F_y$ (N)")
    for axes in grid[-1, 1:]:
        axes.set_xlabel("$F_x$ (N)")
    for axes, title in zip(grid[0], ("robots", "measured force", "matrix model"), strict=True):
        axes.set_title(title)
    figure.colorbar(image, ax=grid[:, 1:], label="density (N$^{-2}$)", shrink=0.5, aspect=30)
    return figure


def _robots(axes: Axes, configuration: DrawnConfiguration, pulls: np.ndarray, far: float) -> None:
    """Draw cables from the platform to the robots, and the forces (2, m) in N they pull with."""
    cables = zip(configuration.direction, configuration.tension, pulls.T, strict=True)
    for i, (direction, tension, pull) in enumerate(cables, start=1):
        robot = far * np.array([np.cos(direction), np.sin(direction)])
        axes.plot(*np.column_stack([(0, 0), robot]), color=style.GREY, linewidth=0.8, zorder=1)
        circle = {"color": style.GREY, "markersize": 13, "markerfacecolor": "white", "zorder": 2}
        axes.plot(*robot, "o", **circle)
        axes.text(*robot, str(i), ha="center", va="center")
        label = rf"$\underline{{T}}_{i}$ = {tension:.2f} N" + "\n"
        label += rf"$\underline{{\theta}}_{i}$ = {direction:.2f} rad"
        side, alignment = (1, "left") if robot[0] >= 0 else (-1, "right")
        place = {"xytext": (10 * side, 0), "textcoords": "offset points", "ha": alignment}
        axes.annotate(label, robot, **place, va="center", fontsize=7)
        style.arrow(axes, (0, 0), pull, style.BLUE, linewidth=1.2)
    style.arrow(axes, (0, 0), pulls.sum(axis=1), style.BLACK, linewidth=1.2)
    axes.set(xlim=(-2 * far, 2 * far), ylim=(-1.2 * far, 1.2 * far), aspect="equal", anchor="N")
    axes.set_axis_off()
