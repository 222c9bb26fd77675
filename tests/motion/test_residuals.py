"""The noise about its mean at each step, and its additive likelihood."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from pipeline.errors import ModelDomainError
from pipeline.motion.additive import fit_covariance
from pipeline.motion.residuals import additive_log_likelihood, pooled_covariance, residuals

NOISE = np.random.default_rng(60).normal(size=(5, 30, 3)) @ np.diag([1e-3, 2e-3, 5e-3]) + np.linspace(0, 0.02, 30)[:, None]


def test_the_pooled_covariance_of_the_residuals_is_the_additive_models():
    np.testing.assert_allclose(pooled_covariance(residuals(NOISE)), fit_covariance(NOISE), rtol=1e-12)
    # control: the mean noise would enter
    assert np.trace(pooled_covariance(NOISE)) > 5 * np.trace(fit_covariance(NOISE))


def test_the_mean_noise_of_a_step_changes_no_residual():
    np.testing.assert_allclose(residuals(NOISE + np.random.default_rng(61).normal(size=(30, 3))), residuals(NOISE), atol=1e-14)


def test_the_additive_likelihood_is_the_mean_of_the_normal_log_densities():
    r = residuals(NOISE).reshape(-1, 3)
    expected = multivariate_normal(np.zeros(3), fit_covariance(NOISE)).logpdf(r).mean()
    np.testing.assert_allclose(additive_log_likelihood(residuals(NOISE)), expected, rtol=1e-12)


def test_a_single_take_is_refused():
    with pytest.raises(ModelDomainError, match="two takes"):
        residuals(NOISE[:1])


@pytest.mark.parametrize("factors", [[1.0, 1.0, 0.0], [1.0, np.nan, 1.0]])
def test_noise_without_a_density_is_refused(factors):
    with pytest.raises(ModelDomainError, match="maximum-likelihood"):
        pooled_covariance(NOISE * factors)


def test_noise_in_a_plane_is_refused():
    with pytest.raises(ModelDomainError, match="plane"):
        pooled_covariance(NOISE @ np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 0.0]]))
