"""The linear filter against the joint normal law and a Kalman filter; the baselines that know the
training takes alone.
"""

import numpy as np
import pytest
from noisy_frames import noisy_frames
from numpy.random import default_rng
from numpy.testing import assert_allclose
from scipy.linalg import block_diag
from sequences import correlated

from pipeline.core.errors import ModelDomainError
from pipeline.filtering import linear
from pipeline.filtering.measurement import Measurements

DT = 0.01


def drawn(grid: int, n: int, times: list[float], seed: int):
    """A path, a prior (grid, n, grid, n), the measurements at ``times`` and a response."""
    rng = default_rng(seed)
    root = 0.01 * rng.standard_normal((grid * n, grid * n))
    prior = (root @ root.T).reshape(grid, n, grid, n)

    count = len(times)
    noise_root = 0.02 * rng.standard_normal((count, n, n))
    y, bias = rng.standard_normal((2, count, n))
    covariance = noise_root @ noise_root.swapaxes(1, 2)
    covariance += 1e-4 * np.eye(n)
    frames = Measurements("a", np.array(times), y, bias, covariance)

    response = np.eye(n) + 0.3 * rng.standard_normal((n, n))
    path = rng.standard_normal((grid, n))
    return path, prior, frames, response


def direct(path, prior, frames, response, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of the pose at step k from the joint law of poses and frames."""
    grid, n = path.shape
    so_far = (frames.t >= 0) & (frames.t <= k * DT + 1e-12)
    steps = frames.t[so_far, None] / DT
    weights = np.maximum(0, 1 - np.abs(np.arange(grid) - steps))  # of a polygon
    unbiased = frames.y - frames.bias
    innovations = unbiased[so_far] - weights @ path

    full = prior.reshape(grid * n, grid * n)
    observation = np.kron(weights, response)
    noise = block_diag(*frames.covariance[so_far])
    total = observation @ full @ observation.T + noise
    across = observation @ prior[:, :, k].reshape(grid * n, n)
    gain = np.linalg.solve(total, across).T
    mean = path[k] + gain @ innovations.ravel()
    return mean, prior[k, :, k] - gain @ across


@pytest.mark.parametrize("n", [2, 3])
def test_every_step_has_the_moments_of_the_joint_law_given_the_frames_so_far(n):
    times = [-0.004, 0.0, 0.0125, 0.03, 0.031, 0.0475, 0.09, 0.2]
    path, prior, frames, response = drawn(10, n, times, seed=n)
    (mean,), (covariance,) = linear.linear_filter(path, prior, [frames], DT, response)
    for k in range(10):
        expected, spread = direct(path, prior, frames, response, k)
        assert_allclose(mean[k], expected, rtol=1e-8)
        assert_allclose(covariance[k], spread, rtol=1e-6, atol=1e-12)

    # control: measurements without the response
    (without_response,), _ = linear.linear_filter(path, prior, [frames], DT)
    assert np.abs(without_response - mean)[1:].max() > 1e-3
    with pytest.raises(ModelDomainError, match="prior covariance"):
        linear.linear_filter(path, -prior, [frames], DT)


KEEP = 0.8
STEPS = 120
SPREAD = np.array([[4.0, 1.0], [1.0, 3.0]]) * 1e-4
NOISE = np.array([[2.0, -0.5], [-0.5, 1.0]]) * 1e-5


def measured(takes: int, seed: int, noise=NOISE, keep: float = KEEP) -> np.ndarray:
    """(takes, STEPS, 2) rad of a first-order law about a path, measured with ``noise``."""
    rng = default_rng(seed)
    draws = rng.standard_normal((takes, STEPS, 2)) @ np.linalg.cholesky(SPREAD).T
    deviations = correlated(draws, keep, axis=1)
    errors = rng.multivariate_normal(np.zeros(2), noise, (takes, STEPS))
    path = np.linspace(0, 1, STEPS)
    return path[:, None] + deviations + errors


@pytest.fixture(scope="module")
def poses() -> np.ndarray:
    return measured(400, 8)


def test_the_autocorrelated_law_is_the_one_that_takes_were_drawn_with(poses):
    roots = linear.deviation_roots(poses, NOISE)
    lags = np.arange(1, 8)
    correlation = linear.autocorrelation(poses, NOISE)

    for k in (0, 50, 119):
        expected = np.cov(poses[:, k].T) - NOISE
        assert_allclose(roots[k] @ roots[k], expected, rtol=1e-9)
    expected = KEEP**lags * (1 - lags / STEPS)
    assert_allclose(correlation[lags], expected, atol=0.02)

    # control: the measurement taken for deviation
    with_noise = linear.autocorrelation(poses, 0 * NOISE)
    assert np.all(with_noise[lags] < correlation[lags] - 0.005)


def test_the_autocorrelation_of_few_takes_is_not_biased_by_their_mean():
    """Four takes: with the noise of four, not of three, the first lag would be 8 % too high."""
    takes = 4
    keep = 0.5
    noise = 0.25 * SPREAD
    first_lags = []
    for seed in range(300):
        poses = measured(takes, seed, noise, keep)
        first_lags.append(linear.autocorrelation(poses, noise)[1])
    expected = keep * (1 - 1 / STEPS)

    assert np.mean(first_lags) == pytest.approx(expected, rel=0.03)


def test_the_autocorrelated_filter_is_calibrated_and_without_measurements_the_training_mean(
    poses,
):
    true = measured(100, 6, 0 * NOISE)
    k = np.arange(0, STEPS, 3)
    rng = default_rng(5)

    def filtered(noise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        frames = noisy_frames(true, k, DT, noise, rng)
        return linear.autocorrelated_filter(poses, NOISE, frames, DT)

    means, covariances = filtered(NOISE)
    error = means - true
    variances = np.diagonal(covariances, axis1=2, axis2=3)
    inside = np.abs(error) <= np.sqrt(variances)
    square = np.mean(error**2)

    assert covariances.shape == (*true.shape, 2)
    assert np.mean(inside) == pytest.approx(0.683, abs=0.02)
    assert square == pytest.approx(variances.mean(), rel=0.06)
    assert square < 0.4 * np.mean((poses.mean(axis=0) - true) ** 2)

    # control: frames of no information leave the training mean and covariance
    blind, spread = filtered(1e6 * NOISE)
    assert_allclose(blind[0], poses.mean(axis=0), atol=1e-3)
    assert_allclose(spread[0, 50] + NOISE, np.cov(poses[:, 50].T), rtol=1e-3)


@pytest.mark.parametrize("keep", [0.0, 0.95])
def test_baselines_predict_as_well_as_the_law_allows(keep):
    noise = 4e-6 * np.eye(2)
    training = measured(300, 1, noise, keep)
    poses = measured(300, 2, noise, keep)
    recorded = SPREAD + noise
    # variance less the part that the measured pose before tells
    gain = keep**2 * SPREAD @ np.linalg.solve(recorded, SPREAD)

    predicted = linear.baseline_predictions(training, poses, noise)

    for name, covariance in (("none", recorded), ("memory", recorded - gain)):
        errors, covariances = predicted[name]
        total = np.trace(covariance)
        assert np.mean(errors**2) == pytest.approx(total / 2, rel=0.12)
        told = np.trace(covariances.mean(axis=0))
        assert told == pytest.approx(total, rel=0.12)
