"""Plain models of a joint step: draws and density of the stated law, fits that return known
parameters, and no number for a parameter that the steps cannot tell.
"""

import numpy as np
import pytest
from scipy import integrate, stats

from pipeline.core.errors import ModelDomainError
from pipeline.models.joint_steps import (
    PLAIN,
    JointStepModel,
    fit_joint_steps,
    student_log_density,
)

JOINTS = ("shoulder", "elbow", "wrist")
R = np.array([[1.0, 0.6, 0.0], [0.6, 1.0, -0.3], [0.0, -0.3, 1.0]])


def model(degrees: float = np.inf, power: float = 2.0) -> JointStepModel:
    values = {
        "joints": JOINTS,
        "resolution": np.full(3, 1e-7),
        "floor": np.array([1.0, 4.0, 9.0]) * 1e-10,
        "gain": np.array([1.0, 2.0, 0.5]) * 4e-4 * 8e-3 ** (2 - power),
        "reach": np.full(3, 8e-3),
        "degrees": np.full(3, degrees),
        "correlation": R if np.isinf(degrees) else np.eye(3),
        "power": power,
    }
    return JointStepModel(**values)


def steps(count: int, still: tuple[int, ...] = (), seed: int = 0) -> np.ndarray:
    dq = 8e-3 * np.sin(np.outer(np.arange(count), [0.01, 0.013, 0.017]) + seed)
    dq[:, list(still)] *= 1e-3
    return dq


@pytest.mark.parametrize("power", [1.0, 2.0])
@pytest.mark.parametrize("degrees", [np.inf, 6.0])
def test_draws_have_the_stated_covariance_and_the_density_of_the_stated_law(degrees, power):
    own, dq = model(degrees, power), np.array([8e-3, -2e-3, 0.0])
    noise = own.noise_sample(np.tile(dq, (200_000, 1)), np.random.default_rng(1))
    expected = own.covariance_of_joint_step(dq)
    variance = own.resolution**2 + own.floor + own.gain * np.abs(dq) ** power
    wide = 1.0 if np.isinf(degrees) else degrees / (degrees - 2)
    np.testing.assert_allclose(np.diag(expected), wide * variance, rtol=1e-12)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(np.cov(noise.T) / scale, expected / scale, atol=0.04)
    if np.isinf(degrees):
        reference = stats.multivariate_normal(np.zeros(3), expected).logpdf(noise[:5])
    else:
        reference = stats.t(degrees, scale=own.scale(dq)).logpdf(noise[:5]).sum(axis=1)
    np.testing.assert_allclose(own.noise_log_density(dq, noise[:5]), reference, rtol=1e-10)


@pytest.mark.parametrize("degrees", [3.0, 8.0])
def test_measurement_noise_on_student_noise_is_the_convolution(degrees):
    def convolved(x: float) -> float:
        law, blur = stats.t(degrees), stats.norm(scale=0.7)
        return integrate.quad(lambda y: law.pdf(y) * blur.pdf(x - y), -30, 30, limit=300)[0]

    x = np.array([0.0, 1.0, 4.0])
    own = student_log_density(x, np.ones(3), degrees, 0.49)
    np.testing.assert_allclose(np.exp(own), [convolved(each) for each in x], rtol=1e-5)
    with pytest.raises(ModelDomainError, match="diagonal"):
        model(6.0).noise_log_density(np.zeros(3), np.zeros(3), R * 1e-10)


@pytest.mark.parametrize("name", [name for name, (power, _) in PLAIN.items() if power])
def test_the_fit_returns_known_parameters(name):
    power, student = PLAIN[name]
    degrees = 6.0 if student else np.inf
    known, dq = model(degrees, power), steps(40_000)
    noise = known.noise_sample(dq, np.random.default_rng(2))
    fit = fit_joint_steps(name, dq, noise, JOINTS)
    # at power 1 few steps are slow enough to show the noise at rest
    rest = 0.12 if power == 2 else 0.25
    np.testing.assert_allclose(fit.model.floor, known.floor, rtol=rest)
    np.testing.assert_allclose(fit.model.gain, known.gain, rtol=0.08)
    assert not fit.untold
    if np.isinf(degrees):
        np.testing.assert_allclose(fit.model.correlation, R, atol=0.03)
    else:
        np.testing.assert_allclose(fit.model.degrees, 6.0, rtol=0.12)
    # control: every other growth of the variance is less likely
    for other, (growth, tails) in PLAIN.items():
        if tails == student and growth != power:
            rival = fit_joint_steps(other, dq, noise, JOINTS).model
            lost = fit.model.noise_log_density(dq, noise) - rival.noise_log_density(dq, noise)
            assert lost.mean() > (0.05 if growth == 0 else 0.005)


@pytest.mark.parametrize("name", ["scaled_all", "scaled_t", "distance_t"])
def test_the_gain_of_a_joint_that_hardly_moved_has_no_number_and_its_motion_is_refused(name):
    dq = steps(4000, still=(0,))
    noise = model().noise_sample(dq, np.random.default_rng(3))
    fit = fit_joint_steps(name, dq, noise, JOINTS)
    assert [row[:2] for row in fit.untold if row[0] == "gain"] == [("gain", "shoulder")]
    assert np.isnan(fit.model.gain[0])
    loaded = fit.model
    moved = np.array([8e-3, 8e-3, 8e-3])
    with pytest.raises(ModelDomainError, match=r"noise of shoulder at a step of 0\.008 rad"):
        loaded.covariance_of_joint_step(moved)
    # control: the other joints are predicted, and this joint at recorded steps
    moved[0] = 8e-6
    std = np.sqrt(np.diag(loaded.covariance_of_joint_step(moved)))
    expected = np.sqrt(np.diag(model().covariance_of_joint_step(moved)))
    np.testing.assert_allclose(std, expected, rtol=0.25)


@pytest.mark.parametrize("name", PLAIN)
def test_steps_without_noise_make_no_model(name):
    dq = steps(500)
    with pytest.raises(ModelDomainError, match="no noise"):
        fit_joint_steps(name, dq, np.zeros_like(dq), JOINTS)
