"""The takes of the motion capture that cases are worked out from, from the tables of the stages."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.cases.fits import Takes
from pipeline.core import contracts
from pipeline.core.columns import columns
from pipeline.core.options.dataset import Motion, Robot
from pipeline.recordings.steps import training_steps


def recorded_takes(robot: Robot, motion: Motion) -> Takes:
    """Training and test takes of ``motion`` as ``track`` wrote them."""
    joints = contracts.read("joints", Path("data/track"))
    _, poses = contracts.stacked(joints[joints.part == "training"], "q")
    test = {
        take: np.array(rows[columns("q", robot.joints)], order="C")
        for take, rows in joints[joints.part == "test"].groupby("take")
    }
    return Takes(training_steps(robot, motion), poses, test)
