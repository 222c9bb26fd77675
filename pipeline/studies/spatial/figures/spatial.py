"""What the characteristic length does to the noise of a spatial arm.

Spread of the joints on one motion, as a share of the step that the task asks for, over the length
that makes the task's radians and metres one unit; each panel an arm. A reading of the models that
is free of units is a flat line. Band: LU without pivoting in those orders of the task's rows that
meet no small pivot on the motion. The Gaussian model is scaled to QR of Jᵀ at 1 m, its bound in
proportion to the norm of J⁺.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from pipeline.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    LIGHT_GREY,
    TWO_COLUMNS,
    VERMILLION,
    letter,
    panels,
)

TABLES = {"spatial": "data/studies/spatial"}
DECLARATIONS = Path(__file__).parents[1] / "tables.yaml"

LINES = {
    "pivoted_lu": {"label": "LU, pivoted", "color": BLUE, "linestyle": "--"},
    "qr": {"label": "QR of $J$", "color": GREEN, "linestyle": (0, (6, 1.5, 1, 1.5))},
    "gaussian": {"label": "Gaussian", "color": BLACK, "linestyle": "-."},
    "qr_transposed": {
        "label": r"QR of $J^{\mathsf{T}}$",
        "color": VERMILLION,
        "linestyle": "-",
        "linewidth": 2.2,
    },
}


def draw(spatial: pd.DataFrame) -> Figure:
    """Table ``spatial``: a panel an arm, on one scale."""
    arms = list(spatial.groupby("arm", sort=False))
    figure, (row,) = panels(TWO_COLUMNS, 2.7, columns=len(arms), sharex=True, sharey=True)
    for axes, name, (arm, table) in zip(row, "abcdefgh", arms, strict=False):
        lu = table[table["reading"] == "lu"]
        axes.fill_between(
            lu["length"],
            lu["least"],
            lu["greatest"],
            color=LIGHT_GREY,
            linewidth=0,
            label="LU, not pivoted",
        )
        for reading, line in LINES.items():
            rows = table[table["reading"] == reading]
            axes.plot(rows["length"], rows["spread"], **line)
        small, count = lu["small_pivot"].iloc[0], lu["orders"].iloc[0]
        letter(axes, name)
        axes.set_title(f"{arm}: LU fails in {small} of {count} orders")
        axes.set(xscale="log", yscale="log", xlabel="characteristic length (m)")
        axes.set_xlim(table["length"].min(), table["length"].max())
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axis.set_minor_formatter(FuncFormatter(lambda value, _: ""))
    row[0].set_ylabel("noise over step")
    row[0].set_ylim(0.9 * np.nanmin(spatial[["spread", "least"]]), None)
    figure.legend(*row[0].get_legend_handles_labels(), loc="outside upper center", ncols=5)
    return figure
