"""Definition 2, Theorems 2 to 4, the MaxEnt parameters and the limits of the dispersion."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from pipeline.core.errors import ModelDomainError
from pipeline.models.wishart.law import step_covariance
from pipeline.randommatrix import normal, wishart

SIGMA = np.array([[1.0, 0.3, 0.0], [0.3, 0.8, -0.2], [0.0, -0.2, 0.5]])


def largest_score(samples: np.ndarray, expected: np.ndarray) -> float:
    error = samples.std(axis=0, ddof=1) / np.sqrt(len(samples))
    return float(np.abs((samples.mean(axis=0) - expected) / error).max())


def test_theorem_2_a_gram_matrix_of_at_least_as_many_columns_is_positive_definite():
    rng = np.random.default_rng(3)
    # control: with fewer columns than rows the theorem does not hold
    for q, definite in [(3, True), (2, False)]:
        x = normal.sample(np.zeros((3, q)), SIGMA, np.eye(q), (2000,), rng)
        least = np.linalg.eigvalsh(x @ np.swapaxes(x, -1, -2))[:, 0]
        assert np.all(least > 1e-10) == definite


@pytest.mark.parametrize("n", range(2, 9))
def test_theorems_1_to_5_hold_for_matrices_of_every_size(n):
    rng = np.random.default_rng(n)
    assert wishart.sample(n + 7.0, np.eye(n), (), rng).shape == (n, n)
    factors = rng.standard_normal((2, n + 2, n + 2)) / np.sqrt(n + 2)
    sigma, columns = factors @ factors.swapaxes(1, 2) + 0.2 * np.eye(n + 2)
    sigma, mean = sigma[:n, :n], 0.3 * rng.standard_normal((n, n + 2))
    x = normal.sample(mean, sigma, columns, (20_000,), rng)
    turned, a = np.swapaxes(x, 1, 2), np.eye(n + 2) + 0.3 * rng.standard_normal((n + 2, n + 2))
    densities = normal.log_density(x[:50], mean, sigma, columns)
    transposed = normal.log_density(turned[:50], mean.T, columns, sigma)
    np.testing.assert_allclose(densities, transposed, rtol=1e-9)
    forms = x @ a @ turned
    assert largest_score(forms, normal.expected_quadratic(mean, sigma, columns, a)) < 5
    assert largest_score(forms, normal.expected_quadratic(mean, sigma, 1.2 * columns, a)) > 5
    x = normal.sample(0 * mean, sigma, np.eye(n + 2), (20_000,), rng)
    gram = np.linalg.slogdet(x @ np.swapaxes(x, 1, 2))[1]

    def level(d: float) -> float:
        drawn = wishart.sample(d, sigma, (20_000,), rng)
        return stats.ks_2samp(gram, np.linalg.slogdet(drawn)[1]).pvalue

    assert level(n + 2.0) > 1e-3 and level(n + 2.5) < 1e-6
    d = n + 1.6
    draws = wishart.sample(d, sigma, (20_000,), rng)
    assert largest_score(draws, wishart.mean(d, sigma)) < 5
    assert largest_score(draws, wishart.mean(1.1 * d, sigma)) > 5
    reference = stats.wishart(d, sigma).logpdf(np.moveaxis(draws[:50], 0, -1))
    np.testing.assert_allclose(wishart.log_density(draws[:50], d, sigma), reference, rtol=1e-8)


@pytest.mark.parametrize(
    "statistic", [np.linalg.det, lambda s: np.trace(s, axis1=-2, axis2=-1), lambda s: s[:, 2, 1]]
)
def test_theorem_3_bartlett_draws_have_the_law_of_the_gram_matrix(statistic):
    rng = np.random.default_rng(4)
    x = normal.sample(np.zeros((3, 7)), SIGMA, np.eye(7), (4000,), rng)
    gram = statistic(x @ np.swapaxes(x, -1, -2))
    assert stats.ks_2samp(gram, statistic(wishart.sample(7.0, SIGMA, (4000,), rng))).pvalue > 0.01


def test_theorem_3_wrong_degrees_of_freedom_are_detected():
    rng = np.random.default_rng(5)
    x = normal.sample(np.zeros((3, 7)), SIGMA, np.eye(7), (4000,), rng)
    gram = np.linalg.det(x @ np.swapaxes(x, -1, -2))
    assert (
        stats.ks_2samp(gram, np.linalg.det(wishart.sample(7.5, SIGMA, (4000,), rng))).pvalue < 1e-6
    )


@pytest.mark.parametrize("d", [2.4, 5.5, 64.0])
def test_theorem_4_the_mean_is_d_sigma_also_for_real_degrees_of_freedom(d):
    draws = wishart.sample(d, SIGMA, (40_000,), np.random.default_rng(6))
    assert largest_score(draws, wishart.mean(d, SIGMA)) < 4.5
    assert largest_score(draws, wishart.mean(d + 0.5, SIGMA)) > 4.5


@pytest.mark.parametrize("d", [2.4, 5.5, 64.0])
def test_the_density_is_that_of_scipy(d):
    draws = wishart.sample(d, SIGMA, (50,), np.random.default_rng(7))
    reference = stats.wishart(d, SIGMA).logpdf(np.moveaxis(draws, 0, -1))
    np.testing.assert_allclose(wishart.log_density(draws, d, SIGMA), reference, rtol=1e-9)


@pytest.mark.parametrize("sigma_b", [0.1, 0.25, 0.7, 1.2])
def test_the_maxent_law_has_the_mean_and_the_dispersion_it_was_asked_for(sigma_b):
    n = 3
    d = wishart.degrees_of_freedom(sigma_b, n)
    assert d == pytest.approx((n + 1) / sigma_b**2, rel=1e-14)
    draws = wishart.sample(d, np.eye(n) / d, (40_000,), np.random.default_rng(8))
    assert largest_score(draws, np.eye(n)) < 4.5
    squared = ((draws - np.eye(n)) ** 2).sum(axis=(-1, -2)) / n
    assert largest_score(squared, np.array(sigma_b**2)) < 4.5
    assert largest_score(squared, np.array((1.1 * sigma_b) ** 2)) > 4.5
    np.testing.assert_allclose(
        wishart.normalized_std(draws, np.eye(n)), np.sqrt(squared.mean()), rtol=1e-12
    )


@pytest.mark.parametrize("n", range(2, 9))
def test_the_inverse_of_the_maxent_law_moves_a_vector_as_the_closed_form_says(n):
    """B⁻¹a has the mean d/(d − n − 1)·a and the covariance of a step with J₂ = I."""
    sigma_b, a, draws = 0.2, np.arange(1.0, n + 1), 20_000
    d = wishart.degrees_of_freedom(sigma_b, n)
    b = wishart.sample(d, np.eye(n) / d, (draws,), np.random.default_rng(n))
    moved = np.linalg.solve(b, np.tile(a, (draws, 1))[..., None])[..., 0]
    assert largest_score(moved, d / (d - n - 1) * a) < 5
    centred = moved - moved.mean(axis=0)
    products = centred[:, :, None] * centred[:, None, :]
    assert largest_score(products, step_covariance(a, np.eye(n), sigma_b)) < 5
    assert largest_score(products, step_covariance(a, np.eye(n), 1.1 * sigma_b)) > 5


def test_theta_follows_the_papers_equation_for_any_size():
    for n in (2, 3, 6):
        mean, sigma_b = np.eye(n), 0.3
        printed = (1 + np.trace(mean) ** 2 / np.trace(mean @ mean)) / sigma_b**2 - (n + 1)
        assert wishart.maxent_theta(sigma_b, n) == pytest.approx(printed, rel=1e-14)


def test_the_limits_of_the_dispersion_are_where_density_mean_and_variance_of_the_inverse_end():
    for moments, d in [(0, 2), (1, 4), (2, 6)]:
        assert 4 / wishart.largest_dispersion(3, inverse_moments=moments) ** 2 == pytest.approx(d)
    assert wishart.largest_dispersion(3, inverse_moments=1) == 1.0


@pytest.mark.parametrize("sigma_b", [0.0, -0.2, np.sqrt(2), 3.0, np.nan])
def test_a_dispersion_without_a_density_is_refused(sigma_b):
    with pytest.raises(ModelDomainError, match=r"sigma_B must lie between 0 and 1\.414"):
        wishart.degrees_of_freedom(sigma_b, 3)


def test_degrees_of_freedom_without_a_density_are_refused():
    with pytest.raises(ModelDomainError, match="only for d > 2"):
        wishart.sample(2.0, SIGMA, (1,), np.random.default_rng(0))
    with pytest.raises(ModelDomainError, match="only for d > 2"):
        wishart.log_density(SIGMA, 1.5, SIGMA)
