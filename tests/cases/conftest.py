"""Recordings of a small chain that moves and rests, a depth camera that saw some of them, and the
options of a run.
"""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.arm.chain import PlanarChain
from pipeline.cases.case import Choices, Takes
from pipeline.filtering.particle_filter import FilterOptions
from pipeline.models.kinds import options_type
from pipeline.models.noise import process_noise
from pipeline.models.steps import Recorded

STEPS, REST = 24, 6
STD = np.array([2e-3, 3e-3, 4e-3])


@pytest.fixture(scope="session")
def chain() -> PlanarChain:
    links = np.array([[0.0, 0.155], [0.0, 0.135], [0.0, 0.17]])
    return PlanarChain(
        np.zeros(2), links, np.ones(3), np.full(3, -3.0), np.full(3, 3.0), np.full(3, np.pi / 2)
    )


@pytest.fixture(scope="session")
def takes(chain) -> Takes:
    """12 takes to fit to and 4 to test on; noise at every step, ten times as much while the robot
    moves.
    """
    rng = np.random.default_rng(5)
    v = np.zeros((STEPS, 3))
    v[REST:-REST] = [0.002, -0.001, 0.02]
    moving = np.any(v, axis=1)
    poses = np.empty((16, STEPS + 1, 3))
    poses[:, 0] = [0.3, 1.5, 0.2]
    for k in range(STEPS):
        noise = rng.normal(0.0, STD * (1.0 if moving[k] else 0.1), (16, 3))
        poses[:, k + 1] = poses[:, k] + np.matvec(chain.inverse_jacobian(poses[:, k]), v[k]) + noise
    recorded = Recorded(
        chain, poses[:12, :-1], v, process_noise(chain, poses[:12], v), ("a", "b", "c")
    )
    return Takes(recorded, poses[:12], {f"test_{n}": take for n, take in enumerate(poses[12:])})


@pytest.fixture
def base() -> Choices:
    models = {
        "additive": options_type("additive")("additive", estimator="paper"),
        "wishart": options_type("wishart")(
            "wishart", estimator="paper", decomposition="by_shape", floor=0.2
        ),
        "gaussian": options_type("gaussian")("gaussian", estimator="paper", beta=0.5),
    }
    return Choices(models, FilterOptions(60), "one_step")
