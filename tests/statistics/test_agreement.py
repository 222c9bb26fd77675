"""How errors and their bounds are compared."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from pipeline.statistics.agreement import (
    correlation,
    coverage,
    lag_one_correlation,
    root_mean_square,
)


def test_the_root_mean_square_is_that_of_all_values():
    assert root_mean_square(np.array([[3.0, 4.0], [0.0, 0.0]])) == 2.5
    errors = np.random.default_rng(1).normal(0.3, 0.4, 100_000)
    assert abs(root_mean_square(errors) - 0.5) < 0.005
    # control: a bias counts, as it does not in a standard deviation
    assert abs(errors.std() - 0.5) > 0.05


def test_the_correlation_does_not_see_scale_or_offset():
    a = np.random.default_rng(2).normal(size=50)
    assert correlation(a, 3 * a + 7) == pytest.approx(1)
    assert correlation(a, -a) == pytest.approx(-1)


@pytest.mark.parametrize("rho", [0.0, 0.6, -0.9])
def test_the_correlation_recovers_that_of_its_law(rho):
    count = 20_000
    x, y = np.random.default_rng(3).standard_normal((2, count))
    assert abs(correlation(x, rho * x + np.sqrt(1 - rho**2) * y) - rho) < 4 * (
        1 - rho**2
    ) / np.sqrt(count)


def test_what_is_constant_follows_nothing():
    a = np.random.default_rng(4).normal(size=50)
    assert correlation(a, np.full(50, 0.1)) == correlation(np.full(50, 0.1), a) == 0.0


@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0])
def test_a_calibrated_bound_of_a_normal_error_covers_what_the_normal_law_says(scale):
    rng, count = np.random.default_rng(5), 40_000
    spread = rng.uniform(0.1, 3.0, (4, count // 4))
    covered = coverage(spread * rng.standard_normal(spread.shape), scale * spread)
    share = 2 * norm.cdf(scale) - 1
    assert abs(covered - share) < 4 * np.sqrt(share * (1 - share) / count)


def test_a_bound_is_reached_on_either_side():
    assert coverage(np.array([-1.0, 1.0, 1.01, -1.01]), np.ones(4)) == 0.5


def test_the_lag_one_correlation_is_that_of_its_law_whatever_the_mean_at_each_step():
    noise = np.random.default_rng(6).standard_normal((100, 401))
    moving = noise[:, 1:] - 0.5 * noise[:, :-1]  # correlation −0.5/1.25
    trend = 10 * np.sin(np.arange(400))
    assert lag_one_correlation(moving + trend) == pytest.approx(-0.4, abs=0.025)
    assert lag_one_correlation(noise) == pytest.approx(0.0, abs=0.025)
    assert lag_one_correlation(np.ones((3, 5))) == 0.0
