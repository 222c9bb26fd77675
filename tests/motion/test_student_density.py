"""The density of Student noise plus normal noise against the integral it stands for, and its slopes against differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import loggamma, norm
from scipy.stats import t as student_t

from pipeline.errors import ModelDomainError
from pipeline.motion.student_density import blurred_log_density, mean_slopes, student_log_density

SCALE = 1e-5 * np.array([[3.0, -2.0, 1.0], [-2.0, 4.0, -1.5], [1.0, -1.5, 9.0]])
MEASUREMENT = 1e-5 * np.array([[2.0, 1.0, 0.0], [1.0, 3.0, 0.5], [0.0, 0.5, 1.0]])
NONE = np.zeros((3, 3))
DEGREES = [0.5, 0.8, 3.0, 30.0, 3000.0]


def residuals() -> np.ndarray:
    """(6, 3) rad, from zero to 300 times the usual."""
    return np.random.default_rng(94).normal(0, 0.005, (6, 3)) * np.array([0.0, 0.5, 1.0, 3.0, 20.0, 300.0])[:, None]


@pytest.mark.parametrize("share", [1.0, 1e-6])
@pytest.mark.parametrize("nu", DEGREES)
def test_the_density_is_the_integral_over_the_precision(nu, share):
    found = blurred_log_density(residuals(), nu, share * SCALE, MEASUREMENT)
    # a sum over ln τ on one fine grid, the covariances each inverted for itself
    x = np.linspace(-60, 6, 50_001)
    covariances = share * SCALE * np.exp(-x)[:, None, None] + MEASUREMENT
    precisions = np.linalg.inv(covariances)
    constant = loggamma(nu / 2).logpdf(x + np.log(nu / 2)) - 0.5 * np.linalg.slogdet(2 * np.pi * covariances)[1]
    for r, value in zip(residuals(), found, strict=True):
        terms = constant - 0.5 * np.vecdot(r, np.matvec(precisions, r))
        np.testing.assert_allclose(np.trapezoid(np.exp(terms - value), x), 1.0, atol=1e-9)
        # control: the law without measurement noise is another
        assert abs(value - student_log_density(r, nu, share * SCALE)) > 1e-4


@pytest.mark.parametrize("nu", [0.5, 3.0, 30.0])
def test_noise_along_one_axis_is_the_convolution_of_a_student_with_a_normal_law(nu):
    spread, noise = 0.004, np.array([0.003, 0.005, 0.002])
    turn = np.random.default_rng(96).normal(size=(3, 3))
    scale, measurement = turn @ np.diag([spread**2, 0.0, 0.0]) @ turn.T, turn @ np.diag(noise**2) @ turn.T
    for r in residuals()[:4]:
        found = blurred_log_density(turn @ r, nu, scale, measurement) + np.log(abs(np.linalg.det(turn)))

        def product(step: float, along: float = r[0]) -> float:
            return student_t(nu, scale=spread).pdf(step) * norm(scale=noise[0]).pdf(along - step)

        convolved = quad(product, r[0] - 12 * noise[0], r[0] + 12 * noise[0], epsabs=0, epsrel=1e-10, limit=200)[0]
        assert found == pytest.approx(np.log(convolved) + norm(scale=noise[1:]).logpdf(r[1:]).sum(), abs=1e-8)
        # control: without the Student part it is another
        assert abs(found - norm(scale=noise).logpdf(r).sum()) > 1e-2


@pytest.mark.parametrize("nu", [*DEGREES, 1e4])
def test_without_measurement_noise_it_is_the_closed_form(nu):
    exact = student_log_density(residuals(), nu, SCALE)
    np.testing.assert_allclose(blurred_log_density(residuals(), nu, SCALE, NONE), exact, atol=1e-10, rtol=0)
    # control: with some it is not
    assert np.abs(blurred_log_density(residuals(), nu, SCALE, MEASUREMENT) - exact).max() > 0.1


def test_a_density_does_not_depend_on_the_residuals_beside_it():
    many = np.random.default_rng(97).normal(0, 0.005, (3000, 3))
    together = blurred_log_density(np.concatenate([many, residuals()]), 3.0, SCALE, MEASUREMENT)
    np.testing.assert_allclose(together[-6:], blurred_log_density(residuals(), 3.0, SCALE, MEASUREMENT), atol=1e-10, rtol=0)
    assert blurred_log_density(many.reshape(30, 100, 3), 3.0, SCALE, MEASUREMENT).shape == (30, 100)
    assert blurred_log_density(np.empty((0, 3)), 3.0, SCALE, MEASUREMENT).shape == (0,)


@pytest.mark.parametrize("measurement", [NONE, MEASUREMENT])
@pytest.mark.parametrize("nu", [0.8, 3.0, 300.0])
def test_the_slopes_are_the_differences_of_the_mean(nu, measurement):
    r = np.random.default_rng(98).normal(0, 0.01, (50, 3))
    found = mean_slopes(r, nu, SCALE, measurement)

    def mean(nu: float, scale: np.ndarray) -> float:
        return float(blurred_log_density(r, nu, scale, measurement).mean())

    assert found.mean == pytest.approx(mean(nu, SCALE), abs=1e-12)
    h = 1e-4 * nu
    assert found.by_nu == pytest.approx((mean(nu + h, SCALE) - mean(nu - h, SCALE)) / (2 * h), rel=1e-3)
    for direction in np.random.default_rng(99).normal(size=(4, 3, 3)):
        tilt = 1e-9 * (direction + direction.T)
        difference = (mean(nu, SCALE + tilt) - mean(nu, SCALE - tilt)) / 2
        assert np.sum(found.by_scale * tilt) == pytest.approx(difference, rel=1e-3)
        # control: another tilt has another slope
        assert np.sum(found.by_scale * np.abs(tilt)) != pytest.approx(difference, rel=1e-3)


def test_where_there_is_no_density_it_says_so():
    flat = np.diag([1e-5, 1e-5, 0.0])
    for log_density in (lambda: student_log_density(residuals(), 3.0, flat), lambda: blurred_log_density(residuals(), 3.0, flat, NONE)):
        with pytest.raises(ModelDomainError, match="positive definite"):
            log_density()
    with pytest.raises(ModelDomainError, match="positive semidefinite"):
        blurred_log_density(residuals(), 3.0, SCALE, -MEASUREMENT)
    for value in (np.nan, np.inf):
        with pytest.raises(ModelDomainError, match="not finite"):
            blurred_log_density(np.array([0.0, value, 0.0]), 3.0, SCALE, MEASUREMENT)
