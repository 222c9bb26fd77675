"""Uncertainty of motions along one task path, predicted and realised.

One panel an arm, all physics. Across: predicted Σ tr Cov(ω) over that of the minimum-norm motion,
a symbol a model; upwards: the realised sum over that of the minimum-norm motion, a colour a motion.
On the dotted diagonal the prediction holds.
"""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pipeline.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    TWO_COLUMNS,
    VERMILLION,
    letter,
    panels,
)
from pipeline.studies.planning.stage import MINIMUM, motion_label

COLOURS, SYMBOLS = (BLACK, GREY, GREEN, BLUE, VERMILLION, ORANGE, PURPLE), "osD^vP"


def draw(planning: pd.DataFrame, planning_predictions: pd.DataFrame) -> Figure:
    """Predicted over realised ratios."""
    keys = ["arm", "physics"]
    predicted = planning_predictions.dropna(subset="sum")
    norm = predicted[predicted["motion"] == MINIMUM].set_index([*keys, "model"])["sum"]
    places = pd.MultiIndex.from_frame(predicted[[*keys, "model"]])
    predicted = predicted.assign(predicted=predicted["sum"] / norm.reindex(places).to_numpy())
    both = predicted.merge(planning[[*keys, "motion", "ratio"]], on=[*keys, "motion"])
    arms = list(dict.fromkeys(planning["arm"]))
    motions = dict(zip(dict.fromkeys(planning["motion"]), COLOURS, strict=False))
    models = dict(zip(dict.fromkeys(both["model"]), SYMBOLS, strict=False))
    figure, grid = panels(TWO_COLUMNS, 3.2, columns=len(arms))
    for number, (axes, arm) in enumerate(zip(grid[0], arms, strict=True)):
        for row in both[both["arm"] == arm].itertuples():
            look = {"color": motions[row.motion], "marker": models[row.model]}
            axes.plot([row.predicted], [row.ratio], ls="none", ms=4, alpha=0.8, **look)
        axes.set(xscale="log", yscale="log", xlabel="predicted over minimum norm", title=arm)
        axes.axline((1, 1), (2, 2), color=GREY, ls=":", lw=0.8)
        for ticks in (axes.xaxis, axes.yaxis):
            ticks.set_major_formatter("{x:g}")
            ticks.set_minor_formatter("{x:g}")
        axes.tick_params(which="both", labelsize=7)
        letter(axes, "abcdefg"[number])
    grid[0, 0].set_ylabel("realised over minimum norm")
    entries = [
        Line2D([], [], marker="o", ls="none", color=color, label=motion_label(name))
        for name, color in motions.items()
    ]
    entries += [
        Line2D([], [], marker=mark, ls="none", mfc="none", mec=BLACK, label=f"predicted by {name}")
        for name, mark in models.items()
    ]
    entries.append(Line2D([], [], color=GREY, ls=":", lw=0.8, label="prediction holds"))
    figure.legend(handles=entries, loc="outside lower center", ncols=3)
    return figure
