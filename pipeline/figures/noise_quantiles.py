"""Quantiles of the noise of a step, held out, against those of the normal law.

A panel for each joint: noise in the standard deviations that a plain model predicted, of motions
that it was not fitted to. Noise as predicted and normal lies on the grey line; where the tails bend
away from it, few steps hold most of the variance.
"""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures.style import BLACK, LIGHT_GREY, TWO_COLUMNS, VERMILLION, beside, panels

TABLES = {"noise_quantiles": "data/predict"}
NEEDS = "robot with recorded steps"
LINES = {
    "scaled_all": (BLACK, "-", "speed-scaled"),
    "scaled_t": (VERMILLION, "--", "speed-scaled, t"),
}


def draw(noise_quantiles: pd.DataFrame) -> Figure:
    """Table ``noise_quantiles``: a panel for each joint, a line for each speed-scaled model."""
    joints = list(dict.fromkeys(noise_quantiles["joint"]))
    across = beside(len(joints))
    lines = -(-len(joints) // across)
    figure, grid = panels(TWO_COLUMNS, 0.4 + 1.6 * lines, lines, across)
    for axes in grid.flat[len(joints) :]:
        axes.remove()
    for joint, axes in zip(joints, grid.flat, strict=False):
        ends = noise_quantiles["normal"].min(), noise_quantiles["normal"].max()
        axes.plot(ends, ends, color=LIGHT_GREY)
        for model, (colour, style, label) in LINES.items():
            chosen = (noise_quantiles["joint"] == joint) & (noise_quantiles["model"] == model)
            own = noise_quantiles[chosen]
            axes.plot(own["normal"], own["noise"], style, color=colour, label=label)
        axes.set_title(joint.replace("_", " "))
        axes.set_xlabel("normal quantile")
    for axes in grid[:, 0]:
        axes.set_ylabel("noise (predicted std)")
    grid[0, 0].legend(loc="upper left")
    return figure
