"""Which decompositions the printed numbers allow.

(a) Standard deviation of a step at the printed parameters over the printed one (grey: 1), roots of
traces: median and middle 90 % of the paths with ramps and rest; an arrow marks an interval that
goes on. (b) Likelihood over the one of pivoted LU (grey: 1), the tolerance integrated out: marks
for the paths with ramps and rest, lines from the least to the greatest of six path priors.
"""

from __future__ import annotations

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.figures.style import (
    BLACK,
    BLUE,
    GREY,
    ORANGE,
    TWO_COLUMNS,
    VERMILLION,
    letter,
    panels,
)
from pipeline.studies.which_decomposition.words import NAMES, QUANTITIES, main_rows

LABELS = NAMES | {"qr_transposed": r"QR of J$^\mathsf{T}$"}
SETS = {"sigma_b": r"$\Sigma_\omega$ and $\sigma_B$", "alpha_u": r"with ($\alpha$, $u$)"}
MARKS = dict(zip(QUANTITIES, (("o", BLUE), ("s", ORANGE), ("D", VERMILLION)), strict=True))
WIDTHS, LIKELIHOODS = (0.02, 30), (1e-3, 1e3)  # ranges of the axes


def draw(widths: pd.DataFrame, evidence: pd.DataFrame) -> Figure:
    """Tables ``widths`` and ``evidence``."""
    main = widths[widths["prior"] == widths["prior"].iloc[0]].set_index("reading")
    rows = {reading: height for height, reading in enumerate(main.index)}
    figure, ((left, right),) = panels(
        TWO_COLUMNS, 0.27 * len(rows) + 0.95, columns=2, sharey=True, width_ratios=(1, 1.25)
    )
    for reading, height in rows.items():
        _interval(left, main.loc[reading], height)
    integrated = evidence[evidence["tolerance"] == 0]
    integrated = integrated[integrated["size"] == evidence["size"].iloc[0]]
    for number, (name, (marker, colour)) in enumerate(MARKS.items()):
        part = integrated[integrated["quantities"] == name]
        heights = part["reading"].map(rows) + 0.22 * (number - 1)
        ends = part.groupby(heights.round(6))["likelihood"].agg(["min", "max"])
        right.hlines(ends.index, ends["min"], ends["max"], color=colour, linewidth=1.2)
        here = main_rows(part)
        right.plot(
            here["likelihood"],
            heights[here.index],
            linestyle="",
            marker=marker,
            markersize=4,
            color=colour,
            label=SETS.get(name, QUANTITIES[name]),
        )
    left.plot([], [], color=BLACK, marker="o", markersize=4, label="median, 90 % of the paths")
    left.plot([], [], color=GREY, label="printed value; pivoted LU")
    left.set_yticks(list(rows.values()), [LABELS[reading] for reading in rows])
    left.set(
        xlim=WIDTHS, ylim=(len(rows) - 0.5, -0.6), xlabel="standard deviation over printed one"
    )
    right.set(xlim=LIKELIHOODS, xlabel="likelihood over pivoted LU's")
    for axes, name in ((left, "a"), (right, "b")):
        axes.set_xscale("log")
        axes.axvline(1, color=GREY, linewidth=0.8, zorder=0)
        axes.tick_params(axis="y", length=0)
        letter(axes, name)
    figure.legend(loc="outside lower center", ncols=5, columnspacing=1.2, handlelength=1.4)
    return figure


def _interval(axes: Axes, row: pd.Series, height: float) -> None:
    axes.hlines(height, row["low"], min(row["high"], WIDTHS[1]), color=BLACK, linewidth=1.2)
    axes.plot(row["median"], height, marker="o", markersize=4, color=BLACK)
    if row["high"] > WIDTHS[1]:
        axes.plot(WIDTHS[1], height, marker=">", markersize=4, color=BLACK, clip_on=False)
