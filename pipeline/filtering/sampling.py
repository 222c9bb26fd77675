"""Sequential importance sampling with resampling, compiled: the loop over the steps of one take is
the last function.

Each step goes through the particles in blocks that stay in the processor's nearest cache: a block
is moved by the model's law and held against D_q while it is there. Joint angles are kept as (n, P),
so that neighbours in memory are the same joint of neighbouring particles and the compiler computes
four at once. It neither reorders nor fuses operations by itself: the results are the same on every
processor.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import float64, int64, types

from pipeline.arm.compiled import ARM
from pipeline.arm.numbers import Arm
from pipeline.core.borrowed import borrowed
from pipeline.core.compiled import VECTOR, compiled, inner
from pipeline.filtering.resampling import SCHEME
from pipeline.filtering.start import mark_outside
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
from pipeline.filtering.weights import WEIGHING, make_equal, normalise, weighted_moments
from pipeline.models.commands import Commands
from pipeline.models.draws import move_block
from pipeline.models.law import CORRECTION, NUMBERS, STEP, Numbers
from pipeline.randommatrix.words import WORDS

SIGNATURE = types.Tuple((float64, int64))(
    STEP,
    CORRECTION,
    NUMBERS,
    VECTOR,
    ARM,
    DOMAIN,
    COMMANDS,
    FRAMES,
    WEIGHING,
    SCHEME,
    float64,
    PARTICLES,
    RECORD,
    WORDS,
)


@inner
def propagate(
    law: Callable,
    correct: Callable,
    numbers: Numbers,
    parameters: np.ndarray,
    arm: Arm,
    domain: Domain,
    commands: Commands,
    k: int,
    before: np.ndarray,
    q: np.ndarray,
    log_weights: np.ndarray,
    room: np.ndarray,
    words: np.ndarray,
) -> tuple[int, int]:
    """Draw ``q`` (n, P) from the motion model given ``before`` under the commands of step ``k``;
    for how many the noise was clipped, and how many left D_q. ``room`` (P,) is scratch.

    A particle that leaves D_q loses its weight and waits where it was: the model is not asked about
    poses that the arm cannot take.
    """
    clipped = outside = 0
    poses, size = q.shape[1], numbers.command.shape[1]
    v, target = commands.v[k], commands.path[k]
    for start in range(0, poses, size):
        count = size if start + size < poses else poses - start
        clipped += move_block(
            law,
            correct,
            numbers,
            parameters,
            arm,
            v,
            target,
            commands.share,
            before,
            q,
            start,
            count,
            words,
        )
        outside += keep_inside(domain, before, q, start, start + count, log_weights, room)
    return clipped, outside


@inner
def keep_inside(
    domain: Domain,
    before: np.ndarray,
    q: np.ndarray,
    start: int,
    stop: int,
    log_weights: np.ndarray,
    room: np.ndarray,
) -> int:
    """Take the weight of the particles ``start`` to ``stop`` of ``q`` (n, P) that left D_q and put
    them back to where they were ``before``; how many of them had any. ``room`` (P,) is scratch.
    """
    if not mark_outside(domain, q, start, stop, room):
        return 0
    lost = 0
    for i in range(start, stop):
        if room[i] > 0.0:
            lost += log_weights[i] > -np.inf
            log_weights[i] = -np.inf
            for j in range(len(q)):
                q[j, i] = before[j, i]
    return lost


@compiled(SIGNATURE)
def sequential_importance_sampling(
    law: Callable,
    correct: Callable,
    numbers: Numbers,
    parameters: np.ndarray,
    arm: Arm,
    domain: Domain,
    commands: Commands,
    frames: Frames,
    weigh: Callable,
    resample: Callable,
    threshold: float,
    particles: Particles,
    record: Record,
    words: np.ndarray,
) -> tuple[float, int]:
    """Fill ``record``; the log-evidence, and the step at which all weights vanished or −1.

    ``law`` moves the particles with ``parameters`` and ``numbers``, which have room for a block
    (:mod:`pipeline.models.law`), ``correct`` closes their loop
    (:mod:`pipeline.models.correction`), ``weigh`` holds them against ``frames``. Below an effective
    sample size of ``threshold``·P particles ``resample`` chooses anew, from ``words`` (4,).
    """
    numbers, parameters, arm, domain = borrowed((numbers, parameters, arm, domain))
    commands, frames, record, words = borrowed((commands, frames, record, words))
    q, before, weights, log_weights, chosen, room = borrowed(particles)
    log_evidence = 0.0
    effective = make_equal(weights, log_weights)
    for k in range(len(commands.v) + 1):
        if k > 0:
            before, q = q, before
            record.clipped[k], record.outside[k] = propagate(
                law,
                correct,
                numbers,
                parameters,
                arm,
                domain,
                commands,
                k - 1,
                before,
                q,
                log_weights,
                room[0],
                words,
            )
        for frame in range(frames.first[k], frames.first[k + 1]):
            weigh(arm, frames, frame, before, q, log_weights, room)
        if record.outside[k] > 0 or frames.first[k] < frames.first[k + 1]:
            effective, log_total = normalise(log_weights, weights)
            if not np.isfinite(log_total):
                return log_evidence, k
            log_evidence += log_total

        weighted_moments(weights, q, record.mean[k], record.covariance[k], room)
        record.ess[k] = effective
        if effective < threshold * len(weights):
            resample(weights, chosen, room, words)
            for j in range(len(q)):
                here, there = q[j], before[j]
                for i in range(len(chosen)):
                    there[i] = here[np.uint64(chosen[i])]  # unsigned, as no index is below zero
            before, q = q, before
            effective, record.resampled[k] = make_equal(weights, log_weights), True
    return log_evidence, -1
