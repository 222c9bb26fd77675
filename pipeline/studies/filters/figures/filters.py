"""Filters between the training mean and the yardstick, and over the duration of a deviation.

(a) Root mean square error over that of the training mean, on the run's test takes: a disc a joint,
the bar from the lowest to the highest of them; left of the grey line is below the training mean,
the yardstick knows the law of the arm's deviations. (b) to (d) Simulated takes, over the lag of the
sway: the same ratio, mean over the joints; coverage of ±1σ, mean over the joints, with the normal
law's 0.68 in grey; log score minus that of the training mean.
"""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from pipeline.core.filters import MEMORY, NONE
from pipeline.figures.style import BLACK, BLUE, GREEN, GREY, TWO_COLUMNS, letter, panels
from pipeline.studies.filters.stage import COVERAGE, LOG, RMS, YARDSTICK, error_ratio, label

LOOKS = {
    MEMORY: {"color": GREEN, "linestyle": "-."},
    YARDSTICK: {"color": BLACK, "linestyle": "-"},
}
CLOSED_LOOP = {"color": BLUE, "linestyle": ":"}


def draw(filters: pd.DataFrame, filters_lasting: pd.DataFrame) -> Figure:
    """The run on the left, durations on the right."""
    figure, ((run, ratio, covered, score),) = panels(
        TWO_COLUMNS, 2.9, columns=4, width_ratios=[1.2, 1, 1, 1]
    )
    errors = filters[(filters["score"] == RMS) & (filters["filter"] != NONE)]
    errors = errors.assign(ratio=error_ratio(errors))
    names = list(dict.fromkeys(errors["filter"]))
    for y, name in enumerate(names):
        values = errors.loc[errors["filter"] == name, "ratio"]
        run.plot([values.min(), values.max()], [y, y], color=BLUE, lw=1.2)
        run.plot(values, [y] * len(values), "o", color=BLUE, ms=3)
    run.axvline(1.0, color=GREY, linewidth=1.6)
    run.set_yticks(range(len(names)), map(label, names))
    run.set(xlabel="rms error over the\ntraining mean's", xlim=(0, None))
    run.invert_yaxis()
    rows = filters_lasting.assign(
        ratio=error_ratio(filters_lasting), lag=1e3 * filters_lasting["sway_time"]
    )
    for name, own in rows[rows["filter"] != NONE].groupby("filter", sort=False):
        look = LOOKS.get(name, CLOSED_LOOP) | {"marker": "o", "markersize": 2.5}
        for axes, kind, column in (
            (ratio, RMS, "ratio"),
            (covered, COVERAGE, "mean"),
            (score, LOG, "difference"),
        ):
            mean = own[own["score"] == kind].groupby("lag")[column].mean()
            axes.plot(mean.index, mean, label=label(name), **look)
    for axes, level in ((ratio, 1.0), (covered, 0.683), (score, 0.0)):
        line = axes.axhline(level, color=GREY, linewidth=1.6, zorder=0)
        axes.set(xscale="log", xlabel="lag of the sway (ms)")
    ratio.set(ylabel="rms error over the training mean's", ylim=(0, None))
    covered.set(ylabel="coverage of ±1σ", ylim=(0, 1))
    score.set(ylabel="log score minus the training mean's (nat)")
    for name, axes in zip("abcd", (run, ratio, covered, score), strict=True):
        letter(axes, name)
    handles, labels = ratio.get_legend_handles_labels()
    figure.legend(
        [*handles, line], [*labels, "training mean; 0.68"], loc="outside upper center", ncols=4
    )
    return figure
