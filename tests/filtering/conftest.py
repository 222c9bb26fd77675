from __future__ import annotations

import numpy as np
import pytest
from planar_poses import chain
from sliding_arm import sliding_arm

from pipeline.arm.chain import PlanarChain
from pipeline.arm.serial import SerialChain

__all__ = ["chain"]


@pytest.fixture(scope="session")
def free() -> SerialChain:
    """An arm whose joints are its task, J = I, its limits out of the way."""
    return sliding_arm(np.eye(3), np.full(3, -50.0), np.full(3, 50.0))


@pytest.fixture(scope="session")
def elbow() -> PlanarChain:
    """A chain with its elbow at a right angle where the joints are at zero, without limits."""
    links = np.array([[0.0, 0.155], [0.135, 0.0], [0.0, 0.17]])
    limit = np.full(3, 50.0)
    return PlanarChain(np.zeros(2), links, np.ones(3), -limit, limit, np.ones(3))
