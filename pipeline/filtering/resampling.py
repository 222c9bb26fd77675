"""Resampling schemes of the particle filter (Douc, Cappé & Moulines 2005) and the effective sample size that calls for them.

A scheme takes weights (P,), non-negative and of sum 1, and a Generator, and returns P indices (P,) of the particles to go on with;
particle i is expected P·w_i times, and never where w_i = 0.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Scheme = Callable[[np.ndarray, np.random.Generator], np.ndarray]

BELOW_ONE = np.nextafter(1.0, 0.0)
# P·w is a whole number up to rounding where weights are equal; without this its floor would miss it
ROUNDING = 1e-9


def effective_sample_size(weights: np.ndarray) -> float:
    """1/Σw² of normalised ``weights`` (P,): from 1, one particle carrying all, to P, all alike (Kong, Liu & Wong 1994)."""
    return float(1.0 / (weights @ weights))


def systematic(weights: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """One uniform shifts a comb of P equidistant points: counts are ⌊P·w_i⌋ or ⌈P·w_i⌉ (Kitagawa 1996)."""
    count = len(weights)
    return _inverse_cdf(weights, (np.arange(count) + rng.random()) / count)


def stratified(weights: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """One uniform in each of P strata of equal width (Kitagawa 1996)."""
    count = len(weights)
    return _inverse_cdf(weights, (np.arange(count) + rng.random(count)) / count)


def multinomial(weights: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """P independent draws (Gordon, Salmond & Smith 1993)."""
    return _inverse_cdf(weights, _sorted_uniforms(len(weights), rng))


def residual(weights: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """⌊P·w_i⌋ copies for certain, the rest by independent draws from what is left of the weights (Liu & Chen 1998)."""
    expected = len(weights) * weights
    certain = np.floor(expected + ROUNDING).astype(int)
    kept = np.repeat(np.arange(len(weights)), certain)
    missing = len(weights) - len(kept)
    if missing == 0:
        return kept
    drawn = _inverse_cdf(np.maximum(expected - certain, 0.0), _sorted_uniforms(missing, rng))
    return np.concatenate([kept, drawn])


# None: sequential importance sampling as it stands, in which the weights degenerate
SCHEMES: dict[str, Scheme | None] = {
    "systematic": systematic,
    "stratified": stratified,
    "residual": residual,
    "multinomial": multinomial,
    "none": None,
}


def _inverse_cdf(weights: np.ndarray, uniforms: np.ndarray) -> np.ndarray:
    """Indices at which the cumulative ``weights``, scaled to end at 1, first exceed the sorted ``uniforms``."""
    cumulative = np.cumsum(weights)
    cumulative /= cumulative[-1]
    # rounding may bring a uniform up to 1, which no cumulative weight exceeds
    return np.searchsorted(cumulative, np.minimum(uniforms, BELOW_ONE), side="right")


def _sorted_uniforms(count: int, rng: np.random.Generator) -> np.ndarray:
    """``count`` independent uniforms in rising order: the arrivals of a Poisson process over the next one, without a sort."""
    arrivals = np.cumsum(rng.standard_exponential(count + 1))
    return arrivals[:-1] / arrivals[-1]
