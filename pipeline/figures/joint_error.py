"""Figures of the joint error law of the model card, on held-out motions."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullLocator, ScalarFormatter

from pipeline.figures import style

BANDS = {"0.1 s": style.COLORS[0], "0.5 s": style.COLORS[1]}  # horizon → colour
SECONDS = {"one sample": "one sample", "0.1 s": "0.1", "0.5 s": "0.5"}
# models whose error is drawn beside the law's
YARDSTICKS = {
    "joint_constant": {"label": "constant about the command", "linestyle": ":"},
    "last_value": {"label": "last value", "linestyle": "-."},
    "joint_autoregression": {"label": "autoregression", "linestyle": (0, (5, 1))},
}
# looks of the law's errors and of their predicted size
ERRORS = {"color": "k", "marker": "o", "ms": 3, "label": "errors of the law"}
PREDICTED = {"linestyle": "--", "color": BANDS["0.1 s"], "label": "predicted"}


def held_out_error(held_out_run: pd.DataFrame) -> Figure:
    """Draw a panel for each joint: its error over time, and the bands ±1σ of the predictions."""
    joints = list(held_out_run["joint"].unique())
    across = style.panels_across(len(joints))
    size = style.TWO_COLUMNS, 1.5, 0.6
    figure, (row,) = style.joint_panels(len(joints), across, size)
    for joint, axes in zip(joints, row, strict=True):
        rows = held_out_run[held_out_run["joint"] == joint]
        _draw_bands(axes, rows)
        axes.set_title(style.joint_label(joint))
    for axes in row[::across]:
        axes.set_ylabel("error (mrad)")
    style.legend(figure)
    return figure


def _draw_bands(axes: Axes, rows: pd.DataFrame) -> None:
    """Draw the bands of the predictions of one joint, the longest horizon first, and its error."""
    for horizon, color in reversed(BANDS.items()):
        band = rows[rows["horizon"] == horizon]
        low = band["mean"] - band["std"]
        high = band["mean"] + band["std"]
        look = {"color": color, "alpha": 0.4, "lw": 0}
        look["label"] = f"±1σ, {horizon} ahead"
        axes.fill_between(band["t"], 1e3 * low, 1e3 * high, **look)
    first = rows[rows["horizon"] == next(iter(BANDS))]
    axes.plot(first["t"], 1e3 * first["error"], "k", linewidth=0.5, label="recorded")


def sigma_over_horizon(
    joint_scores: pd.DataFrame,
    held_out_run: pd.DataFrame,
) -> Figure:
    """Draw a panel for each joint: standard deviation predicted by the law of the card, and that of
    its errors and of the yardsticks' errors.
    """
    law = held_out_run["model"].iloc[0]
    moving = joint_scores[joint_scores["samples"] == "commanded"]
    joints = list(moving["joint"].unique())
    across = style.panels_across(len(joints))
    lines = -(-len(joints) // across)
    figure, grid = style.panels(
        style.TWO_COLUMNS,
        0.6 + 1.6 * lines,
        lines,
        across,
        sharex=True,
    )
    for joint, axes in zip(joints, grid.flat, strict=False):
        rows = moving[moving["joint"] == joint]
        for model, look in YARDSTICKS.items():
            measured = rms_by_horizon(rows[rows["model"] == model], "measured_rad")
            axes.plot(measured.index, 1e3 * measured, color=style.LIGHT_GREY, **look)
        of_law = rows[rows["model"] == law]
        measured = rms_by_horizon(of_law, "measured_rad")
        predicted = rms_by_horizon(of_law, "predicted_rad")
        axes.plot(measured.index, 1e3 * measured, **ERRORS)
        axes.plot(predicted.index, 1e3 * predicted, **PREDICTED)
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(MaxNLocator(5))  # plain numbers within a decade
        axes.yaxis.set_major_formatter(ScalarFormatter())
        axes.yaxis.set_minor_locator(NullLocator())
        horizons = [SECONDS[name] for name in measured.index]
        axes.set_xticks(range(len(measured)), horizons)
        axes.set_title(style.joint_label(joint))
    for empty in grid.flat[len(joints) :]:
        empty.remove()
    for first in grid[:, 0]:
        first.set_ylabel("standard deviation (mrad)")
    for lowest in grid.flat[max(len(joints) - across, 0) : len(joints)]:
        lowest.tick_params(labelbottom=True)
        lowest.set_xlabel("time ahead (s)")
    style.legend(figure, ncols=5)
    return figure


def rms_by_horizon(rows: pd.DataFrame, column: str) -> pd.Series:
    """Return the rms of ``column`` by horizon, weighted by the number of errors."""
    squares = (rows[column] ** 2 * rows["count"]).groupby(rows["horizon"], sort=False)
    return np.sqrt(squares.sum() / rows.groupby("horizon", sort=False)["count"].sum())
