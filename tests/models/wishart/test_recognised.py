"""Steps that were drawn from the Wishart model under one decomposition of the Jacobian are likelier
under that one than under any other, each with its most likely dispersion.
"""

from __future__ import annotations

import numpy as np
import pytest
from oracles import READINGS as NAMED

from pipeline.models.draws import draw_steps
from pipeline.models.steps import Recorded
from pipeline.models.wishart.estimators import fit_likelihood
from pipeline.models.wishart.law import WishartModel

READINGS = list(NAMED.values())
SIGMA_B, TAKES = 0.25, 10
MEASUREMENT = 1e-7 * np.eye(3)


def log_likelihoods(chain, q, v, noise) -> np.ndarray:
    """Likelihoods of the steps by reading, at its own most likely dispersion."""
    q_next = q + np.matvec(chain.inverse_jacobian(q), v) + noise
    data = Recorded(chain, q, v, noise, ("a", "b", "c"), MEASUREMENT)
    return np.array(
        [
            WishartModel(fit_likelihood(data, reading).sigma_b, reading)
            .log_density(chain, q, v, q_next, MEASUREMENT)
            .mean()
            for reading in READINGS
        ]
    )


@pytest.mark.parametrize("true", range(len(READINGS)))
def test_a_reading_is_recognised_among_all_by_its_likelihood(chain, poses, step, true):
    rng = np.random.default_rng(true)
    q, v = np.tile(poses[:30], (TAKES, 1, 1)), np.tile(step, (30, 1))
    drawn, _ = draw_steps(WishartModel(SIGMA_B, READINGS[true]), chain, q, v, rng)
    noise = drawn - q - np.matvec(chain.inverse_jacobian(q), v)
    noise = noise + np.sqrt(MEASUREMENT[0, 0]) * rng.standard_normal(noise.shape)
    likelihood = log_likelihoods(chain, q, v, noise)
    others = np.delete(likelihood, true)
    # nats a step: of 300 steps, 15 for the nearest of the others
    assert likelihood[true] > others.max() + 0.05
