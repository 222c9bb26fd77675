"""The recorded steps that the motion models are fitted to, from the tables of the stages before."""

from __future__ import annotations

from pathlib import Path

from pipeline.arm.model import arm_of
from pipeline.core import contracts
from pipeline.core.options.dataset import Robot
from pipeline.models.steps import Recorded
from pipeline.recordings.commands import commanded_steps

MOTION, TRACK = Path("data/ingest/motion"), Path("data/track")


def training_steps(robot: Robot, rate: float) -> Recorded:
    """Poses before each step, commanded steps and process noise of the training takes; ``rate`` of
    the motion in 1/s.
    """
    joints = contracts.read("joints", TRACK)
    _, q = contracts.stacked(joints[joints.part == "training"], "q")
    v = commanded_steps(contracts.read("trajectory", MOTION), rate)
    _, noise = contracts.stacked(contracts.read("process_noise", TRACK), "w")
    return Recorded(arm_of(robot).chain, q[:, :-1], v, noise, tuple(robot.joints))
