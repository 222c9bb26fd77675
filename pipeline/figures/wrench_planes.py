"""Wrench of cooperating robots plane by plane, measured and modelled.

One row per configuration of robots whose cables do not meet in one point; a panel for each plane of
two forces and of two moments. Grey shades: kernel density of the measured wrench. Orange lines:
kernel density of as many samples of the matrix model. Both are over the greatest measured density
in the plane, the lines at the shades' edges. Moments are over the characteristic length. To look
at: whether lines lie where shades end.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from pipeline.figures import style

TABLES = {"wrench_planes": "data/wrench"}
NEEDS = "six-axis record of cables that do not meet in one point"

LEVELS = (0.05, 0.2, 0.4, 0.6, 0.8)  # of the greatest measured density in a plane


def draw(wrench_planes: pd.DataFrame) -> Figure:
    """Table ``wrench_planes``: planes across, configurations below each other."""
    planes = list(dict.fromkeys(zip(wrench_planes["row_x"], wrench_planes["row_y"], strict=True)))
    by_name = list(wrench_planes.groupby("configuration", sort=False))
    layout = {"rows": len(by_name), "columns": len(planes)}
    figure, grid = style.panels(style.TWO_COLUMNS, 0.6 + 1.3 * len(by_name), **layout)
    for row, (name, table) in zip(grid, by_name, strict=True):
        for axes, (x, y) in zip(row, planes, strict=True):
            _plane(axes, table[(table["row_x"] == x) & (table["row_y"] == y)])
            axes.set(xlabel=style.wrench_label(x), ylabel=style.wrench_label(y))
        row[0].set_title(name, loc="left", fontweight="bold")
    lines = Line2D([], [], color=style.VERMILLION, lw=0.7, label="matrix model")
    entries = [Patch(color=style.GREY, label="measured"), lines]
    figure.legend(handles=entries, loc="outside upper center", ncols=2)
    return figure


def _plane(axes: Axes, table: pd.DataFrame) -> None:
    measured, modelled = (
        table[table["source"] == source].pivot(index="y", columns="x", values="density")
        for source in ("measured", "modelled")
    )
    if measured.empty:  # a planar configuration beside others
        axes.set_axis_off()
        return
    greatest = measured.to_numpy().max()
    levels = greatest * np.array(LEVELS)
    cells = (measured.columns, measured.index)
    shades = axes.contourf(*cells, measured.to_numpy(), [*levels, greatest], cmap="Greys", vmin=0)
    lines = axes.contour(
        *cells, modelled.to_numpy(), levels, colors=style.VERMILLION, linewidths=0.7
    )
    for drawn in (shades, lines):
        drawn.set_rasterized(True)
    # as far as either density is
    either = np.maximum(measured.to_numpy(), modelled.to_numpy()) > 0.01 * greatest
    for across, values, limits in ((0, cells[0], axes.set_xlim), (1, cells[1], axes.set_ylim)):
        there = np.asarray(values)[either.any(axis=across)]
        limits(there[0], there[-1])
    axes.locator_params(nbins=3)
