"""Sequential importance sampling with resampling, compiled: the loop over the steps of one take is
the last function.

Each step goes through the particles in blocks that stay in the processor's nearest cache: a block
is moved by the model's law and held against D_q while it is there. Joint angles are kept as (3, P),
so that neighbours in memory are the same joint of neighbouring particles and the compiler computes
four at once. It neither reorders nor fuses operations, and exp and log are the C library's: the
results are the same on every processor.
"""

from __future__ import annotations

import numpy as np
from numba import float64, int64, types

from pipeline.arm.compiled import ARM, Arm
from pipeline.core.compiled import VECTOR, compiled, inner
from pipeline.filtering.resampling import SCHEME
from pipeline.filtering.state import (
    COMMANDS,
    DOMAIN,
    FRAMES,
    PARTICLES,
    RECORD,
    Domain,
    Frames,
    Particles,
    Record,
)
from pipeline.filtering.weights import make_equal, normalise, weigh, weighted_moments
from pipeline.models.commands import Commands
from pipeline.models.draws import BLOCK, move_block
from pipeline.models.law import GENERATOR, NUMBERS, STEP, Numbers, block

SIGNATURE = types.Tuple((float64, int64))(
    types.FunctionType(STEP),
    NUMBERS,
    VECTOR,
    ARM,
    DOMAIN,
    COMMANDS,
    FRAMES,
    types.FunctionType(SCHEME),
    float64,
    PARTICLES,
    RECORD,
    GENERATOR,
)


@inner
def propagate(
    law: object,
    numbers: Numbers,
    parameters: np.ndarray,
    arm: Arm,
    domain: Domain,
    commands: Commands,
    k: int,
    before: np.ndarray,
    q: np.ndarray,
    log_weights: np.ndarray,
    rng: np.random.Generator,
) -> tuple[int, int]:
    """Draw ``q`` (3, P) from the motion model given ``before`` under the commands of step ``k``;
    for how many the noise was clipped, and how many left D_q.

    A particle that leaves D_q loses its weight and waits where it was: the model is not asked about
    poses that the arm cannot take.
    """
    clipped = outside = 0
    count, v, target = q.shape[1], commands.v[k], commands.path[k]
    for start in range(0, count, BLOCK):
        stop = start + BLOCK if start + BLOCK < count else count
        here, there = block(before, start, stop), block(q, start, stop)
        clipped += move_block(
            law, numbers, parameters, arm, v, target, commands.share, here, there, rng
        )
        outside += keep_inside(domain, here, there, log_weights[start:stop])
    return clipped, outside


@inner
def keep_inside(domain: Domain, here: tuple, there: tuple, log_weights: np.ndarray) -> int:
    """Take the weight of the particles of a block that left D_q and put them back; how many of them
    had any.
    """
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


@compiled(SIGNATURE)
def sequential_importance_sampling(
    law: object,
    numbers: Numbers,
    parameters: np.ndarray,
    arm: Arm,
    domain: Domain,
    commands: Commands,
    frames: Frames,
    resample: object,
    threshold: float,
    particles: Particles,
    record: Record,
    rng: np.random.Generator,
) -> tuple[float, int]:
    """Fill ``record``; the log-evidence, and the step at which all weights vanished or −1.

    ``law`` moves the particles with ``parameters`` and ``numbers``, which have room for a block
    (:mod:`pipeline.models.law`). Below an effective sample size of ``threshold``·P particles
    ``resample`` chooses anew.
    """
    q, before, weights, log_weights, chosen, room = particles
    log_evidence = 0.0
    effective = make_equal(weights, log_weights)
    for k in range(len(commands.v) + 1):
        if k > 0:
            before, q = q, before
            record.clipped[k], record.outside[k] = propagate(
                law, numbers, parameters, arm, domain, commands, k - 1, before, q, log_weights, rng
            )
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
