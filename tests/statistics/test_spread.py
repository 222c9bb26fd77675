"""Samples are spread on the nodes as by the spline's printed form, whole, and only inside."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.statistics.spread import spread

LOW, STEP = np.array([1.0, -2.0]), np.array([0.11, 0.07])


def spread_with_numpy(samples, low, step, rows, columns):
    """The plain form: shares by the quadratic B-spline as printed by Schoenberg, added
    node by node.
    """
    masses = np.zeros((rows, columns))
    position = (samples - low) / step
    nearest = np.round(position).astype(int)
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            node = nearest + np.array([i, j])
            distance = np.abs(position - node)
            shares = np.where(distance <= 0.5, 0.75 - distance**2, (1.5 - distance) ** 2 / 2)
            np.add.at(masses, tuple(node.T), shares.prod(axis=1))
    return masses


def spread_anew(samples: np.ndarray, rows: int, columns: int) -> np.ndarray:
    masses = np.zeros((rows, columns))
    spread(samples, LOW, STEP, masses)
    return masses


def test_it_is_the_plain_one():
    samples = LOW + np.random.default_rng(28).uniform(0.5, 30.0, (3000, 2))
    rows, columns = np.ceil((samples.max(axis=0) - LOW) / STEP).astype(int) + 4
    masses = spread_anew(samples, rows, columns)
    plain = spread_with_numpy(samples, LOW, STEP, rows, columns)
    np.testing.assert_allclose(masses, plain, atol=1e-13)
    np.testing.assert_allclose(masses.sum(), len(samples), rtol=1e-12)


@pytest.mark.parametrize("at", [[0.49, 5.0], [5.0, 0.49], [7.51, 5.0], [5.0, 6.51], [-1e300, 5.0]])
def test_what_does_not_lie_inside_is_left_out(at):
    inside = LOW + STEP * np.array([[0.51, 0.51], [7.49, 6.49]])
    outside = LOW + STEP * np.array(at)
    masses = spread_anew(np.vstack([inside, outside]), 9, 9)
    np.testing.assert_array_equal(masses, spread_anew(inside, 9, 9))
    assert masses.sum() == pytest.approx(2) and masses[:, -1].sum() == 0
    assert masses[0, 0] > 0 and masses[8, 7] > 0


def test_a_sample_that_is_no_number_is_left_out():
    assert not spread_anew(np.array([[np.nan, 0.0], [1.5, np.nan], [np.inf, 0.0]]), 9, 9).any()
