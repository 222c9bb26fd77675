"""Resampling schemes of the particle filter (Douc, Cappé & Moulines 2005), compiled.

A scheme ``resample(weights, chosen, room, words)`` takes weights (P,), non-negative and of sum 1,
and the words (4,) of a generator, and fills ``chosen`` (P,) with the indices of the particles to go
on with; ``room`` (2, P) is for what it needs on the way. Particle i is expected P·w_i times, and
never where w_i = 0. All of them hold sorted points against the cumulative weights: where the points
lie in strata, how many are below a weight is known at once; else walking along both takes P steps,
where a search for each point would take P·log P. What NumPy does with whole arrays is written as
loops, which compile in half the time.
"""

from __future__ import annotations

import numpy as np
from numba import types

from pipeline.core.compiled import MATRIX, VECTOR, inner, passed
from pipeline.randommatrix.words import WORDS, close, opened, uniform
from pipeline.randommatrix.ziggurat import standard_exponential

COUNTS = types.Array(types.int64, 1, "C")
SCHEME = types.FunctionType(types.void(VECTOR, COUNTS, MATRIX, WORDS))
# P·w is a whole number up to rounding where weights are equal; without this its floor would miss it
ROUNDING = 1e-9


@inner
def cumulate(weights: np.ndarray, cumulative: np.ndarray) -> None:
    """Fill ``cumulative`` with the sums of the ``weights`` up to each, scaled to end at 1; the
    quarters beside each other, as one sum would wait for itself.
    """
    quarter = len(weights) // 4
    a = b = c = d = 0.0
    for i in range(quarter):
        a += weights[i]
        b += weights[quarter + i]
        c += weights[2 * quarter + i]
        d += weights[3 * quarter + i]
        cumulative[i], cumulative[quarter + i] = a, b
        cumulative[2 * quarter + i], cumulative[3 * quarter + i] = c, d
    for i in range(4 * quarter, len(weights)):
        d += weights[i]
        cumulative[i] = d
    before = 0.0
    for k in range(4):
        stop = (k + 1) * quarter if k < 3 else len(weights)
        for i in range(k * quarter, stop):
            cumulative[i] += before
        before = cumulative[stop - 1] if stop > 0 else 0.0
    for i in range(len(weights)):
        cumulative[i] /= before


@inner
def inverse_cdf(
    weights: np.ndarray, points: np.ndarray, cumulative: np.ndarray, chosen: np.ndarray
) -> None:
    """Fill ``chosen``, of as many as the sorted ``points``, with the indices at which the
    cumulative ``weights``, scaled to end at 1, first exceed them; a point may come up to 1.
    ``cumulative``, of as many as the weights, is filled too.
    """
    cumulate(weights, cumulative)
    # the last particle with weight: rounding may bring a point up to 1, which no cumulative weight
    # exceeds
    last = len(weights) - 1
    while last > 0 and not cumulative[last - 1] < 1.0:
        last -= 1
    i = 0
    for j in range(len(points)):
        point = points[j]
        while i < last and cumulative[i] <= point:
            i += 1
        chosen[j] = i


@inner
def sorted_uniforms(points: np.ndarray, words: np.ndarray) -> None:
    """Fill ``points`` with independent uniforms in rising order: the arrivals of a Poisson process
    over the next one, without a sort.
    """
    arrival, state = 0.0, opened(words)
    for j in range(len(points)):
        way, state = standard_exponential(state)
        arrival += way
        points[j] = arrival
    way, state = standard_exponential(state)
    close(words, state)
    last = arrival + way
    for j in range(len(points)):
        points[j] /= last


@inner
def repeat(below: np.ndarray, chosen: np.ndarray) -> None:
    """Fill ``chosen`` (P,) with each particle as often as there are points between the cumulative
    weight before it and its own, ``below`` (P,) which so many of the P points lie.

    Each is put where its points begin, over those before it that have none, and stands until the
    next: without a branch that depends on the weights.
    """
    count, first, last = len(chosen), 0, 0
    for j in range(count):
        chosen[j] = 0
    for i in range(count):
        if first < count:  # as a rule: all points are below the cumulative weight of the last
            chosen[first] = i
        first = int(below[i])
    for j in range(count):
        last = chosen[j] if chosen[j] > last else last
        chosen[j] = last


@passed
def systematic(
    weights: np.ndarray, chosen: np.ndarray, room: np.ndarray, words: np.ndarray
) -> None:
    """One uniform shifts a comb of P equidistant points: counts are ⌊P·w_i⌋ or ⌈P·w_i⌉ (Kitagawa
    1996).
    """
    below, count = room[0], len(weights)
    shift, state = uniform(opened(words))
    close(words, state)
    cumulate(weights, below)
    for i in range(count):
        below[i] = np.ceil(count * below[i] - shift)
    repeat(below, chosen)


@passed
def stratified(
    weights: np.ndarray, chosen: np.ndarray, room: np.ndarray, words: np.ndarray
) -> None:
    """One uniform in each of P strata of equal width (Kitagawa 1996)."""
    points, below, count = room[0], room[1], len(weights)
    state = opened(words)
    for j in range(count):
        part, state = uniform(state)
        points[j] = j + part
    close(words, state)
    cumulate(weights, below)
    for i in range(count):
        place = count * below[i]
        stratum = min(int(place), count - 1)
        # all strata before its own, and that one where its point is below
        below[i] = stratum + (points[stratum] < place)
    repeat(below, chosen)


@passed
def multinomial(
    weights: np.ndarray, chosen: np.ndarray, room: np.ndarray, words: np.ndarray
) -> None:
    """P independent draws (Gordon, Salmond & Smith 1993)."""
    sorted_uniforms(room[0], words)
    inverse_cdf(weights, room[0], room[1], chosen)


@passed
def residual(weights: np.ndarray, chosen: np.ndarray, room: np.ndarray, words: np.ndarray) -> None:
    """⌊P·w_i⌋ copies for certain, the rest by independent draws from what is left of the weights
    (Liu & Chen 1998).
    """
    left, count, kept = room[0], len(weights), 0
    for i in range(count):
        expected = count * weights[i]
        certain = np.floor(expected + ROUNDING)
        left[i] = expected - certain if expected > certain else 0.0
        for _ in range(int(certain)):
            chosen[kept] = i
            kept += 1
    if kept < count:
        points = room[1][: count - kept]
        sorted_uniforms(points, words)
        inverse_cdf(left, points, left, chosen[kept:])


# None: sequential importance sampling as it stands, in which the weights degenerate
SCHEMES = {
    "systematic": systematic,
    "stratified": stratified,
    "residual": residual,
    "multinomial": multinomial,
    "none": None,
}
