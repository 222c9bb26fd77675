"""Singular values and vectors by one-sided rotations, against LAPACK's."""

from __future__ import annotations

import numpy as np
import pytest
from compiled_calls import from_python

from pipeline.models.wishart.singular import orthogonalize

SIZES = [(1, 1), (2, 2), (3, 2), (6, 6), (8, 5)]


@pytest.mark.parametrize(("n", "m"), SIZES)
def test_a_matrix_is_taken_apart(n, m):
    matrix = np.random.default_rng(1).standard_normal((n, m))
    columns, turn = matrix.T.copy(), np.eye(m)
    from_python(orthogonalize)(columns, turn)
    np.testing.assert_allclose(columns.T @ turn, matrix, atol=1e-13)
    np.testing.assert_allclose(turn @ turn.T, np.eye(m), atol=1e-13)
    lengths = np.linalg.norm(columns, axis=1)
    np.testing.assert_allclose(np.sort(lengths)[::-1], np.linalg.svd(matrix)[1], rtol=1e-12)
    across = columns @ columns.T / np.outer(lengths, lengths)
    np.testing.assert_allclose(across, np.eye(m), atol=1e-13)


def test_small_singular_values_keep_their_digits():
    """Where columns are scaled apart; the eigenvalues of MᵀM lose the smallest altogether."""
    rng = np.random.default_rng(2)
    left, right = np.linalg.qr(rng.standard_normal((5, 4)))[0], np.eye(4)
    scale = np.array([1.0, 1e-5, 1e-10, 1e-15])
    columns, turn = np.ascontiguousarray((left * scale).T), right.copy()
    from_python(orthogonalize)(columns, turn)
    np.testing.assert_allclose(np.linalg.norm(columns, axis=1), scale, rtol=1e-12)
    mixed = np.array([[1.0, 0.5, 0.2, 0.1]]) * np.ones((4, 4)) + np.eye(4)
    product = left @ mixed * scale
    columns = np.ascontiguousarray(product.T)
    from_python(orthogonalize)(columns, np.empty((4, 0)))
    # the product of all is the determinant, exact by scaling the columns back
    exact = abs(np.linalg.det(mixed)) * scale.prod()
    assert np.linalg.norm(columns, axis=1).prod() == pytest.approx(exact, rel=1e-11)
    # control: by the eigenvalues of MᵀM, the greatest scale last
    squared = np.linalg.eigvalsh(product[:, ::-1].T @ product[:, ::-1])
    assert not abs(np.sqrt(np.maximum(squared, 0.0)).prod() / exact - 1) < 0.1
