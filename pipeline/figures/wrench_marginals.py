"""Wrench of cooperating robots row by row, measured and modelled.

One row per configuration of robots whose cables do not meet in one point; a panel for each force
and moment. Kernel densities of the measured wrench (solid orange) and of as many samples of the
matrix model (dashed blue). Moments are over the characteristic length. To look at: a row in which
the model is narrower than the record asks for more than the bounds of its class of systems give.
"""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures import style

TABLES = {"wrench_marginals": "data/wrench"}

NEEDS = "six-axis record of cables that do not meet in one point"
LINES = {
    "measured": style.RECORDED | {"label": "measured"},
    "modelled": {"label": "matrix model", "color": style.BLUE, "linestyle": "--"},
}
SHOWN = 0.005  # of the greatest density of a panel: where its axis ends


def draw(wrench_marginals: pd.DataFrame) -> Figure:
    """Table ``wrench_marginals``: rows of the wrench across, configurations below each other."""
    rows = list(wrench_marginals["row"].unique())
    by_name = list(wrench_marginals.groupby("configuration", sort=False))
    layout = {"rows": len(by_name), "columns": len(rows)}
    figure, grid = style.panels(style.TWO_COLUMNS, 0.5 + 1.15 * len(by_name), **layout)
    for line, (name, table) in zip(grid, by_name, strict=True):
        for axes, row in zip(line, rows, strict=True):
            own = table[table["row"] == row]
            shown = own[own["density"] > SHOWN * own["density"].max()]
            for source, look in LINES.items():
                curve = own[own["source"] == source]
                axes.plot(curve["value"], curve["density"], **look)
            axes.set(xlabel=style.wrench_label(row), ylim=(0, None), yticks=[])
            if len(shown):
                axes.set_xlim(shown["value"].min(), shown["value"].max())
            axes.locator_params(axis="x", nbins=3)
        line[0].set_title(name, loc="left", fontweight="bold")
        line[0].set_ylabel("density (1/N)")
    style.legend(figure, ncols=2)
    return figure
