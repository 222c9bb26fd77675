"""Definition 1, Theorems 1 and 5 against simulation, the vectorised normal and SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import matrix_normal

from pipeline.core.errors import ModelDomainError
from pipeline.randommatrix.normal import expected_quadratic, log_density, sample

MEAN = np.array([[1.0, -2.0, 0.5], [0.0, 3.0, 1.0]])
ROWS = np.array([[1.0, 0.6], [0.6, 2.0]])
COLUMNS = np.array([[0.5, 0.2, 0.0], [0.2, 1.0, -0.3], [0.0, -0.3, 2.0]])
DRAWS = 60_000


@pytest.fixture(scope="module")
def draws() -> np.ndarray:
    return sample(MEAN, ROWS, COLUMNS, (DRAWS,), np.random.default_rng(1))


def largest_score(samples: np.ndarray, expected: np.ndarray) -> float:
    """Largest |sample mean − expected| over the entries, in standard errors."""
    error = samples.std(axis=0, ddof=1) / np.sqrt(len(samples))
    return float(np.abs((samples.mean(axis=0) - expected) / error).max())


def products(vectors: np.ndarray) -> np.ndarray:
    return vectors[:, :, None] * vectors[:, None, :]


def test_definition_1_the_transpose_stacked_by_columns_has_covariance_sigma_kron_psi(draws):
    stacked = (draws - MEAN).reshape(DRAWS, -1)  # row-major order of X is vec(Xᵀ)
    assert largest_score(stacked, np.zeros(6)) < 4.5
    assert largest_score(products(stacked), np.kron(ROWS, COLUMNS)) < 4.5
    # control: the other order of the Kronecker product is told apart
    assert largest_score(products(stacked), np.kron(COLUMNS, ROWS)) > 20


def test_theorem_1_the_transpose_exchanges_row_and_column_covariance(draws):
    transposed = np.swapaxes(draws, -1, -2)
    densities = log_density(draws[:100], MEAN, ROWS, COLUMNS)
    np.testing.assert_allclose(
        log_density(transposed[:100], MEAN.T, COLUMNS, ROWS), densities, rtol=1e-12
    )
    stacked = (transposed - MEAN.T).reshape(DRAWS, -1)
    assert largest_score(products(stacked), np.kron(COLUMNS, ROWS)) < 4.5
    assert largest_score(products(stacked), np.kron(ROWS, COLUMNS)) > 20


def test_the_density_is_that_of_scipy(draws):
    reference = matrix_normal(MEAN, ROWS, COLUMNS).logpdf(draws[:200])
    np.testing.assert_allclose(log_density(draws[:200], MEAN, ROWS, COLUMNS), reference, rtol=1e-12)


def test_theorem_5_gives_the_mean_of_a_quadratic_form_that_is_not_symmetric(draws):
    a = np.array([[1.0, 0.7, 0.0], [-0.4, 0.5, 0.2], [0.3, 0.0, -1.0]])
    forms = draws @ a @ np.swapaxes(draws, -1, -2)
    assert largest_score(forms, expected_quadratic(MEAN, ROWS, COLUMNS, a)) < 4.5
    # control: without the covariance of the columns
    assert largest_score(forms, expected_quadratic(MEAN, ROWS, np.eye(3), a)) > 20


def test_theorem_5_holds_for_a_batch_of_forms():
    a = np.random.default_rng(2).standard_normal((4, 3, 3))
    batch = expected_quadratic(MEAN, ROWS, COLUMNS, a)
    np.testing.assert_allclose(
        batch, [expected_quadratic(MEAN, ROWS, COLUMNS, each) for each in a], rtol=1e-13
    )


@pytest.mark.parametrize(
    "bad", [np.diag([1.0, -1.0]), np.full((2, 2), np.nan), np.array([[1.0, 0.0], [0.5, 1.0]])]
)
def test_a_row_covariance_that_is_not_positive_definite_is_refused(bad):
    with pytest.raises(ModelDomainError, match="Σ must be finite, symmetric and positive definite"):
        sample(MEAN, bad, COLUMNS, (1,), np.random.default_rng(0))
