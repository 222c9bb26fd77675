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


def _ornstein_uhlenbeck(
    shape: tuple[int, ...], steps_per_time: float, rng: np.random.Generator
) -> np.ndarray:
    """Stationary unit-variance Ornstein–Uhlenbeck paths along the last axis, exact on the grid."""
    keep = np.exp(-1.0 / steps_per_time)
    noise = rng.standard_normal(shape)
    noise[..., 1:] *= np.sqrt(1 - keep**2)
    return lfilter([1.0], [1.0, -keep], noise, axis=-1)


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
    # a little before and after the motion, so that early and late exposures see it too
    t = np.arange(-50, round(trajectory.duration * options.rate) + 51) * dt
    goal, speed = desired_joints(np.clip(t, 0.0, trajectory.duration), trajectory)
    gain = (
        1
        + options.speed_error_std
        * _ornstein_uhlenbeck((3, t.size), options.speed_error_time / dt, rng).T
    )
    ripple = options.encoder_ripple * np.sin(goal + rng.uniform(0, 2 * np.pi, 3))
    q = np.empty_like(goal)
    q[0] = goal[0] + options.start_std * rng.standard_normal(3)
    for i in range(t.size - 1):
        q[i + 1] = q[i] + dt * gain[i] * (speed[i] + options.servo_gain * (goal[i] - q[i]))
    pace = (
        np.linalg.norm(speed, axis=1) / np.linalg.norm(chain.max_speed)
    ) ** options.speed_exponent
    sway = np.zeros_like(q)
    sway[:, :2] = _ornstein_uhlenbeck((2, t.size), options.sway_time / dt, rng).T * options.sway_std
    sway *= (options.sway_rest + (1 - options.sway_rest) * pace)[:, None]
    q = (
        q
        + offset
        + ripple
        + np.einsum("tij,tj->ti", chain.inverse_jacobian(q, what="time of the laboratory"), sway)
    )
    play = 2 * ndtr(_ornstein_uhlenbeck((t.size,), options.clearance_time / dt, rng)) - 1
    q[:, 2] += (
        options.clearance
        * play
        * np.minimum(1.0, np.abs(speed[:, 2] / options.rattle_speed) ** options.speed_exponent)
    )
    return t, q


def expose(
    t: np.ndarray, q: np.ndarray, at: np.ndarray, options: DynamicsOptions, rng: np.random.Generator
) -> np.ndarray:
    """(K, 3) true joint angles in rad at the instants ``at`` (K,) in s, each missed by the jitter
    of its exposure.
    """
    instants = np.clip(at + options.jitter_std * rng.standard_normal(at.shape), t[0], t[-1])
    return np.stack([np.interp(instants, t, q[:, j]) for j in range(3)], axis=-1)
