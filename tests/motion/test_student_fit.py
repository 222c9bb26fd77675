"""Degrees of freedom and scale are found again in draws of their law; Gaussian noise gives the additive model."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_t

from pipeline.errors import ModelDomainError
from pipeline.motion.additive import fit_covariance
from pipeline.motion.residuals import residuals
from pipeline.motion.student_fit import fit_student

TAKES, STEPS = 100, 200
SCALE = 1e-5 * np.array([[3.0, -2.0, 1.0], [-2.0, 4.0, -1.5], [1.0, -1.5, 9.0]])


def drawn(nu: float, takes: int = TAKES) -> np.ndarray:
    """Student noise with a mean of its own at each step."""
    rng = np.random.default_rng(100)
    precision = rng.chisquare(nu, (takes, STEPS, 1)) / nu if np.isfinite(nu) else 1.0
    return rng.multivariate_normal(np.zeros(3), SCALE, (takes, STEPS)) / np.sqrt(precision) + 0.01 * rng.standard_normal((STEPS, 3))


@pytest.mark.parametrize("nu", [3.0, 6.0])
def test_the_parameters_of_the_laws_own_draws_are_found_again(nu):
    found = fit_student(drawn(nu))
    # standard errors over seeds: 2 % of ν = 6, less of 3; the mean at each step, estimated with outliers in it, adds a bias of its own
    assert abs(found.nu / nu - 1) < 0.1
    assert np.linalg.norm(found.scale - SCALE) < 0.05 * np.linalg.norm(SCALE)
    assert found.log_likelihood > found.additive_log_likelihood + 0.02
    assert not found.at_end
    # control: the sample covariance is not the scale
    assert np.linalg.norm(fit_covariance(drawn(nu)) - SCALE) > 0.3 * np.linalg.norm(SCALE)


def test_gaussian_noise_gives_the_additive_model():
    noise = drawn(np.inf)
    found = fit_student(noise)
    assert found.nu > 100
    np.testing.assert_allclose(found.scale * found.nu / (found.nu - 2), fit_covariance(noise), rtol=0.01, atol=1e-7)
    # at the end of the interval of ν the law is not quite Gaussian; twice the number of steps times the mean difference is at most
    # chi-squared with one degree of freedom
    assert -1e-5 < found.log_likelihood - found.additive_log_likelihood < 10 / (2 * TAKES * STEPS)
    # control: noise of six degrees of freedom is far from it
    assert fit_student(drawn(6.0)).nu < 10


def test_the_likelihood_is_scipys_and_no_neighbour_has_a_greater():
    noise = drawn(4.0, takes=30)
    found = fit_student(noise)
    r = residuals(noise).reshape(-1, 3)

    def likelihood(nu: float, scale: np.ndarray) -> float:
        return float(multivariate_t(np.zeros(3), scale, df=nu).logpdf(r).mean())

    np.testing.assert_allclose(found.log_likelihood, likelihood(found.nu, found.scale), rtol=1e-10)
    tilt = 1e-7 * np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    for nu, scale in ((0.98, 1.0), (1.02, 1.0), (1.0, 0.99), (1.0, 1.01)):
        assert likelihood(nu * found.nu, scale * found.scale) < found.log_likelihood
    for sign in (-1, 1):
        assert likelihood(found.nu, found.scale + sign * tilt) < found.log_likelihood


def test_the_fit_is_the_same_in_other_units():
    one, other = fit_student(drawn(4.0, takes=20)), fit_student(drawn(4.0, takes=20) * [1.0, 100.0, 1.0])
    np.testing.assert_allclose(other.nu, one.nu, rtol=1e-5)
    np.testing.assert_allclose(other.scale / np.outer([1, 100, 1], [1, 100, 1]), one.scale, rtol=1e-5, atol=1e-12)


def test_noise_most_of_which_is_zero_has_no_greatest_likelihood():
    noise = drawn(4.0, takes=20)
    noise[:, 20:] = 0.0
    with pytest.raises(ModelDomainError, match="no bound"):
        fit_student(noise)
