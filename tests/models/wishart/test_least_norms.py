"""The least sum of two norms for matrices of any size: against its secular equation by LAPACK's
singular values, and stationary in each of its three cases.
"""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.models.wishart.least_norms import least_sum_of_norms

SIZES = [(1, 1), (3, 3), (6, 6), (2, 1), (3, 2), (7, 6), (8, 3)]
every_size = pytest.mark.parametrize(("n", "m"), SIZES)


def objective(noise, matrix, y, ratio) -> np.ndarray:
    rest = noise - np.matvec(matrix, y)
    return np.linalg.norm(rest, axis=1) + ratio * np.linalg.norm(y, axis=1)


def by_singular_values(noise: np.ndarray, matrix: np.ndarray, ratio: float) -> np.ndarray:
    """By another route: the secular equation in the singular values of A, by bisection."""
    left, singular, right = np.linalg.svd(matrix, full_matrices=False)
    c, square = np.vecmat(noise, left), singular**2
    rest = noise - np.matvec(left, c)
    n, m = matrix.shape[-2:]
    outside = np.vecdot(rest, rest)[:, None] * (n > m)
    # μ = scale·t/(1 − t): t = 0 is the exact fit, t = 1 is y = 0
    scale = square[:, :1]
    low, high = np.zeros_like(scale), np.ones_like(scale)

    def beyond(t: np.ndarray) -> np.ndarray:
        weights = (c / ((1 - t) * square + t * scale)) ** 2
        inside = (weights * (square - ratio**2)).sum(axis=-1, keepdims=True)
        with np.errstate(divide="ignore", invalid="ignore"):
            across = np.where(outside > 0, ratio**2 * outside / (t * scale) ** 2, 0.0)
        return inside >= across

    exact, zero = beyond(low), ~beyond(high)
    for _ in range(80):
        middle = (low + high) / 2
        above = beyond(middle)
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    t = np.where(exact, 0.0, np.where(zero, 1.0, high))
    shares = (1 - t) * singular * c / ((1 - t) * square + t * scale)
    return np.vecmat(shares, right)


@every_size
@pytest.mark.parametrize("ratio", [1e-3, 0.03, 0.3, 1.0, 3.0])
@pytest.mark.parametrize(("condition", "tolerance"), [(1.0, 1e-10), (1e4, 1e-6)])
def test_the_root_is_that_of_the_secular_equation(n, m, ratio, condition, tolerance):
    rng = np.random.default_rng(4)
    noise, matrix = rng.standard_normal((500, n)), rng.standard_normal((500, n, m))
    matrix[:, :, 0] *= condition
    y = least_sum_of_norms(noise, matrix, ratio)
    reference = by_singular_values(noise, matrix, ratio)
    # A weighs its columns by the condition; the optimum is flat
    unit = np.array([condition, *np.ones(m - 1)])
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
    result, reference = (
        fit(noise, matrix, 0.1) for fit in (least_sum_of_norms, by_singular_values)
    )
    values = [objective(noise, matrix, each, 0.1) for each in (result, reference, result * 1.01)]
    np.testing.assert_allclose(values[0], values[1], rtol=1e-7)
    # control: a hundredth beside it
    assert np.median(np.abs(values[2] / values[1] - 1)) > 1e-6


@every_size
def test_without_a_price_it_is_the_fit_of_least_squares(n, m):
    rng = np.random.default_rng(6)
    noise, matrix = rng.standard_normal((100, n)), rng.standard_normal((100, n, m))
    expected = np.matvec(np.linalg.pinv(matrix), noise)
    np.testing.assert_allclose(least_sum_of_norms(noise, matrix, 0.0), expected, rtol=1e-8)


@every_size
@pytest.mark.parametrize("ratio", [0.03, 0.3, 1.0, 3.0])
def test_the_sum_of_norms_is_stationary_in_each_of_its_three_cases(n, m, ratio):
    rng = np.random.default_rng(3)
    noise, matrix = rng.standard_normal((400, n)), rng.standard_normal((400, n, m))
    y = least_sum_of_norms(noise, matrix, ratio)
    residual = noise - np.matvec(matrix, y)
    pull = np.vecmat(residual, matrix)
    size, rest = np.linalg.norm(y, axis=1), np.linalg.norm(residual, axis=1)
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
