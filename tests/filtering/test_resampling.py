"""Resampling schemes: unbiased counts, their exact variances, and what is certain of them."""

from __future__ import annotations

import numpy as np
import pytest
from compiled_calls import chosen_by, from_python

from pipeline.filtering.resampling import SCHEMES, inverse_cdf

DRAWING = SCHEMES[:-1]
REPEATS = 6000
BAND = 4.5  # standard errors; twelve weights of four schemes stay inside with probability 0.9997


@pytest.fixture(scope="module")
def weights() -> np.ndarray:
    drawn = np.random.default_rng(7).dirichlet(np.full(12, 0.7))
    drawn[3] = 0.0
    return drawn / drawn.sum()


def counts_of(
    scheme, weights: np.ndarray, rng: np.random.Generator, repeats: int = REPEATS
) -> np.ndarray:
    return np.array(
        [
            np.bincount(chosen_by(scheme, weights, rng), minlength=len(weights))
            for _ in range(repeats)
        ]
    )


def exact_variance(name: str, weights: np.ndarray) -> np.ndarray:
    """Var(count_i) in closed form."""
    count = len(weights)
    expected = count * weights
    if name == "multinomial":
        return expected * (1 - weights)
    if name == "systematic":
        return (expected % 1) * (1 - expected % 1)
    if name == "residual":
        left = expected % 1
        return left * (1 - left / left.sum())
    # stratified: stratum s hits particle i with the probability that their intervals share
    edges = np.concatenate([[0.0], np.cumsum(expected)])
    strata = np.arange(count)
    hit = np.clip(
        np.minimum(edges[1:, None], strata + 1) - np.maximum(edges[:-1, None], strata), 0.0, 1.0
    )
    return (hit * (1 - hit)).sum(axis=1)


def bias_in_standard_errors(counts: np.ndarray, name: str, weights: np.ndarray) -> float:
    deviation = counts.mean(axis=0) - len(weights) * weights
    standard_error = np.sqrt(exact_variance(name, weights) / len(counts))
    random = standard_error > 0
    assert np.all(deviation[~random] == 0.0)
    return float(np.max(np.abs(deviation[random]) / standard_error[random]))


@pytest.mark.parametrize("name", DRAWING)
def test_a_particle_is_chosen_in_proportion_to_its_weight(name, weights):
    counts = counts_of(name, weights, np.random.default_rng(1))
    assert np.all(counts.sum(axis=1) == len(weights))
    assert np.all(counts[:, weights == 0.0] == 0)
    assert bias_in_standard_errors(counts, name, weights) < BAND


@pytest.mark.parametrize("name", DRAWING)
def test_a_longer_buffer_changes_no_choice_and_nothing_is_written_behind(name, weights):
    for seed in range(20):
        short, long = (
            chosen_by(name, weights, np.random.default_rng(seed), beyond) for beyond in (0, 200)
        )
        assert np.array_equal(long, short)


def test_a_comb_that_is_never_shifted_is_found_out_as_biased(weights):
    points = (np.arange(len(weights)) + 0.5) / len(weights)
    chosen = np.searchsorted(np.cumsum(weights), points, side="right")
    counts = np.tile(np.bincount(chosen, minlength=len(weights)), (REPEATS, 1))
    assert bias_in_standard_errors(counts, "systematic", weights) > 3 * BAND


def variance_in_standard_errors(counts: np.ndarray, variance: np.ndarray) -> float:
    squares = (counts - counts.mean(axis=0)) ** 2
    random = variance > 1e-12
    assert np.allclose(squares[:, ~random], 0.0)
    standard_error = squares[:, random].std(axis=0) / np.sqrt(len(counts))
    return float(
        np.max(np.abs(squares[:, random].mean(axis=0) - variance[random]) / standard_error)
    )


@pytest.mark.parametrize("name", DRAWING)
def test_the_variance_of_a_count_is_that_of_its_closed_form_and_of_no_other_scheme(name, weights):
    counts = counts_of(name, weights, np.random.default_rng(2))
    assert variance_in_standard_errors(counts, exact_variance(name, weights)) < BAND
    for other in set(DRAWING) - {name}:
        assert variance_in_standard_errors(counts, exact_variance(other, weights)) > BAND


def test_no_scheme_varies_more_than_independent_draws(weights):
    variance = {
        name: counts_of(name, weights, np.random.default_rng(3)).var(axis=0).sum()
        for name in DRAWING
    }
    assert variance["systematic"] < variance["stratified"] < variance["multinomial"]
    assert variance["residual"] < variance["multinomial"]


def test_systematic_counts_lie_within_one_of_what_is_expected():
    rng = np.random.default_rng(4)
    for _ in range(300):
        weights = rng.dirichlet(np.full(50, 0.3))
        counts = np.bincount(chosen_by("systematic", weights, rng), minlength=50)
        assert np.all((counts == np.floor(50 * weights)) | (counts == np.ceil(50 * weights)))


def test_residual_counts_never_fall_below_the_certain_copies_and_independent_draws_do():
    weights = np.random.default_rng(5).dirichlet(np.full(50, 0.3))
    certain = np.floor(50 * weights)
    assert np.all(counts_of("residual", weights, np.random.default_rng(5), 200) >= certain)
    assert np.any(counts_of("multinomial", weights, np.random.default_rng(5), 200) < certain)


@pytest.mark.parametrize("scheme", ["systematic", "stratified", "residual"])
def test_equal_weights_keep_every_particle_once(scheme):
    # weights that went through an exponential, as in the filter, are right only up to rounding
    weights = np.full(1000, np.nextafter(1 / 1000, 0.0))
    assert np.array_equal(
        np.sort(chosen_by(scheme, weights, np.random.default_rng(6))), np.arange(1000)
    )


@pytest.mark.parametrize("scheme", DRAWING)
def test_one_particle_with_all_the_weight_is_the_only_one_left(scheme):
    for sole in (0, 4, 9):
        assert np.all(chosen_by(scheme, np.eye(10)[sole], np.random.default_rng(8)) == sole)


@pytest.mark.parametrize("point", [0.0, np.nextafter(1.0, 0.0), 1.0])
def test_points_at_either_end_of_their_range_fall_on_particles_with_weight(point):
    weights = np.concatenate([[0.0], np.full(1000, 1 / 1000), [0.0, 0.0]])
    chosen = np.array([-1])
    from_python(inverse_cdf)(weights, np.array([point]), np.empty(len(weights)), chosen)
    assert chosen[0] == (1 if point == 0.0 else 1000)
