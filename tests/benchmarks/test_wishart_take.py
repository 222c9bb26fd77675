"""The model that the peers of the particle filter are given is ours: the same law of one step, the
same arm, the same frames.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenario import PLANAR, SIGMA_B, START, scene, take, youbot
from scipy.stats import multivariate_normal
from wishart_take import WishartTake

from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.law import WishartModel

# what a sample's mean or covariance may be off, in its standard errors: the greatest of twelve is
# beyond it once in ten thousand
BAND = 4.5


def off(draws: np.ndarray, model: WishartModel, v: np.ndarray) -> float:
    """The greatest error of the draws' mean and covariance under ``model``, in standard errors;
    ``draws`` (N, 3) of a step from START.
    """
    chain, q = youbot(), START.mean
    centred = draws - model.mean(chain, q, v)
    products = centred[:, :, None] * centred[:, None, :] - model.covariance(chain, q, v)
    errors = np.concatenate([centred, products.reshape(-1, 9)], axis=1)
    return float(np.max(np.abs(errors.mean(axis=0)) / (errors.std(axis=0) / np.sqrt(len(draws)))))


@pytest.mark.parametrize(
    ("law", "arm", "draws"),
    [
        ("closed form", "youbot", 100_000),
        ("Algorithm 1", "youbot", 20_000),
        ("Algorithm 1 by hand", "youbot", 100_000),
    ],
)
def test_a_peer_moves_its_particles_by_the_law_of_our_model(law, arm, draws):
    motion, model = take(12, arm), scene(arm).model
    moved = WishartTake(law, **motion.told()).step(3, np.tile(START.mean, (draws, 1)))
    v = motion.steps[2]
    assert off(moved, model, v) < BAND
    # neither a slightly wider perturbation nor another decomposition would pass
    assert off(moved, replace(model, sigma_b=1.1 * SIGMA_B), v) > BAND
    for name in {*PLANAR.values(), "qr"} - {PLANAR[arm]}:
        assert off(moved, replace(model, decomposition=Decomposition(name)), v) > BAND


def test_a_peers_arm_has_our_jacobian():
    q = START.mean + np.random.default_rng(1).uniform(-0.5, 0.5, (50, 3))
    np.testing.assert_allclose(
        WishartTake("closed form", **take(3).told()).jacobian(q), youbot().jacobian(q), atol=1e-15
    )


def test_a_peer_weighs_its_particles_as_we_do():
    motion = take(12)
    stated = WishartTake("closed form", **motion.told())
    q = START.mean + np.random.default_rng(2).uniform(-0.1, 0.1, (50, 3))
    assert sorted(stated.y) == [3, 6, 9, 12]
    for frame, k in enumerate(stated.y):
        observed = multivariate_normal(
            motion.measurements.y[frame], motion.measurements.covariance[frame]
        )
        # up to the constant of the normal density
        np.testing.assert_allclose(
            np.diff(stated.log_likelihood(k, q)), np.diff(observed.logpdf(q)), rtol=1e-9
        )
