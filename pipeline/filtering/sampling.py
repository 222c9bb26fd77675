"""Sequential importance sampling with resampling, compiled: the loop over the steps of one take is
the last function.

Joint angles are kept as (n, P),
so that neighbours in memory are the same joint of neighbouring particles and the compiler computes
four at once. It neither reorders nor fuses operations: the results are the same on every processor.
"""

from __future__ import annotations

import numpy as np

from pipeline.arm.interface import ArmConstants
from pipeline.core.compiled import compiled, inner
from pipeline.filtering.resampling import resample
from pipeline.filtering.start import mark_outside
from pipeline.filtering.state import Domain, Frames, Particles, Record
from pipeline.filtering.tip_weights import weigh_tip
from pipeline.filtering.weights import make_equal, normalise, weigh, weighted_moments
from pipeline.models.kernel import move
from pipeline.models.model import Commands, Law


@inner
def keep_inside(
    domain: Domain,
    before: np.ndarray,
    q: np.ndarray,
    log_weights: np.ndarray,
    scratch: np.ndarray,
) -> int:
    """Take the weight of the particles of ``q`` (n, P) that left D_q and put them back to where
    they were ``before``, as the model has no step from poses that the arm cannot take; return how
    many of them had any weight. ``scratch`` (P,) is overwritten.
    """
    if not mark_outside(domain, q, scratch):
        return 0
    lost = 0
    for i in range(len(log_weights)):
        if scratch[i] > 0.0:
            lost += log_weights[i] > -np.inf
            log_weights[i] = -np.inf
            for j in range(len(q)):
                q[j, i] = before[j, i]
    return lost


@compiled
def sequential_importance_sampling(
    law: Law,
    arm: ArmConstants,
    space: int | None,
    block: np.ndarray,
    domain: Domain,
    commands: Commands,
    frames: Frames,
    scheme: int,
    threshold: float,
    particles: Particles,
    record: Record,
    rng: np.random.Generator,
) -> tuple[float, int]:
    """Fill ``record``; return the log-evidence, and the step at which all weights vanished or −1.

    ``law`` moves the particles (:mod:`pipeline.models.kernel`), ``frames`` weigh them. Below an
    effective sample size of ``threshold``·P particles the ``scheme`` resamples.
    """
    q, before, weights, log_weights, chosen, scratch = particles
    log_evidence = 0.0
    effective = make_equal(weights, log_weights)
    for k in range(len(commands.v) + 1):
        if k > 0:
            q, before = before, q
            v, target = commands.v[k - 1], commands.path[k - 1]
            record.clipped[k] = move(
                law, arm, space, block, v, target, commands.share, before, q, rng
            )
            record.outside[k] = keep_inside(domain, before, q, log_weights, scratch[0])
        for frame in range(frames.first[k], frames.first[k + 1]):
            if space is None:
                weigh(frames, frame, before, q, log_weights, scratch)
            elif frames.tip:
                weigh_tip(arm, frames, frame, before, q, log_weights, scratch)
            else:
                weigh(frames, frame, before, q, log_weights, scratch)
        if record.outside[k] > 0 or frames.first[k] < frames.first[k + 1]:
            effective, log_total = normalise(log_weights, weights)
            if not np.isfinite(log_total):
                return log_evidence, k
            log_evidence += log_total

        weighted_moments(weights, q, record.mean[k], record.covariance[k], scratch)
        record.ess[k] = effective
        if effective < threshold * len(weights):
            resample(scheme, weights, chosen, scratch, rng)
            for j in range(len(q)):
                here, there = q[j], before[j]
                for i in range(len(chosen)):
                    there[i] = here[np.uint64(chosen[i])]  # unsigned, as no index is below zero
            before, q = q, before
            effective, record.resampled[k] = make_equal(weights, log_weights), True
    return log_evidence, -1
