"""Borrowed arrays are the same memory, and those who hold it are as many after as before."""

from __future__ import annotations

import sys
from typing import NamedTuple

import numpy as np
from numba import njit

from pipeline.core.borrowed import borrowed


class Numbered(NamedTuple):
    matrix: np.ndarray
    number: int


@njit
def fill(numbered: Numbered, row: np.ndarray) -> None:
    (matrix, number), row = borrowed((numbered, row))
    for k in range(len(matrix)):
        view = matrix[k]
        for i in range(len(view)):
            view[i] = number + row[i]


def test_what_is_written_to_a_borrowed_array_is_in_the_array():
    matrix, row = np.zeros((2, 3)), np.arange(3.0)
    held = sys.getrefcount(matrix), sys.getrefcount(row)
    fill(Numbered(matrix, 5), row)
    assert np.array_equal(matrix, [[5.0, 6.0, 7.0]] * 2)
    assert (sys.getrefcount(matrix), sys.getrefcount(row)) == held
