"""A planar chain with the arm's link lengths, poses along its motion, and a commanded step."""

from __future__ import annotations

import numpy as np
import pytest
from oracles import READINGS, pivot_shares

from pipeline.arm.chain import PlanarChain


@pytest.fixture(scope="session")
def chain() -> PlanarChain:
    links = np.array([[0.0, 0.155], [0.0, 0.135], [0.0, 0.17]])
    return PlanarChain(
        np.zeros(2),
        links,
        np.array([1.0, 1.0, -1.0]),
        np.full(3, -3.0),
        np.full(3, 3.0),
        np.full(3, np.pi / 2),
    )


@pytest.fixture(scope="session")
def poses(chain) -> np.ndarray:
    """(200, 3) joint angles in rad, elbow between 65 and 135 degrees, heading anywhere but where LU
    without pivoting of :data:`oracles.READINGS` has a small pivot.
    """
    rng = np.random.default_rng(0)
    q = np.stack(
        [rng.uniform(-2, 2, 200), np.deg2rad(rng.uniform(65, 135, 200)), rng.uniform(-2, 2, 200)],
        axis=-1,
    )
    plain = [reading for reading in READINGS.values() if reading.name == "lu"]
    for pose in q:
        while min(pivot_shares(chain.jacobian(pose), reading).min() for reading in plain) < 0.1:
            pose[[0, 2]] += 0.4
    return q


@pytest.fixture(scope="session")
def step() -> np.ndarray:
    return np.array([0.004, -0.003, 0.03])
