"""The paper's estimate of the dispersion over the two choices that the paper leaves open.

(a) Over the ratio of the weights of the convex problem, in units of the ratio that is used. (b)
Over the floor under the eigenvalues of the inverse perturbation. Red: of the recordings. Other
colours: of data drawn from the Wishart model with the dispersion at the dotted line of the same
colour, with the measurement noise of the recordings (solid) and without (dashed). Grey: what is
used. A choice that recovers the truth has a line on the dotted one of its colour. A step at rest
counts as no dispersion at all, so that the lines lie lower than the steps that move alone would put
them.
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
    GREEN,
    LIGHT_GREY,
    ORANGE,
    PURPLE,
    RECORDED,
    TWO_COLUMNS,
    letter,
    panels,
)

TABLES = {"sigma_b_choices": "data/studies/recovery"}
DECLARATIONS = Path(__file__).parents[1] / "tables.yaml"
NEEDS = "motion that rests, or the Wishart model by the paper's estimator"

NOISELESS = (0, (4, 1.5))
COLOURS = (BLUE, GREEN, PURPLE, ORANGE, BLACK)  # of the true dispersions in turn


def draw(sigma_b_choices: pd.DataFrame) -> Figure:
    """Table ``sigma_b_choices``, of the first option that has the paper's estimator."""
    rows = sigma_b_choices[sigma_b_choices["estimator"] == sigma_b_choices["estimator"].iloc[0]]
    drawn = rows.dropna(subset="truth")
    colours = dict(zip(sorted(drawn["truth"].unique()), COLOURS, strict=False))
    used = {"ratio": 1.0, "floor": rows.loc[rows["varied"] == "ratio", "floor"].iloc[0]}
    figure, (panel,) = panels(TWO_COLUMNS, 3.0, columns=2, sharey=True)
    for axes, (varied, column) in zip(panel, (("ratio", "share"), ("floor", "floor")), strict=True):
        axes.axvline(used[varied], color=LIGHT_GREY, linewidth=3, zorder=0)
        shown = rows[rows["varied"] == varied]
        recorded = shown[shown["source"] == "recorded"]
        axes.plot(recorded[column], recorded["sigma_b"], **RECORDED)
        for truth, colour in colours.items():
            axes.axhline(truth, color=colour, linewidth=0.7, linestyle=":", zorder=1)
            for source, style in (("drawn", "-"), ("drawn without measurement noise", NOISELESS)):
                line = shown[(shown["truth"] == truth) & (shown["source"] == source)]
                axes.plot(line[column], line["sigma_b"], color=colour, linestyle=style)
    ratio, floor = panel
    ratio.set(
        xscale="log",
        xlabel=r"$\alpha_2/\alpha_1$ over the one used",
        ylabel=r"$\hat\sigma_B$",
        ylim=(0, 1.05 * np.nanmax(rows["sigma_b"])),
    )
    floor.set(xlabel=r"floor $\epsilon$ of $B^{-1} \succeq \epsilon I$")
    for axes, name in zip(panel, "ab", strict=True):
        letter(axes, name)
    entries = [Line2D([], [], **RECORDED)]
    entries += [
        Line2D([], [], color=colour, label=rf"drawn with $\sigma_B$ = {truth:g}")
        for truth, colour in colours.items()
    ]
    entries += [Line2D([], [], color=BLACK, linestyle=NOISELESS, label="without measurement noise")]
    figure.legend(
        handles=entries, loc="outside upper center", ncols=len(entries), columnspacing=1.2
    )
    return figure
