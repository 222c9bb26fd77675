"""How the errors of the matrix model fall with the number of cables.

Mean error of the matrix model of the wrench against the parametric one over fresh systems,
attachments apart, (a) in the plane and (b) in space, on logarithmic axes. Variances are those of
the diagonal Σ_S; the moment in the plane is one row. Grey: a slope of −1/2.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter

from pipeline.figures.style import BLACK, BLUE, GREY, VERMILLION, letter, panels

TABLES = {"wrench_moments": "data/studies/wrench_moments"}
DECLARATIONS = Path(__file__).parents[1] / "tables.yaml"
SIZE = 4.6, 2.6  # in
PARTS = {"forces": BLUE, "moments": VERMILLION}
ERRORS = {
    "variance": ("variances", "-", "o"),
    "covariance_full": ("covariance, full $\\Sigma_S$", "--", "s"),
    "covariance_diagonal": ("covariance, diagonal $\\Sigma_S$", ":", "^"),
}


def draw(wrench_moments: pd.DataFrame) -> Figure:
    """Table ``wrench_moments`` at the characteristic length 1: a panel a place, on one scale."""
    table = wrench_moments[wrench_moments["length"] == 1.0]
    figure, (row,) = panels(*SIZE, columns=2, sharex=True, sharey=True)
    for axes, name, place in zip(row, "ab", ("plane", "space"), strict=True):
        _lines(axes, table[table["place"] == place], place)
        letter(axes, name)
        axes.set_title(place)
        axes.set(xscale="log", yscale="log", xlabel="number of cables")
        axes.set_xticks([3, 5, 10, 20, 30], ["3", "5", "10", "20", "30"])
        axes.set_yticks([1, 2, 5, 10], ["1", "2", "5", "10"])
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_minor_formatter(NullFormatter())
    row[0].set_ylabel("mean error (%)")
    handles = [Line2D([], [], color=colour, label=part) for part, colour in PARTS.items()]
    handles.append(Line2D([], [], color=GREY, linewidth=0.8, label="slope −½"))
    handles += [
        Line2D([], [], color=BLACK, linestyle=dashes, marker=marker, markersize=3, label=label)
        for label, dashes, marker in ERRORS.values()
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=3)
    return figure


def _lines(axes: Axes, table: pd.DataFrame, place: str) -> None:
    """The errors of one place over the number of cables, each a mean over the repeats."""
    means = table.groupby(["part", "agents"])[[*ERRORS]].mean()
    for part, colour in PARTS.items():
        # the one row of a planar moment has no covariance beside its variance
        for error in ["variance"] if (place, part) == ("plane", "moments") else ERRORS:
            _, dashes, marker = ERRORS[error]
            curve = 100 * means.loc[part, error]
            axes.plot(
                curve.index, curve, color=colour, linestyle=dashes, marker=marker, markersize=3
            )
    lowest = 100 * means.loc["forces", "variance"]
    guide = 0.8 * lowest.iloc[0] * (lowest.index[0] / lowest.index) ** 0.5
    axes.plot(lowest.index, guide, color=GREY, linewidth=0.8)
