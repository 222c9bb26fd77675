"""Resampling schemes of the particle filter (Douc, Cappé & Moulines 2005), compiled.

A scheme takes weights (P,), non-negative and of sum 1, and a generator, and fills ``chosen`` (P,)
with the indices of the particles to go on with; ``scratch`` has (2, P) or more floats, of which the
first P of two rows are used.
Particle i is expected P·w_i times, and never where w_i = 0. All of them hold sorted points against
the cumulative weights: where the points lie in strata, how many are below a weight is known at
once; else walking along both takes P steps, where a search for each point would take P·log P. Loops
stand for NumPy's array expressions, as they compile in half the time.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.compiled import inner

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
def sorted_uniforms(points: np.ndarray, rng: np.random.Generator) -> None:
    """Fill ``points`` with independent uniforms in rising order: the arrivals of a Poisson process
    over the next one, without a sort.
    """
    arrival = 0.0
    for j in range(len(points)):
        arrival += rng.standard_exponential()
        points[j] = arrival
    last = arrival + rng.standard_exponential()
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


@inner
def systematic(
    weights: np.ndarray, chosen: np.ndarray, scratch: np.ndarray, rng: np.random.Generator
) -> None:
    """One uniform shifts a comb of P equidistant points: counts are ⌊P·w_i⌋ or ⌈P·w_i⌉ (Kitagawa
    1996).
    """
    below, count, shift = scratch[0], len(weights), rng.random()
    cumulate(weights, below)
    for i in range(count):
        below[i] = np.ceil(count * below[i] - shift)
    repeat(below, chosen)


@inner
def stratified(
    weights: np.ndarray, chosen: np.ndarray, scratch: np.ndarray, rng: np.random.Generator
) -> None:
    """One uniform in each of P strata of equal width (Kitagawa 1996)."""
    points, below, count = scratch[0], scratch[1], len(weights)
    for j in range(count):
        points[j] = j + rng.random()
    cumulate(weights, below)
    for i in range(count):
        place = count * below[i]
        stratum = min(int(place), count - 1)
        # all strata before its own, and that one where its point is below
        below[i] = stratum + (points[stratum] < place)
    repeat(below, chosen)


@inner
def multinomial(
    weights: np.ndarray, chosen: np.ndarray, scratch: np.ndarray, rng: np.random.Generator
) -> None:
    """P independent draws (Gordon, Salmond & Smith 1993)."""
    count = len(weights)
    points = scratch[0][:count]
    sorted_uniforms(points, rng)
    inverse_cdf(weights, points, scratch[1][:count], chosen)


@inner
def residual(
    weights: np.ndarray, chosen: np.ndarray, scratch: np.ndarray, rng: np.random.Generator
) -> None:
    """⌊P·w_i⌋ copies for certain, the rest by independent draws from what is left of the weights
    (Liu & Chen 1998).
    """
    count, kept = len(weights), 0
    left = scratch[0][:count]
    for i in range(count):
        expected = count * weights[i]
        certain = np.floor(expected + ROUNDING)
        left[i] = expected - certain if expected > certain else 0.0
        for _ in range(int(certain)):
            chosen[kept] = i
            kept += 1
    if kept < count:
        points = scratch[1][: count - kept]
        sorted_uniforms(points, rng)
        inverse_cdf(left, points, left, chosen[kept:])


# "none" is sequential importance sampling without resampling, in which the weights degenerate
SCHEMES = ("systematic", "stratified", "residual", "multinomial", "none")


@inner
def resample(
    scheme: int,
    weights: np.ndarray,
    chosen: np.ndarray,
    scratch: np.ndarray,
    rng: np.random.Generator,
) -> None:
    """Fill ``chosen`` by the ``scheme`` of this number in :data:`SCHEMES`."""
    if scheme == 0:
        systematic(weights, chosen, scratch, rng)
    elif scheme == 1:
        stratified(weights, chosen, scratch, rng)
    elif scheme == 2:
        residual(weights, chosen, scratch, rng)
    else:
        multinomial(weights, chosen, scratch, rng)
