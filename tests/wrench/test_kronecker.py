"""Σ_S and Ψ_S come back from recorded Jacobians, and are refused where the records cannot tell
them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from planar_cables import planar_cables
from scipy.stats import matrix_normal

from pipeline.core.errors import ModelDomainError
from pipeline.wrench.directions import sample_directions
from pipeline.wrench.kronecker import moment_fit
from pipeline.wrench.matrix import MatrixModel, matrix_model
from pipeline.wrench.parametric import wrench_covariance

MEAN = np.array([[0.9, -0.4, 0.1, 0.5], [0.3, 0.8, -1.0, 0.2]])
SIGMA_S = np.array([[5.0, 2.0], [2.0, 3.0]]) * 1e-4
PSI = np.array(
    [[0.4, 0.1, 0.0, 0.0], [0.1, 0.6, 0.1, 0.0], [0.0, 0.1, 2.0, -0.3], [0.0, 0.0, -0.3, 1.0]]
)  # its trace is the number of cables


MODEL = MatrixModel(MEAN, np.array([3.0, 5.0, 4.0, 4.5]), 0.2 * np.eye(4), PSI)


def recorded(samples, seed, psi=PSI):
    law = matrix_normal(MEAN, SIGMA_S, psi)
    return law.rvs(samples, random_state=np.random.default_rng(seed))


def test_both_covariances_come_back_and_the_identity_would_not_fit():
    fits = [moment_fit(recorded(400, seed)) for seed in range(60)]
    for name, due in (("mean", MEAN), ("sigma_s", SIGMA_S), ("psi", PSI)):
        values = np.array([getattr(each, name) for each in fits])
        z = (values.mean(axis=0) - due) / (values.std(axis=0, ddof=1) / np.sqrt(len(fits)))
        assert np.abs(z).max() < 5  # 34 entries; covariances have a bias of 1/400 that is less
        if name == "psi":
            assert np.abs(values.mean(axis=0) - np.eye(4)).max() > 0.5
            np.testing.assert_allclose([np.trace(value) for value in values], 4.0)


def test_columns_that_are_directions_keep_their_trace():
    rng = np.random.default_rng(5)
    angles, kappa = np.array([0.9, 1.3, 2.0, 3.0]), np.array([100.0, 700.0, 200.0, 400.0])
    tension = np.array([3.0, 5.0, 4.0, 4.5])
    system = planar_cables(tension, angles, np.full(4, 0.5), kappa)
    jacobians = np.swapaxes(sample_directions(system.direction, kappa, 10_000, rng), 1, 2)
    law = moment_fit(jacobians)
    known = replace(matrix_model(system), jacobian=law.mean, psi=law.psi)
    due = wrench_covariance(system) - known.actuation_part()  # caused by the directions
    assert known.spread() * np.trace(law.sigma_s) / np.trace(due) == pytest.approx(1, abs=0.03)


def test_the_columns_of_directions_are_independent_and_their_variances_go_with_1_over_kappa():
    kappa = np.array([100.0, 700.0, 200.0, 400.0])
    mean = planar_cables(*np.ones((4, 4))).direction
    directions = sample_directions(mean, kappa, 20_000, np.random.default_rng(6))
    psi = moment_fit(np.swapaxes(directions, 1, 2)).psi
    due = np.diag(4 / kappa / np.sum(1 / kappa))
    # a variance of 20 000 draws is known to 1 %, a correlation to 0.007
    np.testing.assert_allclose(np.diag(psi), np.diag(due), rtol=0.045)
    scale = np.sqrt(np.diag(psi))
    assert np.abs(psi / np.outer(scale, scale) - np.eye(4)).max() < 0.032
    assert np.abs(psi - np.eye(4)).max() > 0.5


def test_a_cable_that_never_moves_has_no_psi_and_records_that_are_all_alike_are_refused():
    still = recorded(50, 4)
    still[:, :, 1] = MEAN[:, 1]
    np.testing.assert_allclose(moment_fit(still).psi[1], 0.0, atol=1e-20)
    with pytest.raises(ModelDomainError, match="alike"):
        moment_fit(np.tile(MEAN, (5, 1, 1)))


def test_one_law_of_the_tensions_tells_a_trace_with_psi_times_sigma_but_neither_of_the_two():
    other = replace(MODEL, psi=PSI[::-1, ::-1])
    sigma_s = SIGMA_S * MODEL.spread() / other.spread()
    due = MODEL.covariance(SIGMA_S)
    np.testing.assert_allclose(other.covariance(sigma_s), due, rtol=1e-12)
    assert np.abs(other.covariance(SIGMA_S) / due - 1).max() > 0.001


def test_several_known_tensions_tell_psi_and_sigma_but_for_one_factor():
    i, j = np.triu_indices(4)

    def psi_coefficients(tensions):  # TᵀΨT is linear in the entries Ψᵢⱼ, i ≤ j
        return np.where(i == j, 1.0, 2.0) * tensions[:, i] * tensions[:, j]

    rng = np.random.default_rng(42)
    tensions = rng.uniform(1, 4, (10, 4))  # as many as Ψ has entries
    still = np.zeros((4, 4))
    covariances = np.array(
        [replace(MODEL, actuation=t, actuation_cov=still).covariance(SIGMA_S) for t in tensions]
    )
    traces = np.trace(covariances, axis1=1, axis2=2)  # tr Σ_S·TᵀΨT
    psi = np.zeros((4, 4))
    psi[i, j] = psi[j, i] = np.linalg.solve(psi_coefficients(tensions), traces)
    psi *= 4 / np.trace(psi)
    np.testing.assert_allclose(psi, PSI, atol=1e-7)
    np.testing.assert_allclose(
        covariances[0] / (tensions[0] @ psi @ tensions[0]), SIGMA_S, rtol=1e-7
    )
    # one fewer, or one alone in several sizes, leave Ψ open
    for few in (tensions[:9], np.outer(rng.uniform(1, 4, 10), tensions[0])):
        assert np.linalg.matrix_rank(psi_coefficients(few)) < 10
