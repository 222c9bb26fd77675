"""Sequential importance sampling with resampling, compiled. Joint angles are kept as (n, P), so
that neighbours in memory are the same joint of neighbouring particles.
"""

from typing import NamedTuple

import numpy as np

from pipeline.arm.kinematics import rotation_vectors, tip
from pipeline.arm.rows import POSITION, TURN, WIDTH
from pipeline.core.compiled import compiled, inlined, inner
from pipeline.core.elementary import exponential, greatest, inner_product, total
from pipeline.filtering.resampling import resample
from pipeline.models.kernel import move

ROWS = 6  # of a displacement of the tip


@inner
def weigh(arm, space, frames, frame, before, q, log_weights, block, scratch):
    """Add to ``log_weights`` (P,) the log-likelihood of ``frame`` at its share of the way from
    ``before`` to ``q`` (n, P); ``scratch`` has (n + ROWS + 2, WIDTH) floats or more, ``block`` the
    rows of the arm's kinematics. Poses of the tip need an arm in space, ``space`` not None.
    """
    n, share, log_norm = len(q), frames.share[frame], frames.log_norm[frame]
    white, measured = frames.whitening[frame], frames.unbiased[frame]
    whitened, square = scratch[n + ROWS], scratch[n + ROWS + 1]
    rest = scratch[n : n + ROWS] if frames.tip else scratch[:n]
    for start in range(0, len(log_weights), WIDTH):
        count = min(WIDTH, len(log_weights) - start)
        # slices: the compiler knows that none of their indices is negative
        stop = start + count
        for j in range(n):
            here, there, pose = before[j, start:stop], q[j, start:stop], scratch[j]
            for i in range(count):
                pose[i] = here[i] + share * (there[i] - here[i])
        if not frames.tip:
            for j in range(n):
                y, pose = measured[j], scratch[j]
                for i in range(count):
                    pose[i] = y - pose[i]
        if space is not None:  # else its kinematics are not compiled
            if frames.tip:
                displacement(arm, measured, scratch, rest, block, count)
        square[:count] = 0.0
        for j in range(len(white)):
            add_square(white, j, rest, whitened, square, count)
        own = log_weights[start:stop]
        for i in range(count):
            own[i] += log_norm - 0.5 * square[i]


@inner
def displacement(arm, measured, poses, rest, block, count):
    """Fill ``rest`` (6, count) with the displacements of ``measured`` from the tip, m and rad."""
    tip(arm, poses, 0, count, block)
    rotation_vectors(measured, block.reshape(-1), count)
    for k in range(3):
        way, turn = rest[k], rest[3 + k]
        for i in range(count):
            way[i] = measured[k] - block[POSITION + k, i]
            turn[i] = block[TURN + k, i]


@inlined
def add_square(white, j, rest, whitened, square, count):
    """Add to ``square`` the square of row ``j`` of ``white`` times ``rest``, by ``whitened``."""
    for i in range(count):
        whitened[i] = 0.0
    for k in range(j + 1):
        w, other = white[j, k], rest[k]
        for i in range(count):
            whitened[i] += w * other[i]
    for i in range(count):
        square[i] += whitened[i] * whitened[i]


@inner
def normalise(log_weights, weights):
    """Normalise ``log_weights`` (P,) and fill ``weights``; return the effective sample size 1/Σw²
    (Kong, Liu & Wong 1994) and the log of the former sum, not finite where all have vanished.
    """
    peak = greatest(log_weights)
    if not np.isfinite(peak):
        return 0.0, peak
    for i in range(len(weights)):
        weights[i] = exponential(log_weights[i] - peak)
    scale, squares = total(weights), inner_product(weights, weights)
    log_total, share = peak + np.log(scale), 1 / scale
    for i in range(len(weights)):
        weights[i] *= share
        log_weights[i] -= log_total
    return scale * scale / squares, log_total


@inner
def weighted_moments(weights, q, mean, covariance, scratch):
    """Fill ``mean`` (n,) and, about that mean, ``covariance`` (n, n) of particles ``q`` (n, P)
    under normalised ``weights`` (P,); ``scratch`` has (n + 1, WIDTH) floats or more.
    """
    n = len(q)
    for j in range(n):
        mean[j] = inner_product(weights, q[j])
        for k in range(n):
            covariance[j, k] = 0.0
    for start in range(0, len(weights), WIDTH):
        count = min(WIDTH, len(weights) - start)
        weight, weighted = weights[start : start + count], scratch[n, :count]
        for j in range(n):
            angle, middle, deviation = q[j, start : start + count], mean[j], scratch[j, :count]
            for i in range(count):
                deviation[i] = angle[i] - middle
                weighted[i] = weight[i] * deviation[i]
            for k in range(j + 1):
                covariance[j, k] += inner_product(weighted, scratch[k, :count])
    for j in range(n):
        for k in range(j):
            covariance[k, j] = covariance[j, k]


class Domain(NamedTuple):
    """D_q: the joint limits and, of a planar chain's second joint, the angle at which the first two
    links are in line and the least distance from it. Any other arm has no such angle: its law makes
    no step from a singular pose, so that a particle leaves D_q with its next step.
    """

    lower: np.ndarray  # (n,) rad
    upper: np.ndarray  # (n,) rad
    straight: float  # rad, up to half turns
    clearance: float  # rad; zero where there is no such angle


@inner
def keep_inside(domain, before, q, log_weights, outside):
    """Take the weight of the particles of ``q`` (n, P) that left D_q, put them back to ``before``,
    and return the number of those with any weight; ``outside`` (P,) is overwritten.
    """
    second, lost = q[1 if len(q) > 1 else 0], 0
    for i in range(len(second)):
        half_turns = (second[i] - domain.straight) * (1 / np.pi)
        bent = np.pi * abs(half_turns - np.floor(half_turns + 0.5)) >= domain.clearance
        outside[i] = 0.0 if bent else 1.0
    for j in range(len(q)):
        angle, low, high = q[j], domain.lower[j], domain.upper[j]
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


@compiled
def sequential_importance_sampling(
    law, arm, space, block, domain, commands, frames, scheme, threshold, poses, rng
):
    """Return the course of :class:`~pipeline.filtering.particle_filter.Posterior`, the log-evidence
    and the step at which all weights vanished or −1. ``law`` moves the particles from their first
    ``poses`` (n, P) in rad, which are overwritten, and ``frames`` weigh them. Below a sample size
    of ``threshold``·P the ``scheme`` resamples.
    """
    (n, count), grid = poses.shape, len(commands.v) + 1
    mean, covariance = np.empty((grid, n)), np.empty((grid, n, n))
    ess, resampled = np.empty(grid), np.zeros(grid, dtype=np.bool_)
    clipped, outside = np.zeros(grid, dtype=np.int64), np.zeros(grid, dtype=np.int64)
    q, before, chosen = poses, poses.copy(), np.empty(count, dtype=np.int64)
    scratch = np.empty((n + ROWS + 2, max(count, WIDTH)))
    weights, log_weights = np.full(count, 1.0 / count), np.full(count, -np.log(count))
    effective, log_evidence, vanished = float(count), 0.0, -1
    for k in range(grid):
        if k > 0:
            q, before = before, q
            v, target = commands.v[k - 1], commands.path[k - 1]
            clipped[k] = move(law, arm, space, block, v, target, commands.share, before, q, rng)
            outside[k] = keep_inside(domain, before, q, log_weights, scratch[0])
        for frame in range(frames.first[k], frames.first[k + 1]):
            weigh(arm, space, frames, frame, before, q, log_weights, block, scratch)
        if outside[k] > 0 or frames.first[k] < frames.first[k + 1]:
            effective, log_total = normalise(log_weights, weights)
            if not np.isfinite(log_total):
                vanished = k
                break
            log_evidence += log_total
        # moments are formed before resampling
        weighted_moments(weights, q, mean[k], covariance[k], scratch)
        ess[k] = effective
        if effective < threshold * count:
            resample(scheme, weights, chosen, scratch, rng)
            for j in range(n):
                here, there = q[j], before[j]
                for i in range(count):
                    there[i] = here[np.uint64(chosen[i])]  # unsigned, as no index is below zero
            before, q = q, before
            weights[:], log_weights[:] = 1.0 / count, -np.log(count)
            effective, resampled[k] = float(count), True
    return (mean, covariance, ess, resampled, clipped, outside), log_evidence, vanished
