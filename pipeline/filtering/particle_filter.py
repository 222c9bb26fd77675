"""Particle filter of the joint angles under a stochastic motion model (section "RMT-based particle
filtering"), for any arm and any measurement.

The motion model is the proposal (Doucet, de Freitas & Gordon 2001). The domain D_q of the state is
the set of regular poses within the joint limits. A particle that leaves D_q has weight zero, so the
posterior is conditioned on paths within D_q.
"""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray
from numpy.random import Generator

from pipeline.arm.chain import Chain
from pipeline.core import rng as streams
from pipeline.core.errors import DegenerateFilterError, ModelDomainError
from pipeline.core.options.analysis import Filter
from pipeline.filtering import sampling
from pipeline.filtering.measurement import Frames, Measurements
from pipeline.models.closed_loop import FOLDER, Loop
from pipeline.models.draws import compiled_arm
from pipeline.models.model import Commands, MotionModel, corrected_command
from pipeline.models.steps import Recorded


@dataclass(frozen=True)
class Start:
    """Normal law of the first pose, estimated from the training takes and restricted to D_q."""

    mean: ndarray  # (n,) rad
    covariance: ndarray  # (n, n) rad², singular allowed

    @classmethod
    def of_takes(cls, recorded: Recorded) -> "Start":
        """Return the law of the first measured pose of the takes of ``recorded``."""
        first = recorded.q[:, 0]
        return cls(first.mean(axis=0), np.cov(first.T))


@dataclass(frozen=True)
class Posterior:
    """Moments of p(q_k | y up to t_k) before resampling, Eq. (posterior-expectation); counts."""

    mean: ndarray  # (M+1, n) rad
    covariance: ndarray  # (M+1, n, n) rad², about the posterior mean
    ess: ndarray  # (M+1,) effective sample size
    resampled: ndarray  # (M+1,) bool: the step ended in resampling
    clipped: ndarray  # (M+1,) int: particles whose noise covariance the model clipped
    # (M+1,) int: particles that left D_q; at k = 0 rejected first poses
    outside: ndarray
    measured: ndarray  # (M+1,) bool: at least one measurement entered
    left_out: int  # measurements before the start or after the end of the motion


@dataclass(frozen=True)
class FilterTrial:
    """One take for the filter of a model in an open or a closed loop."""

    name: str  # of the model
    loop: Loop
    closed: bool
    measurements: Measurements
    number: int  # of the take
    start: Start
    options: Filter
    draw: int = 0  # number of the random numbers; 0 for the run's


def take_posterior(
    trial: FilterTrial,
    chain: Chain,
    rate: float,
    seed: int,
) -> Posterior:
    """Return the posterior of one take of a motion at ``rate`` steps per second. The random stream
    belongs to model, loop, draw and take.
    """
    stage = f"filter.{trial.name}"
    if trial.closed:
        stage += f".{FOLDER}"
    stream = streams.drawn_stream(seed, stage, trial.number, draw=trial.draw)
    return particle_filter(
        trial.loop.model,
        chain,
        trial.loop.commands,
        1 / rate,
        trial.start,
        trial.measurements,
        trial.options,
        stream,
    )


def particle_filter(
    model: MotionModel,
    chain: Chain,
    commands: Commands,
    dt: float,
    start: Start,
    measurements: Measurements,
    options: Filter,
    rng: Generator,
) -> Posterior:
    """Return the posterior of the joint angles of one take: Eq. (posterior-expectation) of q_k and
    of its squared deviation from the mean. ``commands`` are M steps of ``dt`` (s), in an open or a
    closed loop. Raises DegenerateFilterError where all weights vanish and ModelDomainError for a
    covariance that is not positive definite, with take and step.
    """
    frames = measurements.frames(len(commands.v), dt)
    take = measurements.take
    poses, rejected = initial_particles(start, chain, options.particles, rng, take)
    setting = _setting(chain, frames, options)
    q = np.array(poses.T, order="C")
    particles, record = sampling.fresh_arrays(*q.shape, len(commands.v) + 1)
    steps = setting, q, particles, record, rng
    if model.traits.compiled:
        v, path = (np.array(array, dtype=float, order="C") for array in commands[:2])
        loop = Commands(v, path, float(commands.share))
        arm = model.law(chain), *compiled_arm(chain)
        vanished = sampling.sequential_importance_sampling(*arm, loop, *steps)
    else:
        memory = None
        if model.traits.memory:
            memory = model.first_memory(poses, start.mean, rng)
        vanished = _filter_by_draws(model, chain, commands, memory, *steps)
    if vanished >= 0:
        raise DegenerateFilterError(
            f"all {options.particles} weights vanished: every particle has left the joint limits "
            "or is not finite; use more particles, or compare the model's noise and the start "
            "pose with the recording",
            take=take,
            step=vanished,
            time=round(vanished * dt, 6),
        )
    record.outside[0] = rejected
    left_out = len(measurements.t) - len(frames.share)
    return Posterior(*record, np.diff(frames.first) > 0, left_out)


def _setting(chain: Chain, frames: Frames, options: Filter) -> sampling.Setting:
    lower = np.array(chain.lower, dtype=float)
    upper = np.array(chain.upper, dtype=float)
    threshold = float(options.threshold)
    if options.scheme == "none":
        threshold = 0.0  # no effective sample size is below 0
    scheme = sampling.SCHEMES.index(options.scheme)
    return sampling.Setting((lower, upper), frames, scheme, threshold)


def _filter_by_draws(
    model: MotionModel,
    chain: Chain,
    commands: Commands,
    memory: ndarray | None,
    setting: sampling.Setting,
    q: ndarray,
    particles: sampling.Particles,
    record: sampling.Record,
    rng: Generator,
) -> int:
    """Return and fill what :func:`sequential_importance_sampling` does, by the ``model``'s draws in
    NumPy, from the ``memory`` (P, s) of the particles or None. Each step takes tens of times as
    long.
    """
    before = q.copy()
    for k in range(len(record.ess)):
        if k > 0:
            q, before = before, q
            memory = _move_by_draws(model, chain, commands, memory, k, before, q, rng)
        state = sampling.update(k, setting, before, q, particles, record, rng)
        if state == sampling.VANISHED:
            return k
        if state == sampling.RESAMPLED:
            before, q = q, before
            if memory is not None:
                memory = memory[particles.chosen]
    return -1


def _move_by_draws(
    model: MotionModel,
    chain: Chain,
    commands: Commands,
    memory: ndarray | None,
    k: int,
    before: ndarray,
    q: ndarray,
    rng: Generator,
) -> ndarray | None:
    """Fill ``q`` (n, P) with the poses of step ``k`` after ``before``, and return their memory. A
    pose after a singular pose is NaN; the memory stays where it would not be finite.
    """
    alive = ~chain.singular(before.T)
    poses = before.T[alive]
    v = commands.v[k - 1]
    v = np.broadcast_to(v, (len(poses), len(v)))
    if commands.share:
        target = commands.path[k - 1]
        v = corrected_command(chain, poses, v, target, commands.share)
    q[:] = np.nan
    if memory is None:
        q.T[alive] = model.sample(chain, poses, v, rng)
        return None
    q.T[alive], after = model.advance(chain, poses, v, memory[alive], rng)
    memory = memory.copy()
    memory[alive] = np.where(np.isfinite(after), after, memory[alive])
    return memory


def initial_particles(
    start: Start,
    chain: Chain,
    count: int,
    rng: Generator,
    take: str,
) -> tuple[ndarray, int]:
    """Return (count, n) draws in rad of the ``start`` within D_q, and the number of rejected draws.
    Raises ModelDomainError for a covariance that is not finite, and DegenerateFilterError where
    ``count`` consecutive draws lie outside D_q.
    """
    if not np.isfinite(start.covariance).all():
        message = "the covariance of the start poses is not finite"
        raise ModelDomainError(f"{message}; give two training takes", take=take)
    variances, axes = np.linalg.eigh(start.covariance)
    # rounding may turn the zero eigenvalues of a singular covariance negative
    root = axes * np.sqrt(np.maximum(variances, 0.0))
    poses = np.empty((0, len(variances)))
    rejected = 0
    while len(poses) < count:
        normals = rng.standard_normal((count, len(variances)))
        draws = start.mean + (root * normals[:, None]).sum(axis=-1)
        inside = draws[chain.within_limits(draws) & ~chain.singular(draws)]
        if len(inside) == 0:
            raise DegenerateFilterError(
                f"none of {count} start poses lies within the joint limits; compare the start of "
                "the training takes with the limits in the URDF",
                take=take,
                step=0,
                mean=start.mean.round(4).tolist(),
            )
        rejected += count - len(inside)
        poses = np.concatenate([poses, inside])[:count]
    return poses, rejected
