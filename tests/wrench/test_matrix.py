"""The random-matrix wrench model against draws of the whole matrix, a bounded optimiser and its limits."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import ks_2samp

from pipeline.errors import ModelDomainError
from pipeline.wrench.matrix import MatrixModel, expected_wrench, matrix_model, optimal_sigma_s, sample_wrenches, wrench_covariance
from pipeline.wrench.parametric import CableSystem, force_covariance

BAND = 4.5  # standard errors

MODEL = MatrixModel(
    jacobian=np.array([[0.9, -0.4, 0.1], [0.3, 0.8, -1.0]]),
    actuation=np.array([0.5, -1.0, 2.0]),
    actuation_cov=np.array([[2.0, 0.5, 0.0], [0.5, 1.0, -0.3], [0.0, -0.3, 1.5]]),
    psi=np.array([[1.0, 0.3, 0.0], [0.3, 0.6, 0.1], [0.0, 0.1, 1.4]]),
)
SIGMA_S = np.array([[0.5, 0.2], [0.2, 0.3]])
N = 100_000


def whole_matrix_wrenches(rng):
    """W = S·T with S drawn entry by entry: S̲ + Σ_S^½ Z Ψ_S^½."""
    noise = np.linalg.cholesky(SIGMA_S) @ rng.standard_normal((N, 2, 3)) @ np.linalg.cholesky(MODEL.psi).T
    actuation = MODEL.actuation + rng.standard_normal((N, 3)) @ np.linalg.cholesky(MODEL.actuation_cov).T
    return np.einsum("knm,km->kn", MODEL.jacobian + noise, actuation)


def covariance_z(samples, covariance):
    centred = samples - samples.mean(axis=0)
    products = np.einsum("ki,kj->kij", centred, centred)
    return (products.mean(axis=0) - covariance) * np.sqrt(N) / products.std(axis=0)


def random_systems(count, agents, rng):
    shape = (count, agents)
    return CableSystem(rng.uniform(1.8, 14, shape), rng.uniform(0, 6.3, shape), rng.uniform(0.5, 2.3, shape), rng.uniform(100, 2400, shape))


def test_products_of_whole_random_matrices_have_the_closed_forms_moments():
    samples = whole_matrix_wrenches(np.random.default_rng(3))
    covariance = wrench_covariance(MODEL, SIGMA_S)
    mean_z = (samples.mean(axis=0) - expected_wrench(MODEL)) / np.sqrt(np.diag(covariance) / N)
    assert np.abs(mean_z).max() < BAND
    assert np.abs(covariance_z(samples, covariance)).max() < BAND
    identity = MatrixModel(MODEL.jacobian, MODEL.actuation, MODEL.actuation_cov, np.eye(3))
    assert np.abs(covariance_z(samples, wrench_covariance(identity, SIGMA_S))).max() > 2 * BAND


def test_reduced_sampling_has_the_law_of_the_whole_product_and_a_normal_law_has_not():
    rng = np.random.default_rng(4)
    whole, reduced = whole_matrix_wrenches(rng), sample_wrenches(MODEL, SIGMA_S, N, rng)
    normal = rng.multivariate_normal(expected_wrench(MODEL), wrench_covariance(MODEL, SIGMA_S), N)
    for direction in ([1.0, 0.0], [0.0, 1.0], [0.6, -0.8]):
        assert ks_2samp(whole @ direction, reduced @ direction).pvalue > 1e-3
    assert ks_2samp(whole[:, 0], normal[:, 0]).pvalue < 1e-6


def test_without_randomness_of_the_matrix_or_of_the_actuation_the_wrench_is_what_remains():
    rng = np.random.default_rng(5)
    fixed = MatrixModel(MODEL.jacobian, MODEL.actuation, np.zeros((3, 3)), MODEL.psi)
    np.testing.assert_allclose(sample_wrenches(fixed, np.zeros((2, 2)), 4, rng), np.tile(expected_wrench(MODEL), (4, 1)), rtol=1e-12)
    np.testing.assert_allclose(wrench_covariance(MODEL, np.zeros((2, 2))), MODEL.jacobian @ MODEL.actuation_cov @ MODEL.jacobian.T)


def test_the_closed_form_optimum_is_that_of_a_bounded_optimiser_where_the_bound_holds_and_where_it_does_not():
    systems = random_systems(400, 2, np.random.default_rng(6))
    model = matrix_model(systems)
    variance = np.einsum("...ii->...i", force_covariance(systems))
    closed = optimal_sigma_s(model, variance)
    held = np.flatnonzero((closed == 0).any(axis=1))
    assert len(held) >= 10
    for k in np.concatenate([held[:10], np.flatnonzero((closed > 0).all(axis=1))[:10]]):
        one = MatrixModel(model.jacobian[k], model.actuation[k], model.actuation_cov[k], model.psi)
        found = least_squares(
            lambda s, one=one, k=k: 1e4 * (np.diag(wrench_covariance(one, np.diag(s) * 1e-4)) - variance[k]),
            [5.0, 5.0], bounds=(0, np.inf), xtol=1e-14, ftol=1e-14, gtol=1e-14,
        )  # fmt: skip
        np.testing.assert_allclose(closed[k], found.x * 1e-4, atol=2e-9)


def test_without_the_bound_the_optimal_matrix_model_has_the_parametric_variances():
    systems = random_systems(300, 5, np.random.default_rng(7))
    model = matrix_model(systems)
    variance = np.einsum("...ii->...i", force_covariance(systems))
    sigma_s = optimal_sigma_s(model, variance)
    fitted = np.einsum("...ii->...i", wrench_covariance(model, sigma_s[:, None, :] * np.eye(2)))
    free = sigma_s > 0
    assert free.mean() > 0.9
    np.testing.assert_allclose(fitted[free], variance[free], rtol=1e-12)
    assert np.all(fitted[~free] > variance[~free])


def test_covariances_that_are_none_and_cables_without_tension_are_refused():
    rng = np.random.default_rng(8)
    with pytest.raises(ModelDomainError, match="Σ_S"):
        sample_wrenches(MODEL, np.array([[1.0, 2.0], [2.0, 1.0]]), 3, rng)
    with pytest.raises(ModelDomainError, match="tension"):
        optimal_sigma_s(matrix_model(CableSystem(np.zeros(2), np.ones(2), np.zeros(2), np.ones(2))), np.ones(2))
