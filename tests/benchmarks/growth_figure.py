"""How cost grows: (a) processor time and (b) memory beyond what was there before, over the size of
what grows.

Lines of slope one in grey. The legend gives each line's slope over the larger half of its sizes;
memory that does not grow is not drawn, nor what is less than can be told.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    LIGHT_GREY,
    ORANGE,
    PURPLE,
    TWO_COLUMNS,
    VERMILLION,
    letter,
    panels,
)

TOLD = 0.1  # MB; less is a matter of single pages, and none has no place on a logarithmic axis
LINES = {
    "particles": {"color": BLUE, "marker": "o", "linestyle": "-"},
    "steps": {"color": VERMILLION, "marker": "s", "linestyle": "--"},
    "joints": {"color": BLACK, "marker": "x", "linestyle": (0, (1, 1))},
    "takes": {"color": GREEN, "marker": "^", "linestyle": "-."},
    "frames": {"color": PURPLE, "marker": "D", "linestyle": ":"},
    "agents": {"color": ORANGE, "marker": "v", "linestyle": (0, (6, 1.5, 1, 1.5))},
}


def draw(costs: pd.DataFrame) -> Figure:
    """Table ``cost_growth``: over, size, seconds, megabytes, time_slope, memory_slope."""
    figure, ((time, memory),) = panels(TWO_COLUMNS, 2.8, columns=2)
    for axes, column, least, kind, label in (
        (time, "seconds", 0.0, "time_slope", "processor time (s)"),
        (memory, "megabytes", TOLD, "memory_slope", "memory (MB)"),
    ):
        for over, rows in costs.groupby("over", sort=False):
            slope = rows[kind].iloc[0]
            if np.isfinite(slope):
                stated = rows[rows[column] > least]
                axes.plot(
                    stated["size"],
                    stated[column],
                    label=f"{over}: {slope:z.2f}",
                    markersize=3,
                    **LINES[over],
                )
        axes.set(xscale="log", yscale="log", xlabel="size", ylabel=label)
        if axes.get_lines():
            axes.legend(title="slope over", loc="center left", bbox_to_anchor=(1.0, 0.5))
    for axes, name in ((time, "a"), (memory, "b")):
        letter(axes, name)
        _slope_one(axes)
    return figure


def _slope_one(axes) -> None:
    """Grey lines of slope one, a factor of ten apart, where the axes are."""
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    for offset in range(
        int(np.floor(np.log10(low / right))), int(np.ceil(np.log10(high / left))) + 1
    ):
        axes.plot(
            [left, right],
            [left * 10.0**offset, right * 10.0**offset],
            color=LIGHT_GREY,
            linewidth=0.4,
            zorder=0,
        )
    axes.set(xlim=(left, right), ylim=(low, high))
