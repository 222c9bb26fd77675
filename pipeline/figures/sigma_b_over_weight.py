"""Dispersion by the paper's convex problem over the weight that the paper leaves open.

σ̂_B of (BsampOpt) for the weight α₂/α₁ of the perturbation's norm against the residual, for the
recorded takes and for as many takes drawn from the fitted model from the same poses, with the
measurement noise added. Dashed: the moment estimate, which has no weight, and which is the true σ_B
of the drawn takes. Dots: the weights at which the printed problem returns it. Vertical line: the
weight that the noise recorded at rest gives. The weight that returns the true dispersion of drawn
takes does not return the recorded one.
"""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures.style import GREY, ONE_COLUMN, VERMILLION, model_lines, panels

TABLES = {"sigma_b_weights": "data/score"}
NEEDS = "fitted Wishart model"
STYLES = {"recorded": "-", "drawn": ":"}
LABELS = {"recorded": "recorded takes", "drawn": "takes drawn from the model"}


def draw(sigma_b_weights: pd.DataFrame, models: list[str]) -> Figure:
    """Table ``sigma_b_weights``: a panel for each Wishart model, in the colours of ``models``."""
    named = list(sigma_b_weights["model"].unique())
    figure, grid = panels(ONE_COLUMN, 0.5 + 2.4 * len(named), rows=len(named), sharex=True)
    lines = model_lines([*models, *(model for model in named if model not in models)])
    for (axes,), model in zip(grid, named, strict=True):
        rows = sigma_b_weights[sigma_b_weights["model"] == model]
        points = {name: rows[rows["point"] == name] for name in ("curve", "moments", "used")}
        for source, curve in points["curve"].groupby("source", sort=False):
            axes.plot(
                curve["ratio"],
                curve["sigma_b"],
                color=lines[model]["color"],
                linestyle=STYLES[source],
                label=LABELS[source],
            )
        meeting = points["moments"]
        if len(meeting):
            axes.axhline(
                meeting["sigma_b"].iloc[0],
                color=VERMILLION,
                linewidth=0.8,
                linestyle="--",
                label="moment estimate",
            )
            axes.plot(
                meeting["ratio"],
                meeting["sigma_b"],
                "o",
                color=VERMILLION,
                markersize=3,
                label="weight that returns it",
            )
        axes.axvline(
            points["used"]["ratio"].iloc[0],
            color=GREY,
            linewidth=0.8,
            label="weight by the noise at rest",
        )
        axes.set(xscale="log", ylim=(0, None), ylabel=r"$\hat\sigma_B$")
        if len(named) > 1:
            axes.set_title(lines[model]["label"])
    grid[0, 0].legend(fontsize="x-small", loc="upper right")
    grid[-1, 0].set_xlabel(r"weight $\alpha_2/\alpha_1$ (rad)")
    return figure
