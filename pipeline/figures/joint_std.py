"""Standard deviation of the joint angles: recordings against models.

Recorded (red, solid), additive Gaussian noise (dotted), Wishart perturbation (dashed) and Gaussian
noise matrix (dash-dot). With one-step simulation, as in the paper, it is that of the process noise
of one step, and the recorded line is the one of the figure of the joint realisations; with
free-running simulation it is that of the joint angles themselves. To look at: whether a model
follows the recorded line, in its course over time and in its height.
"""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from pipeline.core.columns import column
from pipeline.figures.style import (
    RECORDED,
    TWO_COLUMNS,
    beside,
    joint_lines,
    joint_panels,
    model_lines,
)

TABLES = {"deviation": "data/score"}

QUANTITIES = {
    "one_step": "std of the process noise (rad)",
    "free_running": "std of the joint angle (rad)",
}


def draw(deviation: pd.DataFrame, models: list[str], joints: list[str], mode: str) -> Figure:
    """Fig. (STDq): one panel per joint of table ``deviation``, all on one scale; ``mode`` is that
    of the simulation.
    """
    across = beside(len(joints))
    figure, (row,) = joint_panels(len(joints), across, (TWO_COLUMNS, 1.9, 0.6), sharey=True)
    for (joint, name), axes in zip(joint_lines(joints).items(), row, strict=True):
        for source, line in ({"recorded": RECORDED} | model_lines(models)).items():
            rows = deviation[deviation["source"] == source]
            axes.plot(rows["t"], rows[column("s", joint)], **line)
        axes.set(title=name["label"], xlim=(0, deviation["t"].max()))
    for first in row[::across]:
        first.set_ylabel(QUANTITIES[mode])
    row[0].set_ylim(bottom=0)
    figure.legend(*row[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure
