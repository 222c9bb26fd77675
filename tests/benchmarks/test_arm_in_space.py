"""The model that the peers of the filter of an arm in space are given is ours: the same law of one
step, the same arm, the same measurements.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from arm_in_space import SpatialTake
from pinocchio_loop import PinocchioTake
from scenario import SIGMA_B, SPATIAL, robot, take
from wishart_take import WishartTake, take_of

from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.law import WishartModel

# what a sample's mean or covariance may be off, in its standard errors: the greatest of seventy is
# beyond it once in a thousand
BAND = 4.5


def by_pinocchio(arm: str) -> PinocchioTake:
    options = robot(arm)
    return PinocchioTake(options.urdf, options.tool, **take(4, arm).told())


def off(draws: np.ndarray, model: WishartModel, arm: str) -> float:
    """The greatest error of the draws' mean and covariance under ``model``, in standard errors;
    ``draws`` (N, n) of the third step, from the start.
    """
    motion = take(4, arm)
    chain, q, command = motion.scene.chain, motion.scene.start.mean, motion.steps[2]
    centred = draws - model.mean(chain, q, command)
    products = centred[:, :, None] * centred[:, None, :] - model.covariance(chain, q, command)
    errors = np.concatenate([centred, products.reshape(len(draws), -1)], axis=1)
    return float(np.max(np.abs(errors.mean(axis=0)) / (errors.std(axis=0) / np.sqrt(len(draws)))))


@pytest.mark.slow
@pytest.mark.parametrize("arm", SPATIAL)
@pytest.mark.parametrize(
    ("law", "draws"),
    [("closed form", 100_000), ("closed form, LAPACK's QR", 100_000), ("Pinocchio", 20_000)],
)
def test_a_peer_moves_its_particles_by_the_law_of_our_model(arm, law, draws):
    motion = take(4, arm)
    stated = by_pinocchio(arm) if law == "Pinocchio" else SpatialTake(law, **motion.told())
    moved = stated.step(3, np.tile(motion.scene.start.mean, (draws, 1)))
    model = motion.scene.model
    assert off(moved, model, arm) < BAND
    # neither a slightly wider perturbation nor another decomposition would pass
    assert off(moved, replace(model, sigma_b=1.1 * SIGMA_B), arm) > BAND
    assert off(moved, replace(model, decomposition=Decomposition("pivoted_lu")), arm) > BAND


@pytest.mark.parametrize("arm", SPATIAL)
def test_a_peers_arm_has_our_jacobian(arm):
    motion = take(4, arm)
    n = len(motion.scene.start.mean)
    q = motion.scene.start.mean + np.random.default_rng(1).uniform(-0.5, 0.5, (50, n))
    ours = motion.scene.chain.jacobian(q)
    vectorised = np.moveaxis(SpatialTake("closed form", **motion.told()).jacobian(q), -1, 0)
    np.testing.assert_allclose(vectorised, ours, atol=1e-14)
    loop = by_pinocchio(arm)
    np.testing.assert_allclose([loop.jacobian(pose) for pose in q], ours, atol=1e-9)


def test_who_is_told_of_an_arm_in_space_moves_one():
    assert isinstance(take_of("closed form", **take(4, "ur5").told()), SpatialTake)
    assert isinstance(take_of("closed form", **take(4).told()), WishartTake)
