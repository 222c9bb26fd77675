"""Synthetic arm: command, motion and takes of one session.

The position-controlled robot has many small disturbances, but no random Jacobian: speed errors of
the servo, sway of the end-effector, clearance of one joint, and jitter of the exposure times.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.random import Generator
from scipy.special import ndtr

from pipeline.arm.chain import Chain, PlanarChain
from pipeline.arm.interface import trajectory_table
from pipeline.core.errors import ConfigError
from pipeline.laboratory.options import (
    ClockOptions,
    DynamicsOptions,
    EncoderOptions,
    TrajectoryOptions,
)

LAGS = 4  # first-order lags of a drive: position, velocity, current loop and gear elasticity
SETTLED = 30  # duration of the response in time constants; the rest is below 1e-9
ROUNDING = 1e-9  # relative rounding error of a step at the speed limit


@dataclass(frozen=True)
class JointPath:
    """Joint angles ``joints`` (M+1, n) in rad at ``rate`` (Hz), with the monotone cubic interpolant
    of Fritsch and Butland (SIAM J. Sci. Stat. Comput. 5, 1984), which does not overshoot.
    """

    joints: np.ndarray
    rate: float

    @property
    def duration(self) -> float:
        """Time in s from the first pose to the last."""
        return (len(self.joints) - 1) / self.rate

    @cached_property
    def interpolant(self) -> Callable[..., np.ndarray]:
        """Function (times (...) in s, order) → angles (..., n) or their derivatives."""
        from scipy.interpolate import PchipInterpolator

        times = np.arange(len(self.joints)) / self.rate
        return PchipInterpolator(times, self.joints)

    def require_followable(self, chain: Chain) -> None:
        """Raise ConfigError, with the first step beyond the limits of ``chain``."""
        speed = np.diff(self.joints, axis=0) * self.rate
        _require_followable(chain, self.joints, speed, "the joint path")


Commanded = TrajectoryOptions | JointPath


def _require_followable(
    chain: Chain,
    q: np.ndarray,
    speed: np.ndarray,
    motion: str,
) -> None:
    greatest = (1 + ROUNDING) * chain.max_speed
    slow = np.all(np.abs(speed) <= greatest, axis=1)
    lower = chain.lower
    upper = chain.upper
    fastest = chain.max_speed
    for fits, fault in (
        (chain.within_limits(q), f"leaves the joint limits {lower} to {upper} rad"),
        (slow, f"is faster than the joints' limits {fastest} rad/s; allow more time"),
    ):
        if not fits.all():
            raise ConfigError(f"{motion} {fault}", step=int(np.argmin(fits)))


def desired_joints(t: np.ndarray, motion: Commanded) -> tuple[np.ndarray, np.ndarray]:
    """Return commanded joint angles (..., n) in rad and speeds (..., n) in rad/s at times ``t``
    (...) in s. Out and back, the speed rises and falls as a raised cosine and is constant between.
    """
    if isinstance(motion, JointPath):
        return motion.interpolant(t), motion.interpolant(t, 1)
    progress, rate = _out_and_back(np.asarray(t, dtype=float), motion)
    folded = np.asarray(motion.folded)
    stroke = np.asarray(motion.extended) - folded
    angles = folded + progress[..., None] * stroke
    return angles, rate[..., None] * stroke


def _out_and_back(
    t: np.ndarray,
    motion: TrajectoryOptions,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the share of the stroke at times ``t`` (...) in s, and its rate in 1/s."""
    half = motion.duration / 2
    ramp = motion.ramp
    moving = half - 2 * motion.rest
    peak = 1.0 / (moving - ramp)

    # time since the start of one way, to the nearer end of it, and within the ramp
    from_rest = np.minimum(t, motion.duration - t) - motion.rest
    s = np.clip(from_rest, 0.0, moving)
    back = np.minimum(s, moving - s)
    inside = np.minimum(back, ramp)

    phase = np.pi * inside / ramp
    speed = peak * (1 - np.cos(phase)) / 2
    accelerated = (inside - ramp / np.pi * np.sin(phase)) / 2
    way = peak * (accelerated + back - inside)
    progress = np.where(s <= moving / 2, way, 1.0 - way)
    return progress, np.where(t <= half, speed, -speed)


def desired_path(chain: Chain, options: TrajectoryOptions) -> np.ndarray:
    """Return commanded angles (M+1, n) in rad; ConfigError for angles beyond the joints' limits."""
    key = "laboratory.trajectory"
    if len(options.folded) != len(chain.lower):
        message = f"folded and extended must have {len(chain.lower)} angles each"
        raise ConfigError(f"{key}: {message}")
    q, speed = desired_joints(motion_grid(options), options)
    _require_followable(chain, q, speed, f"{key}: the motion")
    return q


def motion_grid(options: TrajectoryOptions) -> np.ndarray:
    """Return the times (M+1,) in s of the steps of the motion."""
    steps = round(options.duration * options.rate)
    return np.arange(steps + 1) / options.rate


def desired_trajectory(chain: Chain, options: TrajectoryOptions) -> pd.DataFrame:
    """Return the commanded trajectory: columns k, t, poses x and velocities v, in SI units."""
    return trajectory_table(chain, desired_path(chain, options), options.rate)


def lagged_noise(
    shape: tuple[int, ...],
    steps_per_lag: float,
    rng: Generator,
) -> np.ndarray:
    """Draw stationary normal paths of variance 1 along the last axis: white noise behind LAGS."""
    from scipy.signal import lfilter

    poles = np.full(LAGS, np.exp(-1.0 / steps_per_lag))
    denominator = np.poly(poles)
    settled = int(np.ceil(SETTLED * steps_per_lag))
    impulse = np.eye(1, settled)[0]
    response = lfilter([1.0], denominator, impulse)
    *paths, steps = shape
    noise = rng.standard_normal((*paths, settled + steps))
    passed_on = lfilter([1.0], denominator, noise, axis=-1)
    return passed_on[..., settled:] / np.linalg.norm(response)


def servo_times(motion: Commanded, options: DynamicsOptions) -> np.ndarray:
    """Return the servo's times (N,) in s, from 50 servo steps before to 50 after the motion."""
    steps = round(motion.duration * options.rate)
    return np.arange(-50, steps + 51) * (1.0 / options.rate)


def true_chain(nominal: Chain, options: DynamicsOptions, rng: Generator) -> Chain:
    """Draw the true arm, with errors of link lengths; ConfigError for options of another arm."""
    number = len(nominal.lower)
    if len(options.sway_std) != len(nominal.task) or options.play_joint > number:
        raise ConfigError(
            f"sway_std must have an entry for each of {', '.join(nominal.task)}, got "
            f"{options.sway_std}, and play_joint must lie between 1 and {number}, got "
            f"{options.play_joint}",
            key="laboratory.dynamics",
        )
    planar = isinstance(nominal, PlanarChain)
    if planar:
        links = nominal.links
        lengths = nominal.lengths
    else:
        links = nominal.placements[1:, 9:]
        lengths = np.linalg.norm(links, axis=1)
    built = lengths + options.length_std * rng.standard_normal(len(links))
    # links of length 0 (between intersecting axes) keep their length
    ratio = np.divide(built, lengths, out=np.ones_like(lengths), where=lengths > 0)
    if planar:
        return replace(nominal, links=links * ratio[:, None])
    placements = nominal.placements.copy()
    placements[1:, 9:] *= ratio[:, None]
    return replace(nominal, placements=placements)


class Chance(NamedTuple):
    """Random variates of a take, or of many along leading axes; paths are :func:`lagged_noise`."""

    gain: np.ndarray  # (..., N, n) paths of the speed errors
    phase: np.ndarray  # (..., n) rad, phase of the encoders' ripple
    start: np.ndarray  # (..., n) standard normal, error of the start pose
    sway: np.ndarray  # (..., N, m) paths of the sway by task coordinate
    play: np.ndarray  # (..., N) path of the joint with play


def draw(
    chain: Chain,
    motion: Commanded,
    options: DynamicsOptions,
    rng: Generator,
) -> Chance:
    """Draw the variates of one take, which depend on ``motion`` only by its duration."""
    n = len(chain.lower)
    m = len(chain.task)
    rate = options.rate
    steps = len(servo_times(motion, options))
    return Chance(
        gain=lagged_noise((n, steps), options.speed_error_time * rate, rng).T,
        phase=rng.uniform(0, 2 * np.pi, n),
        start=rng.standard_normal(n),
        sway=lagged_noise((m, steps), options.sway_time * rate, rng).T,
        play=lagged_noise((steps,), options.clearance_time * rate, rng),
    )


class Swing(NamedTuple):
    """One take of the arm at N servo steps, or many along leading axes (...)."""

    t: np.ndarray  # (N,) s on the motion clock
    q: np.ndarray  # (..., N, n) rad, true joint angles
    # (..., N, n) rad, angles at the motors, before gears and encoder errors
    servo: np.ndarray


def swing(
    chain: Chain,
    offset: np.ndarray,
    motion: Commanded,
    options: DynamicsOptions,
    chance: Chance,
) -> Swing:
    """Return the takes of ``motion`` by the true ``chain`` with the variates ``chance``."""
    t = servo_times(motion, options)
    goal, speed = desired_joints(np.clip(t, 0.0, motion.duration), motion)
    servo = _servo_angles(chain, goal, speed, options, chance)

    pace = np.linalg.norm(speed, axis=1) / np.linalg.norm(chain.max_speed)
    in_motion = pace**options.speed_exponent
    share = options.sway_rest + (1 - options.sway_rest) * in_motion
    sway = chance.sway * options.sway_std
    sway *= share[:, None]

    inverse = chain.inverse_jacobian(servo, what="time of the laboratory")
    phase = chance.phase[..., None, :]
    ripple = options.encoder_ripple * np.sin(goal + phase)
    swayed = np.einsum("...ij,...j->...i", inverse, sway)
    q = servo + offset + ripple + swayed

    play = 2 * ndtr(chance.play) - 1
    joint = options.play_joint - 1
    rattle = np.abs(speed[:, joint] / options.rattle_speed)
    filled = np.minimum(1.0, rattle**options.speed_exponent)
    q[..., joint] += options.clearance * play * filled
    return Swing(t, q, servo)


def _servo_angles(
    chain: Chain,
    goal: np.ndarray,
    speed: np.ndarray,
    options: DynamicsOptions,
    chance: Chance,
) -> np.ndarray:
    """Return the angles (..., N, n) rad at the motors of a proportional servo with feed-forward
    that follows ``goal`` (N, n) rad and ``speed`` (N, n) rad/s.
    """
    dt = 1.0 / options.rate
    gain = 1 + options.speed_error_std * chance.gain
    servo = np.empty_like(gain)
    servo[..., 0, :] = goal[0] + options.start_std * chance.start
    for i in range(len(goal) - 1):
        now = servo[..., i, :]
        wanted = speed[i] + options.servo_gain * (goal[i] - now)
        turning = gain[..., i, :] * wanted
        turned = np.clip(turning, -chain.max_speed, chain.max_speed)
        servo[..., i + 1, :] = now + dt * turned
    return servo


def expose(
    t: np.ndarray,
    q: np.ndarray,
    at: np.ndarray,
    options: DynamicsOptions,
    rng: Generator,
) -> np.ndarray:
    """Return true joint angles (K, n) rad at the times ``at`` (K,) s plus random jitter."""
    jitter = options.jitter_std * rng.standard_normal(at.shape)
    exposed = np.clip(at + jitter, t[0], t[-1])
    return joints_at(exposed, t, q)


def joints_at(instants: np.ndarray, t: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return ``q`` (N, n) rad, given at ``t`` (N,) s, interpolated at ``instants`` (K,): (K, n)."""
    joints = [np.interp(instants, t, joint) for joint in q.T]
    return np.stack(joints, axis=-1)


class Session(NamedTuple):
    """True arm and zeros of the encoders, constant during a session."""

    chain: Chain  # true arm
    encoder: np.ndarray  # (n,) rad, errors of the encoders' zeros


def open_session(nominal: Chain, options: DynamicsOptions, rng: Generator) -> Session:
    """Draw the arm and the encoders' zeros; ConfigError for options of another arm."""
    built = true_chain(nominal, options, rng)
    zeros = options.encoder_offset_std * rng.standard_normal(len(nominal.lower))
    return Session(built, zeros)


class PerformedMotion(NamedTuple):
    """One take of a session, and joint angles at the times of the motion grid."""

    swing: Swing
    motion_capture: np.ndarray  # (M+1, n) rad, at the exposures of the motion capture
    truth: np.ndarray  # (M+1, n) rad, at the exact times of the motion grid


def perform(
    session: Session,
    trajectory: TrajectoryOptions,
    options: DynamicsOptions,
    rng: Generator,
) -> PerformedMotion:
    """Draw one take of the trajectory and the exposures of the motion capture."""
    chance = draw(session.chain, trajectory, options, rng)
    take = swing(session.chain, session.encoder, trajectory, options, chance)
    grid = motion_grid(trajectory)
    watched = expose(take.t, take.q, grid, options, rng)
    return PerformedMotion(take, watched, joints_at(grid, take.t, take.q))


class DepthFrames(NamedTuple):
    """Exposures of a depth camera during a take, and the joint angles at the exposures."""

    exposed: np.ndarray  # (F,) s on the motion clock
    times: np.ndarray  # (F,) s on the camera's clock
    joints: np.ndarray  # (F, n) rad, at the exposures
    clock_offset: float  # s, camera's clock minus motion clock at the start


def depth_frames(
    take: Swing,
    duration: float,
    clock: ClockOptions,
    rng: Generator,
) -> DepthFrames:
    """Draw the frames of a take of ``duration`` s."""
    number = int(duration * clock.rate) + 1
    frames = np.arange(number) / clock.rate
    jitter = clock.jitter_std * rng.standard_normal(frames.shape)
    exposed = np.clip(frames + jitter, 0.0, duration)
    offset = clock.offset + clock.offset_std * rng.standard_normal()
    times = exposed * (1 + clock.drift) + offset
    return DepthFrames(exposed, times, joints_at(exposed, take.t, take.q), offset)


def log_joints(
    take: Swing,
    trajectory: TrajectoryOptions,
    encoders: EncoderOptions,
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return times (N,) in s on the motion clock and the signals ``target`` and ``actual``, each
    (N, n) in rad. The encoders measure the motors' angles, rounded to the encoders' resolution,
    without errors of the zeros and motion behind the gears.
    """
    rows = int(trajectory.duration * encoders.rate) + 1
    t = np.arange(rows) / encoders.rate
    target, _ = desired_joints(t, trajectory)
    motors = joints_at(t, take.t, take.servo)
    counts = np.round(motors / encoders.resolution)
    return t, {"target": target, "actual": counts * encoders.resolution}
