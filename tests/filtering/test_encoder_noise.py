"""The noise of encoders: its bias, its size and how long it lasts come back, and readings taken for
independent under it are worth what they are worth.
"""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.filtering.encoder_noise import encoder_noise

TAKES, STEPS, DT, KEEP = 400, 300, 0.01, 0.8
SPREAD = np.array([[4.0, 1.0], [1.0, 3.0]]) * 1e-6


def drawn(keep: float, seed: int = 1) -> np.ndarray:
    """(TAKES, STEPS, 2) rad errors of which a share ``keep`` is left after a step, about a bias."""
    rng = np.random.default_rng(seed)
    fresh = rng.standard_normal((TAKES, STEPS, 2)) @ np.linalg.cholesky(SPREAD).T
    errors = np.empty_like(fresh)
    errors[:, 0] = fresh[:, 0]
    for k in range(1, STEPS):
        errors[:, k] = keep * errors[:, k - 1] + np.sqrt(1 - keep**2) * fresh[:, k]
    return errors + 1e-2 * np.linspace(-1, 1, STEPS)[:, None]


@pytest.mark.parametrize("keep", [0.0, KEEP])
def test_bias_covariance_and_duration_are_those_drawn(keep):
    noise = encoder_noise(drawn(keep), DT)
    np.testing.assert_allclose(noise.bias[:, 0], 1e-2 * np.linspace(-1, 1, STEPS), atol=5e-4)
    np.testing.assert_allclose(noise.covariance, np.tile(SPREAD, (STEPS, 1, 1)), atol=6e-7)
    # the correlations of both signs of lag; a sum over 800 sequences has a standard error of 5 %
    assert noise.lasts / DT == pytest.approx((1 + keep) / (1 - keep), rel=0.15)


def test_readings_taken_for_independent_say_as_much_of_a_constant_as_they_know():
    errors = drawn(KEEP)
    noise = encoder_noise(errors, DT)
    every = 4 * np.arange(STEPS // 4)
    for places in (np.arange(STEPS), every):
        bias, covariance = noise.of_readings(DT * places)
        said = np.linalg.inv(np.linalg.inv(covariance).sum(axis=0))
        weights = said @ np.linalg.inv(covariance)
        means = np.einsum("kij,tkj->ti", weights, errors[:, places] - bias)
        np.testing.assert_allclose(np.cov(means.T), said, atol=0.25 * said.max())
    # control: as if each were independent with its own covariance
    naive = SPREAD / STEPS
    assert np.all(np.diagonal(np.cov(means.T)) > 5 * np.diagonal(naive))


def test_readings_farther_apart_than_their_errors_last_have_the_covariance_of_one():
    noise = encoder_noise(drawn(KEEP), DT)
    _, covariance = noise.of_readings(np.array([0.0, 1.0, 2.0]))
    np.testing.assert_array_equal(covariance, noise.covariance[[0, 100, 200]])
    _, crowded = noise.of_readings(np.array([0.0, 0.01, 0.02]))
    np.testing.assert_allclose(crowded, noise.lasts / DT * noise.covariance[:3])


def test_errors_of_a_shorter_stretch_are_of_their_own_size():
    errors = drawn(0.0)
    errors[:, 200:] *= 5
    noise = encoder_noise(errors, DT)
    assert noise.covariance[250, 0, 0] == pytest.approx(25 * SPREAD[0, 0], rel=0.2)
    assert noise.covariance[100, 0, 0] == pytest.approx(SPREAD[0, 0], rel=0.2)
