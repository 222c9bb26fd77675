"""Wrench of cooperating robots row by row, measured and modelled.

One row per configuration of robots whose cables do not meet in one point; a panel for each force
and moment. Kernel densities of the measured wrench and of as many samples of the matrix model.
Moments are over the characteristic length. To look at: a row in which the model is narrower than
the record asks for more than the bounds of its class of systems give.
"""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures.style import BLUE, RECORDED, TWO_COLUMNS, panels
from pipeline.figures.wrench_planes import NEEDS as NEEDS
from pipeline.figures.wrench_planes import label

TABLES = {"wrench_marginals": "data/wrench"}

LINES = {
    "measured": RECORDED | {"label": "measured"},
    "modelled": {"label": "matrix model", "color": BLUE, "linestyle": "--"},
}
SHOWN = 0.005  # of the greatest density of a panel: where its axis ends


def draw(wrench_marginals: pd.DataFrame) -> Figure:
    """Table ``wrench_marginals``: rows of the wrench across, configurations below each other."""
    rows = list(wrench_marginals["row"].unique())
    by_name = list(wrench_marginals.groupby("configuration", sort=False))
    figure, grid = panels(
        TWO_COLUMNS, 0.5 + 1.15 * len(by_name), rows=len(by_name), columns=len(rows)
    )
    for line, (name, table) in zip(grid, by_name, strict=True):
        for axes, row in zip(line, rows, strict=True):
            own = table[table["row"] == row]
            shown = own[own["density"] > SHOWN * own["density"].max()]
            for source, look in LINES.items():
                curve = own[own["source"] == source]
                axes.plot(curve["value"], curve["density"], **look)
            axes.set(xlabel=label(row), ylim=(0, None), yticks=[])
            if len(shown):
                axes.set_xlim(shown["value"].min(), shown["value"].max())
            axes.locator_params(axis="x", nbins=3)
        line[0].set_title(name, loc="left", fontweight="bold")
        line[0].set_ylabel("density")
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return figure
