"""Sums in lanes: right, in an order of their own, for any number of numbers."""

from __future__ import annotations

import numpy as np
import pytest
from compiled_calls import from_python

from pipeline.core.elementary import LANES, greatest, inner_product, total


@pytest.mark.parametrize("count", [0, 1, LANES - 1, LANES, LANES + 1, 10 * LANES + 3])
def test_sums_and_the_greatest_are_numpys(count):
    rng = np.random.default_rng(count)
    x, y = rng.standard_normal((2, count))
    assert from_python(inner_product)(x, y) == pytest.approx(x @ y, abs=1e-13)
    assert from_python(total)(x) == pytest.approx(x.sum(), abs=1e-13)
    assert from_python(greatest)(x) == x.max(initial=-np.inf)


def test_the_lanes_are_summed_each_by_itself_and_joined_half_and_half():
    x, y = np.random.default_rng(1).standard_normal((2, 20 * LANES))
    lanes = np.zeros(LANES)
    for row in (x * y).reshape(-1, LANES):
        lanes = row + lanes
    while len(lanes) > 1:
        lanes = lanes[: len(lanes) // 2] + lanes[len(lanes) // 2 :]
    assert from_python(inner_product)(x, y) == lanes[0] != sum((x * y).tolist())


def test_the_greatest_is_not_taken_of_what_is_no_number():
    x = np.full(40, -np.inf)
    assert from_python(greatest)(x) == -np.inf
    x[[3, 39]] = np.nan
    x[20] = -2.0
    assert from_python(greatest)(x) == -2.0
