"""Least uncertain motion along a task path: the paper's sketch of motion planning.

A step of the joints is Δq = J⁺(q)·ẋ·Δt, the constraint of Eq. 42 with the duration Δt that the
paper omits. The start pose therefore determines the motion. The starts are the poses of the arm at
the beginning of the path: one pose a branch if the arm has as many joints as the task has rows,
curves of poses if it has more.
"""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray

from pipeline.arm.chain import Chain
from pipeline.core.errors import ConfigError
from pipeline.models.model import MotionModel

NEWTON_STEPS = 40
LONGEST_STEP = 0.5  # rad, longest step of Newton's method
# m, distance from the first pose of the path at which a start is on it
TOLERANCE = 1e-11
SAME_START = 6  # decimals in rad to which equal starts agree
BATCH = 1024  # poses whose matrices fit the processor's cache


@dataclass(frozen=True, eq=False)
class PathTask:
    """A path of M steps that the tip of an arm of n joints and m ≤ n task rows follows."""

    chain: Chain
    path: ndarray  # (M+1, p) poses x_k, as returned by ``chain.pose``
    rate: float  # 1/Δt, steps per second
    margin: float  # m, least singular value of J that a motion keeps


def start_poses(task: PathTask, count: int) -> ndarray:
    """Return the poses (S, n) in rad within the joint limits at which the tip is at the beginning
    of the path: distinct solutions of Newton's method from ``count`` poses within the limits, ±π
    without a limit.
    """
    from scipy.stats.qmc import Halton

    chain = task.chain
    bounded = np.isfinite(chain.upper - chain.lower)
    low = np.where(bounded, chain.lower, -np.pi)
    high = np.where(bounded, chain.upper, np.pi)
    shares = Halton(len(low), scramble=False).fast_forward(1).random(count)
    q = low + (high - low) * shares
    target = task.path[0]
    for _ in range(NEWTON_STEPS):
        q = q[~chain.singular(q)]
        off = chain.displacement(chain.pose(q), target)
        step = np.matvec(chain.inverse_jacobian(q), off)
        length = np.linalg.norm(step, axis=-1, keepdims=True)
        shortening = LONGEST_STEP / np.maximum(length, LONGEST_STEP)
        q = q + step * shortening

    off = chain.displacement(chain.pose(q), target)
    distance = np.linalg.norm(off, axis=-1)
    reached = distance <= TOLERANCE
    q = q[reached & chain.within_limits(q)]
    rounded = np.round(q, SAME_START)
    _, first = np.unique(rounded, axis=0, return_index=True)
    return q[first]


def motions_from(task: PathTask, starts: ndarray) -> ndarray:
    """Return the motions (S, M+1, n) in rad from the ``starts`` (S, n), with NaN after a singular
    pose. The task velocity leads from the present pose to the next pose of the path, so that errors
    of second order in Δt do not add up.
    """
    chain = task.chain
    count, joints = starts.shape
    motions = np.full((count, len(task.path), joints), np.nan)
    motions[:, 0] = starts
    moving = np.arange(count)
    for k, target in enumerate(task.path[1:]):
        singular = chain.singular(motions[moving, k])
        moving = moving[~singular]
        q = motions[moving, k]
        # ẋ·Δt
        task_step = chain.displacement(chain.pose(q), target)
        inverse = chain.inverse_jacobian(q)
        motions[moving, k + 1] = q + np.matvec(inverse, task_step)
    return motions


def feasible(task: PathTask, motions: ndarray) -> ndarray:
    """Return (S,) True for the ``motions`` (S, M+1, n) that keep the joints' limits of angle and
    speed and the margin from singular poses.
    """
    chain = task.chain
    complete = np.isfinite(motions).all(axis=(1, 2))
    result = np.zeros(len(motions), dtype=bool)
    for number in np.flatnonzero(complete):
        q = motions[number]
        speed = np.abs(np.diff(q, axis=0)) * task.rate
        within = chain.within_limits(q).all()
        slow = np.all(speed <= chain.max_speed)
        clear = np.all(chain.least_singular_value(q) >= task.margin)
        result[number] = within and slow and clear
    return result


def feasible_motions(task: PathTask, count: int) -> ndarray:
    """Return the feasible motions (S, M+1, n) in rad from the starts that ``count`` runs of
    Newton's method find; ConfigError if there is none.
    """
    motions = motions_from(task, start_poses(task, count))
    motions = motions[feasible(task, motions)]
    if not len(motions):
        message = "no start has a motion within the limits of angle and speed and the margin; "
        message += "lower the margin or the pace"
        raise ConfigError(message, key="margin")
    return motions


def summed_variance(model: MotionModel, task: PathTask, motions: ndarray) -> ndarray:
    """Return Σ_k tr Cov(ω_k) (S,) in rad² of the ``motions`` (S, M+1, n) under ``model``, the trace
    of the sum that Eq. 41 minimises; raises ModelDomainError as ``model.covariance`` does.
    """
    chain = task.chain
    sums = []
    for q in motions:
        pose = chain.pose(q)
        v = chain.displacement(pose[:-1], pose[1:])
        traces = []
        for first in range(0, len(v), BATCH):
            batch = slice(first, first + BATCH)
            covariance = model.covariance(chain, q[:-1][batch], v[batch])
            traces.append(np.trace(covariance, axis1=-2, axis2=-1))
        sums.append(np.concatenate(traces).sum())
    return np.array(sums)


def least_uncertain(model: MotionModel, task: PathTask, motions: ndarray) -> ndarray:
    """Return the motion (M+1, n) in rad of least :func:`summed_variance` of the ``motions``."""
    return motions[np.argmin(summed_variance(model, task, motions))]
