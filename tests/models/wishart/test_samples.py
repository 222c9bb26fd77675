"""The perturbations where no bound holds them back, of arms of any size: against the free optimum
by LAPACK's singular values, and stationary in each of its three cases.
"""

from __future__ import annotations

import numpy as np
import pytest
from perturbation_problems import free_optimum, parts

from pipeline.models.wishart.bound import ROWS
from pipeline.models.wishart.samples import perturb

SIZES = [(1, 1), (3, 3), (6, 6), (2, 1), (3, 2), (7, 6), (8, 3)]
every_size = pytest.mark.parametrize(("n", "m"), SIZES)
FAR = 1e100  # δ that no bound is met in


def free(noise: np.ndarray, matrix: np.ndarray, ratio: float) -> np.ndarray:
    """(N, m) y for A (N, n, m)."""
    count, n, m = matrix.shape
    e = np.random.default_rng(9).standard_normal((count, m))
    e /= np.linalg.norm(e, axis=1)[:, None]
    root = np.sqrt(2)
    back = root * matrix + (1 - root) * np.matvec(matrix, e)[:, :, None] * e[:, None, :]
    s, norms, bound = np.zeros((count, m, m)), np.zeros((count, 2)), np.zeros(count, dtype=bool)
    room = np.empty((n, m + 1)), np.empty((3, m, m)), np.empty((ROWS, m))
    assert perturb(noise, e, back, ratio, FAR, 200, s, norms, bound, *room) == -1
    y, c = parts(s, e)
    np.testing.assert_allclose(norms[:, 1], np.linalg.norm(s, axis=(1, 2)), rtol=1e-9)
    np.testing.assert_allclose(norms[:, 0], residual(noise, matrix, y), rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(c, 0.0, atol=1e-9 * np.abs(y).max())
    assert not bound.any()
    return y


def residual(noise, matrix, y) -> np.ndarray:
    return np.linalg.norm(noise - np.matvec(matrix, y), axis=1)


def objective(noise, matrix, y, ratio) -> np.ndarray:
    return residual(noise, matrix, y) + ratio * np.linalg.norm(y, axis=1)


@every_size
@pytest.mark.parametrize("ratio", [1e-3, 0.03, 0.3, 1.0, 3.0])
@pytest.mark.parametrize("condition", [1.0, 1e4])
def test_the_root_is_that_of_the_secular_equation(n, m, ratio, condition):
    rng = np.random.default_rng(4)
    noise, matrix = rng.standard_normal((500, n)), rng.standard_normal((500, n, m))
    matrix[:, :, 0] *= condition
    y = free(noise, matrix, ratio)
    reference = free_optimum(noise, matrix, ratio)
    # A weighs its columns by the condition; the optimum is flat, and AᵀA has the square of what is
    # left
    unit = np.array([condition, *np.ones(m - 1)])
    tolerance = 1e-9 + 1e-15 * np.linalg.cond(matrix / unit) ** 2
    distance = np.linalg.norm((y - reference) * unit, axis=1)
    assert np.all(distance <= tolerance * np.linalg.norm(reference * unit, axis=1) + 1e-15)
    least = objective(noise, matrix, reference, ratio)
    np.testing.assert_allclose(objective(noise, matrix, y, ratio), least, rtol=1e-9, atol=1e-9)


@every_size
@pytest.mark.parametrize("across", [0.0, 1e-13, 1e-9, 1e-4])
def test_noise_that_hardly_leaves_the_range_of_the_matrix_is_explained_as_within_it(n, m, across):
    rng = np.random.default_rng(5)
    matrix, y = rng.standard_normal((300, n, m)), rng.standard_normal((300, m))
    noise = np.matvec(matrix, y)
    noise += across * rng.standard_normal(noise.shape)
    result, reference = (each(noise, matrix, 0.1) for each in (free, free_optimum))
    values = [objective(noise, matrix, each, 0.1) for each in (result, reference, result * 1.01)]
    np.testing.assert_allclose(values[0], values[1], rtol=1e-7)
    # control: a hundredth beside it
    assert np.median(np.abs(values[2] / values[1] - 1)) > 1e-6


@every_size
def test_without_a_price_it_is_the_fit_of_least_squares(n, m):
    rng = np.random.default_rng(6)
    noise, matrix = rng.standard_normal((100, n)), rng.standard_normal((100, n, m))
    expected = np.matvec(np.linalg.pinv(matrix), noise)
    np.testing.assert_allclose(free(noise, matrix, 0.0), expected, rtol=1e-8)


@every_size
@pytest.mark.parametrize("ratio", [0.03, 0.3, 1.0, 3.0])
def test_the_sum_of_norms_is_stationary_in_each_of_its_three_cases(n, m, ratio):
    rng = np.random.default_rng(3)
    noise, matrix = rng.standard_normal((400, n)), rng.standard_normal((400, n, m))
    y = free(noise, matrix, ratio)
    left = noise - np.matvec(matrix, y)
    pull = np.vecmat(left, matrix)
    size, rest = np.linalg.norm(y, axis=1), np.linalg.norm(left, axis=1)
    zero, exact = size == 0, rest < 1e-9
    inside = ~zero & ~exact
    gradient = ratio * y[inside] / size[inside, None] - pull[inside] / rest[inside, None]
    np.testing.assert_allclose(gradient, 0, atol=1e-6)
    assert np.all(np.linalg.norm(pull[zero], axis=1) <= ratio * rest[zero] * (1 + 1e-9))
    if n > m:
        assert not np.any(exact)
    else:
        unit = y / np.where(zero, 1, size)[:, None]
        dual = ratio * np.linalg.solve(np.swapaxes(matrix, -1, -2), unit[..., None])[..., 0]
        assert np.all(np.linalg.norm(dual[exact & ~zero], axis=1) <= 1 + 1e-6)
        assert exact.any() or ratio > 0.3
    assert inside.any() or m == n == 1
    assert zero.any() or ratio < 3
