"""Spread and memory of the training takes, and the filter that knows them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import toeplitz
from space_arms import LWR4

from pipeline.arm.model import chain_of
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.memory import memory, memory_filter, remembered, spreads

KEEP, TAKES, STEPS, DT = 0.8, 400, 120, 0.01
SPREAD = np.array([[4.0, 1.0], [1.0, 3.0]]) * 1e-4
CHAIN = chain_of(LWR4)
NOISE = np.array([[2.0, -0.5], [-0.5, 1.0]]) * 1e-5


def true_poses(takes: int, seed: int) -> np.ndarray:
    """(takes, STEPS, 2) rad of a first-order law about a path."""
    rng = np.random.default_rng(seed)
    root = np.linalg.cholesky(SPREAD)
    off = np.empty((takes, STEPS, 2))
    off[:, 0] = rng.standard_normal((takes, 2)) @ root.T
    for k in range(1, STEPS):
        fresh = np.sqrt(1 - KEEP**2) * rng.standard_normal((takes, 2)) @ root.T
        off[:, k] = KEEP * off[:, k - 1] + fresh
    return np.linspace(0, 1, STEPS)[:, None] + off


@pytest.fixture(scope="module")
def poses() -> np.ndarray:
    """True poses, measured with noise."""
    noise = np.random.default_rng(9).multivariate_normal(np.zeros(2), NOISE, (TAKES, STEPS))
    return true_poses(TAKES, 8) + noise


def test_the_law_has_the_takes_spread_less_the_measurements_at_each_step(poses):
    roots, without = spreads(poses, NOISE)
    law = remembered(roots, memory(poses, NOISE))
    assert without == 0
    for k in (0, 50, 119):
        sample = np.cov(poses[:, k].T)
        np.testing.assert_allclose(law[k, :, k], sample - NOISE, rtol=1e-9)


def test_the_memory_is_the_correlation_that_the_takes_were_drawn_with(poses):
    lags = np.arange(1, 8)
    expected = KEEP**lags * (1 - lags / STEPS)
    np.testing.assert_allclose(memory(poses, NOISE)[lags], expected, atol=0.02)
    # control: the measurement taken for deviation
    assert np.all(memory(poses, 0 * NOISE)[lags[:2]] < expected[:2] - 0.02)


@pytest.mark.parametrize("share", [0.0, 1.0, 30.0])
def test_the_law_is_a_covariance_however_much_is_measurement(poses, share):
    few, noise = poses[:5], share * NOISE
    law = remembered(spreads(few, noise)[0], memory(few, noise))
    size = law.shape[0] * law.shape[1]
    assert np.linalg.eigvalsh(law.reshape(size, size)).min() > -1e-12
    # control: the measurement taken from the lag of none alone leaves no covariance
    if share > 1:
        deviation = few - few.mean(axis=0)
        products = [np.sum(deviation[:, : STEPS - lag] * deviation[:, lag:]) for lag in range(30)]
        products[0] -= 4 * STEPS * np.trace(noise)
        assert np.linalg.eigvalsh(toeplitz(products)).min() < -1e-3


def test_takes_that_are_nothing_but_measurement_have_no_spread_and_no_memory():
    noise = np.random.default_rng(4).multivariate_normal(np.zeros(2), NOISE, (50, STEPS))
    roots, without = spreads(noise, 3 * NOISE)
    assert without == 2 * STEPS and not roots.any()
    assert memory(noise, 300 * NOISE).tolist() == [1.0] + [0.0] * (STEPS - 1)


def frames(poses: np.ndarray, every: int, noise: np.ndarray) -> list[Measurements]:
    """Of each take of ``poses`` (takes, K, 2) every so many steps a measurement."""
    k = np.arange(0, STEPS, every)
    drawn = np.random.default_rng(5).multivariate_normal(np.zeros(2), noise, (len(poses), len(k)))
    covariance = np.tile(noise, (len(k), 1, 1))
    return [
        Measurements("take", DT * k, take[k] + off, np.zeros((len(k), 2)), covariance)
        for take, off in zip(poses, drawn, strict=True)
    ]


def test_the_filter_beats_none_by_what_the_law_says_and_is_calibrated(poses):
    test = true_poses(100, 6)
    means, covariances, without = memory_filter(poses, NOISE, frames(test, 3, NOISE), DT, CHAIN)
    assert without == 0 and covariances.shape == (*test.shape, 2)
    error, variances = means - test, np.diagonal(covariances, axis1=2, axis2=3)
    assert np.mean(np.abs(error) <= np.sqrt(variances)) == pytest.approx(0.683, abs=0.02)
    rms = np.sqrt(np.mean(error**2))
    assert rms == pytest.approx(np.sqrt(variances.mean()), rel=0.03)
    assert rms < 0.6 * np.sqrt(np.mean((poses.mean(axis=0) - test) ** 2))
    # control: frames that say nothing leave no filter at all
    blind, spread, _ = memory_filter(poses, NOISE, frames(test, 3, 1e6 * NOISE), DT, CHAIN)
    np.testing.assert_allclose(blind[0], poses.mean(axis=0), atol=1e-3)
    np.testing.assert_allclose(spread[0, 50] + NOISE, np.cov(poses[:, 50].T), rtol=1e-3)
