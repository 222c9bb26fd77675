"""Equations of small symmetric matrices, against LAPACK's."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.models.wishart.triangles import factorize, solve


@pytest.mark.parametrize("m", [1, 2, 3, 6, 8])
def test_an_equation_is_solved_with_its_ridge(m):
    rng = np.random.default_rng(1)
    root, side = rng.standard_normal((m + 2, m)), rng.standard_normal(m)
    matrix, factor, solution = root.T @ root, np.empty((m, m)), np.empty(m)
    factorize(matrix, 0.3, factor)
    form = solve(factor, side, solution)
    np.testing.assert_allclose((matrix + 0.3 * np.eye(m)) @ solution, side, atol=1e-12)
    assert form == pytest.approx(side @ solution, rel=1e-12)
    # control: without the ridge it is another
    assert np.abs(matrix @ solution - side).max() > 1e-3


def test_columns_of_any_units_leave_the_solution_as_exact():
    rng = np.random.default_rng(2)
    root, units = rng.standard_normal((5, 3)), np.array([1.0, 1e8, 1e-8])
    side, solution, factor = rng.standard_normal(3), np.empty(3), np.empty((3, 3))
    scaled = root * units
    factorize(scaled.T @ scaled, 0.0, factor)
    solve(factor, units * side, solution)
    expected = np.linalg.solve(root.T @ root, side)
    np.testing.assert_allclose(units * solution, expected, rtol=1e-10)


def test_the_least_share_of_a_pivot_tells_how_singular_the_matrix_is():
    factor = np.empty((2, 2))
    for far, share in ((1.0, 0.5), (1e-8, 1e-8)):
        matrix = np.array([[1.0, 1.0], [1.0, 1.0 + far]])
        assert factorize(matrix, 0.0, factor) == pytest.approx(share, rel=1e-6)
    assert factorize(np.ones((2, 2)), 0.0, factor) == 0.0
