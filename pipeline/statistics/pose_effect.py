"""Exponent of a pose quantity in the size of a joint's noise, after the joint speed.

    ln s²_w = α_j + 2β ln|q̇_w| + 2γ ln x_w + ε_w,

s²_w is the mean square of the noise of joint j over a window w of WINDOW moving steps and x a
quantity of the pose, such as ‖J⁺‖. γ is 1 if the size of the noise is proportional to x at equal
speed, and 0 if it depends on the speed alone. Steps are not independent: intervals are of the
jackknife over motions, or over blocks of a single motion.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy import ndarray
from numpy.random import Generator
from scipy.special import ndtri

from pipeline.statistics.curves import POWER
from pipeline.statistics.takes import Difference, jackknife_counts, jackknife_difference

# name of a pose quantity in the table pose_effect
NORM = "norm of the inverse Jacobian"
# parts of the noise
ALL = "all"
DIFFERING = "differing"
REPEATED = "repeated"
WINDOW = 10  # steps
BLOCKS = 8  # of a single motion
MOVING = 0.05  # share of the joint's greatest speed below which a step does not count
LEAST_WINDOWS = 20
DRAWS = 200
DETECTED = 0.975  # of the normal law, two-sided at 5 %


class PoseEffect(NamedTuple):
    """Exponent γ with its interval, and the power to tell γ = 1 from 0."""

    exponent: Difference
    power: float
    windows: int
    groups: int
    spread: float  # standard deviation of ln x that the speed does not explain
    needed: float  # the same, at which γ = 1 would be told from 0 with the power POWER


def windows_of(motions: Sequence[tuple[ndarray, ndarray, ndarray]]) -> ndarray:
    """Return the windows (5, W) of all joints: number of the motion or block, number of the joint,
    ln s², ln|q̇|² and ln x². ``motions`` have noise (M, n) in rad, commanded steps (M, n) in rad
    and the pose quantity x ≥ 0 (M, n); x = 0 at rest.
    """
    speeds = [np.abs(dq).max(axis=0, initial=0.0) for _, dq, _ in motions]
    fastest = np.max(speeds, axis=0)
    rows = []
    for number, motion in enumerate(motions):
        for j in np.flatnonzero(fastest > 0):
            of_joint = [values[:, j] for values in motion]
            windows = _moving_windows(*of_joint, MOVING * fastest[j])
            for start, logs in windows:
                group = number
                if len(motions) == 1:
                    group = BLOCKS * start // len(motion[0])
                rows.append((group, j, *logs))
    return np.array(rows, dtype=float).reshape(-1, 5).T


def _moving_windows(
    noise: ndarray,
    steps: ndarray,
    x: ndarray,
    least_step: float,
) -> Iterator[tuple[int, ndarray]]:
    """Yield the first step of each window of WINDOW moving steps of a joint, and ln of its mean
    squares of ``noise``, ``steps`` and the pose quantity ``x`` (M,) > 0.
    """
    moving = np.flatnonzero(np.abs(steps) > least_step)
    for window in np.array_split(moving, max(len(moving) // WINDOW, 1)):
        if len(window) != WINDOW or not x[window].all():
            continue
        squares = [np.mean(values[window] ** 2) for values in (noise, steps, x)]
        # exact zeros of quantised angles
        if squares[0] > 0:
            yield window[0], np.log(squares)


def pose_effect(windows: ndarray, rng: Generator) -> PoseEffect | None:
    """Return the effect of the pose, or None for too few windows or a pose quantity that the speed
    determines. The power is the share of DRAWS of a true γ = 1, with the residuals of the windows
    in their order and shifted within the groups, whose interval lies above 0.
    """
    group, joint, size, speed, pose = windows
    groups = np.unique(group)
    if len(size) < LEAST_WINDOWS or len(groups) < 3:
        return None
    weights = jackknife_counts(len(groups))[:, np.searchsorted(groups, group)]
    of_joint = joint[:, None] == np.unique(joint)
    design = np.column_stack([of_joint, speed, pose]).astype(float)
    if np.linalg.matrix_rank(design) < design.shape[1]:
        return None

    def exponents(size: ndarray) -> ndarray:
        return np.array([_slopes(design, size, row)[-1] for row in weights])

    residuals = size - design @ _slopes(design, size, weights[0])
    detected = 0
    for _ in range(DRAWS):
        drawn = _shifted_residuals(residuals, group, rng)
        detected += jackknife_difference(exponents(pose + drawn)).low > 0

    without_pose = design[:, :-1]
    by_speed = np.linalg.lstsq(without_pose, pose, rcond=None)[0]
    unexplained = pose - without_pose @ by_speed
    spread = float(unexplained.std()) / 2
    effect = jackknife_difference(exponents(size))
    error = (effect.high - effect.low) / (2 * ndtri(DETECTED))
    return PoseEffect(
        exponent=effect,
        power=detected / DRAWS,
        windows=len(size),
        groups=len(groups),
        spread=spread,
        needed=float(spread * error * (ndtri(DETECTED) + ndtri(POWER))),
    )


def _shifted_residuals(residuals: ndarray, group: ndarray, rng: Generator) -> ndarray:
    """Return the ``residuals`` (W,) in their order, shifted and with one sign in each group."""
    shifted = np.empty_like(residuals)
    for name in np.unique(group):
        member = group == name
        shifted[member] = np.roll(residuals[member], rng.integers(member.sum()))
        shifted[member] *= rng.choice([-1.0, 1.0])
    return shifted


def _slopes(design: ndarray, size: ndarray, weights: ndarray) -> ndarray:
    weighted = weights > 0
    return np.linalg.lstsq(design[weighted], size[weighted], rcond=None)[0]
