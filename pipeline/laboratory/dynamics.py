"""The synthetic arm in motion: many small disturbances of a position-controlled robot, none of them
a random Jacobian.

What moves is the true joint angle q(t). The servo follows the commanded angle with speed errors
proportional to speed; what the cameras see behind the gears is moved further by the end-effector's
swaying, by the clearance of joint 3 and by the timing of the exposure. All of it is bounded: a
position-controlled arm does not wander off.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.signal import lfilter
from scipy.special import ndtr

from pipeline.arm.chain import PlanarChain
from pipeline.laboratory.options import DynamicsOptions, TrajectoryOptions
from pipeline.laboratory.swing import desired_joints

LAGS = 4  # of a drive: position loop, velocity loop, current loop and the gear's elasticity
SETTLED = 30  # lags after which nothing is left of a start: four lags pass on 1e-9 of it


def lagged_noise(
    shape: tuple[int, ...], steps_per_lag: float, rng: np.random.Generator
) -> np.ndarray:
    """Stationary normal paths of variance 1 along the last axis: white noise through LAGS equal
    lags of first order, as a drive behind its servo loops passes it on. Velocity and acceleration
    exist.
    """
    denominator, response = _lags(steps_per_lag)
    noise = rng.standard_normal((*shape[:-1], len(response) + shape[-1]))
    passed_on = lfilter([1.0], denominator, noise, axis=-1)[..., len(response) :]
    return passed_on / np.linalg.norm(response)


def lagged_correlation(steps: np.ndarray, steps_per_lag: float) -> np.ndarray:
    """(...) correlation of :func:`lagged_noise` with itself so many ``steps`` (...) later, whole
    and not negative.
    """
    _, response = _lags(steps_per_lag)
    size = 2 * len(response)
    power = np.abs(np.fft.rfft(response, size)) ** 2
    correlation = np.append(np.fft.irfft(power, size)[: len(response)], 0.0)
    # beyond the response nothing is left
    return correlation[np.minimum(steps, len(response))] / correlation[0]


def _lags(steps_per_lag: float) -> tuple[np.ndarray, np.ndarray]:
    """The recursive filter's denominator, and its response to an impulse until that is settled."""
    denominator = np.poly(np.full(LAGS, np.exp(-1.0 / steps_per_lag)))
    impulse = np.zeros(int(np.ceil(SETTLED * steps_per_lag)))
    impulse[0] = 1.0
    return denominator, lfilter([1.0], denominator, impulse)


def servo_times(trajectory: TrajectoryOptions, options: DynamicsOptions) -> np.ndarray:
    """(N,) times of the servo's steps in s on the motion clock: a little before and after the
    motion, so that early and late exposures see it too.
    """
    dt = 1.0 / options.rate
    return np.arange(-50, round(trajectory.duration * options.rate) + 51) * dt


def sway_share(chain: PlanarChain, speed: np.ndarray, options: DynamicsOptions) -> np.ndarray:
    """(N,) share of the sway that there is at joint speeds ``speed`` (N, n) in rad/s."""
    pace = (
        np.linalg.norm(speed, axis=1) / np.linalg.norm(chain.max_speed)
    ) ** options.speed_exponent
    return options.sway_rest + (1 - options.sway_rest) * pace


def play_share(speed: np.ndarray, options: DynamicsOptions) -> np.ndarray:
    """(N,) share of the play that joint 3 fills at joint speeds ``speed`` (N, n) in rad/s."""
    return np.minimum(1.0, np.abs(speed[:, 2] / options.rattle_speed) ** options.speed_exponent)


def true_chain(
    nominal: PlanarChain, options: DynamicsOptions, rng: np.random.Generator
) -> PlanarChain:
    """The arm as it was built: the nominal chain with its session's errors of link length."""
    lengths = nominal.lengths
    return replace(
        nominal,
        links=nominal.links
        * ((lengths + options.length_std * rng.standard_normal(3)) / lengths)[:, None],
    )


def session_offset(options: DynamicsOptions, rng: np.random.Generator) -> np.ndarray:
    """(3,) zero errors of the encoders in rad, constant through a session."""
    return options.encoder_offset_std * rng.standard_normal(3)


def simulate_take(
    chain: PlanarChain,
    offset: np.ndarray,
    trajectory: TrajectoryOptions,
    options: DynamicsOptions,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """One take: times (N,) in s on the motion clock and true joint angles (N, 3) in rad, at
    ``options.rate``.

    ``chain`` is the true chain, ``offset`` (3,) the session's encoder zeros in rad.
    """
    dt = 1.0 / options.rate
    t = servo_times(trajectory, options)
    goal, speed = desired_joints(np.clip(t, 0.0, trajectory.duration), trajectory)
    gain = (
        1
        + options.speed_error_std * lagged_noise((3, t.size), options.speed_error_time / dt, rng).T
    )
    ripple = options.encoder_ripple * np.sin(goal + rng.uniform(0, 2 * np.pi, 3))
    q = np.empty_like(goal)
    q[0] = goal[0] + options.start_std * rng.standard_normal(3)
    for i in range(t.size - 1):
        q[i + 1] = q[i] + dt * gain[i] * (speed[i] + options.servo_gain * (goal[i] - q[i]))
    sway = lagged_noise((3, t.size), options.sway_time / dt, rng).T * options.sway_std
    sway *= sway_share(chain, speed, options)[:, None]
    q = (
        q
        + offset
        + ripple
        + np.einsum("tij,tj->ti", chain.inverse_jacobian(q, what="time of the laboratory"), sway)
    )
    play = 2 * ndtr(lagged_noise((t.size,), options.clearance_time / dt, rng)) - 1
    q[:, 2] += options.clearance * play * play_share(speed, options)
    return t, q


def expose(
    t: np.ndarray, q: np.ndarray, at: np.ndarray, options: DynamicsOptions, rng: np.random.Generator
) -> np.ndarray:
    """(K, 3) true joint angles in rad at the instants ``at`` (K,) in s, each missed by the jitter
    of its exposure.
    """
    instants = np.clip(at + options.jitter_std * rng.standard_normal(at.shape), t[0], t[-1])
    return np.stack([np.interp(instants, t, q[:, j]) for j in range(3)], axis=-1)
