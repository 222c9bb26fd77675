"""The second moments of what the laboratory's arm is off its mean path, of first order in its
disturbances (:mod:`pipeline.laboratory.dynamics` draws them).

With d_k = q(t_k) − E q(t_k) in rad

    Cov(d_k, d_l) = p_k p_l J_k⁻¹ diag(σ²) J_l⁻ᵀ ρ(t_k − t_l)          sway
                  + e_n e_nᵀ c_k c_l · (2/π) asin(ρ'(t_k − t_l)/2)      play, in rad ± c_k
                  + what the servo makes of its speed errors and of the start
                  + ripple²/2 · cos(goal_k − goal_l)                    by joint, of random phase

σ, p the sway and its share at the speed, ρ and ρ' the correlations of lagged noise. The play is
2Φ(g) − 1 of a normal g: uniform, of variance 1/3 and of the correlation (6/π) asin(ρ'/2).
"""

from typing import NamedTuple

import numpy as np
from scipy.signal import fftconvolve, lfilter

from pipeline.arm.interface import Chain
from pipeline.laboratory.dynamics import (
    desired_joints,
    lagged_correlation,
    play_share,
    servo_times,
    sway_share,
)
from pipeline.laboratory.options import DynamicsOptions, TrajectoryOptions

PLAY = -1  # the joint that has it


class Deviations(NamedTuple):
    """Second moments of the deviation on the motion grid k = 0 … M."""

    covariance: np.ndarray  # (M+1, n, M+1, n) rad², of the poses at t_k
    exposure: np.ndarray  # (M+1, n, n) rad², from the jitter of the exposure at the mean speed


def deviations(
    chain: Chain, trajectory: TrajectoryOptions, dynamics: DynamicsOptions, path: np.ndarray
) -> Deviations:
    """Return the moments about the mean ``path`` (M+1, n) in rad, where J is taken; raises
    SingularJacobianError.
    """
    t, n = servo_times(trajectory, dynamics), path.shape[-1]
    at = np.searchsorted(t, (np.arange(len(path)) - 0.25) / trajectory.rate)
    goal, speed = desired_joints(np.clip(t, 0.0, trajectory.duration), trajectory)
    apart = np.abs(at[:, None] - at)

    share = sway_share(chain, speed[at], dynamics)[:, None, None]
    sway = share * chain.inverse_jacobian(path, what="step of the mean path") * dynamics.sway_std
    correlation = lagged_correlation(apart, dynamics.sway_time * dynamics.rate)
    covariance = np.einsum("kia,lja,kl->kilj", sway, sway, correlation)

    play = dynamics.clearance * play_share(speed[at], dynamics)
    normal = lagged_correlation(apart, dynamics.clearance_time * dynamics.rate)
    covariance[:, PLAY, :, PLAY] += play[:, None] * play * (2 / np.pi) * np.arcsin(normal / 2)

    for j in range(n):
        servo = _servo(goal[:, j], speed[:, j], at, dynamics)
        phase = goal[at, None, j] - goal[at, j]
        covariance[:, j, :, j] += servo + dynamics.encoder_ripple**2 / 2 * np.cos(phase)

    speeds = np.gradient(path, 1 / trajectory.rate, axis=0)
    exposure = dynamics.jitter_std**2 * speeds[:, :, None] * speeds[:, None, :]
    return Deviations(covariance, exposure)


def _servo(
    goal: np.ndarray, speed: np.ndarray, at: np.ndarray, dynamics: DynamicsOptions
) -> np.ndarray:
    """(K, K) rad², covariance of a joint's angle at the servo's steps ``at`` (K,) from its speed
    errors and its start, of first order; ``goal`` and ``speed`` (N,) in rad and rad/s.

    Off its goal by e_i the servo goes e_{i+1} = (1 − gΔt)e_i + … + ε_i·Δt(speed_i + g(−ē_i)).
    """
    dt = 1 / dynamics.rate
    keep = 1 - dynamics.servo_gain * dt
    pushes = goal[:-1] + dt * speed[:-1] - goal[1:]
    off = np.append(0.0, lfilter([1.0], [1.0, -keep], pushes))
    passed = dynamics.speed_error_std * dt * (speed - dynamics.servo_gain * off)
    steps = np.arange(len(goal))
    since = at[:, None] - 1 - steps
    left = np.where(since >= 0, keep ** np.maximum(since, 0), 0.0) * passed
    correlation = lagged_correlation(steps, dynamics.speed_error_time * dynamics.rate)
    both = np.concatenate([correlation[:0:-1], correlation])[None]
    errors = fftconvolve(left, both, mode="full", axes=1)[:, len(goal) - 1 : 2 * len(goal) - 1]
    errors = errors @ left.T
    start = dynamics.start_std * keep**at
    return errors + start[:, None] * start
