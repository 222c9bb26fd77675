"""Four equations and null vectors by minors against NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from compiled_calls import from_python

from pipeline.arm.minors import (
    across,
    adjugate,
    determinant,
    mirror,
    null,
    pairs,
    product,
    without,
)

RNG = np.random.default_rng(1)


def columns(matrix: np.ndarray) -> list[tuple[float, ...]]:
    return [tuple(column) for column in matrix.T]


@pytest.mark.parametrize("matrix", RNG.standard_normal((5, 4, 4)))
def test_determinants_and_inverses_are_numpys(matrix):
    a, b, c, d = columns(matrix)
    y = (0.3, -0.2, 0.5, 0.7)
    rows = from_python(adjugate)(a, b, c, d)
    det = np.linalg.det(matrix)
    assert np.dot(a, rows[0]) == pytest.approx(det, rel=1e-12)
    np.testing.assert_allclose(np.array(rows) / det, np.linalg.inv(matrix), rtol=1e-11, atol=1e-13)
    x = from_python(product)(rows, 1 / det, y)
    np.testing.assert_allclose(x, np.linalg.solve(matrix, y), rtol=1e-11)
    first, last = from_python(pairs)(a, b), from_python(pairs)(c, d)
    assert from_python(determinant)(first, last) == pytest.approx(det, rel=1e-12)
    # y·across(b, …) is the determinant with y in the place of a
    expected = np.linalg.det(np.column_stack([y, b, c, d]))
    assert np.dot(y, from_python(across)(b, last)) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("matrix", RNG.standard_normal((5, 4, 5)))
def test_a_null_vector_is_one_as_long_as_the_product_of_the_singular_values(matrix):
    x = np.array(from_python(null)(*columns(matrix)))
    np.testing.assert_allclose(matrix @ x, 0, atol=1e-13)
    size = np.prod(np.linalg.svd(matrix, compute_uv=False))
    assert np.linalg.norm(x) == pytest.approx(size, rel=1e-12)


@pytest.mark.parametrize("x", [(1.0, 2.0, -3.0, 0.5, 0.0), (0.0, 0.0, 0.0, 0.0, -2.0)])
def test_a_mirror_takes_a_vector_to_the_last_axis(x):
    mirrored = np.array([*from_python(mirror)(x), 1.0])
    assert np.abs(mirrored).max() <= 1
    image = np.array(x) - 2 * mirrored * (mirrored @ x) / (mirrored @ mirrored)
    np.testing.assert_allclose(image[:4], 0, atol=1e-15)
    assert abs(image[4]) == pytest.approx(np.linalg.norm(x), rel=1e-15)
    assert from_python(without)(x[:4], 2.0, x[:4]) == tuple(-each for each in x[:4])
