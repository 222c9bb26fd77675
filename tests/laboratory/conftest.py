"""The arm and the motion of the synthetic dataset, as its own options give them."""

import numpy as np
import pytest
from omegaconf import OmegaConf
from planar_poses import load_arm

from pipeline.arm.model import Arm
from pipeline.configuration.config import CONF
from pipeline.laboratory.options import DynamicsOptions, TrajectoryOptions

DATASET = OmegaConf.load(CONF / "dataset" / "youbot.yaml")


@pytest.fixture(scope="session")
def arm() -> Arm:
    robot = DATASET.robot
    return load_arm(robot.urdf, list(robot.joints), robot.tool, dict(robot.locked))


@pytest.fixture(scope="session")
def trajectory() -> TrajectoryOptions:
    return TrajectoryOptions(**OmegaConf.to_container(DATASET.laboratory.trajectory))


@pytest.fixture(scope="session")
def dynamics() -> DynamicsOptions:
    """With every disturbance of the dataset."""
    return DynamicsOptions(**OmegaConf.to_container(DATASET.laboratory.dynamics))


@pytest.fixture(scope="session")
def quiet() -> DynamicsOptions:
    """Without any disturbance; 200 steps a second are enough for what is smooth."""
    sizes = "length encoder_offset speed_error start jitter".split()
    silent = {f"{name}_std": 0 for name in sizes} | {"encoder_ripple": 0, "clearance": 0}
    return DynamicsOptions(rate=200.0, sway_std=(0, 0, 0), **silent)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(11)
