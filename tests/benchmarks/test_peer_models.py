"""The models that peers of the filter are given are ours: the same law of one step, the same arm,
the same measurements.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scenario import SIGMA_B, Take, take
from scipy.stats import multivariate_normal
from standard_errors import largest_score
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


def greatest_error(draws: np.ndarray, model: WishartModel, motion: Take) -> float:
    """Greatest error of the mean and covariance of ``draws`` (N, n) of the third step, from the
    start, under ``model``, in standard errors.
    """
    step = motion.scene.chain, motion.scene.start.mean, motion.steps[2]
    centred = draws - model.mean(*step)
    products = centred[:, :, None] * centred[:, None, :]
    of_covariance = largest_score(products, model.covariance(*step))
    return max(largest_score(centred), of_covariance)


@pytest.mark.slow
@pytest.mark.parametrize("arm, law, draws", CASES)
def test_a_peer_has_our_arm_and_moves_its_particles_by_the_law_of_our_model(
    arm,
    law,
    draws,
):
    motion = take(12, arm)
    chain, model, start = motion.scene[:3]
    peer = take_of(law, **motion.plain())
    around = np.random.default_rng(1).uniform(-0.5, 0.5, (50, len(start.mean)))
    q = start.mean + around
    jacobian = peer.jacobian(q)
    if arm != "youbot":  # the particles are last
        jacobian = np.moveaxis(jacobian, -1, 0)
    assert_allclose(jacobian, chain.jacobian(q), atol=1e-9)

    moved = peer.step(3, np.tile(start.mean, (draws, 1)))

    assert greatest_error(moved, model, motion) < BAND
    # neither a slightly wider perturbation nor another decomposition would pass
    wider = replace(model, sigma_b=1.1 * SIGMA_B)
    another = Decomposition("qr" if arm == "youbot" else "pivoted_lu")
    for wrong in (wider, replace(model, decomposition=another)):
        assert greatest_error(moved, wrong, motion) > BAND


def test_a_peer_weighs_its_particles_as_we_do():
    motion = take(12)
    peer = take_of("closed form", **motion.plain())
    q = motion.scene.start.mean + np.random.default_rng(2).uniform(-0.1, 0.1, (50, 3))
    seen = motion.measurements

    assert sorted(peer.y) == [3, 6, 9, 12]
    for k, y, covariance in zip(peer.y, seen.y, seen.covariance, strict=True):
        # up to the constant of the normal density
        ours = np.diff(multivariate_normal(y, covariance).logpdf(q))
        theirs = np.diff(peer.log_likelihood(k, q))
        assert_allclose(theirs, ours, rtol=1e-9)
