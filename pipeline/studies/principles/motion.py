"""What the laboratory's arm does, before any camera sees it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arm.chain import PlanarChain
from pipeline.laboratory.dynamics import expose, simulate_take
from pipeline.laboratory.options import DynamicsOptions, TrajectoryOptions
from pipeline.laboratory.swing import desired_joints, desired_trajectory
from pipeline.models.noise import mean_covariance, process_noise
from pipeline.recordings.commands import commanded_steps


@dataclass(frozen=True)
class Moved:
    """Takes of the arm alone."""

    covariance: np.ndarray  # (n, n) rad², Σ_ω
    deviation: np.ndarray  # (takes, M + 1, n) rad, of the poses from their mean over the takes
    t: np.ndarray  # (N,) s, of the servo's steps
    q: np.ndarray  # (takes, N, n) rad, at the servo's steps


def moved(
    chain: PlanarChain,
    motion: TrajectoryOptions,
    dynamics: DynamicsOptions,
    takes: int,
    rng: np.random.Generator,
) -> Moved:
    """``takes`` of the nominal arm with encoders that are right."""
    grid = np.arange(round(motion.duration * motion.rate) + 1) / motion.rate
    poses, paths = [], []
    for _ in range(takes):
        t, q, _ = simulate_take(chain, np.zeros(len(chain.lower)), motion, dynamics, rng)
        poses.append(expose(t, q, grid, dynamics, rng))
        paths.append(q)
    q = np.array(poses)
    v = commanded_steps(desired_trajectory(chain, motion), motion.rate)
    noise = process_noise(chain, q, v)
    return Moved(mean_covariance(noise), q - q.mean(axis=0), t, np.array(paths))


def correlations(covariance: np.ndarray) -> np.ndarray:
    """(n (n − 1)/2,) correlations 12, 13, …, 23, … of ``covariance`` (n, n)."""
    std = np.sqrt(np.diag(covariance))
    return (covariance / np.outer(std, std))[np.triu_indices(len(std), 1)]


def lasting(deviation: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """(K, n) correlation of the ``deviation`` (takes, M + 1, n) with itself ``steps`` (K,) later,
    over takes and times.
    """
    power = np.mean(deviation**2, axis=(0, 1))
    return np.array(
        [
            np.mean(deviation[:, k:] * deviation[:, : len(deviation[0]) - k], axis=(0, 1)) / power
            for k in steps
        ]
    )


def driven(motion: TrajectoryOptions, arm: Moved, every: int) -> tuple[np.ndarray, np.ndarray]:
    """Times (K,) in s of every so many of the steps at full speed, and the joint angles, speeds and
    accelerations (3, takes, K, n) then, in rad, rad/s and rad/s².
    """
    dt = arm.t[1] - arm.t[0]
    speed = np.gradient(arm.q, dt, axis=1)
    acceleration = np.gradient(speed, dt, axis=1)
    _, commanded = desired_joints(np.clip(arm.t, 0.0, motion.duration), motion)
    pace = np.linalg.norm(commanded, axis=1)
    full = np.flatnonzero(pace > 0.99 * pace.max())[::every]
    return arm.t[full], np.stack([arm.q, speed, acceleration])[:, :, full]
