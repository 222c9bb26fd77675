"""The forward form's density with measurement noise: against samples, the plain density, and finer rules."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.motion.gaussian_forward import sample_inverse_action
from pipeline.motion.gaussian_forward_blur import blurred_log_density
from pipeline.motion.gaussian_forward_density import action_log_density

MEASUREMENT = np.array([[0.6, -0.6, 0.0], [-0.6, 1.5, -0.9], [0.0, -0.9, 1.7]]) * 1e-6
POSE = np.array([0.4, 1.7, -0.3])


def log_density(chain, pose, v, y, std, measurement, **nodes) -> np.ndarray:
    y = np.atleast_2d(y)
    v, jacobian = np.broadcast_to(v, y.shape), np.broadcast_to(chain.jacobian(pose), (len(y), 3, 3))
    return blurred_log_density(y, v, jacobian, np.full(len(y), std**2), measurement, **nodes)


@pytest.mark.parametrize(("std", "speed", "measured"), [(0.05, 1.0, 30.0), (0.3, 1.0, 30.0), (0.3, 0.03, 1.0), (1.0, 0.3, 10.0)])
def test_the_density_is_the_mean_of_the_noises_over_drawn_steps(chain, step, std, speed, measured):
    """p(y) = E N(y − x; C) over draws of x, an average that depends on no density of x."""
    rng = np.random.default_rng(1)
    v, noise = speed * step, measured * MEASUREMENT
    jacobian = np.broadcast_to(chain.jacobian(POSE), (400_000, 3, 3))
    x = sample_inverse_action(jacobian, v, np.full(len(jacobian), std**2), rng)
    points = x[:6] + rng.multivariate_normal(np.zeros(3), noise, 6)
    root = np.linalg.inv(np.linalg.cholesky(noise))

    def excess(variance_factor: float) -> np.ndarray:
        found = np.exp(log_density(chain, POSE, v, points, variance_factor * std, noise))
        result = []
        for y, density in zip(points, found, strict=True):
            kernels = np.exp(-0.5 * np.sum(((y - x) @ root.T) ** 2, axis=1)) * np.linalg.det(root) / (2 * np.pi) ** 1.5
            error = np.hypot(kernels.std() / np.sqrt(len(kernels)), 0.005 * density)
            result.append(abs(kernels.mean() - density) / error)
        return np.array(result)

    assert excess(1.0).max() < 4
    # control: a standard deviation 30 % off
    assert excess(1.3).max() > 5


def test_measurement_noise_that_vanishes_leaves_the_exact_density(chain, poses, step):
    jacobian, s = chain.jacobian(poses), np.full(len(poses), 0.1**2)
    v = np.broadcast_to(step, poses.shape)
    x = sample_inverse_action(jacobian, v, s, np.random.default_rng(2))
    exact = action_log_density(x, v, jacobian, s)
    gaps = [np.abs(blurred_log_density(x, v, jacobian, s, share * MEASUREMENT) - exact).max() for share in (1e-2, 1e-6)]
    # what the blur itself changes is of its own order; what stays is the quadrature's error
    assert gaps[0] < 0.05 and gaps[1] < 0.02
    assert np.abs(action_log_density(x, v, jacobian, 1.2 * s) - exact).max() > 0.05


def test_a_command_that_vanishes_leaves_the_measurement_noise(chain, poses, step):
    y = np.random.default_rng(3).multivariate_normal(np.zeros(3), MEASUREMENT, len(poses))
    jacobian, s = chain.jacobian(poses), np.full(len(poses), 0.05**2)
    squared = np.sum(y * np.linalg.solve(MEASUREMENT, y.T).T, axis=1)
    noise = -0.5 * squared - 1.5 * np.log(2 * np.pi) - 0.5 * np.linalg.slogdet(MEASUREMENT)[1]
    shares = [np.broadcast_to(share * step, y.shape) for share in (1, 1e-3, 1e-5)]
    gaps = [np.median(np.abs(blurred_log_density(y, v, jacobian, s, MEASUREMENT) - noise)) for v in shares]
    assert gaps[0] > 1 and gaps[1] < 0.1 and gaps[2] < 0.03


@pytest.mark.parametrize(("std", "usual", "worst"), [(0.01, 2e-3, 3e-3), (0.1, 2e-3, 0.2), (1.0, 4e-3, 0.2)])
def test_the_quadrature_converges(chain, poses, step, std, usual, worst):
    """For steps that the law draws; ``worst`` is for commands far below the measurement noise."""
    rng = np.random.default_rng(4)
    v = np.geomspace(0.01, 1.0, 40)[:, None] * step
    jacobian, s = chain.jacobian(poses[:40]), np.full(40, std**2)
    y = sample_inverse_action(jacobian, v, s, rng) + rng.multivariate_normal(np.zeros(3), MEASUREMENT, 40)
    fine = blurred_log_density(y, v, jacobian, s, MEASUREMENT, nodes=(25, 25))
    gaps = np.abs(blurred_log_density(y, v, jacobian, s, MEASUREMENT) - fine)
    assert np.median(gaps) < usual and gaps.max() < worst
    # control: too few nodes
    assert np.abs(blurred_log_density(y, v, jacobian, s, MEASUREMENT, nodes=(4, 4)) - fine).max() > 2 * worst


def test_far_outliers_have_finite_densities(chain, poses, step):
    for std in (0.01, 0.3):
        for share in (-100.0, 100.0):
            y = share * np.matvec(chain.inverse_jacobian(poses), step)
            found = blurred_log_density(y, np.broadcast_to(step, y.shape), chain.jacobian(poses), np.full(len(y), std**2), MEASUREMENT)
            assert np.all(np.isfinite(found)) and np.all(found < 0)


def test_one_step_is_as_one_of_many(chain, poses, step):
    y = 1.1 * np.matvec(chain.inverse_jacobian(poses), step)
    v, s = np.broadcast_to(step, y.shape), np.full(len(y), 0.01)
    many = blurred_log_density(y, v, chain.jacobian(poses), s, MEASUREMENT)
    one = blurred_log_density(y[7:8], v[7:8], chain.jacobian(poses[7:8]), s[7:8], MEASUREMENT)
    # the ascent to the mode ends for all of a block at once
    assert one[0] == pytest.approx(many[7], abs=1e-3)
