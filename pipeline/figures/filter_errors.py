"""Errors of the particle filter, and the bounds it gives for them.

One row per motion model, one column per joint. Blue: posterior mean minus motion capture of the first test take. Red: ±1σ of the
posterior of the same take. Grey: the errors of all other test takes. A bound is good when about two thirds of the errors lie inside it
and it is wide where the errors are wide, narrow where they are narrow.
"""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures.style import BLUE, LIGHT_GREY, TWO_COLUMNS, VERMILLION, model_lines, panels


def draw(filter_error: pd.DataFrame, models: list[str]) -> Figure:
    """Fig. (PartFiltRes) of table ``filter_error``; rows of panels in the order of ``models``, all panels on one scale."""
    figure, grid = panels(TWO_COLUMNS, 0.55 + 1.25 * len(models), rows=len(models), columns=3, sharex=True, sharey=True)
    shown = filter_error["take"].iloc[0]
    for row, (model, line) in zip(grid, model_lines(models).items(), strict=True):
        of_model = filter_error[filter_error["model"] == model]
        take = of_model[of_model["take"] == shown]
        others = of_model[of_model["take"] != shown]
        for j, axes in enumerate(row, start=1):
            errors = others.pivot(index="t", columns="take", values=f"e{j}")
            grey = axes.plot(errors.index, errors.to_numpy(), color=LIGHT_GREY, linewidth=0.25, rasterized=True, zorder=1)
            (error,) = axes.plot(take["t"], take[f"e{j}"], color=BLUE, linewidth=0.8)
            for sign in (1, -1):
                (bound,) = axes.plot(take["t"], sign * take[f"s{j}"], color=VERMILLION, linewidth=0.8)
        row[0].set_ylabel(f"{line['label']}\nerror (rad)")
    for j, axes in enumerate(grid[0], start=1):
        axes.set_title(f"$q_{j}$")
    for axes in grid[-1]:
        axes.set(xlabel="time (s)", xlim=(0, filter_error["t"].max()))
    labels = [f"error of {shown}", f"±1σ bound of {shown}", "errors of the other takes"]
    entries = [error, bound, *grey[:1]]
    figure.legend(entries, labels[: len(entries)], loc="outside upper center", ncols=3)
    return figure
