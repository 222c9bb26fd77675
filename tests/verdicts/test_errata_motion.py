"""Errata of the motion part that no other test shows: signs, units and orders, and moments that do
not exist.
"""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.arm.chain import PlanarChain
from pipeline.models.draws import draw_steps
from pipeline.models.gaussian.law import GaussianModel, noise_scale
from pipeline.models.noise import process_noise
from pipeline.models.wishart.decomposition import COMPUTED, Decomposition
from pipeline.models.wishart.law import WishartModel
from pipeline.statistics.takes import lag_one_correlation

POSE = np.array([0.4, 1.7, -0.3])
STEP = np.array([0.004, -0.003, 0.03])


def arm(metre: float = 1.0) -> PlanarChain:
    """The arm with its lengths in units of which a metre has ``metre``."""
    links = metre * np.array([[0.0, 0.155], [0.0, 0.135], [0.0, 0.17]])
    ranges = (np.full(3, end) for end in (-3.0, 3.0, np.pi / 2))
    return PlanarChain(np.zeros(2), links, np.array([1.0, 1.0, -1.0]), *ranges)


def test_only_measured_minus_nominal_is_the_noise_of_a_random_jacobian():
    """(J⁻¹ − J̲⁻¹)ẋᵈΔt of (Omegk) is ω as estimated here, and minus ω as (OmgReal) prints it."""
    chain = arm()
    factor = np.eye(3) + 0.1 * np.random.default_rng(0).standard_normal((3, 3))
    random = chain.jacobian(POSE) @ factor
    q = np.stack([POSE, POSE + np.linalg.solve(random, STEP)])
    meant = (np.linalg.inv(random) - chain.inverse_jacobian(POSE)) @ STEP
    printed = q[0] + chain.inverse_jacobian(q[0]) @ STEP - q[1]
    np.testing.assert_allclose(process_noise(chain, q[None], STEP[None])[0, 0], meant, atol=1e-14)
    np.testing.assert_allclose(printed, -meant, atol=1e-14)
    assert np.abs(meant).max() > 1e-3


@pytest.mark.parametrize("share", [0.4, 0.8])
def test_noise_of_a_corrected_deviation_is_anticorrelated_and_white_noise_is_not(share):
    """ω = e_{k+1} − e_k of e_{k+1} = (1 − κ)e_k + w_k has the lag-one correlation −κ/2. Band: 5
    standard errors; the control is w itself, which would add up to √M times its size.
    """
    takes, steps = 200, 320
    w = np.random.default_rng(9).standard_normal((takes, steps))
    e = np.zeros((takes, steps + 1))
    for k in range(steps):
        e[:, k + 1] = (1 - share) * e[:, k] + w[:, k]
    band = 5 / np.sqrt(w.size)
    assert abs(lag_one_correlation(np.diff(e)) + share / 2) < band
    assert abs(lag_one_correlation(w)) < band < share / 2
    assert w.sum(axis=1).std() > 0.8 * np.sqrt(steps) > 8 * e[:, -1].std()


@pytest.mark.parametrize("name", COMPUTED)
def test_another_unit_of_length_is_another_model_but_under_qr_of_the_transpose(name):
    model = WishartModel(0.25, Decomposition(name))
    metres = model.covariance(arm(), POSE, STEP)
    millimetres = model.covariance(arm(1000), POSE, STEP * [1000, 1000, 1])
    same = np.allclose(millimetres, metres, rtol=1e-6)
    assert same == (name == "qr_transposed")
    assert same or np.abs(np.diag(millimetres) / np.diag(metres) - 1).max() > 0.5
    # control: the nominal step is the same
    nominal = arm(1000).inverse_jacobian(POSE) @ (STEP * [1000, 1000, 1])
    np.testing.assert_allclose(nominal, arm().inverse_jacobian(POSE) @ STEP)


def test_the_noise_under_pivoted_lu_jumps_where_the_pivots_change_and_under_qr_nowhere():
    q = np.tile(POSE, (4001, 1))
    q[:, 0] = np.linspace(-2, 2, 4001)

    def greatest_jump(name: str) -> float:
        model = WishartModel(0.25, Decomposition(name))
        variance = np.diagonal(model.covariance(arm(), q, STEP), axis1=-2, axis2=-1)
        return float(np.abs(np.diff(np.log(variance), axis=0)).max())

    assert greatest_jump("pivoted_lu") > 0.3
    assert greatest_jump("qr") < 1e-3 and greatest_jump("qr_transposed") < 1e-2


def test_steps_through_the_inverse_of_a_gaussian_matrix_have_no_variance():
    """P(|Δq| > t) falls as 1/t, for the determinant has a density at zero; with the inverse
    Gaussian it falls faster than any power.
    """
    rng = np.random.default_rng(1)
    chain, size = arm(), 400_000
    drawn = chain.jacobian(POSE) + 0.05 * rng.standard_normal((size, 3, 3))
    forward = np.abs(np.linalg.solve(drawn, STEP)[:, 0])
    far = np.array([1.0, 4.0, 16.0])
    tail = np.array([np.mean(forward > t) for t in far])
    # four standard errors of the count beyond the farthest
    np.testing.assert_allclose(far * tail, far[0] * tail[0], rtol=4 / np.sqrt(size * tail[-1]))
    # control: the model of the inverse has nothing out there
    inverse, _ = draw_steps(GaussianModel(0.1, 30.0), chain, np.tile(POSE, (size, 1)), STEP, rng)
    assert not np.any(np.abs(inverse[:, 0] - POSE[0]) > far[0])


def test_half_of_the_matrices_exceed_the_bound_at_full_level():
    """tr{nΣ} ≤ u² − ‖J̲‖² bounds E‖J‖² by u², and no single norm."""
    rng = np.random.default_rng(2)
    inverse, u, draws = arm().inverse_jacobian(POSE), 18.0, 100_000
    scale = np.sqrt(noise_scale(np.linalg.norm(inverse), 1.0, u, 3, 3))

    def norms_at(level: float) -> np.ndarray:
        noise = level * scale * rng.standard_normal((draws, 3, 3))
        return np.linalg.norm(inverse + noise, axis=(1, 2))

    norms = norms_at(1.0)
    assert np.mean(norms**2) == pytest.approx(u**2, rel=0.01)
    assert 0.4 < np.mean(norms > u) < 0.6
    # control: a tenth of the level all but keeps it
    assert np.mean(norms_at(0.1) > u) < 1e-3
