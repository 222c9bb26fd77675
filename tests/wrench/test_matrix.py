"""The random-matrix wrench model against draws of the whole matrix, a bounded optimiser and its
limits; Σ_S and Ψ_S from recorded Jacobians.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cable_systems import planar_cables
from scipy.optimize import least_squares
from scipy.stats import ks_2samp, matrix_normal

from pipeline.core.errors import ModelDomainError
from pipeline.wrench.matrix import (
    MatrixModel,
    matrix_model,
    moment_fit,
    optimal_sigma_s,
    sample_wrenches,
    unbounded_sigma_s,
)
from pipeline.wrench.parametric import sample_directions, wrench_covariance

BAND = 4.5  # standard errors
MODEL = MatrixModel(
    np.array([[0.9, -0.4, 0.1], [0.3, 0.8, -1.0]]),
    np.array([0.5, -1.0, 2.0]),
    actuation_cov=np.array([[2.0, 0.5, 0.0], [0.5, 1.0, -0.3], [0.0, -0.3, 1.5]]),
    psi=np.array([[1.0, 0.3, 0.0], [0.3, 0.6, 0.1], [0.0, 0.1, 1.4]]),
)
SIGMA_S = np.array([[0.5, 0.2], [0.2, 0.3]])
N = 100_000
TOLERANCE = {"xtol": 1e-14, "ftol": 1e-14, "gtol": 1e-14}


def whole_matrix_wrenches(rng):
    """W = S·T with S drawn entry by entry: S̲ + Σ_S^½ Z Ψ_S^½."""
    left, right, of_actuation = map(np.linalg.cholesky, (SIGMA_S, MODEL.psi, MODEL.actuation_cov))
    noise = left @ rng.standard_normal((N, 2, 3)) @ right.T
    actuation = MODEL.actuation + rng.standard_normal((N, 3)) @ of_actuation.T
    return np.einsum("knm,km->kn", MODEL.jacobian + noise, actuation)


def covariance_z(samples, covariance):
    centred = samples - samples.mean(axis=0)
    products = np.einsum("ki,kj->kij", centred, centred)
    return (products.mean(axis=0) - covariance) * np.sqrt(N) / products.std(axis=0)


def random_systems(count, agents, rng):
    ends = ((1.8, 14), (0, 6.3), (0.5, 2.3), (100, 2400))
    return planar_cables(*(rng.uniform(*each, (count, agents)) for each in ends))


def one_of(model, k):
    return MatrixModel(model.jacobian[k], model.actuation[k], model.actuation_cov[k], model.psi)


def test_products_of_whole_random_matrices_have_the_closed_forms_moments():
    samples = whole_matrix_wrenches(np.random.default_rng(3))
    covariance = MODEL.covariance(SIGMA_S)
    off = samples.mean(axis=0) - MODEL.jacobian @ MODEL.actuation
    assert np.abs(off / np.sqrt(np.diag(covariance) / N)).max() < BAND
    assert np.abs(covariance_z(samples, covariance)).max() < BAND
    identity = replace(MODEL, psi=np.eye(3))
    assert np.abs(covariance_z(samples, identity.covariance(SIGMA_S))).max() > 2 * BAND


def test_reduced_sampling_has_the_law_of_the_whole_product_and_a_normal_law_has_not():
    rng = np.random.default_rng(4)
    whole, reduced = whole_matrix_wrenches(rng), sample_wrenches(MODEL, SIGMA_S, N, rng)
    normal = rng.multivariate_normal(MODEL.jacobian @ MODEL.actuation, MODEL.covariance(SIGMA_S), N)
    for direction in ([1.0, 0.0], [0.0, 1.0], [0.6, -0.8]):
        assert ks_2samp(whole @ direction, reduced @ direction).pvalue > 1e-3
    assert ks_2samp(whole[:, 0], normal[:, 0]).pvalue < 1e-6


def test_without_randomness_of_the_matrix_or_of_the_actuation_the_wrench_is_what_remains():
    rng = np.random.default_rng(5)
    fixed, nothing = replace(MODEL, actuation_cov=np.zeros((3, 3))), np.zeros((2, 2))
    due = np.tile(MODEL.jacobian @ MODEL.actuation, (4, 1))
    np.testing.assert_allclose(sample_wrenches(fixed, nothing, 4, rng), due, rtol=1e-12)
    due = MODEL.jacobian @ MODEL.actuation_cov @ MODEL.jacobian.T
    np.testing.assert_allclose(MODEL.covariance(nothing), due)


def test_the_diagonal_optimum_is_that_of_a_bounded_optimiser_with_and_without_its_bound_active():
    systems = random_systems(400, 2, np.random.default_rng(6))
    model, covariance = matrix_model(systems), wrench_covariance(systems)
    closed, held = optimal_sigma_s(unbounded_sigma_s(model, covariance), "diagonal")
    np.testing.assert_array_equal(held, np.sum(np.einsum("...ii->...i", closed) == 0, axis=-1))
    assert np.sum(held > 0) >= 10
    for k in np.concatenate([np.flatnonzero(held)[:10], np.flatnonzero(held == 0)[:10]]):
        one = one_of(model, k)

        def residual(s, one=one, k=k):
            return 1e4 * np.diag(one.covariance(np.diag(s) * 1e-4) - covariance[k])

        optimum = least_squares(residual, [5.0, 5.0], bounds=(0, np.inf), **TOLERANCE)
        np.testing.assert_allclose(closed[k], np.diag(optimum.x) * 1e-4, atol=2e-9)


def test_the_full_optimum_is_that_of_an_optimiser_and_clipped_diagonals_alone_are_not():
    systems = random_systems(400, 2, np.random.default_rng(40))
    model, covariance = matrix_model(systems), wrench_covariance(systems)
    unbounded = unbounded_sigma_s(model, covariance)
    closed, held = optimal_sigma_s(unbounded, "full")
    np.testing.assert_array_equal(held > 0, np.linalg.det(unbounded) < 0)
    assert np.sum(held > 0) >= 10 and np.sum(held == 0) >= 10
    worse = []
    for k in np.concatenate([np.flatnonzero(held)[:10], np.flatnonzero(held == 0)[:10]]):
        one = one_of(model, k)

        def difference(sigma_s, one=one, k=k):
            return (one.covariance(sigma_s) - covariance[k]).ravel()

        def of_factor(entries, difference=difference):
            factor = np.array([[entries[0], 0.0], entries[1:]])
            return 1e3 * difference(factor @ factor.T * 1e-4)

        starts = ([2.0, 0.0, 2.0], [2.0, 2.0, 0.5], [2.0, -2.0, 0.5])
        optimum = [least_squares(of_factor, start, **TOLERANCE).cost for start in starts]
        reached = 0.5 * np.sum((1e3 * difference(closed[k])) ** 2)
        assert reached <= min(optimum) * (1 + 1e-9) + 1e-9
        assert reached == pytest.approx(min(optimum), rel=1e-3, abs=1e-6)
        entries = unbounded[k] + np.diag(np.maximum(0, -np.diag(unbounded[k])))
        worse.append(np.linalg.eigvalsh(entries)[0] < -1e-6)
    assert any(worse[:10]) and not any(worse[10:])


def test_without_active_bounds_the_moments_are_the_parametric_ones_and_else_variances_are_greater():
    systems = random_systems(300, 5, np.random.default_rng(7))
    model, covariance = matrix_model(systems), wrench_covariance(systems)
    unbounded = unbounded_sigma_s(model, covariance)
    full, held = optimal_sigma_s(unbounded, "full")
    fitted = model.covariance(full)
    assert 0.5 < np.mean(held == 0) < 1
    np.testing.assert_allclose(fitted[held == 0], covariance[held == 0], rtol=1e-11, atol=1e-12)
    assert np.all(np.trace(fitted - covariance, axis1=-2, axis2=-1)[held > 0] > 0)
    diagonal, entries = optimal_sigma_s(unbounded, "diagonal")
    difference = model.covariance(diagonal) - covariance
    np.testing.assert_allclose(np.einsum("...ii->...i", difference)[entries == 0], 0.0, atol=1e-12)
    # without off-diagonal terms the covariance of the two components is that of the actuation alone
    assert np.abs(difference[..., 0, 1]).max() > 0.01


def test_covariances_that_are_none_and_cables_without_tension_are_refused():
    rng = np.random.default_rng(8)
    with pytest.raises(ModelDomainError, match="Σ_S"):
        sample_wrenches(MODEL, np.array([[1.0, 2.0], [2.0, 1.0]]), 3, rng)
    with pytest.raises(ModelDomainError, match="need variance"):
        moment_fit(np.tile(MODEL.jacobian, (5, 1, 1)))
    with pytest.raises(ModelDomainError, match="tension"):
        slack = planar_cables(np.zeros(2), np.ones(2), np.zeros(2), np.ones(2))
        unbounded_sigma_s(matrix_model(slack), np.eye(2))


MEAN = np.array([[0.9, -0.4, 0.1, 0.5], [0.3, 0.8, -1.0, 0.2]])
SIGMA_CABLES = np.array([[5.0, 2.0], [2.0, 3.0]]) * 1e-4
# its trace is the number of cables
PSI = np.diag([0.4, 0.6, 2.0, 1.0]) + np.diag([0.1, 0.1, -0.3], 1) + np.diag([0.1, 0.1, -0.3], -1)
CABLES = MatrixModel(MEAN, np.array([3.0, 5.0, 4.0, 4.5]), 0.2 * np.eye(4), PSI)


def recorded(samples, seed, psi=PSI):
    law = matrix_normal(MEAN, SIGMA_CABLES, psi)
    return law.rvs(samples, random_state=np.random.default_rng(seed))


def test_both_covariances_come_back_and_the_identity_would_not_fit():
    fits = [moment_fit(recorded(400, seed)) for seed in range(60)]
    for name, due in (("mean", MEAN), ("sigma_s", SIGMA_CABLES), ("psi", PSI)):
        values = np.array([getattr(each, name) for each in fits])
        z = (values.mean(axis=0) - due) / (values.std(axis=0, ddof=1) / np.sqrt(len(fits)))
        assert np.abs(z).max() < 5  # 34 entries; covariances have a bias of 1/400 that is less
        if name == "psi":
            assert np.abs(values.mean(axis=0) - np.eye(4)).max() > 0.5
            np.testing.assert_allclose([np.trace(value) for value in values], 4.0)


def test_the_columns_of_directions_are_independent_and_their_variances_go_with_1_over_kappa():
    kappa = np.array([100.0, 700.0, 200.0, 400.0])
    mean = planar_cables(*np.ones((4, 4))).direction
    directions = sample_directions(mean, kappa, 20_000, np.random.default_rng(6))
    fit = moment_fit(jacobians := np.swapaxes(directions, 1, 2))
    psi, x = fit.psi, jacobians - fit.mean
    # the trace is exact, whatever the law of the columns
    total = np.mean(np.sum(x**2, axis=(1, 2)))
    assert np.trace(fit.sigma_s) * np.trace(psi) == pytest.approx(total, rel=1e-12)
    due = np.diag(4 / kappa / np.sum(1 / kappa))
    # a variance of 20 000 draws is known to 1 %, a correlation to 0.007
    np.testing.assert_allclose(np.diag(psi), np.diag(due), rtol=0.045)
    scale = np.sqrt(np.diag(psi))
    assert np.abs(psi / np.outer(scale, scale) - np.eye(4)).max() < 0.032
    assert np.abs(psi - np.eye(4)).max() > 0.5


def test_one_law_of_the_tensions_tells_a_trace_with_psi_times_sigma_but_neither_of_the_two():
    other = replace(CABLES, psi=PSI[::-1, ::-1])
    sigma_s = SIGMA_CABLES * CABLES.spread() / other.spread()
    due = CABLES.covariance(SIGMA_CABLES)
    np.testing.assert_allclose(other.covariance(sigma_s), due, rtol=1e-12)
    assert np.abs(other.covariance(SIGMA_CABLES) / due - 1).max() > 0.001


def test_several_known_tensions_tell_psi_and_sigma_but_for_one_factor():
    i, j = np.triu_indices(4)

    def psi_coefficients(tensions):  # TᵀΨT is linear in the entries Ψᵢⱼ, i ≤ j
        return np.where(i == j, 1.0, 2.0) * tensions[:, i] * tensions[:, j]

    rng = np.random.default_rng(42)
    tensions = rng.uniform(1, 4, (10, 4))  # as many as Ψ has entries
    still = np.zeros((4, 4))
    known = [replace(CABLES, actuation=t, actuation_cov=still) for t in tensions]
    covariances = np.array([model.covariance(SIGMA_CABLES) for model in known])
    traces = np.trace(covariances, axis1=1, axis2=2)  # tr Σ_S·TᵀΨT
    psi = np.zeros((4, 4))
    psi[i, j] = psi[j, i] = np.linalg.solve(psi_coefficients(tensions), traces)
    psi *= 4 / np.trace(psi)
    np.testing.assert_allclose(psi, PSI, atol=1e-7)
    sigma_s = covariances[0] / (tensions[0] @ psi @ tensions[0])
    np.testing.assert_allclose(sigma_s, SIGMA_CABLES, rtol=1e-7)
    # one fewer, or one alone in several sizes, leave Ψ open
    for few in (tensions[:9], np.outer(rng.uniform(1, 4, 10), tensions[0])):
        assert np.linalg.matrix_rank(psi_coefficients(few)) < 10
