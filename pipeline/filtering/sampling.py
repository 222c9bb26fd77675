"""Sequential importance sampling with resampling, compiled: the loop over the steps of one take.

Joint angles are kept as (n, P), so that neighbours in memory are the same joint of neighbouring
particles and the compiler computes four at once. It neither reorders nor fuses operations: the
results are the same on every processor.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pipeline.core.compiled import compiled, inner
from pipeline.filtering.resampling import resample
from pipeline.filtering.weights import NEAR, ROWS, normalise, weigh, weighted_moments
from pipeline.models.kernel import move


class Domain(NamedTuple):
    """D_q: the joint limits and, of a planar chain's second joint, the angle at which the first two
    links are in line and the least distance from it.

    |det J| of a planar chain is the product of both links' lengths and the sine of the angle
    between them, which the second joint alone decides. Any other arm has no such angle: its law
    makes no step from a singular pose, so that a particle leaves D_q with its next step.
    """

    lower: np.ndarray  # (n,) rad
    upper: np.ndarray  # (n,) rad
    straight: float  # rad, up to half turns
    clearance: float  # rad; zero where there is no such angle


@inner
def keep_inside(domain, before, q, log_weights, outside):
    """Take the weight of the particles of ``q`` (n, P) that left D_q, put them back to ``before``,
    as no model has a step from where they are, and return the number of those with any weight.
    ``outside`` (P,) is overwritten.
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
    """Return mean (M+1, n), covariance (M+1, n, n), effective sample size, resampled, clipped and
    outside (M+1,); the log-evidence; and the step at which all weights vanished or −1.

    ``law`` moves the particles from their first ``poses`` (n, P) in rad, which are overwritten, and
    ``frames`` weigh them. Below an effective sample size of ``threshold``·P the ``scheme``
    resamples.
    """
    (n, count), grid = poses.shape, len(commands.v) + 1
    mean, covariance = np.empty((grid, n)), np.empty((grid, n, n))
    ess, resampled = np.empty(grid), np.zeros(grid, dtype=np.bool_)
    clipped, outside = np.zeros(grid, dtype=np.int64), np.zeros(grid, dtype=np.int64)
    q, before, chosen = poses, poses.copy(), np.empty(count, dtype=np.int64)
    scratch = np.empty((n + ROWS + 2, max(count, NEAR)))
    weights, log_weights = np.full(count, 1.0 / count), np.full(count, -np.log(count))
    effective, log_evidence, vanished = float(count), 0.0, -1
    for k in range(grid):
        if k > 0:
            q, before = before, q
            v, target = commands.v[k - 1], commands.path[k - 1]
            clipped[k] = move(law, arm, space, block, v, target, commands.share, before, q, rng)
            outside[k] = keep_inside(domain, before, q, log_weights, scratch[0])
        for frame in range(frames.first[k], frames.first[k + 1]):
            weigh(arm, space, frames, frame, before, q, log_weights, scratch)
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
