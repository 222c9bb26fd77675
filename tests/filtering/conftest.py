from __future__ import annotations

import numpy as np
import pytest
from planar_poses import chain

from pipeline.arm.chain import PlanarChain

__all__ = ["chain"]


@pytest.fixture(scope="session")
def free() -> PlanarChain:
    """A chain whose joint limits are out of the way, and whose elbow is bent at a right angle where
    the joints are at zero.
    """
    return PlanarChain(
        origin=np.zeros(2),
        links=np.array([[0.0, 0.155], [0.135, 0.0], [0.0, 0.17]]),
        signs=np.ones(3),
        lower=np.full(3, -50.0),
        upper=np.full(3, 50.0),
        max_speed=np.ones(3),
    )
