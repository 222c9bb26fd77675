"""Resampling schemes: unbiased counts, their exact variances, and their certain properties."""

from __future__ import annotations

import numpy as np
import pytest
from compiled_calls import chosen_by

from pipeline.filtering.resampling import SCHEMES

DRAWING = SCHEMES[:-1]
REPEATS = 6000
BAND = 4.5  # standard errors; twelve weights of four schemes stay inside with probability 0.9997


@pytest.fixture(scope="module")
def weights() -> np.ndarray:
    drawn = np.random.default_rng(7).dirichlet(np.full(12, 0.7))
    drawn[3] = 0.0
    return drawn / drawn.sum()


def counts_of(scheme, weights, seed: int, repeats: int = REPEATS) -> np.ndarray:
    rng, count = np.random.default_rng(seed), len(weights)
    drawn = [chosen_by(scheme, weights, rng) for _ in range(repeats)]
    return np.array([np.bincount(chosen, minlength=count) for chosen in drawn])


def exact_variance(name: str, weights: np.ndarray) -> np.ndarray:
    """Var(count_i) in closed form."""
    count = len(weights)
    expected = count * weights
    left = expected % 1
    if name == "multinomial":
        return expected * (1 - weights)
    if name == "systematic":
        return left * (1 - left)
    if name == "residual":
        return left * (1 - left / left.sum())
    # stratified: stratum s hits particle i with the probability that their intervals share
    edges, strata = np.concatenate([[0.0], np.cumsum(expected)]), np.arange(count)
    ends = np.minimum(edges[1:, None], strata + 1), np.maximum(edges[:-1, None], strata)
    hit = np.clip(ends[0] - ends[1], 0.0, 1.0)
    return (hit * (1 - hit)).sum(axis=1)


def bias_in_standard_errors(counts: np.ndarray, name: str, weights: np.ndarray) -> float:
    deviation = counts.mean(axis=0) - len(weights) * weights
    standard_error = np.sqrt(exact_variance(name, weights) / len(counts))
    random = standard_error > 0
    assert np.all(deviation[~random] == 0.0)
    return float(np.max(np.abs(deviation[random]) / standard_error[random]))


def variance_in_standard_errors(counts: np.ndarray, variance: np.ndarray) -> float:
    squares = (counts - counts.mean(axis=0)) ** 2
    random = variance > 1e-12
    assert np.allclose(squares[:, ~random], 0.0)
    error = squares[:, random].std(axis=0) / np.sqrt(len(counts))
    return float(np.max(np.abs(squares[:, random].mean(axis=0) - variance[random]) / error))


@pytest.mark.parametrize("name", DRAWING)
def test_counts_have_the_mean_and_the_variance_of_their_scheme_and_of_no_other(name, weights):
    counts = counts_of(name, weights, 1)
    assert np.all(counts.sum(axis=1) == len(weights))
    assert np.all(counts[:, weights == 0.0] == 0)
    assert bias_in_standard_errors(counts, name, weights) < BAND
    for other in DRAWING:
        distance = variance_in_standard_errors(counts, exact_variance(other, weights))
        assert (distance < BAND) == (other == name)


@pytest.mark.parametrize("name", DRAWING)
def test_a_longer_buffer_changes_no_choice_and_nothing_is_written_behind(name, weights):
    """The filter's buffers are never shorter than a block, however few the particles."""
    for seed in range(20):
        short, long = (
            chosen_by(name, weights, np.random.default_rng(seed), beyond) for beyond in (0, 200)
        )
        assert np.array_equal(long, short)


@pytest.mark.parametrize("scheme", DRAWING)
def test_weights_at_the_ends_of_their_range(scheme):
    for sole in (0, 4, 9):
        chosen = chosen_by(scheme, np.eye(10)[sole], np.random.default_rng(8))
        assert np.all(chosen == sole)
    # weights that went through an exponential, as in the filter, are right only up to rounding
    equal = np.full(1000, np.nextafter(1 / 1000, 0.0))
    chosen = np.sort(chosen_by(scheme, equal, np.random.default_rng(6)))
    assert np.array_equal(chosen, np.arange(1000)) == (scheme != "multinomial")
    # rounding may bring a point up to the end, where no particle has weight
    ends = np.concatenate([[0.0], np.full(1000, 1 / 1000), [0.0, 0.0]])
    for seed in range(20):
        chosen = chosen_by(scheme, ends, np.random.default_rng(seed))
        assert chosen.min() >= 1 and chosen.max() <= 1000
