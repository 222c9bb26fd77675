"""The takes of the motion capture that cases are worked out from, from the tables of the stages."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.core import contracts
from pipeline.core.columns import columns
from pipeline.core.options.dataset import Robot
from pipeline.recordings.steps import training_steps
from pipeline.studies.cases.fits import Takes


def recorded_takes(robot: Robot, rate: float) -> Takes:
    """Training and test takes as ``track`` wrote them; ``rate`` of the motion in 1/s."""
    joints = contracts.read("joints", Path("data/track"))
    _, poses = contracts.stacked(joints[joints.part == "training"], "q")
    test = {
        take: np.array(rows[columns("q", robot.joints)], order="C")
        for take, rows in joints[joints.part == "test"].groupby("take")
    }
    return Takes(training_steps(robot, rate), poses, test)
