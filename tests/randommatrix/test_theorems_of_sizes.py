"""Theorems 1 to 5 and the exact law of one step for matrices of two to eight rows, each by drawing;
the controls are a covariance, degrees of freedom or a dispersion that is another.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from pipeline.models.wishart.law import step_covariance
from pipeline.randommatrix import normal, wishart

DRAWS = 20_000
APART = 5.0  # standard errors of the furthest of up to 64 entries
pytestmark = pytest.mark.parametrize("n", range(2, 9))


def largest_score(samples: np.ndarray, expected: np.ndarray) -> float:
    error = samples.std(axis=0, ddof=1) / np.sqrt(len(samples))
    return float(np.abs((samples.mean(axis=0) - expected) / error).max())


def covariance(n: int, seed: int) -> np.ndarray:
    factor = np.random.default_rng(seed).standard_normal((n, n))
    return factor @ factor.T / n + 0.2 * np.eye(n)


def test_theorems_1_and_5_hold_for_matrices_of_other_row_and_column_numbers(n):
    rng, rows, columns = np.random.default_rng(n), covariance(n, 1), covariance(n + 1, 2)
    mean = 0.3 * rng.standard_normal((n, n + 1))
    draws = normal.sample(mean, rows, columns, (DRAWS,), rng)
    turned = np.swapaxes(draws, -1, -2)
    np.testing.assert_allclose(
        normal.log_density(draws[:50], mean, rows, columns),
        normal.log_density(turned[:50], mean.T, columns, rows),
        rtol=1e-10,
    )
    a = np.eye(n + 1) + 0.3 * rng.standard_normal((n + 1, n + 1))
    forms = draws @ a @ turned
    assert largest_score(forms, normal.expected_quadratic(mean, rows, columns, a)) < APART
    assert largest_score(forms, normal.expected_quadratic(mean, rows, 1.2 * columns, a)) > APART


def test_theorems_2_and_3_a_gram_matrix_has_the_wishart_law(n):
    rng, sigma = np.random.default_rng(n), covariance(n, 3)
    x = normal.sample(np.zeros((n, n + 2)), sigma, np.eye(n + 2), (DRAWS,), rng)
    gram = x @ np.swapaxes(x, -1, -2)
    assert np.all(np.linalg.eigvalsh(gram)[:, 0] > 0)

    def level(d: float) -> float:
        drawn = np.linalg.slogdet(wishart.sample(d, sigma, (DRAWS,), rng))[1]
        return stats.ks_2samp(np.linalg.slogdet(gram)[1], drawn).pvalue

    assert level(n + 2.0) > 1e-3
    assert level(n + 2.5) < 1e-6


def test_theorem_4_the_mean_is_d_sigma_and_the_density_scipys(n):
    sigma, d = covariance(n, 4), n + 1.6
    draws = wishart.sample(d, sigma, (DRAWS,), np.random.default_rng(n))
    assert largest_score(draws, wishart.mean(d, sigma)) < APART
    assert largest_score(draws, wishart.mean(1.1 * d, sigma)) > APART
    reference = stats.wishart(d, sigma).logpdf(np.moveaxis(draws[:50], 0, -1))
    np.testing.assert_allclose(wishart.log_density(draws[:50], d, sigma), reference, rtol=1e-8)


def test_the_inverse_of_the_maxent_law_moves_a_vector_as_the_closed_form_says(n):
    """B⁻¹a has the mean d/(d − n − 1)·a and the covariance of a step with J₂ = I."""
    sigma_b, a = 0.2, np.arange(1.0, n + 1)
    d = wishart.degrees_of_freedom(sigma_b, n)
    b = wishart.sample(d, np.eye(n) / d, (DRAWS,), np.random.default_rng(n))
    moved = np.linalg.solve(b, np.tile(a, (DRAWS, 1))[..., None])[..., 0]
    assert largest_score(moved, d / (d - n - 1) * a) < APART
    centred = moved - moved.mean(axis=0)
    products = centred[:, :, None] * centred[:, None, :]
    assert largest_score(products, step_covariance(a, np.eye(n), sigma_b)) < APART
    assert largest_score(products, step_covariance(a, np.eye(n), 1.1 * sigma_b)) > APART
