"""Noise of the joint angles from the depth camera, over the time of the motion.

(a) Mean and (b) standard deviation over the test takes of the angle from the depth image minus the
angle from motion capture, frame by frame. To look at: a mean away from zero is a bias, and what
changes over the motion the filter must know frame by frame.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from pipeline.core.columns import column, members
from pipeline.figures import style

TABLES = {"kinect_noise": "data/articulate"}
NEEDS = "depth camera"


def draw(kinect_noise: pd.DataFrame) -> Figure:
    """Fig. (MeanStdKinNoise): the estimate from all takes, none left out."""
    rows = kinect_noise[kinect_noise["take"] == "none"].set_index("t")
    figure, (row,) = style.panels(style.ONE_COLUMN, 2.1, columns=2, sharex=True)
    for joint, line in style.joint_lines(members(kinect_noise, "b")).items():
        row[0].plot(rows[column("b", joint)], **line)
        row[1].plot(np.sqrt(rows[column("r", joint, joint)]), **line)
    row[0].axhline(0, color=style.GREY, linewidth=0.5, zorder=0)
    labels = ("mean (rad)", "standard deviation (rad)")
    for axes, name, label in zip(row, "ab", labels, strict=True):
        axes.set(xlabel="time (s)", ylabel=label)
        axes.xaxis.set_major_locator(MultipleLocator(1))
        style.letter(axes, name)
    row[1].set_ylim(bottom=0)
    figure.get_layout_engine().set(wspace=0.1)
    style.legend(figure, ncols=3)
    return figure
