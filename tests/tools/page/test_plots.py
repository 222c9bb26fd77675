"""Paths of plots go through the values at the places that the axes give them."""

from __future__ import annotations

import re
from itertools import accumulate

import numpy as np
import pytest

from pipeline.tools.page.plots import TICKS, Axis, band, line, stroke

X, Y = Axis(0.0, 2.0, 100), Axis(-1.0, 1.0, 50, reversed=True)


def points(path: str) -> np.ndarray:
    """The corners of a path of relative lines."""
    numbers = [float(text) for text in re.findall(r"-?[\d.]+", path)]
    steps = [tuple(numbers[i : i + 2]) for i in range(0, len(numbers), 2)]
    return np.array(list(accumulate(steps, lambda a, b: (a[0] + b[0], a[1] + b[1]))))


def test_a_line_goes_through_its_values_and_rounding_does_not_add_up():
    x = np.linspace(0, 2, 1001)
    y = np.sin(7 * x)
    places = points(line(X, Y, x, y, "").path)
    assert places == pytest.approx(np.column_stack([50 * x, 25 * (1 - y)]), abs=0.0501)


def test_a_band_goes_up_one_bound_and_back_the_other():
    x, zero = np.array([0.0, 1.0, 2.0]), np.zeros(3)
    places = points(band(X, Y, x, zero, zero + 0.5, "").path)
    assert places.tolist() == [[0, 25], [50, 25], [100, 25], [100, 12.5], [50, 12.5], [0, 12.5]]


@pytest.mark.parametrize("span", [(0.0, 0.96), (-37.2, 37.2), (1.58, 1.61), (-4.9, 3.2)])
def test_ticks_are_few_round_and_inside(span):
    ticks = Axis(*span, 100).ticks
    values = [float(text.replace("−", "-")) for _, text in ticks]
    assert 2 <= len(ticks) <= TICKS
    assert all(0 <= place <= 100 for place, _ in ticks)
    assert all(span[0] <= value <= span[1] for value in values)
    share = np.array([place for place, _ in ticks]) / 100
    assert share == pytest.approx((np.array(values) - span[0]) / (span[1] - span[0]), abs=1e-3)


def test_dashes_follow_matplotlibs():
    assert "dasharray:none" in stroke("red") and "dasharray:7 4" in stroke("red", "--")
    assert "dasharray:6 3" in stroke("red", (0, (3, 1.5)), width=2)
