"""Errors of the particle filter in a closed loop, beside no filter and an open loop.

One row per motion model, one column per joint; root mean square error over the test takes at every
time. Grey: no filter at all, the training takes' mean at that time. Blue: the model as the paper
has it, in an open loop. Green: its closed-loop form, which corrects a share of what the arm is off
its path. Black, in every row the same: the linear filter of the training takes' own spread and
memory. To look at: a filter below the grey line earns its place.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.core.columns import columns as family_columns
from pipeline.core.filters import MEMORY, NONE, closed
from pipeline.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    TWO_COLUMNS,
    beside,
    joint_lines,
    joint_panels,
    model_lines,
)

TABLES = {"filter_error": "data/score"}
NEEDS = "depth camera"


def draw(filter_error: pd.DataFrame, models: list[str], joints: list[str]) -> Figure:
    """Rows of panels in the order of ``models``, the panels of a joint on one scale; a model
    without a closed loop lacks its line.
    """
    across = beside(len(joints))
    size = TWO_COLUMNS, 1.25, 0.55
    figure, grid = joint_panels(len(joints), across, size, groups=len(models), sharey=True)
    columns = family_columns("e", joints)
    squares = filter_error[columns] ** 2
    mean = squares.groupby([filter_error["model"], filter_error["t"]]).mean()
    running = np.sqrt(mean)
    for row, (model, line) in zip(grid, model_lines(models).items(), strict=True):
        shown = {
            "no filter": (NONE, {"color": GREY, "linewidth": 1.6}),
            "open loop": (model, {"color": BLUE, "linewidth": 0.8}),
            "closed loop": (closed(model), {"color": GREEN, "linewidth": 0.8, "linestyle": "--"}),
            "linear, takes' memory": (MEMORY, {"color": BLACK, "linewidth": 0.8}),
        }
        for column, axes in zip(columns, row, strict=True):
            for label, (name, look) in shown.items():
                if name in running.index:
                    rms = running.loc[name, column]
                    axes.plot(rms.index, rms, label=label, **look)
        for first in row[::across]:
            first.set_ylabel(f"{line['label']}\nrms error (rad)")
    # where a model has a second line, the joints of the first are not those of the one above
    for row in grid if across < len(joints) else grid[:1]:
        for line, axes in zip(joint_lines(joints).values(), row, strict=True):
            axes.set_title(line["label"])
    grid[0, 0].set_xlim(0, filter_error["t"].max())
    grid[0, 0].set_ylim(bottom=0)
    handles = {}
    for axes in grid.flat:
        handles |= dict(zip(*axes.get_legend_handles_labels()[::-1], strict=True))
    figure.legend(handles.values(), handles.keys(), loc="outside upper center", ncols=4)
    return figure
