"""The model that the peers on JAX are given is ours: the same law of one step of the same arm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from peer_process import INTERPRETER, PeerProcess
from scenario import SIGMA_B, take

from pipeline.models.wishart.decomposition import Decomposition

# what a sample's mean or covariance may be off, in its standard errors: the greatest of seventy is
# beyond it once in a thousand
BAND = 4.5


@pytest.mark.slow
@pytest.mark.skipif(not INTERPRETER.exists(), reason="the peers' environment is missing")
@pytest.mark.parametrize("arm", ["youbot", "ur5", "lwr4"])
def test_a_peer_moves_its_particles_by_the_law_of_our_model(arm):
    motion = take(4, arm)
    chain, q, command = motion.scene.chain, motion.scene.start.mean, motion.steps[2]
    with PeerProcess("jax_draws", {"count": 100_000, **motion.told()}) as draws:
        drawn = np.array(draws())

    def off(model) -> float:
        """The greatest error of the draws' mean and covariance, in standard errors."""
        centred = drawn - model.mean(chain, q, command)
        products = centred[:, :, None] * centred[:, None, :] - model.covariance(chain, q, command)
        errors = np.concatenate([centred, products.reshape(len(drawn), -1)], axis=1)
        return np.max(np.abs(errors.mean(axis=0)) / errors.std(axis=0)) * np.sqrt(len(drawn))

    model = motion.scene.model
    assert off(model) < BAND
    # neither a slightly wider perturbation nor another decomposition would pass
    assert off(replace(model, sigma_b=1.1 * SIGMA_B)) > BAND
    name = "qr" if model.decomposition.name == "pivoted_lu" else "pivoted_lu"
    assert off(replace(model, decomposition=Decomposition(name))) > BAND
