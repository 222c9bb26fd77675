"""Resampling schemes of the particle filter (Douc, Cappé & Moulines 2005), compiled.

A scheme takes weights (P,), non-negative and of sum 1, and a Generator, and returns P indices (P,) of the particles to go on with;
particle i is expected P·w_i times, and never where w_i = 0. All of them hold sorted points against the cumulative weights: walking along
both at once takes P steps, where a search for each point would take P·log P. What NumPy does with whole arrays is written as loops, which
compile in half the time and need no arrays in between.
"""

from __future__ import annotations

import numpy as np
from numba import types

from pipeline.compiled import compiled
from pipeline.motion.compiled.law import GENERATOR, VECTOR

SCHEME = types.Array(types.int64, 1, "C")(VECTOR, GENERATOR)
# P·w is a whole number up to rounding where weights are equal; without this its floor would miss it
ROUNDING = 1e-9


@compiled()
def inverse_cdf(weights: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Indices at which the cumulative ``weights``, scaled to end at 1, first exceed the sorted ``points``, which may come up to 1."""
    cumulative, total = np.empty(len(weights)), 0.0
    for i in range(len(weights)):
        total += weights[i]
        cumulative[i] = total
    for i in range(len(weights)):
        cumulative[i] /= total
    # the last particle with weight: rounding may bring a point up to 1, which no cumulative weight exceeds
    last = len(weights) - 1
    while last > 0 and not cumulative[last - 1] < 1.0:
        last -= 1
    chosen = np.empty(len(points), np.int64)
    i = 0
    for j in range(len(points)):
        while i < last and cumulative[i] <= points[j]:
            i += 1
        chosen[j] = i
    return chosen


@compiled()
def sorted_uniforms(count: int, rng: np.random.Generator) -> np.ndarray:
    """``count`` independent uniforms in rising order: the arrivals of a Poisson process over the next one, without a sort."""
    points, arrival = np.empty(count), 0.0
    for j in range(count):
        arrival += rng.standard_exponential()
        points[j] = arrival
    last = arrival + rng.standard_exponential()
    for j in range(count):
        points[j] /= last
    return points


@compiled()
def systematic(weights: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """One uniform shifts a comb of P equidistant points: counts are ⌊P·w_i⌋ or ⌈P·w_i⌉ (Kitagawa 1996)."""
    count, shift = len(weights), rng.random()
    points = np.empty(count)
    for j in range(count):
        points[j] = (j + shift) / count
    return inverse_cdf(weights, points)


@compiled()
def stratified(weights: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """One uniform in each of P strata of equal width (Kitagawa 1996)."""
    count = len(weights)
    points = np.empty(count)
    for j in range(count):
        points[j] = (j + rng.random()) / count
    return inverse_cdf(weights, points)


@compiled()
def multinomial(weights: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """P independent draws (Gordon, Salmond & Smith 1993)."""
    return inverse_cdf(weights, sorted_uniforms(len(weights), rng))


@compiled()
def residual(weights: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """⌊P·w_i⌋ copies for certain, the rest by independent draws from what is left of the weights (Liu & Chen 1998)."""
    count, kept = len(weights), 0
    chosen, left = np.empty(count, np.int64), np.empty(count)
    for i in range(count):
        certain = np.floor(count * weights[i] + ROUNDING)
        left[i] = max(count * weights[i] - certain, 0.0)
        for _ in range(int(certain)):
            chosen[kept] = i
            kept += 1
    if kept < count:
        drawn = inverse_cdf(left, sorted_uniforms(count - kept, rng))
        for j in range(len(drawn)):
            chosen[kept + j] = drawn[j]
    return chosen


# None: sequential importance sampling as it stands, in which the weights degenerate
SCHEMES = {
    "systematic": systematic,
    "stratified": stratified,
    "residual": residual,
    "multinomial": multinomial,
    "none": None,
}
