"""Wishart matrices of real degrees of freedom in bulk, against SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from pipeline.randommatrix import wishart

pytestmark = pytest.mark.benchmark(group="Wishart samples, 3 × 3")
D = 64.0  # of σ_B = 0.25
SIGMA = np.array([[1.0, 0.3, 0.0], [0.3, 0.8, -0.2], [0.0, -0.2, 0.5]])


def test_ours(benchmark, size):
    count, rng = size(100_000, 100), np.random.default_rng(1)
    benchmark.extra_info |= {"role": "ours", "items": count}
    draws = benchmark.pedantic(wishart.sample, (D, SIGMA, (count,), rng), rounds=9, warmup_rounds=1)
    assert draws.shape == (count, 3, 3)


def test_scipy(benchmark, size):
    count, rng = size(10_000, 100), np.random.default_rng(1)
    benchmark.extra_info |= {"role": "peer", "items": count, "target": 20}
    benchmark.pedantic(
        stats.wishart.rvs,
        (D, SIGMA),
        {"size": count, "random_state": rng},
        rounds=9,
        warmup_rounds=1,
    )


def test_floor_of_the_random_numbers_alone(benchmark, size):
    count, rng = size(100_000, 100), np.random.default_rng(1)
    benchmark.extra_info |= {"role": "floor", "items": count}

    def draw() -> None:
        rng.standard_normal((count, 3))
        for i in range(3):
            rng.chisquare(D - i, count)

    benchmark.pedantic(draw, rounds=9, warmup_rounds=1)
