"""Draws of a step with a model's compiled law and NumPy's variates, or by the law's ``sample``, and
realisations along the desired trajectory, step by step or free-running.
"""

from typing import NamedTuple

import numpy as np
from numpy import ndarray
from numpy.random import Generator

from pipeline.arm.chain import Chain
from pipeline.arm.kinematics import ArmConstants
from pipeline.arm.rows import WIDTH, block_rows
from pipeline.core.errors import ModelDomainError
from pipeline.models.kernel import move
from pipeline.models.model import MotionModel
from pipeline.models.steps import Recorded


def compiled_arm(chain: Chain) -> tuple[ArmConstants, ndarray]:
    """Return the constants of the ``chain`` and a zeroed buffer (rows, poses) for a block."""
    rows = block_rows(len(chain.lower), len(chain.task)).size
    return chain.constants, np.zeros((rows, WIDTH))


def draw_steps(
    model: MotionModel,
    chain: Chain,
    q: ndarray,
    v: ndarray,
    rng: Generator,
) -> tuple[ndarray, int]:
    """Return one draw of q_{k+1} for each pose of ``q`` (..., n) in rad, and the number of draws
    with a noise covariance clipped at zero.

    ``v`` (m,) or (m + n,) is the command of all poses, row k of (M, m) or (M, m + n) of ``q[..., k,
    :]``. Raises SingularJacobianError, and ModelDomainError if a draw is not finite.
    """
    if not model.traits.compiled:
        return model.sample(chain, q, v, rng), 0
    commands = np.array(np.atleast_2d(v), dtype=float, order="C")
    # (M, n, poses under one command): joints come first in memory for the law
    together = q.reshape(-1, len(commands), q.shape[-1])
    before = np.array(np.moveaxis(together, 0, -1), dtype=float, order="C")
    law = model.law(chain)
    moved = np.empty_like(before)
    clipped = 0
    arm, block = compiled_arm(chain)
    for v_k, q_k, moved_k in zip(commands, before, moved, strict=True):
        clipped += move(law, arm, block, v_k, v_k, 0.0, q_k, moved_k, rng)
    drawn = np.moveaxis(moved, -1, 0).reshape(q.shape)
    lost = ~np.isfinite(drawn).all(axis=-1)
    if np.any(lost):
        chain.require_regular(q)  # the step from a singular pose is NaN
        index = tuple(np.argwhere(lost)[0].tolist())
        pose = np.asarray(q, dtype=float)[index]
        raise ModelDomainError(
            f"the model has no finite next step at {int(lost.sum())} pose(s); check the command "
            "and the parameters of the model",
            index=index,
            q=pose.round(4).tolist(),
        )
    return drawn, clipped


def realize(
    model: MotionModel,
    chain: Chain,
    q: ndarray,
    v: ndarray,
    mode: str,
    rng: Generator,
) -> tuple[ndarray, int, int]:
    """Realise the motion once for each take of the recorded angles ``q`` (N, M+1, n) in rad, under
    the commands ``v`` (M, m) or (M, m + n). Return the angles (N, M+1, n) in rad and the numbers of
    clipped steps and of lost realisations.

    In mode ``one_step`` each step starts at the recorded pose; in ``free_running`` at the last
    realised pose. A realisation is lost at a singular pose: its later angles are NaN. Raises
    SingularJacobianError for a singular pose in the recordings.
    """
    result = np.full_like(q, np.nan)
    clipped = 0
    result[:, 0] = q[:, 0]
    alive = np.ones(len(q), dtype=bool)
    for k in range(len(v)):
        start = q[:, k]
        if mode == "free_running" and k > 0:
            start = result[:, k]
            alive &= ~chain.singular(start)
        result[alive, k + 1], count = draw_steps(model, chain, start[alive], v[k], rng)
        clipped += count
    return result, clipped, int(np.sum(~alive))


def mean_bias(model: MotionModel, chain: Chain, q: ndarray, v: ndarray) -> ndarray:
    """(M+1,) norm in rad of the exact mean step minus the nominal step from the poses ``q`` (takes,
    M+1, n), mean over the takes; 0 at k = 0. NaN if a step of the model has no mean.
    """
    start = q[:, :-1]
    try:
        bias = model.mean(chain, start, v) - start - chain.nominal_step(start, v)
    except ModelDomainError:
        return np.full(q.shape[1], np.nan)
    return np.append(0.0, np.linalg.norm(bias.mean(axis=0), axis=-1))


class RealizedMoments(NamedTuple):
    """Moments of the realisations of a model."""

    mean: ndarray  # (M+1, n) rad
    # (M+1, n) rad, of the process noise in mode one_step, with zero at k = 0; of the joint angles
    # in free_running; NaN for a model without a covariance
    deviation: ndarray
    clipped: int  # steps with a noise covariance clipped at zero
    lost: int  # realisations that end at a singular pose
    refused: str  # reason for a missing deviation


def realize_recorded(
    model: MotionModel,
    recorded: Recorded,
    mode: str,
    count: int,
    rng: Generator,
) -> RealizedMoments:
    """Return the moments of ``count`` realisations by :func:`realize` that start at the poses of
    the takes of ``recorded`` in turn; raises as :func:`realize` and :func:`realized_moments`.
    """
    chain = recorded.chain
    v = recorded.v
    poses = recorded.poses
    starts = np.resize(poses, (count, *poses.shape[1:]))
    realized, clipped, lost = realize(model, chain, starts, v, mode, rng)
    mean, deviation = realized_moments(chain, starts, v, mode, realized)
    try:
        model.covariance(chain, starts[0, :-1], v)
    except ModelDomainError as error:
        gaps = np.full_like(deviation, np.nan)
        return RealizedMoments(mean, gaps, clipped, lost, str(error))
    return RealizedMoments(mean, deviation, clipped, lost, "")


def realized_moments(
    chain: Chain,
    q: ndarray,
    v: ndarray,
    mode: str,
    realized: ndarray,
) -> tuple[ndarray, ndarray]:
    """Return mean and standard deviation (M+1, n) in rad of the ``realized`` angles (N, M+1, n)
    from the poses ``q`` (N, M+1, n) in rad, as in :class:`RealizedMoments`. Raises ModelDomainError
    if fewer than two realisations remain.
    """
    surviving = np.isfinite(realized[..., 0]).sum(axis=0)
    if surviving.min() < 2:
        message = "fewer than two realisations avoid singular poses: no standard deviation exists"
        step = int(np.argmax(surviving < 2))
        raise ModelDomainError(message, step=step, key="simulation")
    noise = realized
    if mode == "one_step":
        nominal = q[:, :-1] + chain.nominal_step(q[:, :-1], v)
        noise = np.zeros_like(realized)
        noise[:, 1:] = realized[:, 1:] - nominal
    return np.nanmean(realized, axis=0), np.nanstd(noise, axis=0, ddof=1)
