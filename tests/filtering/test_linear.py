"""The linear filter, against a direct solution of the joint normal law and a Kalman filter; of the
pose of the tip against the joints that it is the pose of."""

from __future__ import annotations

import numpy as np
import pytest
from space_arms import LWR4

from pipeline.arm.model import chain_of
from pipeline.core.errors import ModelDomainError
from pipeline.filtering.linear import best_linear
from pipeline.filtering.measurement import Measurements

DT = 0.01
CHAIN = chain_of(LWR4)


def drawn(grid: int, n: int, times: list[float], seed: int):
    """A path, a prior (grid, n, grid, n), the measurements at ``times`` and a response."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((grid * n, grid * n)) * 0.01
    prior = (root @ root.T).reshape(grid, n, grid, n)
    noise = rng.standard_normal((len(times), n, n)) * 0.02
    frames = Measurements(
        "a",
        np.array(times),
        rng.standard_normal((len(times), n)),
        rng.standard_normal((len(times), n)),
        noise @ noise.swapaxes(1, 2) + 1e-4 * np.eye(n),
    )
    response = np.eye(n) + 0.3 * rng.standard_normal((n, n))
    return rng.standard_normal((grid, n)), prior, frames, response


def direct(path, prior, frames, response, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of the pose at step k from the joint law of poses and frames."""
    grid, n = path.shape
    looks, residual, noise = [], [], []
    for j in np.flatnonzero((frames.t >= 0) & (frames.t <= k * DT + 1e-12)):
        weights = np.interp(np.arange(grid), [0], [0.0])
        at = frames.t[j] / DT
        low = min(int(np.floor(at + 1e-9)), grid - 2)
        weights[low], weights[low + 1] = 1 - (at - low), at - low
        looks.append(np.kron(weights, response))
        residual.append(frames.y[j] - frames.bias[j] - weights @ path)
        noise.append(frames.covariance[j])
    full = prior.reshape(grid * n, grid * n)
    here = slice(k * n, (k + 1) * n)
    if not looks:
        return path[k], full[here, here]
    looks = np.concatenate(looks)
    total = looks @ full @ looks.T
    for j, each in enumerate(noise):
        total[j * n : (j + 1) * n, j * n : (j + 1) * n] += each
    gain = np.linalg.solve(total, looks @ full[:, here]).T
    moved = gain @ np.concatenate(residual)
    return path[k] + moved, full[here, here] - gain @ looks @ full[:, here]


@pytest.mark.parametrize("n", [2, 3])
def test_every_step_has_the_moments_of_the_joint_law_given_the_frames_so_far(n):
    times = [-0.004, 0.0, 0.0125, 0.03, 0.031, 0.0475, 0.09, 0.2]
    path, prior, frames, response = drawn(10, n, times, seed=n)
    mean, covariance = best_linear(path, prior, frames, DT, CHAIN, response)
    for k in range(10):
        expected, spread = direct(path, prior, frames, response, k)
        np.testing.assert_allclose(mean[k], expected, rtol=1e-8)
        np.testing.assert_allclose(covariance[k], spread, rtol=1e-6, atol=1e-12)
    # control: a camera without the response is another
    other, _ = best_linear(path, prior, frames, DT, CHAIN)
    assert np.abs(other - mean)[1:].max() > 1e-3


def test_of_a_first_order_law_it_is_the_kalman_filter():
    grid, n, keep = 40, 3, 0.9
    spread = np.array([[4.0, 1.0, 0.0], [1.0, 3.0, -1.0], [0.0, -1.0, 2.0]]) * 1e-4
    steps = np.arange(grid)
    prior = np.einsum("kl,ij->kilj", keep ** np.abs(steps[:, None] - steps), spread)
    path, _, frames, _ = drawn(grid, n, [0.033, 0.066, 0.1, 0.133, 0.3], seed=7)
    mean, covariance = best_linear(path, prior, frames, DT, CHAIN)
    due, _ = frames.schedule(grid - 1, DT)
    # the poses before and after a step
    state, known = np.zeros(2 * n), np.tile(spread, (2, 2))
    move = np.block([[np.zeros((n, n)), np.eye(n)], [np.zeros((n, n)), keep * np.eye(n)]])
    added = np.zeros((2 * n, 2 * n))
    added[n:, n:] = (1 - keep**2) * spread
    for k in range(grid):
        if k > 0:
            state, known = move @ state, move @ known @ move.T + added
        for j, share in due.get(k, ()):
            looks = np.hstack([(1 - share) * np.eye(n), share * np.eye(n)])
            point = (1 - share) * path[k - 1] + share * path[k]
            gain = np.linalg.solve(looks @ known @ looks.T + frames.covariance[j], looks @ known).T
            state = state + gain @ (frames.y[j] - frames.bias[j] - point - looks @ state)
            known = known - gain @ looks @ known
        np.testing.assert_allclose(mean[k] - path[k], state[n:], rtol=1e-8, atol=1e-12)
        np.testing.assert_allclose(covariance[k], known[n:, n:], rtol=1e-7, atol=1e-14)


def test_a_prior_that_is_no_covariance_is_refused():
    path, prior, frames, response = drawn(6, 2, [0.01, 0.03], seed=1)
    with pytest.raises(ModelDomainError, match="prior covariance"):
        best_linear(path, -prior, frames, DT, CHAIN, response)


def test_by_the_pose_of_the_tip_it_is_the_filter_of_the_joints_seen_through_the_jacobian():
    """Six rows of the six joints before the last say of small deviations what the joints would."""
    rng, q = np.random.default_rng(5), np.array([0.3, 0.9, -0.3, -1.6, 0.4, 1.0, 0.2])
    grid, n, size = 12, 7, 1e-4
    path = q + np.linspace(0, 0.3, grid)[:, None] * np.ones(n)
    spread = np.diag([1.0] * 6 + [0.0]) * size**2  # the last joint is known
    apart = np.abs(np.arange(grid)[:, None] - np.arange(grid))
    prior = np.einsum("kl,ij->kilj", 0.95**apart, spread)
    true = path + np.linalg.cholesky(0.95**apart) @ rng.standard_normal((grid, n)) @ (spread**0.5)
    t = DT * np.arange(grid)
    whole = CHAIN.jacobian(path)[..., :6]
    noise = (0.3 * size) ** 2 * np.eye(6)
    measured = CHAIN.pose(true)
    tip = Measurements(
        "a", t, measured, np.zeros((grid, 6)), np.tile(noise, (grid, 1, 1)), tip=True
    )
    inverse = np.linalg.inv(whole)
    known = np.zeros((grid, n, n))
    known[:, :6, :6] = inverse @ noise @ inverse.swapaxes(1, 2)
    known[:, 6, 6] = 1.0
    joints = Measurements("a", t, true, np.zeros((grid, n)), known)
    mean, covariance = best_linear(path, prior, tip, DT, CHAIN)
    expected, spread = best_linear(path, prior, joints, DT, CHAIN)
    # what is left of second order
    np.testing.assert_allclose(mean, expected, atol=2e-3 * size)
    np.testing.assert_allclose(covariance, spread, atol=1e-6 * size**2)
    # control: the prior alone is far off
    assert np.abs(path - expected)[:, :6].max() > 0.3 * size
