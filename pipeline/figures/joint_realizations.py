"""Realisations of the joint angles, and the standard deviation of their process noise.

Left ordinate: the joint angles of all training takes (solid red) and their mean over the takes
(dashed black). Right ordinate: standard deviation over the takes of the process noise of each step
(dash-dot), measured minus nominal step. All takes follow one desired trajectory, so the width of
the red band is what the robot adds to it. To look at: whether the noise of a step changes along the
motion.
"""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from pipeline.core.columns import column, columns, members
from pipeline.figures.style import (
    BESIDE,
    BLACK,
    GREEN,
    ONE_COLUMN,
    RECORDED,
    TWO_COLUMNS,
    joint_lines,
    joint_panels,
)

TABLES = {"joints": "data/track", "process_noise": "data/track"}


def draw(joints: pd.DataFrame, process_noise: pd.DataFrame) -> Figure:
    """Fig. (JointRealzFig): one panel per joint; tables ``joints`` (the training part is shown) and
    ``process_noise``.
    """
    training = joints[joints["part"] == "training"]
    names = members(joints, "q")
    spread = process_noise.groupby("t")[columns("w", names)].std()
    q = training[columns("q", names)]
    span = 0.54 * (q.max() - q.min()).max()
    across, width = (1, ONE_COLUMN) if len(names) <= BESIDE else (2, TWO_COLUMNS)
    figure, (row,) = joint_panels(len(names), across, (width, 1.2, 0.8))
    for (joint, line), axes in zip(joint_lines(names).items(), row, strict=True):
        angles = training.pivot(index="t", columns="take", values=column("q", joint))
        # pixels, not paths: a hundred lines on top of each other would weigh megabytes
        lines = axes.plot(
            angles.index, angles.to_numpy(), color=RECORDED["color"], linewidth=0.4, rasterized=True
        )
        (mean,) = axes.plot(
            angles.index, angles.mean(axis=1), color=BLACK, linestyle="--", linewidth=0.7
        )
        middle = (angles.min().min() + angles.max().max()) / 2
        axes.set(
            ylabel=f"{line['label']} (rad)",
            ylim=(middle - span, middle + span),
            xlim=(0, angles.index[-1]),
        )
        right = axes.twinx()
        (noise,) = right.plot(
            spread.index, spread[column("w", joint)], color=GREEN, linestyle="-.", linewidth=0.8
        )
        right.set(ylabel="std of its noise (rad)", ylim=(0, 1.6 * spread.max().max()))
        right.spines["right"].set_visible(True)
        for part in (right.yaxis.label, right.spines["right"]):
            part.set_color(GREEN)
        right.tick_params(axis="y", colors=GREEN)
    labels = ("realisations", "mean", "std of the process noise (right)")
    figure.legend(
        [lines[0], mean, noise], labels, loc="outside upper center", ncols=3, columnspacing=1.2
    )
    return figure
