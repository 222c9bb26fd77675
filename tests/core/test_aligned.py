"""Rows for four numbers at once begin where a line of the processor's cache does."""

from __future__ import annotations

import pytest

from pipeline.core.aligned import aligned


@pytest.mark.parametrize(("rows", "size"), [(1, 1), (3, 8), (5, 10_000)])
def test_the_first_row_starts_with_a_line_of_the_cache_and_the_others_follow(rows, size):
    many = [aligned(rows, size) for _ in range(20)]
    assert [floats.ctypes.data % 64 for floats in many] == [0] * len(many)
    assert all(floats.shape == (rows, size) and floats.flags.c_contiguous for floats in many)
