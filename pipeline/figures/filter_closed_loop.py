"""Errors of the particle filter in a closed loop, beside the training mean and an open loop.

One row per motion model, one column per joint; root mean square error over the test takes at every
time. Grey: the mean of the training takes at that time. Blue: the model as the paper has it, in an
open loop. Green: its closed-loop form, which corrects a share of the deviation from the mean path.
Black, in every row the same: the linear filter of the training takes' covariance and
autocorrelation. To look at: whether a filter's error is below the grey line.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.core.columns import column, columns
from pipeline.core.filters import MEMORY, NONE, closed
from pipeline.figures import style

TABLES = {"filter_error": "data/score"}
NEEDS = "depth camera"


def draw(filter_error: pd.DataFrame, models: list[str], joints: list[str]) -> Figure:
    """Rows of panels in the order of ``models``, the panels of a joint on one scale."""
    figure, grid = style.model_panels(models, joints, "rms error (rad)")
    squares = filter_error[columns("e", joints)] ** 2
    running = np.sqrt(squares.groupby([filter_error["model"], filter_error["t"]]).mean())
    for row, model in zip(grid, models, strict=True):
        shown = {
            "training mean": (NONE, {"color": style.GREY, "lw": 1.6}),
            "open loop": (model, {"color": style.BLUE, "lw": 0.8}),
            "closed loop": (closed(model), {"color": style.GREEN, "lw": 0.8, "ls": "--"}),
            "linear, autocorrelation": (MEMORY, {"color": style.BLACK, "lw": 0.8}),
        }
        for joint, axes in zip(joints, row, strict=True):
            for label, (name, look) in shown.items():
                if name in running.index:
                    axes.plot(running.loc[name, column("e", joint)], label=label, **look)
    grid[0, 0].set(xlim=(0, filter_error["t"].max()), ylim=(0, None))
    style.legend(figure)
    return figure
