"""The process noise of recorded joint angles, its sign, and its takes_moments."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.errors import ModelDomainError
from pipeline.models.noise import (
    measurement_covariance,
    process_noise,
    recorded_deviation,
    rest_covariance,
)
from pipeline.statistics.takes import takes_moments


def test_the_noise_put_into_a_motion_comes_out_measured_minus_nominal(chain):
    rng = np.random.default_rng(2)
    v = rng.uniform(-0.02, 0.02, (6, 3)) * [0.1, 0.1, 1]
    noise = 0.005 * rng.standard_normal((4, 6, 3))
    q = np.empty((4, 7, 3))
    q[:, 0] = [0.3, 1.6, -0.2]
    for k in range(6):
        q[:, k + 1] = q[:, k] + chain.inverse_jacobian(q[:, k]) @ v[k] + noise[:, k]
    np.testing.assert_allclose(process_noise(chain, q, v), noise, atol=1e-15)


def test_the_measurement_noise_is_what_moves_at_rest():
    rng = np.random.default_rng(4)
    noise = rng.multivariate_normal(np.zeros(3), np.diag([1.0, 4.0, 9.0]), (400, 8))
    v = np.zeros((8, 3))
    v[3:6, 1] = 0.01
    noise[:, 3:6] *= 10
    np.testing.assert_allclose(measurement_covariance(noise, v), np.diag([1.0, 4.0, 9.0]), atol=0.5)
    # control: with the steps that move it would be far larger
    assert np.trace(takes_moments(noise)[1].mean(axis=0)) > 30 * 14 / 2
    with pytest.raises(ModelDomainError, match="never rests"):
        measurement_covariance(noise, np.ones((8, 3)))


def test_the_recorded_spread_is_that_of_the_noise_or_of_the_angles_as_the_realisations_are():
    rng = np.random.default_rng(6)
    q, noise = rng.normal(0.0, 0.1, (30, 6, 3)), rng.normal(0.0, 0.01, (30, 5, 3))
    of_step, of_run = (recorded_deviation(q, noise, mode) for mode in ("one_step", "free_running"))
    assert np.all(of_step[0] == 0)
    np.testing.assert_allclose(
        of_step[1:], np.sqrt(np.diagonal(takes_moments(noise)[1], axis1=1, axis2=2))
    )
    np.testing.assert_allclose(of_run, np.sqrt(np.diagonal(takes_moments(q)[1], axis1=1, axis2=2)))


def test_what_a_take_is_off_all_through_is_in_poses_at_rest_and_in_no_noise_of_a_step():
    rng, v = np.random.default_rng(12), np.zeros((30, 3))
    v[10:20, 0] = 0.01
    white, constant = np.array([1.0, 2.0, 1.0]), np.array([3.0, 1.0, 0.0])
    q = white * rng.standard_normal((500, 31, 3)) + constant * rng.standard_normal((500, 1, 3))
    q[:, 10:20] *= 10
    at_rest = np.diag(rest_covariance(q, v))
    np.testing.assert_allclose(at_rest, white**2 + constant**2, rtol=0.2)
    # control: the steps' noise tells the white part alone
    steps = np.diff(q, axis=1)[:, :9]
    np.testing.assert_allclose(
        np.diag(measurement_covariance(steps, v[:9])) / 2, white**2, rtol=0.2
    )
