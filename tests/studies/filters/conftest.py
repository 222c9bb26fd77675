"""A laboratory whose motion takes a second."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.arm.model import load_arm
from pipeline.laboratory.options import ClockOptions, DynamicsOptions, TrajectoryOptions
from pipeline.studies.survey.robots import Laboratory, NoiseLaw

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="session")
def laboratory() -> Laboratory:
    joints = tuple(f"arm_joint_{number}" for number in (2, 3, 4))
    chain = load_arm(
        ROOT / "pipeline/arm/youbot.urdf",
        list(joints),
        "arm_tool",
        {"arm_joint_1": 2.967, "arm_joint_5": 2.923},
    ).chain
    way = TrajectoryOptions(
        folded=(2.52, -4.65, 0.56),
        extended=(2.22, -4.35, 0.86),
        duration=1.0,
        rest=0.05,
        ramp=0.1,
    )
    camera = NoiseLaw(np.array([0.0, 1.0]), np.zeros((2, 3)), np.tile(1e-4 * np.eye(3), (2, 1, 1)))
    noise = 1e-7 * np.eye(3)
    return Laboratory(chain, joints, DynamicsOptions(), {"": way}, ClockOptions(), noise, camera, 2)
