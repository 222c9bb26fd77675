"""Motions of one task path, and how uncertain they are predicted to be and are.

Base condition, an arm in each row. Left: the angle of the joint in which the motions differ most.
Middle: standard deviation of the noise of a step, all joints together, root mean square over five
steps, of the takes (lines) and as a model predicts it of its own plan (thin dashes in the plan's
colour). Right: the sum of variances
over the motion, predicted and realised, each over that of the minimum-norm motion; colours are the
motions, symbols the models that predict, bars 95 % intervals over the takes. On the diagonal the
prediction holds. The additive model says the same of every motion.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from pipeline.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    LIGHT_GREY,
    ORANGE,
    PURPLE,
    SKY,
    TWO_COLUMNS,
    VERMILLION,
    letter,
    panels,
)

FOLDER = "data/studies/planning"
TABLES = {
    "planning_courses": FOLDER,
    "planning_spreads": FOLDER,
    "planning_predictions": FOLDER,
}
DECLARATIONS = Path(__file__).parents[1] / "tables.yaml"
TOGETHER = 5  # steps that a line's point is of
NOISES = ("predicted", "realised")
MOTIONS = {
    "recorded": ("as recorded", VERMILLION),
    "minimum_norm": ("minimum norm", BLACK),
    "best_conditioned": ("best conditioned", ORANGE),
    "wishart_qr_transposed": (r"plan, Wishart, QR of $J^{\mathsf{T}}$", BLUE),
    "wishart_scaled": ("plan, Wishart, $J_1$ given", GREEN),
    "gaussian": ("plan, Gaussian", PURPLE),
}
MODELS = {
    "additive": ("additive", "x", SKY),
    "wishart_qr_transposed": (r"Wishart, QR of $J^{\mathsf{T}}$", "o", BLUE),
    "wishart_scaled": ("Wishart, $J_1$ given", "s", GREEN),
    "gaussian": ("Gaussian", "^", PURPLE),
}


def draw(
    planning_courses: pd.DataFrame,
    planning_spreads: pd.DataFrame,
    planning_predictions: pd.DataFrame,
) -> Figure:
    """A row of panels for each arm."""
    arms = list(planning_courses.groupby("arm", sort=False))
    figure, rows = panels(TWO_COLUMNS, 0.6 + 2.1 * len(arms), rows=len(arms), columns=3)
    letters = iter("abcdefghi")
    for row, (arm, courses) in zip(rows, arms, strict=True):
        for axes in row:
            letter(axes, next(letters))
        _courses(row[0], row[1], courses)
        row[0].set_title(arm)
        _against(
            row[2],
            _base(planning_spreads, arm).query("part == 'joints' and kind == 'step'"),
            _base(planning_predictions, arm),
        )
    present = planning_courses["motion"].unique()
    lines = [Line2D([], [], color=c, label=n) for m, (n, c) in MOTIONS.items() if m in present]
    said = planning_predictions["model"].unique()
    marks = [
        Line2D(
            [], [], color=GREY, marker=mark, linestyle="", markersize=4, label=f"predicted: {name}"
        )
        for model, (name, mark, _) in MODELS.items()
        if model in said
    ]
    figure.legend(handles=lines + marks, loc="outside upper center", ncols=4)
    return figure


def _base(rows: pd.DataFrame, arm: str) -> pd.DataFrame:
    return rows[(rows["arm"] == arm) & (rows["physics"] == "base condition")]


def _courses(angles: Axes, noise: Axes, courses: pd.DataFrame) -> None:
    for motion, steps in courses.groupby("motion", sort=False):
        rows = _together(steps)
        color = MOTIONS[motion][1]
        angles.plot(rows["t"], rows["angle"], color=color)
        noise.plot(rows["t"], rows["realised"], color=color)
        noise.plot(rows["t"], rows["predicted"], color=color, linewidth=0.8, linestyle=(0, (2, 2)))
    name = courses["joint"].iloc[0].replace("_", " ")
    angles.set(xlabel="time (s)", ylabel=f"angle of {name} (rad)")
    noise.set(xlabel="time (s)", ylabel="noise of a step (rad)", yscale="log")
    noise.set_ylim(courses["realised"].min() / 2, 1.3 * courses["realised"].max())


def _together(steps: pd.DataFrame) -> pd.DataFrame:
    """A row for every TOGETHER of the ``steps``: means, of standard deviations of their squares."""
    squared = steps.assign(**{name: steps[name] ** 2 for name in NOISES})
    columns = ["t", "angle", *NOISES]
    rows = squared.groupby(np.arange(len(steps)) // TOGETHER)[columns].mean()
    return rows.assign(**{name: np.sqrt(rows[name]) for name in NOISES})


def _against(axes: Axes, spreads: pd.DataFrame, predictions: pd.DataFrame) -> None:
    known = spreads.dropna(subset="ratio").set_index("motion")
    for model, rows in predictions.groupby("model", sort=False):
        predicted = rows.set_index("motion")["joints"]
        predicted = predicted / predicted["minimum_norm"]
        for motion in known.index.intersection(predicted.dropna().index):
            row = known.loc[motion]
            reach = np.array(
                [[row["ratio"] - row["ratio_low"]], [row["ratio_high"] - row["ratio"]]]
            )
            axes.errorbar(
                predicted[motion],
                row["ratio"],
                yerr=np.maximum(reach, 0.0),
                color=MOTIONS[motion][1],
                marker=MODELS[model][1],
                markersize=4,
                markerfacecolor="none",
                linewidth=0.8,
            )
    ends = np.array([0.3, 30.0])
    axes.plot(ends, ends, color=LIGHT_GREY, linewidth=0.8, zorder=0)
    axes.set(xlabel="predicted, over minimum norm", ylabel="realised, likewise")
    axes.set(xscale="log", yscale="log")
    low, high = known["ratio_low"].min(), known["ratio_high"].max()
    axes.set_ylim(0.8 * min(low, 1.0), 1.25 * max(high, 1.0))
    sides = predictions.pivot(index="model", columns="motion", values="joints")
    sides = sides.div(sides["minimum_norm"], axis=0).to_numpy()
    axes.set_xlim(0.85 * np.nanmin(sides), 1.18 * np.nanmax(sides))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(FuncFormatter(_some))


def _some(value: float, _: int) -> str:
    """Ticks between powers of ten that have a number."""
    return f"{value:g}" if f"{value:e}"[0] in "257" else ""
