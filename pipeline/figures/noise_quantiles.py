"""Quantiles of the noise of a step, held out, against quantiles of the normal law.

Black: speed-scaled; orange: speed-scaled, Student's t; blue: distance-scaled, Student's t.
A panel for each joint: noise in the standard deviations that a plain model predicted, of motions
that it was not fitted to. Noise as predicted and normal lies on the grey line; where the tails bend
away from it, few steps hold most of the variance.
"""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures import style

TABLES = {"noise_quantiles": "data/predict"}
NEEDS = "robot with recorded steps"
LINES = {
    "scaled_all": {"color": style.BLACK, "label": "speed-scaled"},
    "scaled_t": {"color": style.VERMILLION, "ls": "--", "label": "speed-scaled, t"},
    "distance_t": {"color": style.BLUE, "ls": "-.", "label": "distance-scaled, t"},
}


def draw(noise_quantiles: pd.DataFrame) -> Figure:
    """Table ``noise_quantiles``: a panel for each joint, a line for each of three plain models."""
    joints = list(dict.fromkeys(noise_quantiles["joint"]))
    across = style.beside(len(joints))
    lines = -(-len(joints) // across)
    figure, grid = style.panels(style.TWO_COLUMNS, 0.6 + 1.6 * lines, lines, across)
    for axes in grid.flat[len(joints) :]:
        axes.remove()
    ends = noise_quantiles["normal"].min(), noise_quantiles["normal"].max()
    for joint, axes in zip(joints, grid.flat, strict=False):
        axes.plot(ends, ends, color=style.LIGHT_GREY, label="normal law")
        for model, line in LINES.items():
            chosen = (noise_quantiles["joint"] == joint) & (noise_quantiles["model"] == model)
            axes.plot(*noise_quantiles.loc[chosen, ["normal", "noise"]].to_numpy().T, **line)
        axes.set(title=joint.replace("_", " "), xlabel="normal quantile (std)")
    for axes in grid[:, 0]:
        axes.set_ylabel("noise (predicted std)")
    style.legend(figure)
    return figure
