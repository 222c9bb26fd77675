"""The search over positive semidefinite matrices ends at minima alone, on the boundary too."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.errors import SolverError
from pipeline.models.semidefinite import minimise


def distance_to(target: np.ndarray):
    def objective(matrices):
        (x,) = matrices
        return 0.5 * float(np.sum((x - target) ** 2)), [x - target]

    return objective


def nearest(target: np.ndarray) -> np.ndarray:
    values, axes = np.linalg.eigh(target)
    return (axes * np.maximum(values, 0.0)) @ axes.T


@pytest.mark.parametrize(
    "eigenvalues",
    [[1.0, 2.0, 3.0], [-1.0, 0.5, 2.0], [-2.0, -1.0, 1.0], [-3.0, -2.0, -1.0], [0.0, 0.0, 1.0]],
)
@pytest.mark.parametrize("start", [np.zeros((3, 3)), np.eye(3), np.diag([4.0, 0.0, 0.0])])
def test_the_nearest_positive_semidefinite_matrix_is_found_from_singular_starts_too(
    eigenvalues, start
):
    axes = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    target = (axes * eigenvalues) @ axes.T
    result = minimise(distance_to(target), [start])
    np.testing.assert_allclose(result.matrices[0], nearest(target), atol=1e-4)
    assert result.value == pytest.approx(0.5 * np.sum((nearest(target) - target) ** 2), abs=1e-8)
    # control: at zero every factor is stationary, and most are no minimum
    assert max(eigenvalues) < 0 or 0.5 * np.sum(target**2) > result.value + 0.1


def test_several_matrices_are_searched_together():
    target = np.diag([2.0, -1.0, 3.0])

    def objective(matrices):
        x, y = matrices
        rest, gap = x - target, float(y[0, 0] - 2.0)
        return 0.5 * float(np.sum(rest**2) + gap**2), [rest, np.array([[gap]])]

    result = minimise(objective, [np.zeros((3, 3)), np.zeros((1, 1))])
    np.testing.assert_allclose(result.matrices[0], nearest(target), atol=1e-4)
    np.testing.assert_allclose(result.matrices[1], [[2.0]], atol=1e-4)


@pytest.mark.parametrize("end", [1e-30, 1e-6])
def test_what_has_no_minimum_is_refused(end):
    def falling(matrices):
        size = float(np.trace(matrices[0]))
        return (np.log(size), [np.eye(3) / size]) if size > end else (np.inf, [np.zeros((3, 3))])

    with pytest.raises(SolverError, match="did not end at a minimum"):
        minimise(falling, [np.eye(3)])


def test_a_fall_too_small_to_be_told_from_rounding_ends_the_search():
    target = np.diag([1e-3, -1.0, -1.0])

    def high(matrices):
        value, slopes = distance_to(target)(matrices)
        return 1e12 + value, slopes

    assert not minimise(high, [np.zeros((3, 3))]).matrices[0].any()
    # control: at a height where it can be told, it is
    assert minimise(distance_to(target), [np.zeros((3, 3))]).matrices[0][0, 0] == pytest.approx(
        1e-3, rel=1e-2
    )
