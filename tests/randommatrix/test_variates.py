"""Variates of compiled code: NumPy's own, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest
from compiled_calls import from_python

from pipeline.arm.rows import block_rows
from pipeline.randommatrix.variates import draw_variates

PARTICLES = 20_000
ROWS = block_rows(7, 6)


def drawn(rng: np.random.Generator, count: int, sets: int, each: int, *degrees: float):
    """χ² (G, count) and normal (sets·each, count) variates."""
    block = np.full((ROWS.size, PARTICLES), np.nan)
    first, freedom = ROWS.chi_square, np.array(degrees, dtype=float)
    from_python(draw_variates)(freedom, sets, each, block, first, ROWS.normal, count, rng)
    assert np.isnan(block[:, count:]).all()
    return (
        block[first : first + len(degrees), :count],
        block[ROWS.normal : ROWS.normal + sets * each, :count],
    )


@pytest.mark.parametrize("degrees", [0.02, 0.3, 1.0, 1.9999, 2.0, 2.0001, 3.7, 62.0, 1e6])
@pytest.mark.parametrize("count", [3, PARTICLES])
def test_chi_squares_are_numpys_and_come_before_the_normals(degrees, count):
    one, other = np.random.default_rng(7), np.random.default_rng(7)
    chi_square, normal = drawn(one, count, 1, 2, degrees, 5.0)
    for row, each in zip(chi_square, (degrees, 5.0), strict=True):
        np.testing.assert_array_equal(row, other.chisquare(each, count))
    np.testing.assert_array_equal(normal, other.standard_normal((count, 2)).T)
    assert one.random() == other.random()


@pytest.mark.parametrize("sets", [1, 2])
def test_normals_are_numpys_set_by_set_and_particle_by_particle(sets):
    one, other = np.random.default_rng(8), np.random.default_rng(8)
    _, normal = drawn(one, PARTICLES, sets, 7)
    sets_of_other = [other.standard_normal((PARTICLES, 7)).T for _ in range(sets)]
    np.testing.assert_array_equal(normal, np.concatenate(sets_of_other))
    assert one.random() == other.random()
