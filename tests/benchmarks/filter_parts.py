"""The parts of the particle filter, each done alone for all steps of a take: what the filter's time
is made of, and the floor that it stands on.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import types
from scenario import DT, Take

from pipeline.arm.chain import PlanarChain
from pipeline.arm.compiled import ARM, sine_cosine
from pipeline.arm.numbers import Arm
from pipeline.core.compiled import MATRIX, VECTOR, compiled
from pipeline.filtering.particle_filter import due_frames, empty_record, started
from pipeline.filtering.resampling import SCHEME, systematic
from pipeline.filtering.sampling import keep_inside
from pipeline.filtering.start import domain_of
from pipeline.filtering.state import (
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
from pipeline.models.correction import correction
from pipeline.models.draws import BLOCK, draw, move_block, numbers_for
from pipeline.models.law import CORRECTION, NUMBERS, STEP, Numbers
from pipeline.randommatrix.words import WORDS, words_of

# of a measurement's precision, so that the weights stay alike however often they are weighed
FAINT = 1e-6


def numbers(take: Take, particles: int, rng: np.random.Generator) -> Callable[[], None]:
    """The random numbers of all steps by the project's own draws, block by block into the same
    scratch: the least that the law asks for.
    """
    chain = take.scene.chain
    room = numbers_for(take.scene.model.law(chain), chain)
    return lambda: draw_all(room, len(take.steps), particles, words_of(rng))


def circular_functions(take: Take, particles: int, rng: np.random.Generator) -> Callable[[], None]:
    """The sines and cosines of all joints, and the square roots of the law: two, and in space one
    for each row of the Jacobian beside them.
    """
    chain = take.scene.chain
    roots = 2 if isinstance(chain, PlanarChain) else 2 + len(chain.task)
    q, out = poses(take, particles, rng), np.empty(BLOCK)
    return lambda: turn_all(q, roots, len(take.steps), out)


def moves(take: Take, particles: int, rng: np.random.Generator) -> Callable[[], None]:
    """The particles moved: the random numbers, and the arithmetic."""
    chain, q = take.scene.chain, poses(take, particles, np.random.default_rng(1))
    law, arm, correct, moved = (
        take.scene.model.law(chain),
        chain.numbers(),
        correction(chain),
        np.empty_like(q),
    )
    room, commands = numbers_for(law, chain), take.steps
    return lambda: move_all(
        law.step, correct, room, law.parameters, arm, commands, q, moved, words_of(rng)
    )


def weights_and_moments(take: Take, particles: int, rng: np.random.Generator) -> Callable[[], None]:
    """The particles held against the limits and weighed by the measurements, and their moments."""
    steps, state = len(take.steps), started(poses(take, particles, rng).T)
    frames, _ = due_frames(take.measurements, steps, DT)
    frames = frames._replace(whitening=FAINT * frames.whitening)
    record, domain = empty_record(steps + 1, len(state.q)), domain_of(take.scene.chain)
    arm = take.scene.chain.numbers()
    return lambda: weigh_all(arm, domain, frames, state, record)


def resampling(take: Take, particles: int, rng: np.random.Generator) -> Callable[[], None]:
    """The particles chosen anew, as often as the filter does."""
    times = int(take.filtered(particles, np.random.default_rng(1)).resampled.sum())
    state, weights = started(poses(take, particles, rng).T), rng.dirichlet(np.ones(particles))
    return lambda: resample_all(systematic, weights, state, times, words_of(rng))


def whole(take: Take, particles: int, rng: np.random.Generator) -> Callable[[], None]:
    """The filter."""
    return lambda: take.filtered(particles, rng)


PARTS = {
    "numbers": numbers,
    "moves": moves,
    "weights and moments": weights_and_moments,
    "resampling": resampling,
    "filter": whole,
    "circular functions": circular_functions,
}


def poses(take: Take, particles: int, rng: np.random.Generator) -> np.ndarray:
    """(n, P) draws of the first pose."""
    start = take.scene.start
    return np.ascontiguousarray(rng.multivariate_normal(start.mean, start.covariance, particles).T)


@compiled(types.void(NUMBERS, types.int64, types.int64, WORDS))
def draw_all(room: Numbers, steps: int, particles: int, words: np.ndarray) -> None:
    """Fill ``room`` for every block of every step."""
    size = room.command.shape[1]
    for _ in range(steps):
        for start in range(0, particles, size):
            draw(room, min(size, particles - start), words)


@compiled(types.void(MATRIX, types.int64, types.int64, VECTOR))
def turn_all(q: np.ndarray, roots: int, steps: int, out: np.ndarray) -> None:
    """Fill ``out`` (BLOCK,) with what needs every sine and cosine of ``q`` (n, P) and as many
    ``roots``.
    """
    for _ in range(steps):
        for start in range(0, q.shape[1], BLOCK):
            count = min(BLOCK, q.shape[1] - start)
            for i in range(count):
                out[i] = 0.0
            for j in range(len(q)):
                angle = q[j, start : start + count]
                for i in range(count):
                    sine, cosine = sine_cosine(angle[i])
                    out[i] += sine * cosine
            for _ in range(roots):
                for i in range(count):
                    out[i] = np.sqrt(abs(out[i]))


@compiled(
    types.void(
        STEP,
        CORRECTION,
        NUMBERS,
        VECTOR,
        ARM,
        MATRIX,
        MATRIX,
        MATRIX,
        WORDS,
    )
)
def move_all(
    step: Callable,
    correct: Callable,
    room: Numbers,
    parameters: np.ndarray,
    arm: Arm,
    commands: np.ndarray,
    q: np.ndarray,
    moved: np.ndarray,
    words: np.ndarray,
) -> None:
    """Fill ``moved`` (n, P) from ``q`` (n, P) under every one of the ``commands``."""
    size, particles = room.command.shape[1], q.shape[1]
    for k in range(len(commands)):
        for start in range(0, particles, size):
            count = min(size, particles - start)
            v = commands[k]
            move_block(
                step, correct, room, parameters, arm, v, v, 0.0, q, moved, start, count, words
            )


@compiled(types.void(ARM, DOMAIN, FRAMES, PARTICLES, RECORD))
def weigh_all(arm: Arm, domain: Domain, frames: Frames, state: Particles, record: Record) -> None:
    """What the filter does with the particles of ``state`` between moving and resampling them."""
    q, before, weights, log_weights, _, room = state
    make_equal(weights, log_weights)
    for k in range(1, len(record.mean)):
        for start in range(0, len(weights), BLOCK):
            stop = min(start + BLOCK, len(weights))
            keep_inside(domain, before, q, start, stop, log_weights, room[0])
        for frame in range(frames.first[k], frames.first[k + 1]):
            weigh(arm, frames, frame, before, q, log_weights, room)
        if frames.first[k] < frames.first[k + 1]:
            normalise(log_weights, weights)
        weighted_moments(weights, q, record.mean[k], record.covariance[k], room)


@compiled(types.void(SCHEME, VECTOR, PARTICLES, types.int64, WORDS))
def resample_all(
    resample: Callable,
    chances: np.ndarray,
    state: Particles,
    times: int,
    words: np.ndarray,
) -> None:
    """Choose by ``chances`` (P,) and copy, as the filter does."""
    q, before, weights, log_weights, chosen, room = state
    for _ in range(times):
        resample(chances, chosen, room, words)
        for j in range(len(q)):
            here, there = q[j], before[j]
            for i in range(len(chosen)):
                there[i] = here[np.uint64(chosen[i])]
        make_equal(weights, log_weights)
