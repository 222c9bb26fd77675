"""Each filter between no filter and the yardsticks, and over how long deviations last.

(a) to (c) Root mean square error of each joint over the run's test takes, a mark a filter, with the
95 % interval of its difference to no filter (grey line) about it. Black: the yardstick, which knows
the law of the arm's deviations; dashed: the one that knows the camera too. To look at: which
marks lie left of the grey line, and how near they come to the black ones. (d) to (f) The arm
alone, over the lag of its sway: mean over the joints of the errors over those of no filter;
coverage of one sigma, the lowest and the highest of any joint; and the log score less no filter's.
To look at: which filter stays below 1, within the band and above 0.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.core.filters import MEMORY, NONE
from pipeline.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    TWO_COLUMNS,
    letter,
    panels,
)
from pipeline.studies.filters.scores import (
    COVERAGE,
    FIRST_ORDER,
    INFORMED,
    LOG,
    RMS,
    YARDSTICK,
    over_none,
)
from pipeline.studies.filters.words import label

TABLES = {
    "filters_placed": "data/studies/filters",
    "filters_lasting": "data/studies/filters",
}
DECLARATIONS = Path(__file__).parents[1] / "tables.yaml"
NEEDS = "synthetic laboratory or no depth camera"

LOOKS = {
    FIRST_ORDER: {"color": ORANGE, "linestyle": "--"},
    MEMORY: {"color": GREEN, "linestyle": "-."},
    YARDSTICK: {"color": BLACK, "linestyle": "-"},
}
CLOSED_LOOP = {"color": BLUE, "linestyle": ":"}


def draw(filters_placed: pd.DataFrame, filters_lasting: pd.DataFrame) -> Figure:
    """The run above, the durations below."""
    errors = filters_placed[filters_placed["score"] == RMS]
    joints = list(errors["joint"].unique())
    figure, grid = panels(TWO_COLUMNS, 4.8, rows=2, columns=max(3, len(joints)))
    names = [n for n in errors["filter"].unique() if n not in (NONE, YARDSTICK, INFORMED)]
    for number, (joint, axes) in enumerate(zip(joints, grid[0], strict=False)):
        _marks(axes, errors[errors["joint"] == joint].set_index("filter"), names)
        axes.set_xlabel(f"rms error of {joint.replace('_', ' ')} (rad)")
        axes.set_yticks(range(len(names)), map(label, names) if number == 0 else [])
    _durations(grid[1], filters_lasting)
    for axes in grid[1, 3:]:
        axes.set_axis_off()
    for number, axes in enumerate([*grid[0][: len(joints)], *grid[1][:3]]):
        letter(axes, chr(ord("a") + number))
    return figure


def _marks(axes: Axes, rows: pd.DataFrame, names: list[str]) -> None:
    for place, name in enumerate(names):
        row, none = rows.loc[name], rows.loc[NONE, "mean"]
        axes.plot([none + row["low"], none + row["high"]], [place, place], color=BLUE, lw=0.8)
        axes.plot([row["mean"]], [place], "o", color=BLUE, markersize=3.5)
    for name, look in (
        (NONE, {"color": GREY, "linewidth": 1.6}),
        (YARDSTICK, {"color": BLACK}),
        (INFORMED, {"color": BLACK, "linestyle": "--"}),
    ):
        axes.axvline(rows.loc[name, "mean"], **look)
    axes.invert_yaxis()
    axes.set_xlim(left=0)


def _durations(panes: list[Axes], rows: pd.DataFrame) -> None:
    ratio, covered, score = panes[:3]
    rows = rows.assign(ratio=over_none(rows), lag=1e3 * rows["sway_time"])
    for name, own in rows.groupby("filter", sort=False):
        if name == NONE:
            continue
        look = LOOKS.get(name, CLOSED_LOOP) | {"marker": "o", "markersize": 2.5}
        mean = own[own["score"] == RMS].groupby("lag")["ratio"].mean()
        ratio.plot(mean.index, mean, label=label(name), **look)
        ends = own[own["score"] == COVERAGE].groupby("lag")["mean"].agg(["min", "max"])
        for end in ("min", "max"):
            covered.plot(ends.index, ends[end], **look)
        log = own[own["score"] == LOG].set_index("lag")["difference"]
        score.plot(log.index, log, **look)
    covered.axhspan(0.65, 0.71, color=GREY, alpha=0.3, linewidth=0)
    for axes, level in ((ratio, 1.0), (score, 0.0)):
        axes.axhline(level, color=GREY, linewidth=1.6)
    for axes, what in zip(
        panes, ("rms error over no filter's", "coverage", "log score gained (nat)"), strict=False
    ):
        axes.set(xscale="log", xlabel="lag of the sway (ms)", ylabel=what)
    ratio.set_ylim(bottom=0)
    ratio.legend()
