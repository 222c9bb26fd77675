"""Errors of the particle filter, and the bounds it gives for them.

One row per motion model, two where there are many joints; one panel per joint. Blue: posterior mean
minus motion capture of the first test take. Red: ±1σ of the posterior of the same take. Grey: the
errors of all other test takes. Black: ± the root mean square error without any filter, of the
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
from pipeline.figures.style import (
    BLACK,
    BLUE,
    LIGHT_GREY,
    TWO_COLUMNS,
    VERMILLION,
    beside,
    joint_lines,
    joint_panels,
    model_lines,
)

TABLES = {"filter_error": "data/score"}
NEEDS = "depth camera"


def draw(filter_error: pd.DataFrame, models: list[str], joints: list[str]) -> Figure:
    """Fig. (PartFiltRes) of table ``filter_error``; rows of panels in the order of ``models``, all
    panels on one scale.
    """
    across = beside(len(joints))
    size = TWO_COLUMNS, 1.25, 0.55
    figure, grid = joint_panels(len(joints), across, size, groups=len(models), sharey=True)
    shown = filter_error["take"].iloc[0]
    unfiltered = filter_error[filter_error["model"] == NONE].groupby("t")
    for row, (model, line) in zip(grid, model_lines(models).items(), strict=True):
        rows = filter_error[filter_error["model"] == model]
        take, others = rows[rows["take"] == shown], rows[rows["take"] != shown]
        for joint, axes in zip(joints, row, strict=True):
            errors = others.pivot(index="t", columns="take", values=column("e", joint))
            grey = axes.plot(
                errors.index,
                errors.to_numpy(),
                color=LIGHT_GREY,
                linewidth=0.25,
                rasterized=True,
                zorder=1,
            )
            (error,) = axes.plot(take["t"], take[column("e", joint)], color=BLUE, linewidth=0.8)
            for sign in (1, -1):
                (bound,) = axes.plot(
                    take["t"], sign * take[column("s", joint)], color=VERMILLION, linewidth=0.8
                )
            rms = np.sqrt(unfiltered[column("e", joint)].agg(lambda errors: np.mean(errors**2)))
            for sign in (1, -1):
                (none,) = axes.plot(rms.index, sign * rms, color=BLACK, linewidth=0.5)
        for first in row[::across]:
            first.set_ylabel(f"{line['label']}\nerror (rad)")
    # where a model has a second line, the joints of the first are not those of the one above
    for row in grid if across < len(joints) else grid[:1]:
        for line, axes in zip(joint_lines(joints).values(), row, strict=True):
            axes.set_title(line["label"])
    grid[0, 0].set_xlim(0, filter_error["t"].max())
    labels = [f"error of {shown}", f"±1σ bound of {shown}", "rms error without a filter"]
    labels.append("errors of the other takes")
    entries = [error, bound, none, *grey[:1]]
    figure.legend(entries, labels[: len(entries)], loc="outside upper center", ncols=4)
    return figure
