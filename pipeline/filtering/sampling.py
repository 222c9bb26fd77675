"""Sequential importance sampling with resampling, compiled: the loop over the steps of one take is
the last function.

Each step goes through the particles in blocks that stay in the processor's nearest cache: a block
is moved by the model's law and held against D_q while it is there. Joint angles are kept as (n, P),
so that neighbours in memory are the same joint of neighbouring particles and the compiler computes
four at once. It neither reorders nor fuses operations: the results are the same on every processor.
"""

from __future__ import annotations

import numpy as np

from pipeline.arm.numbers import Arm
from pipeline.core.compiled import compiled, inner
from pipeline.filtering.resampling import resample
from pipeline.filtering.start import mark_outside
from pipeline.filtering.state import Domain, Frames, Particles, Record
from pipeline.filtering.tip_weights import weigh_tip
from pipeline.filtering.weights import make_equal, normalise, weigh, weighted_moments
from pipeline.models.commands import Commands
from pipeline.models.kernel import move_block
from pipeline.models.model import Law


@inner
def propagate(
    law: Law,
    arm: Arm,
    block: np.ndarray,
    domain: Domain,
    commands: Commands,
    k: int,
    before: np.ndarray,
    q: np.ndarray,
    log_weights: np.ndarray,
    scratch: np.ndarray,
    rng: np.random.Generator,
) -> tuple[int, int]:
    """Draw ``q`` (n, P) from the motion model given ``before`` under the commands of step ``k``;
    return for how many the noise was clipped, and how many left D_q.

    A particle that leaves D_q loses its weight and stays where it was: the model has no step from
    poses that the arm cannot take. ``scratch`` (P,) is overwritten.
    """
    clipped = outside = 0
    poses, size = q.shape[1], block.shape[1]
    v, target = commands.v[k], commands.path[k]
    for start in range(0, poses, size):
        count = min(size, poses - start)
        clipped += move_block(
            law, arm, block, v, target, commands.share, before, q, start, count, rng
        )
        outside += keep_inside(domain, before, q, start, start + count, log_weights, scratch)
    return clipped, outside


@inner
def keep_inside(
    domain: Domain,
    before: np.ndarray,
    q: np.ndarray,
    start: int,
    stop: int,
    log_weights: np.ndarray,
    scratch: np.ndarray,
) -> int:
    """Take the weight of the particles ``start`` to ``stop`` of ``q`` (n, P) that left D_q and put
    them back to where they were ``before``; return how many of them had any. ``scratch`` (P,) is
    overwritten.
    """
    if not mark_outside(domain, q, start, stop, scratch):
        return 0
    lost = 0
    for i in range(start, stop):
        if scratch[i] > 0.0:
            lost += log_weights[i] > -np.inf
            log_weights[i] = -np.inf
            for j in range(len(q)):
                q[j, i] = before[j, i]
    return lost


@compiled
def sequential_importance_sampling(
    law: Law,
    arm: Arm,
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
            record.clipped[k], record.outside[k] = propagate(
                law, arm, block, domain, commands, k - 1, before, q, log_weights, scratch[0], rng
            )
        for frame in range(frames.first[k], frames.first[k + 1]):
            if frames.tip:
                weigh_tip(arm, frames, frame, before, q, log_weights)
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
