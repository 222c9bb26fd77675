"""Dispersion by the paper's convex problem over the weight that the paper leaves open.

σ̂_B of (BsampOpt) for the weight α₂/α₁ of the perturbation's norm against the residual, for the
recorded takes and for as many takes drawn from the fitted model from the same poses, with the
measurement noise added. Dashed orange: the moment estimate, which has no weight, and which is the
true σ_B of the drawn takes. Dots: the weights at which the printed problem returns it. Vertical
grey line: the weight that the noise recorded at rest gives. The weight that returns the true
dispersion of drawn takes does not return the recorded one.
"""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures import style

TABLES = {"sigma_b_weights": "data/score"}
NEEDS = "fitted Wishart model"
LINES = {
    "recorded": {"linestyle": "-", "label": "recorded takes"},
    "drawn": {"linestyle": ":", "label": "takes drawn from the model"},
}


def draw(sigma_b_weights: pd.DataFrame, models: list[str]) -> Figure:
    """Table ``sigma_b_weights``: a panel for each Wishart model, in the colours of ``models``."""
    named = list(sigma_b_weights["model"].unique())
    height = 1.0 + 2.2 * len(named)
    figure, grid = style.panels(style.ONE_COLUMN, height, rows=len(named), sharex=True)
    lines, orange = style.model_lines(dict.fromkeys([*models, *named])), style.VERMILLION
    for (axes,), model in zip(grid, named, strict=True):
        rows = sigma_b_weights[sigma_b_weights["model"] == model]
        points = {name: rows[rows["point"] == name] for name in ("curve", "moments", "used")}
        for source, curve in points["curve"].groupby("source", sort=False):
            look = LINES[source] | {"color": lines[model]["color"]}
            axes.plot(curve["ratio"], curve["sigma_b"], **look)
        ratio, level = (points["moments"][name] for name in ("ratio", "sigma_b"))
        if len(level):
            dashed = {"color": orange, "linewidth": 0.8, "linestyle": "--"}
            axes.axhline(level.iloc[0], **dashed, label="moment estimate")
            mark = {"color": orange, "markersize": 3, "label": "weight that returns it"}
            axes.plot(ratio, level, "o", **mark)
        used = {"color": style.GREY, "linewidth": 0.8, "label": "weight by the noise at rest"}
        axes.axvline(points["used"]["ratio"].iloc[0], **used)
        axes.set(xscale="log", ylim=(0, None), ylabel=r"$\hat\sigma_B$ (1)")
        if len(named) > 1:
            axes.set_title(lines[model]["label"])
    style.legend(figure, ncols=2)
    grid[-1, 0].set_xlabel(r"weight $\alpha_2/\alpha_1$ (rad)")
    return figure
