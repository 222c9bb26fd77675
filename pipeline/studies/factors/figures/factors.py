"""Which readings of "LU or QR" the paper's numbers allow.

The published parameters of both matrix models on random paths of the paper's arm, driven as fast as
the published numbers need to go together. A line is a reading: for LU the order in which the task
rows are eliminated stands at the left, and the six lines of a group are the orders of the joints,
1-2-3 on top with a filled mark, then 1-3-2, 2-1-3, 2-3-1, 3-1-2 and 3-2-1. (a) Spread of the
Wishart model over that of the Gaussian one, averaged over the joints: median and middle 90 % of the
paths, and the extremes as a thin line; an arrow where it goes on. Shaded: what the paper says, that
the two differ little; darker: and the Wishart model is the wider one. (b) Share of the paths on
which its statements hold together: all but "wider" (light) and all (dark). Grey: readings for which
they hold on no path.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from pipeline.figures.style import (
    BLACK,
    BLUE,
    GREY,
    LIGHT_GREY,
    SKY,
    TWO_COLUMNS,
    VERMILLION,
    letter,
    panels,
)
from pipeline.studies.factors.shares import ALL, SPEEDS

TABLES = {"factors": "data/studies/factors"}
DECLARATIONS = Path(__file__).parents[1] / "tables.yaml"

NAMES = {"pivoted_lu": "LU, pivoted", "qr": "QR of $J$", "qr_transposed": r"QR of $J^{\mathsf{T}}$"}
SPACING, GAP = 0.085, 0.15  # in, between the lines of a group and between groups
RANGE = (0.15, 60)  # of the ratios that are shown
PALE = "#E3EEF6"


def draw(factors: pd.DataFrame, alike: float) -> Figure:
    """Table ``factors``: all paths at the matched speed, at the first share of rest; ``alike`` is
    the factor within which spreads pass for alike.
    """
    rows = factors[(factors["subset"] == ALL) & (factors["speed"] == SPEEDS[1])]
    rows = rows[rows["rest"] == rows["rest"].iloc[0]]
    groups = list(rows.groupby(["factorisation", "rows"], sort=False))
    places, end = [], 0.0
    for _, group in groups:
        places.append(end + GAP + SPACING * np.arange(len(group)))
        end = places[-1][-1]
    figure, ((ratio, share),) = panels(
        TWO_COLUMNS, end + GAP + 0.95, columns=2, sharey=True, width_ratios=(1.7, 1)
    )
    ratio.axvspan(1 / alike, 1, color=PALE, linewidth=0)
    ratio.axvspan(1, alike, color=LIGHT_GREY, linewidth=0)
    for (_, group), place in zip(groups, places, strict=True):
        for (_, row), height in zip(group.iterrows(), place, strict=True):
            _line(ratio, row, height)
        for column, colour in (("but_wider", SKY), ("all", BLUE)):
            share.barh(place, 100 * group[column], height=SPACING, color=colour, linewidth=0)
        if not group["but_wider"].max() > 0:
            share.text(0, place.mean(), _reason(group, alike), va="center")
    ratio.set_yticks([place.mean() for place in places], [_label(*name) for name, _ in groups])
    ratio.set(
        xscale="log",
        xlim=RANGE,
        ylim=(end + GAP, 0),
        xlabel="spread of the Wishart model over that of the Gaussian model",
    )
    ratio.set_xticks([0.2, 0.5, 1, 2, 5, 10, 20, 50], minor=False)
    ratio.xaxis.set_major_formatter("{x:g}")
    ratio.minorticks_off()
    share.set(xlabel="share of the paths (%)")
    share.margins(x=0.05)
    for axes, name in ((ratio, "a"), (share, "b")):
        axes.tick_params(axis="y", length=0)
        letter(axes, name)
    figure.legend(
        handles=[
            Patch(color=PALE, label="alike"),
            Patch(color=LIGHT_GREY, label="alike, Wishart wider: the paper"),
            Line2D([], [], color=BLACK, marker="o", markersize=3, label="median, 90 % of paths"),
            Patch(color=SKY, label="all but “wider” hold"),
            Patch(color=BLUE, label="all hold"),
        ],
        loc="outside upper center",
        ncols=5,
        columnspacing=1.0,
        handlelength=1.6,
    )
    return figure


def _reason(group: pd.DataFrame, alike: float) -> str:
    """Why no reading of ``group`` fits, as far as the ratio alone says it."""
    if group["ratio_least"].min() > alike:
        return "  none: too wide"
    return "  none: too narrow" if group["ratio_greatest"].max() < 1 / alike else "  none"


def _label(factorisation: str, rows: str) -> str:
    return NAMES.get(factorisation, f"LU, {rows}")


def _line(axes: Axes, row: pd.Series, height: float) -> None:
    if np.isnan(row["ratio_median"]):
        axes.text(1, height, "on no path", va="center", ha="center", fontsize=7, color=GREY)
        return
    colour = VERMILLION if row["but_wider"] > 0 else GREY
    low, high = RANGE
    extremes = [max(row["ratio_least"], low), min(row["ratio_greatest"], high)]
    axes.plot(extremes, [height] * 2, color=colour, linewidth=0.5)
    axes.plot([row["ratio_low"], row["ratio_high"]], [height] * 2, color=colour, linewidth=1.6)
    natural = row["joints"] == "-".join(sorted(row["joints"].split("-")))
    axes.plot(
        row["ratio_median"],
        height,
        marker="o",
        markersize=3.2,
        color=colour,
        markerfacecolor=colour if natural else "white",
        markeredgewidth=0.7,
    )
    if row["ratio_greatest"] > high:
        axes.plot(high, height, marker=">", markersize=2, color=colour, clip_on=False)
