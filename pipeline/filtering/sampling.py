"""Sequential importance sampling with resampling, compiled: the loop over the steps of one take is the last function.

Each step goes through the particles in blocks that stay in the processor's nearest cache: a block is moved by the model's law and held
against D_q while it is there. Joint angles are kept as (3, P), so that neighbours in memory are the same joint of neighbouring particles
and the compiler computes four at once. It neither reorders nor fuses operations, and exp and log are the C library's: the results are the
same on every processor.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import boolean, float64, int64, types

from pipeline.compiled import MATRIX, VECTOR, compiled, inner
from pipeline.filtering.resampling import COUNTS, SCHEME
from pipeline.motion.compiled.chain import Arm
from pipeline.motion.compiled.draws import draw
from pipeline.motion.compiled.law import ARM, GENERATOR, NUMBERS, STEP, TRIPLE, Numbers

BLOCK = 256  # particles
MATRICES = types.Array(float64, 3, "C")


class Domain(NamedTuple):
    """D_q: the joint limits and, of the second joint, the angle at which the first two links are in line and how clear of that it is to be.

    |det J| is the product of both links' lengths and the sine of the angle between them, which the second joint alone decides.
    """

    lower: tuple[float, float, float]  # rad
    upper: tuple[float, float, float]  # rad
    straight: float  # rad, up to half turns
    clearance: float  # rad


class Frames(NamedTuple):
    """The F measurements in the order in which they enter: frames first[k] to first[k+1] when step k is done.

    The density of y at the pose q is exp(log_norm − ‖whitening·(y − bias − q)‖²/2), q the pose at ``share`` of the step.
    """

    first: np.ndarray  # (M+2,)
    share: np.ndarray  # (F,)
    unbiased: np.ndarray  # (F, 3) y − bias, rad
    whitening: np.ndarray  # (F, 3, 3) lower triangular, 1/rad
    log_norm: np.ndarray  # (F,)


class Particles(NamedTuple):
    """P particles: where they are and were, and room for their weights and for what resampling does with them."""

    q: np.ndarray  # (3, P) rad
    before: np.ndarray  # (3, P)
    weights: np.ndarray  # (P,)
    log_weights: np.ndarray  # (P,)
    chosen: np.ndarray  # (P,) int
    room: np.ndarray  # (2, P)


class Record(NamedTuple):
    """The fields of a Posterior that are filled step by step, on the grid k = 0 … M; the counts begin at zero."""

    mean: np.ndarray  # (M+1, 3) rad
    covariance: np.ndarray  # (M+1, 3, 3) rad²
    ess: np.ndarray  # (M+1,)
    resampled: np.ndarray  # (M+1,) bool
    clipped: np.ndarray  # (M+1,) int
    outside: np.ndarray  # (M+1,) int


DOMAIN = types.NamedTuple((TRIPLE, TRIPLE, float64, float64), Domain)
FRAMES = types.NamedTuple((COUNTS, VECTOR, MATRIX, MATRICES, VECTOR), Frames)
PARTICLES = types.NamedTuple((MATRIX, MATRIX, VECTOR, VECTOR, COUNTS, MATRIX), Particles)
RECORD = types.NamedTuple((MATRIX, MATRICES, VECTOR, types.Array(boolean, 1, "C"), COUNTS, COUNTS), Record)
SIGNATURE = types.Tuple((float64, int64))(
    types.FunctionType(STEP), NUMBERS, VECTOR, ARM, DOMAIN, MATRIX, FRAMES, types.FunctionType(SCHEME), float64, PARTICLES, RECORD,
    GENERATOR,
)  # fmt: skip


@inner
def propagate(
    law: object, numbers: Numbers, parameters: np.ndarray, arm: Arm, domain: Domain, v: np.ndarray, before: np.ndarray, q: np.ndarray,
    log_weights: np.ndarray, rng: np.random.Generator,
) -> tuple[int, int]:  # fmt: skip
    """Draw ``q`` (3, P) from the motion model given ``before``; for how many the noise was clipped, and how many left D_q.

    A particle that leaves D_q loses its weight and waits where it was: the model is not asked about poses that the arm cannot take.
    """
    clipped = outside = 0
    count = q.shape[1]
    for start in range(0, count, BLOCK):
        stop = start + BLOCK if start + BLOCK < count else count
        here = (before[0, start:stop], before[1, start:stop], before[2, start:stop])
        there = (q[0, start:stop], q[1, start:stop], q[2, start:stop])
        draw(numbers, stop - start, rng)
        clipped += law(numbers, parameters, arm, (v[0], v[1], v[2]), here, there)
        outside += keep_inside(domain, here, there, log_weights[start:stop])
    return clipped, outside


@inner
def keep_inside(domain: Domain, here: tuple, there: tuple, log_weights: np.ndarray) -> int:
    """Take the weight of the particles of a block that left D_q and put them back; how many of them had any."""
    lost = 0
    (a1, a2, a3), (b1, b2, b3) = domain.lower, domain.upper
    (q1, q2, q3), (p1, p2, p3) = there, here
    for i in range(len(q1)):
        x1, x2, x3 = q1[i], q2[i], q3[i]
        half_turns = (x2 - domain.straight) / np.pi
        bent = np.pi * abs(half_turns - np.floor(half_turns + 0.5)) >= domain.clearance
        if not ((a1 <= x1) & (x1 <= b1) & (a2 <= x2) & (x2 <= b2) & (a3 <= x3) & (x3 <= b3) & bent):
            lost += log_weights[i] > -np.inf
            log_weights[i] = -np.inf
            q1[i], q2[i], q3[i] = p1[i], p2[i], p3[i]
    return lost


@inner
def weigh(frames: Frames, frame: int, before: np.ndarray, q: np.ndarray, log_weights: np.ndarray) -> None:
    """Add to ``log_weights`` (P,) the log-likelihood of ``frame`` at its share of the way from ``before`` to ``q`` (3, P)."""
    share, log_norm = frames.share[frame], frames.log_norm[frame]
    y1, y2, y3 = frames.unbiased[frame, 0], frames.unbiased[frame, 1], frames.unbiased[frame, 2]
    white = frames.whitening[frame]
    w11, w21, w22, w31, w32, w33 = white[0, 0], white[1, 0], white[1, 1], white[2, 0], white[2, 1], white[2, 2]
    (p1, p2, p3), (q1, q2, q3) = (before[0], before[1], before[2]), (q[0], q[1], q[2])
    for i in range(len(log_weights)):
        d1 = y1 - (p1[i] + share * (q1[i] - p1[i]))
        d2 = y2 - (p2[i] + share * (q2[i] - p2[i]))
        d3 = y3 - (p3[i] + share * (q3[i] - p3[i]))
        e1, e2, e3 = w11 * d1, w21 * d1 + w22 * d2, w31 * d1 + w32 * d2 + w33 * d3
        log_weights[i] += log_norm - 0.5 * (e1 * e1 + e2 * e2 + e3 * e3)


@inner
def normalise(log_weights: np.ndarray, weights: np.ndarray) -> tuple[float, float]:
    """Normalise ``log_weights`` (P,) and fill ``weights``; the effective sample size 1/Σw² (Kong, Liu & Wong 1994), from 1, one particle
    carrying all, to P, all alike, and the logarithm of the sum of the weights as they were, which is not finite where all have vanished."""
    peak = -np.inf
    for i in range(len(log_weights)):
        if log_weights[i] > peak:
            peak = log_weights[i]
    if not np.isfinite(peak):
        return 0.0, peak
    total = squares = 0.0
    for i in range(len(log_weights)):
        weights[i] = np.exp(log_weights[i] - peak)
        total += weights[i]
        squares += weights[i] * weights[i]
    log_total = peak + np.log(total)
    for i in range(len(log_weights)):
        weights[i] /= total
        log_weights[i] -= log_total
    return total * total / squares, log_total


@inner
def make_equal(weights: np.ndarray, log_weights: np.ndarray) -> float:
    """Give all P particles the weight 1/P; the effective sample size, P."""
    count = len(weights)
    for i in range(count):
        weights[i], log_weights[i] = 1.0 / count, -np.log(count)
    return float(count)


@inner
def weighted_moments(weights: np.ndarray, q: np.ndarray, mean: np.ndarray, covariance: np.ndarray) -> None:
    """Fill ``mean`` (3,) and, about that mean, ``covariance`` (3, 3) of particles ``q`` (3, P) under normalised ``weights`` (P,)."""
    q1, q2, q3 = q[0], q[1], q[2]
    m1 = m2 = m3 = 0.0
    for i in range(len(weights)):
        m1, m2, m3 = m1 + weights[i] * q1[i], m2 + weights[i] * q2[i], m3 + weights[i] * q3[i]
    c11 = c12 = c13 = c22 = c23 = c33 = 0.0
    for i in range(len(weights)):
        d1, d2, d3 = q1[i] - m1, q2[i] - m2, q3[i] - m3
        w1, w2, w3 = weights[i] * d1, weights[i] * d2, weights[i] * d3
        c11, c12, c13 = c11 + w1 * d1, c12 + w1 * d2, c13 + w1 * d3
        c22, c23, c33 = c22 + w2 * d2, c23 + w2 * d3, c33 + w3 * d3
    mean[0], mean[1], mean[2] = m1, m2, m3
    covariance[0, 0], covariance[0, 1], covariance[0, 2] = c11, c12, c13
    covariance[1, 0], covariance[1, 1], covariance[1, 2] = c12, c22, c23
    covariance[2, 0], covariance[2, 1], covariance[2, 2] = c13, c23, c33


@compiled(SIGNATURE)
def sequential_importance_sampling(
    law: object, numbers: Numbers, parameters: np.ndarray, arm: Arm, domain: Domain, v: np.ndarray, frames: Frames, resample: object,
    threshold: float, particles: Particles, record: Record, rng: np.random.Generator,
) -> tuple[float, int]:  # fmt: skip
    """Fill ``record``; the log-evidence, and the step at which all weights vanished or −1.

    ``law`` moves the particles with ``parameters`` and ``numbers``, which have room for a block (:mod:`pipeline.motion.compiled.law`);
    ``v`` (M, 3) are the commanded steps (m, m, rad). Below an effective sample size of ``threshold``·P particles ``resample`` chooses anew.
    """
    q, before, weights, log_weights, chosen, room = particles
    log_evidence = 0.0
    effective = make_equal(weights, log_weights)
    for k in range(len(v) + 1):
        if k > 0:
            before, q = q, before
            record.clipped[k], record.outside[k] = propagate(law, numbers, parameters, arm, domain, v[k - 1], before, q, log_weights, rng)
        for frame in range(frames.first[k], frames.first[k + 1]):
            weigh(frames, frame, before, q, log_weights)
        if record.outside[k] > 0 or frames.first[k] < frames.first[k + 1]:
            effective, log_total = normalise(log_weights, weights)
            if not np.isfinite(log_total):
                return log_evidence, k
            log_evidence += log_total

        weighted_moments(weights, q, record.mean[k], record.covariance[k])
        record.ess[k] = effective
        if effective < threshold * len(weights):
            resample(weights, chosen, room, rng)
            for j in range(3):
                for i in range(len(weights)):
                    before[j, i] = q[j, chosen[i]]
            before, q = q, before
            effective, record.resampled[k] = make_equal(weights, log_weights), True
    return log_evidence, -1
