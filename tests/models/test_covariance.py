"""Roots and densities of covariances that differ from step to step."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from pipeline.core.errors import ModelDomainError
from pipeline.models.covariance import root
from pipeline.models.density import gaussian_log_density

FACTORS = np.random.default_rng(50).normal(size=(40, 3, 3))
COVARIANCES = FACTORS @ np.swapaxes(FACTORS, -1, -2) + 0.1 * np.eye(3)


def test_the_root_squared_is_the_covariance_also_where_it_is_singular():
    direction = np.array([1.0, -2.0, 0.5])
    for covariance in (*COVARIANCES, np.outer(direction, direction), np.zeros((3, 3))):
        np.testing.assert_allclose(root(covariance) @ root(covariance), covariance, atol=1e-12)
        np.testing.assert_allclose(root(covariance), root(covariance).T, atol=1e-12)


def test_the_density_is_the_normal_one_under_each_steps_own_covariance():
    residual = np.random.default_rng(51).normal(size=(40, 3))
    expected = [
        multivariate_normal(np.zeros(3), covariance).logpdf(r)
        for r, covariance in zip(residual, COVARIANCES, strict=True)
    ]
    np.testing.assert_allclose(gaussian_log_density(residual, COVARIANCES), expected, rtol=1e-12)
    # control: the covariances belong to their steps
    assert np.abs(gaussian_log_density(residual, COVARIANCES[::-1]) - expected).max() > 0.1


@pytest.mark.parametrize(
    "covariance",
    [np.ones((2, 3)), np.ones(3), 1.0, np.diag([1.0, 1.0, -1.0]), np.full((3, 3), np.inf)],
)
def test_what_is_no_covariance_has_no_root(covariance):
    with pytest.raises(ModelDomainError, match="covariance"):
        root(covariance)


def test_a_step_without_a_density_is_refused():
    with pytest.raises(ModelDomainError, match="no density"):
        gaussian_log_density(np.zeros((2, 3)), np.stack([np.eye(3), np.diag([1.0, 1.0, 0.0])]))
