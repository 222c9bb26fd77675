"""Compiled sequential importance sampling, and the resampling schemes of the particle filter (Douc,
Cappé & Moulines 2005). Joint angles are (n, P): neighbours in memory are neighbouring particles.

A scheme takes weights (P,), non-negative and of sum 1, and a generator, and fills ``chosen`` (P,)
with the indices of the particles that continue; ``scratch`` has at least (2, P) floats. Particle i
is chosen P·w_i times on average, and never where w_i = 0.
"""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from pipeline.arm.rows import WIDTH
from pipeline.core.compiled import compiled, inner
from pipeline.core.elementary import exponential, greatest, inner_product, total
from pipeline.models.kernel import move

VANISHED, KEPT, RESAMPLED = range(3)  # results of an update
# "none" is sequential importance sampling without resampling, in which the weights degenerate
SCHEMES = ("systematic", "multinomial", "none")


@inner
def cumulate(weights, cumulative):
    """Fill ``cumulative`` with the cumulative sums of the ``weights``, scaled to end at 1."""
    total = 0.0
    for i in range(len(weights)):
        total += weights[i]
        cumulative[i] = total
    for i in range(len(weights)):
        cumulative[i] /= total


@inner
def repeat(below, chosen):
    """Set ``chosen`` (P,) to i from ``below``[i − 1] to ``below``[i]. No branch depends on the
    weights: i is written where its copies begin, then copied up to the next particle.
    """
    count = len(chosen)
    first = 0
    last = 0
    chosen[:] = 0
    for i in range(count):
        if first < count:
            chosen[first] = i
        first = int(below[i])
    for j in range(count):
        last = chosen[j] if chosen[j] > last else last
        chosen[j] = last


@inner
def systematic(weights, chosen, scratch, rng):
    """Shift P equidistant points by one uniform: counts ⌊P·w_i⌋ or ⌈P·w_i⌉ (Kitagawa 1996)."""
    below = scratch[0]
    count = len(weights)
    shift = rng.random()
    cumulate(weights, below)
    for i in range(count):
        below[i] = np.ceil(count * below[i] - shift)
    repeat(below, chosen)


@inner
def multinomial(weights, chosen, scratch, rng):
    """Draw sorted independent indices, probabilities ∝ ``weights`` (P,) (Gordon et al. 1993)."""
    points = scratch[0]
    cumulative = scratch[1]
    count = len(chosen)
    arrival = 0.0
    # sorted uniforms: arrivals of a Poisson process divided by the next arrival
    for j in range(count):
        arrival += rng.standard_exponential()
        points[j] = arrival
    end = arrival + rng.standard_exponential()
    cumulate(weights, cumulative)
    # the last particle with weight, as rounding may raise a point to 1
    last = len(weights) - 1
    i = 0
    while last > 0 and not cumulative[last - 1] < 1.0:
        last -= 1
    for j in range(count):
        point = points[j] / end
        while i < last and cumulative[i] <= point:
            i += 1
        chosen[j] = i


@inner
def resample(scheme, weights, chosen, scratch, rng):
    """Fill ``chosen`` by SCHEMES[``scheme``]."""
    if scheme == 0:
        systematic(weights, chosen, scratch, rng)
    else:
        multinomial(weights, chosen, scratch, rng)


@inner
def weigh(frames, frame, before, q, log_weights, scratch):
    """Add to ``log_weights`` (P,) the log-likelihood of ``frame``, up to a constant, at its share
    of the step from ``before`` to ``q`` (n, P); ``scratch`` has at least (n + 2, WIDTH) floats.
    """
    n = len(q)
    share = frames.share[frame]
    white = frames.whitening[frame]
    measured = frames.unbiased[frame]
    whitened = scratch[n]
    square = scratch[n + 1]
    for start in range(0, len(log_weights), WIDTH):
        count = min(WIDTH, len(log_weights) - start)
        # slices: the compiler knows that none of their indices is negative
        stop = start + count
        for j in range(n):
            here = before[j, start:stop]
            there = q[j, start:stop]
            y = measured[j]
            rest = scratch[j]
            for i in range(count):
                expected = here[i] + share * (there[i] - here[i])
                rest[i] = y - expected
        square[:count] = 0.0
        for j in range(n):
            whitened[:count] = 0.0
            for k in range(j + 1):
                w = white[j, k]
                rest = scratch[k]
                for i in range(count):
                    whitened[i] += w * rest[i]
            for i in range(count):
                square[i] += whitened[i] * whitened[i]
        weighed = log_weights[start:stop]
        for i in range(count):
            weighed[i] -= 0.5 * square[i]


@inner
def normalise(log_weights, weights):
    """Normalise ``log_weights`` (P,) and fill ``weights``; return the effective sample size 1/Σw²
    (Kong, Liu & Wong 1994), not above zero if no particle has weight.
    """
    peak = greatest(log_weights)
    if not np.isfinite(peak):
        return 0.0
    for i in range(len(weights)):
        weights[i] = exponential(log_weights[i] - peak)
    scale = total(weights)
    squares = inner_product(weights, weights)
    log_total = peak + np.log(scale)
    share = 1 / scale
    for i in range(len(weights)):
        weights[i] *= share
        log_weights[i] -= log_total
    return scale * scale / squares


@inner
def weighted_moments(weights, q, mean, covariance, scratch):
    """Fill ``mean`` (n,) and ``covariance`` (n, n) of the particles ``q`` (n, P) under normalised
    ``weights`` (P,); ``scratch`` has at least (n + 1, WIDTH) floats.
    """
    n = len(q)
    for j in range(n):
        mean[j] = inner_product(weights, q[j])
        for k in range(n):
            covariance[j, k] = 0.0
    for start in range(0, len(weights), WIDTH):
        count = min(WIDTH, len(weights) - start)
        weight = weights[start : start + count]
        weighted = scratch[n, :count]
        for j in range(n):
            angle = q[j, start : start + count]
            middle = mean[j]
            deviation = scratch[j, :count]
            for i in range(count):
                deviation[i] = angle[i] - middle
                weighted[i] = weight[i] * deviation[i]
            for k in range(j + 1):
                covariance[j, k] += inner_product(weighted, scratch[k, :count])
    for j in range(n):
        for k in range(j):
            covariance[k, j] = covariance[j, k]


@inner
def keep_inside(limits, before, q, log_weights, outside):
    """Set the weight of particles ``q`` (n, P) beyond the joint ``limits`` to zero, move
    them back to ``before``, and return the number of them that had weight. ``outside`` (P,) is
    scratch. A step from a singular pose is NaN, which is beyond every limit.
    """
    lower, upper = limits
    lost = 0
    outside[: len(log_weights)] = 0.0
    for j in range(len(q)):
        angle = q[j]
        low = lower[j]
        high = upper[j]
        for i in range(len(angle)):
            within = (low <= angle[i]) & (angle[i] <= high)
            outside[i] = outside[i] if within else 1.0
    for i in range(len(log_weights)):
        if outside[i] > 0.0:
            lost += log_weights[i] > -np.inf
            log_weights[i] = -np.inf
            for j in range(len(q)):
                q[j, i] = before[j, i]
    return lost


class Setting(NamedTuple):
    """Joint limits (lower, upper), measurements and resampling of one filter."""

    limits: tuple
    frames: NamedTuple  # pipeline.filtering.measurement.Frames
    scheme: int  # index of SCHEMES
    # effective sample size over P below which the particles are resampled
    threshold: float


class Particles(NamedTuple):
    """Weights of P particles and scratch."""

    weights: ndarray  # (P,) of sum 1
    log_weights: ndarray  # (P,)
    # (P,) indices of the particles that continued in the last resampling
    chosen: ndarray
    size: ndarray  # (1,) effective sample size
    scratch: ndarray  # (n + 2, max(P, WIDTH))


class Record(NamedTuple):
    """First fields of :class:`~pipeline.filtering.particle_filter.Posterior`."""

    mean: ndarray
    covariance: ndarray
    ess: ndarray
    resampled: ndarray
    clipped: ndarray
    outside: ndarray


def fresh_arrays(n: int, count: int, grid: int) -> tuple[Particles, Record]:
    """Return equal weights of ``count`` particles of n joints, and a record of ``grid`` poses."""
    particles = Particles(
        weights=np.full(count, 1.0 / count),
        log_weights=np.full(count, -np.log(count)),
        chosen=np.empty(count, dtype=np.int64),
        size=np.array([float(count)]),
        scratch=np.empty((n + 2, max(count, WIDTH))),
    )
    record = Record(
        mean=np.empty((grid, n)),
        covariance=np.empty((grid, n, n)),
        ess=np.empty(grid),
        resampled=np.zeros(grid, dtype=np.bool_),
        clipped=np.zeros(grid, dtype=np.int64),
        outside=np.zeros(grid, dtype=np.int64),
    )
    return particles, record


@compiled
def update(k, setting, before, q, particles, record, rng):
    """Weigh the particles ``q`` (n, P) in rad after step ``k`` from ``before`` and ``record`` their
    moments. Return VANISHED if all weights vanished, RESAMPLED if ``before`` contains the particles
    that continue, else KEPT.
    """
    weights, log_weights, chosen, size, scratch = particles
    frames = setting.frames
    n = len(q)
    count = len(weights)
    if k > 0:
        record.outside[k] = keep_inside(
            setting.limits,
            before,
            q,
            log_weights,
            scratch[0],
        )
    for frame in range(frames.first[k], frames.first[k + 1]):
        weigh(frames, frame, before, q, log_weights, scratch)
    if record.outside[k] > 0 or frames.first[k] < frames.first[k + 1]:
        size[0] = normalise(log_weights, weights)
        if not size[0] > 0.0:
            return VANISHED
    weighted_moments(weights, q, record.mean[k], record.covariance[k], scratch)
    record.ess[k] = size[0]
    if not size[0] < setting.threshold * count:
        return KEPT
    resample(setting.scheme, weights, chosen, scratch, rng)
    for j in range(n):
        here = q[j]
        there = before[j]
        for i in range(count):
            there[i] = here[np.uint64(chosen[i])]  # unsigned: no index is negative
    weights[:] = 1.0 / count
    log_weights[:] = -np.log(count)
    size[0] = float(count)
    record.resampled[k] = True
    return RESAMPLED


@compiled
def sequential_importance_sampling(
    law,
    arm,
    block,
    commands,
    setting,
    q,
    particles,
    record,
    rng,
):
    """Fill the ``record`` of particles that the compiled ``law`` moves from their first poses ``q``
    (n, P) in rad, which are overwritten. Return the step at which all weights vanished, or −1.
    """
    before = q.copy()
    for k in range(len(commands.v) + 1):
        if k > 0:
            q, before = before, q
            command = commands.v[k - 1], commands.path[k - 1], commands.share
            record.clipped[k] = move(law, arm, block, *command, before, q, rng)
        state = update(k, setting, before, q, particles, record, rng)
        if state == VANISHED:
            return k
        if state == RESAMPLED:
            before, q = q, before
    return -1
