"""The youBot, its motion and its disturbances as the dataset has them, and the published values."""

from __future__ import annotations

import pytest
from omegaconf import OmegaConf

from pipeline.arm.chain import PlanarChain
from pipeline.arm.model import load_arm
from pipeline.cases.verdict import read_claims
from pipeline.core.config import CONF
from pipeline.laboratory.options import TrajectoryOptions
from pipeline.studies.published import Published, published

YOUBOT = OmegaConf.load(CONF / "dataset/youbot.yaml")


@pytest.fixture(scope="session")
def chain() -> PlanarChain:
    robot = YOUBOT.robot
    return load_arm(robot.urdf, list(robot.joints), robot.tool, dict(robot.locked)).chain


@pytest.fixture(scope="session")
def motion() -> TrajectoryOptions:
    return TrajectoryOptions(**OmegaConf.to_container(YOUBOT.laboratory.trajectory))


@pytest.fixture(scope="session")
def stated() -> Published:
    return published(read_claims())
