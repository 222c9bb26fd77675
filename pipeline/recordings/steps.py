"""The recorded steps that the motion models are fitted to, from the tables of the stages before."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.arm.model import chain_of
from pipeline.core import contracts
from pipeline.core.options.dataset import Motion, Robot
from pipeline.models.steps import Recorded
from pipeline.recordings.commands import commanded_steps

MOTION, TRACK = Path("data/ingest/motion"), Path("data/track")


def training_steps(robot: Robot, motion: Motion) -> Recorded:
    """Poses before each step, commanded steps and process noise of the training takes of
    ``motion``.
    """
    joints = contracts.read("joints", TRACK)
    _, q = contracts.stacked(joints[joints.part == "training"], "q")
    v = commanded_steps(contracts.read("trajectory", MOTION), motion.rate)
    _, noise = contracts.stacked(contracts.read("process_noise", TRACK), "w")
    stated = motion.pose_noise
    known = None if stated is None else 2 * stated**2 * np.eye(len(robot.joints))
    return Recorded(chain_of(robot), q[:, :-1], v, noise, tuple(robot.joints), known)
