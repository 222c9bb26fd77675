"""Errors of the particle filter, and the bounds it gives for them.

One row per motion model, two where there are many joints; one panel per joint. Blue: posterior mean
minus motion capture of the first test take. Orange: ±1σ of the posterior of the same take. Grey:
the errors of all other test takes. Black: ± the root mean square error of the training takes' mean.
A bound is good when about two thirds of the errors lie inside it and it is wide where the errors
are wide, narrow where they are narrow; a filter is worth its while where its errors lie within the
black lines.
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
    mean = filter_error[filter_error["model"] == NONE].groupby("t")
    thin = {"color": style.LIGHT_GREY, "linewidth": 0.25, "rasterized": True, "zorder": 1}
    labels = (f"error of {shown}", f"±1σ bound of {shown}", "rms error of the training mean")
    looks = ((style.BLUE, 0.8), (style.VERMILLION, 0.8), (style.BLACK, 0.5))
    looks = [
        {"color": color, "lw": width, "label": label}
        for label, (color, width) in zip(labels, looks, strict=True)
    ]
    for row, model in zip(grid, models, strict=True):
        rows = filter_error[filter_error["model"] == model]
        take, others = rows[rows["take"] == shown].set_index("t"), rows[rows["take"] != shown]
        for joint, axes in zip(joints, row, strict=True):
            error, std = column("e", joint), take[column("s", joint)]
            rms = np.sqrt(mean[error].agg(lambda errors: np.mean(errors**2)))
            axes.plot(take[error], **looks[0])
            for sign in (1, -1):
                axes.plot(sign * std, **looks[1])
                axes.plot(sign * rms, **looks[2])
            errors = others.pivot(index="t", columns="take", values=error)
            grey = axes.plot(errors.index, errors.to_numpy(), **thin)
            if grey:
                grey[0].set_label("errors of the other takes")
    grid[0, 0].set_xlim(0, filter_error["t"].max())
    style.legend(figure)
    return figure
