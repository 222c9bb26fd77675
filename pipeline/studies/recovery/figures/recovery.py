"""Dispersions that the estimators of the Wishart model recover.

Estimated over true σ_B: mean over the data sets (mark) and all of them (line), for each true σ_B.
The grey line at 1 is the true value.
"""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures.style import BLUE, GREY, ONE_COLUMN, ORANGE, VERMILLION, panels
from pipeline.studies.recovery.stage import LABELS

LOOKS = dict(zip(LABELS, ((BLUE, "o"), (VERMILLION, "s"), (ORANGE, "D")), strict=True))
OFFSET = 0.2  # of the estimators beside each other, as a share of the distance of two σ_B


def draw(recovery: pd.DataFrame) -> Figure:
    """Table ``recovery``."""
    recovery = recovery[recovery["parameter"] == "sigma_b"]
    figure, ((axes,),) = panels(ONE_COLUMN, 2.7)
    places = {truth: place for place, truth in enumerate(dict.fromkeys(recovery["truth"]))}
    for shift, (estimator, (colour, marker)) in zip((-1, 0, 1), LOOKS.items(), strict=True):
        rows = recovery[recovery["estimator"] == estimator].dropna(subset="mean")
        x = rows["truth"].map(places) + shift * OFFSET
        ends = (rows[name] / rows["truth"] for name in ("least", "greatest"))
        axes.vlines(x, *ends, color=colour, linewidth=1.2)
        look = {"color": colour, "marker": marker, "label": LABELS[estimator]}
        axes.plot(x, rows["mean"] / rows["truth"], linestyle="", markersize=4, **look)
    axes.axhline(1, color=GREY, linewidth=0.8, zorder=0, label="true value")
    axes.set_xticks(list(places.values()), [f"{truth:g}" for truth in places])
    axes.set(xlabel=r"true $\sigma_B$", ylabel=r"estimated over true $\sigma_B$")
    axes.set_ylim(bottom=0)
    figure.legend(loc="outside lower center", ncols=2)
    return figure
