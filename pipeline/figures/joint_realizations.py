"""Realisations of the joint angles, and the standard deviation of their process noise.

Left ordinate: the joint angles of all training takes (solid orange) and their mean over the takes
(dashed black). Right ordinate: standard deviation over the takes of the process noise of each step
(dash-dotted green), measured minus nominal step. All takes follow one desired trajectory, so the
width of the orange band is what the robot adds to it. To look at: whether the noise of a step
changes along the motion.
"""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from pipeline.core.columns import column, columns, members
from pipeline.figures import style

TABLES = {"joints": "data/track", "process_noise": "data/track"}


def draw(joints: pd.DataFrame, process_noise: pd.DataFrame) -> Figure:
    """Fig. (JointRealzFig): one panel per joint, of the training part of ``joints``."""
    training, names = joints[joints["part"] == "training"], members(joints, "q")
    std = process_noise.groupby("t")[columns("w", names)].std()
    q = training[columns("q", names)]
    span = 0.54 * (q.max() - q.min()).max()
    few = len(names) <= style.BESIDE
    across, width = (1, style.ONE_COLUMN) if few else (2, style.TWO_COLUMNS)
    figure, (row,) = style.joint_panels(len(names), across, (width, 1.2, 0.8))
    # pixels, not paths: a hundred lines on top of each other would weigh megabytes
    thin = {"color": style.RECORDED["color"], "linewidth": 0.4, "rasterized": True}
    for (joint, line), axes in zip(style.joint_lines(names).items(), row, strict=True):
        angles = training.pivot(index="t", columns="take", values=column("q", joint))
        lines = axes.plot(angles.index, angles.to_numpy(), **thin)
        (mean,) = axes.plot(angles.mean(axis=1), color=style.BLACK, linestyle="--", linewidth=0.7)
        middle = (angles.min().min() + angles.max().max()) / 2
        axes.set(ylabel=f"{line['label']} (rad)", ylim=(middle - span, middle + span))
        axes.set_xlim(0, angles.index[-1])
        right, green = axes.twinx(), {"color": style.GREEN, "linestyle": "-.", "linewidth": 0.8}
        (noise,) = right.plot(std[column("w", joint)], **green)
        right.set(ylabel="noise std (rad)", ylim=(0, 1.6 * std.max().max()))
        right.spines["right"].set_visible(True)
        for part in (right.yaxis.label, right.spines["right"]):
            part.set_color(style.GREEN)
        right.tick_params(axis="y", colors=style.GREEN)
    labels = ("realisations", "mean", "std of the process noise (right)")
    above = {"loc": "outside upper center", "ncols": 3, "columnspacing": 1.2}
    figure.legend([lines[0], mean, noise], labels, **above)
    return figure
