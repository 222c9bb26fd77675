"""The additive noise of greatest likelihood beyond the measurement's."""

from __future__ import annotations

import numpy as np
import pytest
from additive_likelihood import fit_additive
from scipy.stats import multivariate_normal

from pipeline.core.errors import ModelDomainError
from pipeline.models.scaled.likelihood import second_moment

COVARIANCE = 1e-5 * np.array([[3.0, -2.0, 1.0], [-2.0, 4.0, -1.5], [1.0, -1.5, 9.0]])
MEASUREMENT = 1e-5 * np.array([[2.0, 1.0, 0.0], [1.0, 3.0, 0.5], [0.0, 0.5, 1.0]])
NONE = np.zeros((3, 3))


def drawn(covariance: np.ndarray, seed: int = 60) -> np.ndarray:
    return np.random.default_rng(seed).multivariate_normal(np.zeros(3), covariance, (100, 200))


def likelihood(noise: np.ndarray, covariance: np.ndarray) -> float:
    return float(multivariate_normal(np.zeros(3), covariance).logpdf(noise).mean())


def test_the_covariance_comes_back_where_the_measurements_is_known():
    noise = drawn(COVARIANCE + MEASUREMENT)
    result = fit_additive(noise, MEASUREMENT)
    assert result.quiet == 0
    # standard errors of a variance from 20 000 steps: 1 % of it, measurement included
    assert np.linalg.norm(result.covariance - COVARIANCE) < 0.05 * np.linalg.norm(COVARIANCE)
    # control: who ignores the measurement's noise finds it in the motion
    assert np.linalg.norm(fit_additive(noise, NONE).covariance - COVARIANCE) > 0.2 * np.linalg.norm(
        COVARIANCE
    )


def test_without_measurement_noise_it_is_the_second_moment_mean_included():
    noise = drawn(COVARIANCE) + np.array([0.0, 0.01, 0.0])
    result = fit_additive(noise, NONE)
    np.testing.assert_allclose(result.covariance, second_moment(noise, NONE), rtol=1e-10)
    assert result.covariance[1, 1] == pytest.approx(COVARIANCE[1, 1] + 1e-4, rel=0.02)
    np.testing.assert_allclose(
        result.log_likelihood, likelihood(noise, result.covariance), rtol=1e-12
    )


@pytest.mark.parametrize(("share", "quiet"), [(1.0, 0), (8.0, 2), (100.0, 3)])
def test_the_likelihood_is_scipys_and_no_other_covariance_has_a_greater_on_the_boundary_too(
    share, quiet
):
    noise = drawn(COVARIANCE + MEASUREMENT)
    result = fit_additive(noise, share * MEASUREMENT)
    assert result.quiet == quiet == np.count_nonzero(np.linalg.eigvalsh(result.covariance) < 1e-12)
    np.testing.assert_allclose(
        result.log_likelihood,
        likelihood(noise, result.covariance + share * MEASUREMENT),
        rtol=1e-12,
    )
    rng = np.random.default_rng(61)
    for size in (1e-3, 3e-3):
        for _ in range(30):
            direction = size * rng.normal(size=3)
            more = result.covariance + np.outer(direction, direction)
            assert likelihood(noise, more + share * MEASUREMENT) < result.log_likelihood
    if quiet < 3:
        assert (
            likelihood(noise, 0.98 * result.covariance + share * MEASUREMENT)
            < result.log_likelihood
        )
    # control: without the bound at zero the likelihood would still rise
    assert quiet == 0 or likelihood(noise, second_moment(noise, NONE)) > result.log_likelihood


def test_the_fit_follows_every_linear_change_of_the_joints():
    noise, turn = (
        drawn(COVARIANCE + MEASUREMENT),
        np.random.default_rng(62).normal(size=(3, 3)) * [1.0, 30.0, 0.1],
    )
    for share in (1.0, 8.0):
        one, other = (
            fit_additive(noise, share * MEASUREMENT),
            fit_additive(noise @ turn.T, share * turn @ MEASUREMENT @ turn.T),
        )
        np.testing.assert_allclose(
            other.covariance,
            turn @ one.covariance @ turn.T,
            rtol=1e-6,
            atol=1e-9 * np.abs(other.covariance).max(),
        )
        assert other.log_likelihood == pytest.approx(
            one.log_likelihood - np.log(abs(np.linalg.det(turn)))
        )


def test_noise_in_a_plane_has_a_likelihood_with_measurement_noise_alone():
    flat = drawn(COVARIANCE) @ np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 0.0]])
    with pytest.raises(ModelDomainError, match="plane"):
        fit_additive(flat, NONE)
    assert fit_additive(flat, MEASUREMENT).quiet == 1


@pytest.mark.parametrize("factors", [[1.0, 1.0, 0.0], [1.0, np.nan, 1.0]])
def test_noise_without_a_density_is_refused(factors):
    with pytest.raises(ModelDomainError, match="maximum-likelihood"):
        fit_additive(drawn(COVARIANCE) * factors, NONE)


def test_a_measurement_noise_that_is_no_covariance_is_refused():
    with pytest.raises(ModelDomainError, match="positive semidefinite"):
        fit_additive(drawn(COVARIANCE), -MEASUREMENT)
