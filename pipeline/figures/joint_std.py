"""Standard deviation of the joint angles: recordings against models.

Recorded (orange, solid), additive Gaussian noise (light blue, dotted), Wishart perturbation (blue,
dashed) and Gaussian noise matrix (black, dash-dotted). One-step simulation, as in the paper, gives
the process noise of one step, with the recorded line of the joint realisations' figure;
free-running simulation gives the joint angles themselves. A line three times as high as all others
leaves its panels at the top. To look at: whether a model follows
the recorded line, in its course over time and in its height.
"""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from pipeline.core.columns import column, columns
from pipeline.figures import style

TABLES = {"deviation": "data/score"}
QUANTITIES = {
    "one_step": "std of the process noise (rad)",
    "free_running": "std of the joint angle (rad)",
}
OUTLYING = 3  # times the greatest of the other lines


def draw(deviation: pd.DataFrame, models: list[str], joints: list[str], mode: str) -> Figure:
    """Fig. (STDq): one panel per joint, all on one scale; ``mode`` of the simulation."""
    across, size = style.beside(len(joints)), (style.TWO_COLUMNS, 1.9, 0.6)
    lines = {"recorded": style.RECORDED} | style.model_lines(models)
    figure, (row,) = style.joint_panels(len(joints), across, size, sharey=True)
    shown = deviation[deviation["source"].isin(lines)]
    tops = shown.groupby("source")[columns("s", joints)].max().max(axis=1)
    tops = tops.sort_values().to_list()
    while len(tops) > 1 and tops[-1] > OUTLYING * tops[-2]:
        tops.pop()
    for (joint, name), axes in zip(style.joint_lines(joints).items(), row, strict=True):
        for source, line in lines.items():
            rows = deviation[deviation["source"] == source]
            axes.plot(rows["t"], rows[column("s", joint)], **line)
        axes.set(title=name["label"], xlim=(0, deviation["t"].max()))
    row[0].set_ylim(0, 1.05 * tops[-1])
    for first in row[::across]:
        first.set_ylabel(QUANTITIES[mode])
    style.legend(figure)
    return figure
