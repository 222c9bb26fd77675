"""The density of (J̲ + J_ν)⁻¹v in closed form: the determinant's expectation, and the law itself against drawn matrices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from pipeline.motion.gaussian_forward_density import action_log_density, crossing, expected_absolute_determinant, marcum_q

POSE = np.array([0.4, 1.7, -0.3])


def test_marcums_q_is_the_tail_of_a_noncentral_chi_square():
    rng = np.random.default_rng(1)
    a = rng.uniform(0, 50, 2000)
    b = np.maximum(a - rng.exponential(2, 2000), 0)
    np.testing.assert_allclose(marcum_q(b, a), stats.ncx2(2, np.maximum(b, 1e-12) ** 2).sf(a**2), atol=1e-8)
    assert marcum_q(np.zeros(1), np.zeros(1)) == pytest.approx(1.0, abs=1e-8)


@pytest.mark.parametrize("s", [1e-6, 1e-2, 0.3, 30.0])
def test_the_expected_absolute_determinant_is_that_of_drawn_matrices(s):
    mean = np.array([[1.0, 0.3], [-0.2, 0.25]])
    drawn = np.abs(np.linalg.det(mean + np.sqrt(s) * np.random.default_rng(2).standard_normal((200_000, 2, 2))))

    def excess(variance: float) -> float:
        found = expected_absolute_determinant(np.abs(np.linalg.det(mean)), np.sum(mean**2), variance)
        return abs(drawn.mean() - found) / drawn.std() * np.sqrt(len(drawn))

    assert excess(s) < 3.5
    # control: a variance 10 % off, where there is any to see, and the determinant's mean in the place of its absolute value's
    assert s < 0.1 or excess(1.1 * s) > 5
    assert s < 0.1 or abs(drawn.mean() - np.abs(np.linalg.det(mean))) / drawn.std() * np.sqrt(len(drawn)) > 5


def test_without_a_mean_the_expected_absolute_determinant_is_the_variance():
    """det G of standard normal entries has Laplace's law, E|det G| = 1."""
    np.testing.assert_allclose(expected_absolute_determinant(0.0, 0.0, np.array([0.01, 1.0, 7.0])), [0.01, 1.0, 7.0], rtol=1e-8)


def test_the_minor_across_the_step_needs_no_bases(chain, poses, step):
    """‖VᵀJ̲U‖ and det VᵀJ̲U with U and V from a QR decomposition give the same E|det G|."""
    jacobians = chain.jacobian(poses[:20])
    x = np.random.default_rng(3).standard_normal((20, 3))
    v = np.broadcast_to(step, (20, 3))
    found = crossing(jacobians, v, x[:, None], np.full(20, 0.02))[:, 0]
    for i, jacobian in enumerate(jacobians):
        u, w = (np.linalg.qr(vector[:, None], mode="complete")[0][:, 1:] for vector in (x[i], step))
        minor = w.T @ jacobian @ u
        expected = expected_absolute_determinant(np.abs(np.linalg.det(minor)), np.sum(minor**2), 0.02)
        assert found[i] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("s", [0.02**2, 0.1**2, 0.5**2])
def test_the_density_is_that_of_drawn_matrices_box_by_box(chain, step, s):
    rng = np.random.default_rng(4)
    jacobian = chain.jacobian(POSE)
    draws = np.linalg.solve(jacobian + np.sqrt(s) * rng.standard_normal((200_000, 3, 3)), step)
    corners = np.quantile(draws, [0.05, 0.4, 0.6, 0.95], axis=0)

    def excess(low: np.ndarray, high: np.ndarray, variance: float) -> float:
        hits = np.mean(np.all((draws > low) & (draws < high), axis=1))
        x = np.random.default_rng(5).uniform(low, high, (20_000, 3))
        log_density = action_log_density(
            x, np.broadcast_to(step, x.shape), np.broadcast_to(jacobian, (len(x), 3, 3)), np.full(len(x), variance)
        )
        inside = np.exp(log_density) * np.prod(high - low)
        return abs(hits - inside.mean()) / np.hypot(np.sqrt(hits * (1 - hits) / len(draws)), inside.std() / np.sqrt(len(inside)))

    boxes = [(corners[i], corners[j]) for i, j in ((0, 3), (1, 2), (0, 2))]
    assert max(excess(*box, s) for box in boxes) < 3.5
    # control: a standard deviation 20 % off
    assert max(excess(*box, 1.44 * s) for box in boxes) > 5


@pytest.mark.parametrize("s", [0.03**2, 0.2**2, 1.0])
def test_the_density_integrates_to_one(chain, step, s):
    """By importance sampling from the law of the inverse of a matrix with more noise, whose tails ‖x‖⁻⁴ none of this law's exceed."""
    rng = np.random.default_rng(6)
    jacobian, count = chain.jacobian(POSE), 40_000
    wide = 1.5 * s
    x = np.linalg.solve(jacobian + np.sqrt(wide) * rng.standard_normal((count, 3, 3)), step)
    v, jacobians = np.broadcast_to(step, x.shape), np.broadcast_to(jacobian, (count, 3, 3))
    proposal = action_log_density(x, v, jacobians, np.full(count, wide))
    ratio = np.exp(action_log_density(x, v, jacobians, np.full(count, s)) - proposal)
    error = ratio.std() / np.sqrt(count)
    assert error < 0.01
    assert abs(ratio.mean() - 1) < 4 * error
    # control: the same draws against the density of a matrix with three times the variance
    wrong = np.exp(action_log_density(x, v, jacobians, np.full(count, s)) - action_log_density(x, v, jacobians, np.full(count, 3 * s)))
    assert abs(wrong.mean() - 1) > 8 * wrong.std() / np.sqrt(count)


def test_with_little_noise_it_is_the_linearised_normal_law(chain, poses, step):
    """x ≈ x₀ − J̲⁻¹J_νx₀ for s → 0: N(x₀, s‖x₀‖²(J̲ᵀJ̲)⁻¹), to an order of √s."""
    jacobian, s = chain.jacobian(poses), 1e-12
    nominal = np.matvec(chain.inverse_jacobian(poses), step)
    white = np.random.default_rng(7).standard_normal(poses.shape)
    scale = np.sqrt(s * np.vecdot(nominal, nominal))
    x = nominal + scale[:, None] * np.matvec(chain.inverse_jacobian(poses), white)
    found = action_log_density(x, np.broadcast_to(step, x.shape), jacobian, np.full(len(x), s))
    linear = stats.norm.logpdf(white).sum(axis=1) - 3 * np.log(scale) + np.log(np.abs(chain.determinant(poses)))
    np.testing.assert_allclose(found, linear, atol=2e-3)


def test_no_matrix_takes_the_origin_to_the_command(chain, step):
    near = np.array([[0.0, 0.0, 0.0], [1e-9, 0.0, 0.0]])
    jacobians = np.broadcast_to(chain.jacobian(POSE), (2, 3, 3))
    found = action_log_density(near, np.broadcast_to(step, (2, 3)), jacobians, np.full(2, 0.01))
    assert found[0] == -np.inf and found[1] < -1e6
