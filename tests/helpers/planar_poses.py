"""A planar chain with the arm's link lengths, poses along its motion, and a commanded step."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.arm.chain import PlanarChain
from pipeline.arm.model import Arm, arm_of
from pipeline.core.options.dataset import Robot

LENGTHS = np.array([0.155, 0.135, 0.17])  # m


def planar_chain(x=0.0, z=0.0, signs=(1.0, 1.0, 1.0), limit=3.0) -> PlanarChain:
    """The chain of these lengths with its first joint at ``x``, ``z``, straight up at zero."""
    links = np.stack([np.zeros(3), LENGTHS], axis=1)
    ends = np.full(3, limit)
    return PlanarChain(
        np.array([x, z]),
        links,
        np.array(signs),
        -ends,
        ends,
        np.full(3, np.pi / 2),
    )


@pytest.fixture(scope="session")
def chain() -> PlanarChain:
    return planar_chain(signs=(1.0, 1.0, -1.0))


@pytest.fixture(scope="session")
def poses() -> np.ndarray:
    """(200, 3) joint angles in rad, elbow between 65 and 135 degrees, heading anywhere."""
    rng = np.random.default_rng(0)
    return np.stack(
        [
            rng.uniform(-2, 2, 200),
            np.deg2rad(rng.uniform(65, 135, 200)),
            rng.uniform(-2, 2, 200),
        ],
        axis=-1,
    )


@pytest.fixture(scope="session")
def step() -> np.ndarray:
    return np.array([0.004, -0.003, 0.03])


def load_arm(
    urdf: str | Path,
    joints: list[str],
    tool: str | None,
    locked: dict,
) -> Arm:
    """Arm of three parallel ``joints`` of a URDF."""
    return arm_of(Robot(str(urdf), list(joints), tool, locked=dict(locked), plane=True))
