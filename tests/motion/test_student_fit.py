"""Degrees of freedom and scale are found again in draws of their law, the measurement's noise beside them; Gaussian noise is additive."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_t

from pipeline.errors import ModelDomainError
from pipeline.motion.additive_fit import fit_additive
from pipeline.motion.student_density import blurred_log_density
from pipeline.motion.student_fit import DEGREES, fit_student

TAKES, STEPS = 100, 200
SCALE = 1e-5 * np.array([[3.0, -2.0, 1.0], [-2.0, 4.0, -1.5], [1.0, -1.5, 9.0]])
MEASUREMENT = 1e-5 * np.array([[2.0, -1.0, 0.0], [-1.0, 3.0, 0.5], [0.0, 0.5, 2.0]])
NONE = np.zeros((3, 3))


def drawn(nu: float, measurement: np.ndarray = MEASUREMENT, scale: np.ndarray = SCALE, takes: int = TAKES) -> np.ndarray:
    rng = np.random.default_rng(100)
    precision = rng.chisquare(nu, (takes, STEPS, 1)) / nu if np.isfinite(nu) else 1.0
    noise, added = (rng.multivariate_normal(np.zeros(3), c, (takes, STEPS), method="eigh") for c in (scale, measurement))
    return noise / np.sqrt(precision) + added


@pytest.mark.parametrize("measurement", [NONE, MEASUREMENT])
@pytest.mark.parametrize("nu", [1.5, 3.0, 6.0])
def test_the_parameters_of_the_laws_own_draws_are_found_again(nu, measurement):
    found = fit_student(drawn(nu, measurement), measurement)
    # standard errors over seeds: 2 % of ν = 6, less of smaller ones; half as much again with measurement noise
    assert abs(found.nu / nu - 1) < 0.12
    assert np.linalg.norm(found.scale - SCALE) < 0.06 * np.linalg.norm(SCALE)
    assert found.log_likelihood > found.additive_log_likelihood + 0.01
    assert not found.at_end
    # controls: the additive model's covariance is not the scale, and the measurement's noise must not be taken for the motion's
    assert np.linalg.norm(fit_additive(drawn(nu, measurement), measurement).covariance - SCALE) > 0.3 * np.linalg.norm(SCALE)
    if measurement.any():
        ignorant = fit_student(drawn(nu, measurement), NONE)
        assert np.linalg.norm(ignorant.scale - SCALE) > 0.25 * np.linalg.norm(SCALE)
        assert ignorant.nu > 1.1 * nu


@pytest.mark.parametrize("measurement", [NONE, MEASUREMENT])
def test_gaussian_noise_gives_the_additive_model(measurement):
    noise = drawn(np.inf, measurement)
    found, additive = fit_student(noise, measurement), fit_additive(noise, measurement)
    assert found.nu > 50
    assert np.linalg.norm(found.scale * found.nu / (found.nu - 2) - additive.covariance) < 0.01 * np.linalg.norm(additive.covariance)
    # at the end of the interval of ν the law is not quite Gaussian; twice the number of steps times the mean difference is at most
    # chi-squared with one degree of freedom
    assert -1e-5 < found.log_likelihood - found.additive_log_likelihood < 10 / (2 * TAKES * STEPS)
    assert found.additive_log_likelihood == additive.log_likelihood
    # control: noise of six degrees of freedom is far from it
    assert fit_student(drawn(6.0, measurement), measurement).nu < 10


def test_noise_of_lighter_tails_than_a_gaussians_ends_at_the_end_of_the_interval():
    uniform = np.random.default_rng(101).uniform(-0.01, 0.01, (20, STEPS, 3))
    found = fit_student(uniform, 0.1 * MEASUREMENT)
    assert found.at_end
    assert found.nu == pytest.approx(DEGREES[1])


def test_noise_that_is_mostly_the_measurements_ends_at_the_other_end():
    rng = np.random.default_rng(102)
    noise = 1e-5 * rng.standard_normal((20, STEPS, 3))
    noise[:, :20] *= 1e5
    found = fit_student(noise, 1e-10 * np.eye(3))
    assert found.at_end
    assert found.nu == pytest.approx(DEGREES[0])


def test_the_mean_of_the_noise_is_taken_as_noise():
    mean = np.array([0.01, 0.0, 0.0])
    noise = drawn(6.0) + mean
    assert fit_student(noise, MEASUREMENT).scale[0, 0] > 2 * SCALE[0, 0]
    # control: about its mean it is as before
    assert fit_student(noise - mean, MEASUREMENT).scale[0, 0] == pytest.approx(SCALE[0, 0], rel=0.1)


@pytest.mark.parametrize("measurement", [NONE, MEASUREMENT])
def test_the_likelihood_is_that_of_the_parameters_and_no_neighbour_has_a_greater(measurement):
    noise = drawn(4.0, takes=30)
    found = fit_student(noise, measurement)

    def likelihood(nu: float, scale: np.ndarray) -> float:
        if not measurement.any():
            return float(multivariate_t(np.zeros(3), scale, df=nu).logpdf(noise).mean())
        return float(blurred_log_density(noise, nu, scale, measurement).mean())

    np.testing.assert_allclose(found.log_likelihood, likelihood(found.nu, found.scale), rtol=0, atol=1e-9)
    tilt = 1e-7 * np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    for nu, scale in ((0.98, 1.0), (1.02, 1.0), (1.0, 0.99), (1.0, 1.01)):
        assert likelihood(nu * found.nu, scale * found.scale) < found.log_likelihood
    for sign in (-1, 1):
        assert likelihood(found.nu, found.scale + sign * tilt) < found.log_likelihood


def test_a_scale_that_is_singular_in_truth_is_found_and_no_direction_beside_it_is_more_likely():
    direction = np.array([1.0, -2.0, 0.5])
    line = 1e-5 * np.outer(direction, direction)
    noise, stated = drawn(3.0, scale=line), 1.1 * MEASUREMENT
    found = fit_student(noise, stated)
    variances = np.linalg.eigvalsh(found.scale)
    assert variances[1] < 1e-9 < 1e-5 < variances[2]
    assert np.linalg.norm(found.scale - line) < 0.15 * np.linalg.norm(line)
    for beside in 3e-4 * np.random.default_rng(103).normal(size=(20, 3)):
        more = found.scale + np.outer(beside, beside)
        assert blurred_log_density(noise, found.nu, more, stated).mean() < found.log_likelihood
    # control: with no more than the true measurement noise taken away, half of it is left in every direction
    assert np.linalg.eigvalsh(fit_student(noise, 0.5 * stated).scale)[0] > 1e-6


@pytest.mark.parametrize("measurement", [NONE, MEASUREMENT])
def test_the_fit_is_the_same_in_other_units(measurement):
    units, noise = np.array([1.0, 100.0, 1.0]), drawn(4.0, takes=20)
    one, other = fit_student(noise, measurement), fit_student(noise * units, measurement * np.outer(units, units))
    np.testing.assert_allclose(other.nu, one.nu, rtol=1e-4)
    np.testing.assert_allclose(other.scale / np.outer(units, units), one.scale, rtol=1e-4, atol=1e-10)
    assert other.log_likelihood == pytest.approx(one.log_likelihood - np.log(100), abs=1e-9)


@pytest.mark.parametrize(("joints", "share"), [(slice(None), 0.15), (1, 0.75)], ids=["all joints", "one joint"])
def test_noise_too_much_of_which_is_zero_has_no_greatest_likelihood_but_with_measurement_noise(joints, share):
    noise = drawn(4.0, NONE, takes=20)
    noise[:, : round(share * STEPS), joints] = 0.0
    with pytest.raises(ModelDomainError, match="no bound"):
        fit_student(noise, NONE)
    assert np.isfinite(fit_student(noise, MEASUREMENT).log_likelihood)
    # control: a little less has one
    fewer = drawn(4.0, NONE, takes=20)
    fewer[:, : round(0.9 * share * STEPS), joints] = 0.0
    assert DEGREES[0] < fit_student(fewer, NONE).nu < 4.0


def test_noise_without_a_density_and_measurement_noise_that_is_no_covariance_are_refused():
    noise = drawn(4.0, takes=5)
    for factors in ([1.0, 1.0, 0.0], [1.0, np.nan, 1.0]):
        with pytest.raises(ModelDomainError, match="plane or is not finite"):
            fit_student(noise * factors, NONE)
    with pytest.raises(ModelDomainError, match="positive semidefinite"):
        fit_student(noise, -MEASUREMENT)


def test_a_search_from_the_fit_of_like_noise_ends_where_one_from_afar_does():
    noise = drawn(3.0, MEASUREMENT)
    whole, half = fit_student(noise, MEASUREMENT), noise.reshape(-1, 3)[::2]
    found, again = fit_student(half, MEASUREMENT, near=whole), fit_student(half, MEASUREMENT)
    assert found.nu == pytest.approx(again.nu, rel=1e-5)
    np.testing.assert_allclose(found.scale, again.scale, rtol=1e-5, atol=1e-5 * np.abs(again.scale).max())
    # control: half of the noise has another fit than all of it
    assert whole.nu != pytest.approx(again.nu, rel=1e-3)
