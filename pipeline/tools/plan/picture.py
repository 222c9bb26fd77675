"""A planned motion as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipeline.figures.style import BLACK, GREY, PNG_RESOLUTION, TWO_COLUMNS, joint_lines, panels
from pipeline.planning.motions import Planned
from pipeline.planning.problem import Problem

UNITS = {"trace": "tr Cov (rad²)", "log_det": "ln det Cov"}


def draw(
    planned: Planned, problem: Problem, joints: Sequence[str], objective: str, file: Path
) -> None:
    """Write ``file``, a PNG: the ``joints`` over time, the cost of the steps and the least singular
    value with its margin.
    """
    figure, ((angles, cost, clearance),) = panels(TWO_COLUMNS, 2.5, columns=3)
    t = np.arange(len(planned.joints)) / problem.rate
    for column, line in zip(planned.joints.T, joint_lines(joints).values(), strict=True):
        angles.plot(t, column, **line)
    angles.set(ylabel="joints (rad)")
    cost.plot(t[:-1], planned.cost, color=BLACK)
    cost.set(ylabel=f"{UNITS[objective]} of a step")
    clearance.plot(t, planned.clearance, color=BLACK, label="planned")
    clearance.axhline(problem.margin, color=GREY, linestyle="--", label="margin")
    clearance.set(ylabel="least singular value (m)", ylim=(0, None))
    clearance.legend()
    for axes in (angles, cost, clearance):
        axes.set(xlabel="time (s)")
    figure.legend(*angles.get_legend_handles_labels(), loc="outside upper center", ncols=4)
    figure.savefig(file, dpi=PNG_RESOLUTION)
