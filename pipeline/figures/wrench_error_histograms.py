"""Error of the matrix model of the wrench, by number of cables.

Histograms over random test systems of the distance between the output variances of the matrix model
and of the parametric model, relative to the latter; one colour per number of cables m, dark
for few and light for many, with the mean and the greatest error. To look at: where the histograms
move as cables are added.
"""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures import style

TABLES = {"wrench_errors": "data/wrench"}
BINS = 60


def draw(wrench_errors: pd.DataFrame) -> Figure:
    """Fig. (ErrWrnRMT): one histogram per number of cables, all on the same bins."""
    percent = 100 * wrench_errors["error"]
    edges = np.linspace(0, percent.max(), BINS + 1)
    groups = percent.groupby(wrench_errors["agents"])
    colors = mpl.colormaps["viridis"](np.linspace(0, 0.9, len(groups)))
    figure, ((axes,),) = style.panels(style.ONE_COLUMN, 2.5)
    for color, (agents, errors) in zip(colors, groups, strict=True):
        look = {"histtype": "stepfilled", "facecolor": (*color[:3], 0.15), "edgecolor": color}
        label = f"$m$ = {agents}: mean {errors.mean():.1f}, greatest {errors.max():.1f} %"
        axes.hist(errors, edges, **look, linewidth=0.9, label=label)
    axes.set(xlabel="relative error of the variances (%)", ylabel="number of systems")
    axes.set_xlim(0, edges[-1])
    axes.legend(loc="upper right")
    return figure
