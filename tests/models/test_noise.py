"""The process noise of recorded joint angles, its sign and moments, and models at its level: each
has the recorded total variance and keeps all else it is.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from random_arm import motion, random_arm

from pipeline.core.errors import ModelDomainError
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.noise import (
    mean_covariance,
    measurement_covariance,
    process_noise,
    recorded_deviation,
    rest_covariance,
)
from pipeline.models.scaled.law import ScaledModel
from pipeline.models.steps import Recorded, at_recorded_level
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.law import WishartModel
from pipeline.statistics.takes import takes_moments

MEASUREMENT = 1e-10 * np.diag([1.0, 2.0, 3.0])
FULL = np.array([[2.0, -0.5, 0.1], [-0.5, 1.0, 0.2], [0.1, 0.2, 3.0]])
MODELS = {
    "additive": ScaledModel(1e-7 * FULL),
    "gaussian": GaussianModel(0.1, 40.0),
    "scaled": ScaledModel(1e-8 * FULL, 1e-3 * FULL),
    "wishart": WishartModel(0.1, Decomposition("pivoted_lu")),
    "wishart without a covariance": WishartModel(1.2, Decomposition("qr_transposed")),
}


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
    for of, samples in ((of_step[1:], noise), (of_run, q)):
        variances = np.diagonal(takes_moments(samples)[1], axis1=1, axis2=2)
        np.testing.assert_allclose(of, np.sqrt(variances))


def test_what_a_take_is_off_all_through_is_in_poses_at_rest_and_in_no_noise_of_a_step():
    rng, v = np.random.default_rng(12), np.zeros((30, 3))
    v[10:20, 0] = 0.01
    white, constant = np.array([1.0, 2.0, 1.0]), np.array([3.0, 1.0, 0.0])
    q = white * rng.standard_normal((500, 31, 3)) + constant * rng.standard_normal((500, 1, 3))
    q[:, 10:20] *= 10
    at_rest = np.diag(rest_covariance(q, v))
    np.testing.assert_allclose(at_rest, white**2 + constant**2, rtol=0.2)
    # control: the steps' noise tells the white part alone
    of_steps = np.diag(measurement_covariance(np.diff(q, axis=1)[:, :9], v[:9])) / 2
    np.testing.assert_allclose(of_steps, white**2, rtol=0.2)


def recorded(size: float = 1e-4, m: int = 3) -> Recorded:
    """Twelve takes of a motion that begins with a rest, their noise of ``size`` rad."""
    arm = random_arm(3, m)
    q, v = motion(arm, 40, 10)
    noise = size * np.random.default_rng(5).standard_normal((12, *q[:-1].shape))
    joints = ("one", "two", "three")
    return Recorded(arm, np.tile(q[:-1], (12, 1, 1)), v, noise, joints, MEASUREMENT)


def model_trace(model, recorded) -> float:
    """Mean trace of the exact covariance of a step over takes and steps, in rad²."""
    covariance = model.covariance(recorded.chain, recorded.q, recorded.v)
    return float(np.trace(covariance, axis1=-2, axis2=-1).mean())


@pytest.mark.parametrize("m", [3, 2])
@pytest.mark.parametrize("size", [1e-4, 1e-1])
@pytest.mark.parametrize("name", MODELS)
def test_at_the_recorded_level_the_total_variance_is_the_recorded_one(name, size, m):
    data, model = recorded(size, m), MODELS[name]
    if m == 2 and name == "wishart":
        model = replace(model, decomposition=Decomposition("qr"))
    own, of_noise = at_recorded_level(model, data), float(np.trace(mean_covariance(data.noise)))
    assert model_trace(own, data) + np.trace(MEASUREMENT) == pytest.approx(of_noise, rel=1e-9)
    # what is no level stays, and so does the course over time of a normal model
    assert type(own) is type(model)
    for name in ("u", "decomposition"):
        assert getattr(own, name, None) == getattr(model, name, None)
    if not isinstance(model, WishartModel):
        at = data.chain, data.q, data.v
        ratio = model_trace(own, data) / model_trace(model, data)
        np.testing.assert_allclose(own.covariance(*at), ratio * model.covariance(*at), rtol=1e-12)
    # of a loop that is closed every take has its own commands
    closed = at_recorded_level(model, replace(data, v=np.tile(data.v, (len(data.q), 1, 1))))
    assert model_trace(closed, data) == pytest.approx(model_trace(own, data), rel=1e-12)


def test_there_is_no_level_without_noise_of_the_motion():
    at_rest = replace(recorded(), v=np.zeros_like(recorded().v))
    for model in MODELS.values():
        with pytest.raises(ModelDomainError, match="not above that of the measurement noise"):
            at_recorded_level(model, recorded(1e-6))
    with pytest.raises(ModelDomainError, match="without noise"):
        at_recorded_level(GaussianModel(0.0, 40.0), recorded())
    for name in ("gaussian", "wishart"):
        with pytest.raises(ModelDomainError, match=r"without noise|at rest at every step"):
            at_recorded_level(MODELS[name], at_rest)
    with pytest.raises(ModelDomainError, match="at the limit of its covariance"):
        at_recorded_level(MODELS["wishart"], recorded(1e3))
    never_at_rest = replace(recorded(), v=np.ones_like(recorded().v), known_measurement=None)
    with pytest.raises(ModelDomainError, match="never rests"):
        at_recorded_level(MODELS["additive"], never_at_rest)
