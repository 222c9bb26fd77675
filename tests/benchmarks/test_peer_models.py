"""The models that peers of the filter are given are ours: the same law of one step, the same arm,
the same measurements.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenario import SIGMA_B, take
from scipy.stats import multivariate_normal
from takes import take_of

from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.law import WishartModel

BAND = 4.5  # standard errors: the greatest of seventy is beyond it once in a thousand
CASES = [
    ("youbot", "closed form", 100_000),
    ("youbot", "Algorithm 1", 20_000),
    ("ur5", "closed form", 100_000),
    ("lwr4", "closed form", 100_000),
]


def peer(arm: str, law: str):
    return take_of(law, **take(12, arm).plain())


def off(draws: np.ndarray, model: WishartModel, arm: str) -> float:
    """The greatest error of the draws' mean and covariance under ``model``, in standard errors;
    ``draws`` (N, n) of the third step, from the start.
    """
    motion = take(12, arm)
    chain, q, command = motion.scene.chain, motion.scene.start.mean, motion.steps[2]
    centred = draws - model.mean(chain, q, command)
    products = centred[:, :, None] * centred[:, None, :] - model.covariance(chain, q, command)
    errors = np.concatenate([centred, products.reshape(len(draws), -1)], axis=1)
    return float(np.max(np.abs(errors.mean(axis=0)) / (errors.std(axis=0) / np.sqrt(len(draws)))))


@pytest.mark.slow
@pytest.mark.parametrize("arm, law, draws", CASES)
def test_a_peer_moves_its_particles_by_the_law_of_our_model(arm, law, draws):
    motion = take(12, arm)
    model = motion.scene.model
    moved = peer(arm, law).step(3, np.tile(motion.scene.start.mean, (draws, 1)))
    assert off(moved, model, arm) < BAND
    # neither a slightly wider perturbation nor another decomposition would pass
    assert off(moved, replace(model, sigma_b=1.1 * SIGMA_B), arm) > BAND
    other = "qr" if arm == "youbot" else "pivoted_lu"
    assert off(moved, replace(model, decomposition=Decomposition(other)), arm) > BAND


@pytest.mark.parametrize("arm, law, draws", CASES)
def test_a_peers_arm_has_our_jacobian(arm, law, draws):
    chain, start = take(12, arm).scene.chain, take(12, arm).scene.start.mean
    q = start + np.random.default_rng(1).uniform(-0.5, 0.5, (50, len(start)))
    jacobian = peer(arm, law).jacobian(q)
    jacobian = jacobian if arm == "youbot" else np.moveaxis(jacobian, -1, 0)
    np.testing.assert_allclose(jacobian, chain.jacobian(q), atol=1e-9)


def test_a_peer_weighs_its_particles_as_we_do():
    motion, stated = take(12), peer("youbot", "closed form")
    q = motion.scene.start.mean + np.random.default_rng(2).uniform(-0.1, 0.1, (50, 3))
    assert sorted(stated.y) == [3, 6, 9, 12]
    for frame, k in enumerate(stated.y):
        y, covariance = motion.measurements.y[frame], motion.measurements.covariance[frame]
        # up to the constant of the normal density
        ours = np.diff(multivariate_normal(y, covariance).logpdf(q))
        np.testing.assert_allclose(np.diff(stated.log_likelihood(k, q)), ours, rtol=1e-9)
