"""Resampling schemes of the particle filter (Douc, Cappé & Moulines 2005), compiled.

A scheme takes weights (P,), non-negative and of sum 1, and a generator, and fills ``chosen`` (P,)
with the indices of the particles to go on with; ``scratch`` has (2, P) or more floats. Particle i
is expected P·w_i times, and never where w_i = 0.
"""

import numpy as np

from pipeline.core.compiled import inner

# P·w is a whole number up to rounding where weights are equal; without this its floor would miss it
ROUNDING = 1e-9


@inner
def cumulate(weights, cumulative):
    """Fill ``cumulative`` with the sums of the ``weights`` up to each, scaled to end at 1."""
    total = 0.0
    for i in range(len(weights)):
        total += weights[i]
        cumulative[i] = total
    for i in range(len(weights)):
        cumulative[i] /= total


@inner
def repeat(below, chosen):
    """Fill ``chosen`` (P,) with each particle as often as there are points between the cumulative
    weight before it and its own, ``below`` (P,) which so many of the P points lie: each is put
    where its points begin and stays until the next, without a branch that depends on the weights.
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
def systematic(weights, chosen, scratch, rng):
    """Shift P equidistant points by one uniform: counts ⌊P·w_i⌋ or ⌈P·w_i⌉ (Kitagawa 1996)."""
    below, count, shift = scratch[0], len(weights), rng.random()
    cumulate(weights, below)
    for i in range(count):
        below[i] = np.ceil(count * below[i] - shift)
    repeat(below, chosen)


@inner
def stratified(weights, chosen, scratch, rng):
    """Draw one uniform in each of P strata of equal width (Kitagawa 1996)."""
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
def independent(weights, chosen, points, cumulative, rng):
    """Fill ``chosen`` with sorted independent draws of any ``weights`` (P,); the first entries of
    ``points`` and ``cumulative`` are overwritten.
    """
    count, arrival = len(chosen), 0.0
    # sorted uniforms: the arrivals of a Poisson process over the next one
    for j in range(count):
        arrival += rng.standard_exponential()
        points[j] = arrival
    end = arrival + rng.standard_exponential()
    cumulate(weights, cumulative)
    # the last particle with weight: rounding may bring a point up to 1
    last, i = len(weights) - 1, 0
    while last > 0 and not cumulative[last - 1] < 1.0:
        last -= 1
    for j in range(count):
        point = points[j] / end
        while i < last and cumulative[i] <= point:
            i += 1
        chosen[j] = i


@inner
def residual(weights, chosen, scratch, rng):
    """Keep ⌊P·w_i⌋ copies and draw the others from what is left of w (Liu & Chen 1998)."""
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
        independent(left, chosen[kept:], scratch[1], left, rng)


# "none" is sequential importance sampling without resampling, in which the weights degenerate
SCHEMES = ("systematic", "stratified", "residual", "multinomial", "none")


@inner
def resample(scheme, weights, chosen, scratch, rng):
    """Fill ``chosen`` by the ``scheme`` of this number; multinomial: Gordon et al. (1993)."""
    if scheme == 0:
        systematic(weights, chosen, scratch, rng)
    elif scheme == 1:
        stratified(weights, chosen, scratch, rng)
    elif scheme == 2:
        residual(weights, chosen, scratch, rng)
    else:
        independent(weights, chosen, scratch[0], scratch[1], rng)
