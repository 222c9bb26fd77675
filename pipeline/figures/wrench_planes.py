"""Wrench of cooperating robots plane by plane, measured and modelled.

One row per configuration of robots whose cables do not meet in one point; a panel for each plane of
two forces and of two moments. Shades: kernel density of the measured wrench. Lines: kernel density
of as many samples of the matrix model. Both are over the greatest measured density in the plane,
the lines at the shades' edges. Moments are over the characteristic length. To look at: whether
lines lie where shades end.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.figures.style import TWO_COLUMNS, VERMILLION, panels

TABLES = {"wrench_planes": "data/wrench"}
NEEDS = "six-axis record of cables that do not meet in one point"

LEVELS = (0.05, 0.2, 0.4, 0.6, 0.8)  # of the greatest measured density in a plane


def draw(wrench_planes: pd.DataFrame) -> Figure:
    """Table ``wrench_planes``: planes across, in their order, and configurations below each
    other.
    """
    planes = list(dict.fromkeys(zip(wrench_planes["row_x"], wrench_planes["row_y"], strict=True)))
    configurations = list(wrench_planes["configuration"].unique())
    figure, grid = panels(
        TWO_COLUMNS,
        0.3 + 1.3 * len(configurations),
        rows=len(configurations),
        columns=len(planes),
    )
    for row, name in zip(grid, configurations, strict=True):
        for axes, (row_x, row_y) in zip(row, planes, strict=True):
            _plane(
                axes,
                wrench_planes[
                    (wrench_planes["configuration"] == name)
                    & (wrench_planes["row_x"] == row_x)
                    & (wrench_planes["row_y"] == row_y)
                ],
            )
            axes.set(xlabel=label(row_x), ylabel=label(row_y))
        row[0].set_title(name, loc="left", fontweight="bold")
    return figure


def label(row: str) -> str:
    """Label of a row of the wrench at an axis."""
    return f"$F_{row[1]}$ (N)" if row[0] == "f" else rf"$M_{row[1]}/\ell$ (N)"


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
    lines = axes.contour(*cells, modelled.to_numpy(), levels, colors=VERMILLION, linewidths=0.7)
    for drawn in (shades, lines):
        drawn.set_rasterized(True)
    # as far as either density is
    either = np.maximum(measured.to_numpy(), modelled.to_numpy()) > 0.01 * greatest
    for across, values, limits in ((0, cells[0], axes.set_xlim), (1, cells[1], axes.set_ylim)):
        there = np.asarray(values)[either.any(axis=across)]
        limits(there[0], there[-1])
    axes.locator_params(nbins=3)
