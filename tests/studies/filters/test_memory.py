"""Spread and memory of the training takes."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.studies.filters.memory import first_order, memory, remembered, spreads

KEEP, TAKES, STEPS = 0.8, 400, 120
SPREAD = np.array([[4.0, 1.0], [1.0, 3.0]]) * 1e-4
NOISE = np.array([[2.0, -0.5], [-0.5, 1.0]]) * 1e-5


@pytest.fixture(scope="module")
def poses() -> np.ndarray:
    """Takes of two joints of a first-order law about a path, measured with noise."""
    rng = np.random.default_rng(8)
    root = np.linalg.cholesky(SPREAD)
    off = np.empty((TAKES, STEPS, 2))
    off[:, 0] = rng.standard_normal((TAKES, 2)) @ root.T
    for k in range(1, STEPS):
        fresh = np.sqrt(1 - KEEP**2) * rng.standard_normal((TAKES, 2)) @ root.T
        off[:, k] = KEEP * off[:, k - 1] + fresh
    noise = rng.multivariate_normal(np.zeros(2), NOISE, (TAKES, STEPS))
    return np.linspace(0, 1, STEPS)[:, None] + off + noise


def test_the_law_has_the_takes_spread_less_the_measurements_at_each_step(poses):
    law = remembered(spreads(poses, NOISE), memory(poses, NOISE))
    for k in (0, 50, 119):
        sample = np.cov(poses[:, k].T)
        np.testing.assert_allclose(law[k, :, k], sample - NOISE, rtol=1e-9)


def test_the_memory_is_the_correlation_that_the_takes_were_drawn_with(poses):
    lags = np.arange(1, 8)
    expected = KEEP**lags * (1 - lags / STEPS)
    np.testing.assert_allclose(memory(poses, NOISE)[lags], expected, atol=0.02)
    # control: the measurement taken for deviation
    assert np.all(memory(poses, 0 * NOISE)[lags[:2]] < expected[:2] - 0.02)


def test_the_law_is_a_covariance(poses):
    law = remembered(spreads(poses[:5], NOISE), memory(poses[:5], 0 * NOISE))
    size = law.shape[0] * law.shape[1]
    assert np.linalg.eigvalsh(law.reshape(size, size)).min() > -1e-12


def test_the_first_order_memory_is_a_power_that_agrees_a_frame_later():
    correlation = np.cos(np.arange(10) / 8)
    power = first_order(correlation, 3)
    assert power[0] == 1 and power[3] == pytest.approx(correlation[3])
    np.testing.assert_allclose(power[1:] / power[:-1], power[1])
    # what has turned over by then is nothing
    assert np.all(first_order(-correlation, 3)[1:] == 0)
