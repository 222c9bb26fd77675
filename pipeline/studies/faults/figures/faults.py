"""What faults in the recordings cost, where they are not refused.

Each row is a kind of fault; its marks, from light to dark, are growing severities. (a) Motion
capture and (b) depth camera: root mean square error of the joint angles, over that of the same
recordings without the fault. (c) Force transducer: change of the means and standard deviations of
the force. Diamonds: nothing in the recordings shows the fault, so it is neither repaired nor
counted. Crosses at the right edge: refused at that severity. Faults that are refused at every
severity are in the table alone, with the severities, the rules and what was said.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pipeline.figures.style import (
    BLACK,
    BLUE,
    LIGHT_GREY,
    SKY,
    TWO_COLUMNS,
    VERMILLION,
    letter,
    panels,
)

TABLES = {"faults": "data/studies/faults"}
DECLARATIONS = Path(__file__).parents[1] / "tables.yaml"
NEEDS = "synthetic laboratory"

SHADES = ("white", SKY, BLUE)  # of growing severity
INSTRUMENTS = ("motion capture", "depth camera", "force transducer")
LEAST = 1e-4  # N: smaller changes of force are drawn here
CIRCLE = {
    "marker": "o",
    "markersize": 5,
    "markeredgecolor": BLACK,
    "markeredgewidth": 0.5,
    "linestyle": "none",
}
DIAMOND = CIRCLE | {"marker": "D", "markersize": 4.5}
CROSS = {"marker": "x", "markersize": 5, "color": VERMILLION, "linestyle": "none"}
ROW = 0.155  # in
UNNOTICED = "unnoticed"  # as the table says


def draw(faults: pd.DataFrame) -> Figure:
    """Table ``faults``."""
    kept = faults.groupby("fault")["error"].transform(lambda error: error.notna().any())
    shown = {
        instrument: rows
        for instrument, rows in faults[kept].groupby("instrument", sort=False)
        if instrument in INSTRUMENTS
    }
    numbers = [rows["fault"].nunique() for rows in shown.values()]
    height = ROW * sum(numbers) + 0.55 * len(numbers) + 0.3
    figure, grid = panels(TWO_COLUMNS, height, rows=len(shown), height_ratios=numbers)
    for axes, name, (instrument, rows) in zip(grid[:, 0], "abc", shown.items(), strict=False):
        forces = (rows["error_unit"] == "N").all()
        value = np.maximum(rows["error"], LEAST) if forces else rows["error"] / rows["clean_error"]
        edge = 1.1 * max(value.max(), 1.0)
        order = {fault: place for place, fault in enumerate(rows["fault"].unique())}
        level = rows.groupby("fault").cumcount()
        for place, at, x, unnoticed in zip(
            rows["fault"].map(order), level, value, rows["outcome"] == UNNOTICED, strict=True
        ):
            # of equal errors each mark stays visible
            y = place + 0.24 * (at - 1)
            if np.isnan(x):
                axes.plot(edge, y, **CROSS, clip_on=False)
            else:
                axes.plot(x, y, **(DIAMOND if unnoticed else CIRCLE), markerfacecolor=SHADES[at])
        axes.axvline(LEAST if forces else 1.0, color=LIGHT_GREY, linewidth=2, zorder=0)
        axes.set_yticks(
            list(order.values()), [fault.partition(": ")[2] for fault in order], fontsize=7
        )
        label = "change of the moments, N" if forces else "error over that of the clean recordings"
        axes.set(xscale="log" if forces else "linear", ylim=(len(order) - 0.5, -0.5), xlabel=label)
        axes.grid(axis="y", color=LIGHT_GREY, linewidth=0.3)
        letter(axes, name)
        axes.set_title(instrument, fontsize=8)
    words = zip(SHADES, ("mild", "middling", "grave"), strict=True)
    entries = [Line2D([], [], **CIRCLE, markerfacecolor=shade, label=word) for shade, word in words]
    entries += [
        Line2D([], [], **DIAMOND, markerfacecolor=SKY, label="unnoticed"),
        Line2D([], [], **CROSS, label="refused"),
    ]
    figure.legend(handles=entries, loc="outside upper right", ncols=5)
    return figure
