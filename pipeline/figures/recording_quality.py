"""Quality of every take.

A strip is a measure, a mark in it a take, training takes before test takes. Dashed line: the limit,
where the dataset states one; takes beyond any limit are left out of all that follows, and marked by
a cross in every strip and by name above the first. Grey bars on the clock's drift are twice its
standard error; a grey line parts training from test takes.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.figures import style

TABLES = {"takes": "data/track"}

# measure of the table: what stands beside its strip, and how many of that unit are one of the
# table's
STRIPS = {
    "missing_share": ("missing\nsamples (%)", 100),
    "longest_gap": ("longest gap\n(frames)", 1),
    "interpolated": ("interpolated\nframes", 1),
    "relabelled_share": ("relabelled\nsamples (%)", 100),
    "residual_rms": ("rigid-body\nresidual (mm)", 1000),
    "dropped_share": ("dropped depth\nframes (%)", 100),
    "clock_offset": ("clock offset\n(ms)", 1000),
    "clock_offset_standard_error": ("its standard\nerror (ms)", 1000),
    "clock_drift": ("clock drift\n(ms/s)", 1000),
    "lag_behind_command": ("lag behind\ncommand (ms)", 1000),
    "greatest_residual": ("greatest\nresidual (mrad)", 1000),
    "residual_beside_others": ("residual beside\nothers (mrad)", 1000),
    "disturbance": ("disturbance\n(robust std)", 1),
}
SIGNED = ("clock_drift", "lag_behind_command")  # with a limit on either side
KEPT = {"marker": ".", "ms": 3, "color": style.BLUE, "ls": "none", "label": "take"}
LEFT_OUT = {"marker": "x", "ms": 4, "color": style.VERMILLION, "ls": "none", "label": "left out"}


def draw(takes: pd.DataFrame) -> Figure:
    """Table ``takes``, of whichever measures the dataset has."""
    known = takes.drop_duplicates("take").reset_index(drop=True)
    place = pd.Series(np.arange(1, len(known) + 1), known["take"])
    by_measure = dict(list(takes.groupby("measure")))
    shown = [measure for measure in STRIPS if measure in by_measure]
    height = 0.62 * len(shown) + 0.9
    figure, grid = style.panels(style.TWO_COLUMNS, height, rows=len(shown), sharex=True)
    for axes, measure in zip(grid[:, 0], shown, strict=True):
        (label, unit), rows = STRIPS[measure], by_measure[measure].set_index("take")
        for mark, of in ((KEPT, rows[~rows["left_out"]]), (LEFT_OUT, rows[rows["left_out"]])):
            if len(of):
                axes.plot(place[of.index], unit * of["value"], **mark, zorder=3)
        if measure == "clock_drift":
            errors = by_measure["clock_drift_standard_error"].set_index("take")["value"]
            bars = {"fmt": "none", "ecolor": style.GREY, "elinewidth": 0.5}
            bars["label"] = "± 2 standard errors"
            error = 2 * unit * errors[rows.index]
            axes.errorbar(place[rows.index], unit * rows["value"], yerr=error, **bars)
        _limit(axes, unit * rows["limit"].iloc[0], measure in SIGNED, unit * rows["value"].min())
        for boundary in np.flatnonzero(known["part"] != known["part"].shift())[1:] + 0.5:
            axes.axvline(boundary, color=style.LIGHT_GREY, linewidth=0.8, zorder=0)
        axes.set_ylabel(label, rotation=0, ha="right", va="center", fontsize=7)
        axes.locator_params(axis="y", nbins=3)
    figure.align_ylabels(grid[:, 0])
    groups = place.groupby(known["part"].to_numpy(), sort=False).agg(["min", "max"])
    parts = (f"{part} {low} to {high}" for part, (low, high) in groups.iterrows())
    grid[-1, 0].set(xlabel="take: " + ", ".join(parts), xlim=(0, len(known) + 1))
    for take in known.loc[known["left_out"], "take"]:
        above = {"xycoords": ("data", "axes fraction"), "rotation": 30, "fontsize": 7}
        grid[0, 0].annotate(take, (place[take], 1.1), **above, color=style.VERMILLION)
    style.legend(figure)
    return figure


def _limit(axes: Axes, limit: float, signed: bool, low: float) -> None:
    """Draw the limit, on either side of a measure with a sign; other measures start at zero."""
    for side in () if np.isnan(limit) else (-1, 1) if signed else (1,):
        dashed = {"color": style.BLACK, "lw": 0.8, "ls": (0, (4, 3)), "label": "limit"}
        axes.axhline(side * limit, **dashed, zorder=1)
    axes.margins(y=0.12)
    if low >= 0:
        # marks at either end stay whole
        top = axes.get_ylim()[1]
        axes.set_ylim(-0.08 * top, 1.08 * top)
