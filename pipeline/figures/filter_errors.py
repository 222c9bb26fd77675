"""Errors of the particle filter, and the bounds it gives for them.

One row per motion model, two where there are many joints; one panel per joint. Blue: posterior mean
minus motion capture of the first test take. Orange: ±1σ of the posterior of the same take. Grey:
the errors of all other test takes. Black: ± the root mean square error without any filter, of the
training takes' mean. A bound is good when about two thirds of the errors lie inside it and it is
wide where the errors are wide, narrow where they are narrow; a filter is worth its while where its
errors lie within the black lines.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.core.columns import column
from pipeline.core.filters import NONE
from pipeline.figures import style

TABLES = {"filter_error": "data/score"}
NEEDS = "depth camera"


def draw(filter_error: pd.DataFrame, models: list[str], joints: list[str]) -> Figure:
    """Fig. (PartFiltRes): rows of panels in the order of ``models``, all panels on one scale."""
    figure, grid = style.model_panels(models, joints, "error (rad)")
    shown = filter_error["take"].iloc[0]
    unfiltered = filter_error[filter_error["model"] == NONE].groupby("t")
    thin = {"color": style.LIGHT_GREY, "linewidth": 0.25, "rasterized": True, "zorder": 1}
    for row, model in zip(grid, models, strict=True):
        rows = filter_error[filter_error["model"] == model]
        take, others = rows[rows["take"] == shown].set_index("t"), rows[rows["take"] != shown]
        for joint, axes in zip(joints, row, strict=True):
            errors = others.pivot(index="t", columns="take", values=column("e", joint))
            grey = axes.plot(errors.index, errors.to_numpy(), **thin)
            (error,) = axes.plot(take[column("e", joint)], color=style.BLUE, linewidth=0.8)
            rms = np.sqrt(unfiltered[column("e", joint)].agg(lambda errors: np.mean(errors**2)))
            for sign in (1, -1):
                std = sign * take[column("s", joint)]
                (bound,) = axes.plot(std, color=style.VERMILLION, linewidth=0.8)
                (none,) = axes.plot(sign * rms, color=style.BLACK, linewidth=0.5)
    grid[0, 0].set_xlim(0, filter_error["t"].max())
    labels = [f"error of {shown}", f"±1σ bound of {shown}", "rms error without a filter"]
    labels.append("errors of the other takes")
    entries = [error, bound, none, *grey[:1]]
    figure.legend(entries, labels[: len(entries)], loc="outside upper center", ncols=4)
    return figure
