"""The recorded steps that the motion models are fitted to, from the tables of the stages before."""

from __future__ import annotations

from pathlib import Path

from pipeline import contracts, schema
from pipeline.arm.model import load_arm
from pipeline.motion.estimation import Recorded

INGEST, TRACK, NOISE = Path("data/ingest"), Path("data/track"), Path("data/noise")


def training_steps(robot: schema.Robot, rate: float) -> Recorded:
    """Poses before each step, commanded steps and process noise of the training takes; ``rate`` of the motion in 1/s."""
    joints = contracts.read("joints", TRACK)
    _, q = contracts.stacked(joints[joints.part == "training"], ["q1", "q2", "q3"])
    v = contracts.read("trajectory", INGEST)[["vx", "vz", "vphi"]].to_numpy()[:-1] / rate
    _, noise = contracts.stacked(contracts.read("process_noise", NOISE), ["w1", "w2", "w3"])
    return Recorded(load_arm(robot.urdf, robot.joints, robot.tool, robot.locked).chain, q[:, :-1], v, noise)
