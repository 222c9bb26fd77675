"""Wishart matrices of real degrees of freedom in bulk, against SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from pipeline.core.compiled import compiled
from pipeline.randommatrix import wishart
from pipeline.randommatrix.variates import gamma_law, standard_gamma
from pipeline.randommatrix.words import close, opened, words_of
from pipeline.randommatrix.ziggurat import standard_normal

pytestmark = pytest.mark.benchmark(group="Wishart samples, 3 × 3")
D = 64.0  # of σ_B = 0.25
SIGMA = np.array([[1.0, 0.3, 0.0], [0.3, 0.8, -0.2], [0.0, -0.2, 0.5]])


def test_ours(benchmark, size):
    count, rng = size(10_000, 100), np.random.default_rng(1)
    benchmark.extra_info |= {"role": "ours", "items": count}
    wishart.sample(D, SIGMA, (1,), rng)  # loads what is compiled
    draws = benchmark(wishart.sample, D, SIGMA, (count,), rng)
    assert draws.shape == (count, 3, 3)


def test_scipy(benchmark, size):
    count, rng = size(10_000, 100), np.random.default_rng(1)
    benchmark.extra_info |= {"role": "peer", "items": count, "target": 20, "against": "SciPy"}
    benchmark.extra_info["configuration"] = "`scipy.stats.wishart.rvs`, all by one call"
    benchmark(stats.wishart.rvs, D, SIGMA, size=count, random_state=rng)


def test_floor_of_the_random_numbers_alone(benchmark, size):
    count, rng = size(10_000, 100), np.random.default_rng(1)
    benchmark.extra_info |= {"role": "floor", "items": count, "target": 2}
    benchmark.extra_info["configuration"] = (
        "three gamma variates and three normals a matrix, by the project's own compiled draws, "
        "their sum alone kept"
    )
    laws = tuple(gamma_law((D - i) / 2) for i in range(3))
    draw(laws, 1, words_of(rng))
    benchmark(draw, laws, count, words_of(rng))


@compiled()
def draw(laws: tuple, count: int, words: np.ndarray) -> float:
    """The sum of all numbers that ``count`` matrices take."""
    total, state = 0.0, opened(words)
    for _ in range(count):
        for i in range(len(laws)):
            for _ in range(i):
                number, state = standard_normal(state)
                total += number
            number, state = standard_gamma(laws[i], state)
            total += number
    close(words, state)
    return total
