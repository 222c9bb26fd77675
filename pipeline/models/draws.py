"""Draws of a step by the compiled law of a model, whose variates are NumPy's own, bit for bit; and
realisations along the desired trajectory, step by step or running freely.
"""

import numpy as np
from numpy import ndarray
from numpy.random import Generator

from pipeline.arm.chain import PlanarChain
from pipeline.arm.interface import Chain
from pipeline.arm.rows import WIDTH, block_rows
from pipeline.core.errors import ModelDomainError
from pipeline.models.kernel import move
from pipeline.models.model import MotionModel


def block_for(chain: Chain) -> ndarray:
    """Buffer (rows, poses) of a block of the ``chain``, of zeros."""
    return np.zeros((block_rows(len(chain.lower), len(chain.task)).size, WIDTH))


def space_of(chain: Chain) -> int | None:
    """None of a planar chain, 1 of a serial one: numba compiles the kinematics of one of them."""
    return None if isinstance(chain, PlanarChain) else 1


def draw_steps(
    model: MotionModel, chain: Chain, q: ndarray, v: ndarray, rng: Generator
) -> tuple[ndarray, int]:
    """One draw of q_{k+1} for each of the poses ``q`` (..., n) in rad, of the same shape, and for
    how many of them the noise was clipped at zero.

    ``v`` (m,) or (M, m), or longer, are commanded steps: all poses take the one, or those at ``q``
    (..., M, n) each its own. Raises SingularJacobianError, and ModelDomainError where a draw is not
    finite.
    """
    if (space := space_of(chain)) is None:
        chain.require_regular(q)
    law, commands = model.law(chain), np.array(np.atleast_2d(v), dtype=float, order="C")
    # (M, n, poses under one command): joints come first in memory for the law
    together = q.reshape(-1, len(commands), q.shape[-1])
    before = np.array(np.moveaxis(together, 0, -1), dtype=float, order="C")
    moved = np.empty_like(before)
    arm, block, clipped = chain.numbers(), block_for(chain), 0
    for v_k, q_k, moved_k in zip(commands, before, moved, strict=True):
        clipped += move(law, arm, space, block, v_k, v_k, 0.0, q_k, moved_k, rng)
    drawn = np.moveaxis(moved, -1, 0).reshape(q.shape)
    lost = ~np.isfinite(drawn).all(axis=-1)
    if np.any(lost):
        chain.require_regular(q)  # a serial chain's step from a singular pose is NaN
        index = tuple(int(i) for i in np.argwhere(lost)[0])
        raise ModelDomainError(
            f"the model has no finite next step at {int(lost.sum())} pose(s); check the command "
            "and the parameters of the model",
            index=index,
            q=np.asarray(q, dtype=float)[index].round(4).tolist(),
        )
    return drawn, clipped


def realize(
    model: MotionModel, chain: Chain, q: ndarray, v: ndarray, mode: str, rng: Generator
) -> tuple[ndarray, int, int]:
    """(N, M+1, n) joint angles in rad, and the numbers of clipped steps and lost realisations, one
    a take of the recorded angles ``q`` (N, M+1, n) in rad, under the commands ``v`` (M, m) or
    longer.

    In mode ``one_step`` each step starts at the recorded pose; in ``free_running`` at the last one,
    and at a singular pose the realisation is lost: NaN from there on. Raises
    SingularJacobianError for a singular pose in the recordings.
    """
    result, clipped = np.full_like(q, np.nan), 0
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


def realized_moments(
    model: MotionModel, chain: Chain, q: ndarray, v: ndarray, mode: str, realized: ndarray
) -> tuple[ndarray, ndarray, str | None]:
    """Mean and standard deviation (M+1, n) in rad of the realisations ``realized`` (N, M+1, n) of
    :func:`realize`, of the process noise in mode ``one_step``, zero at k = 0, of the joint angles
    in ``free_running``, NaN where the model has no covariance; and why. Raises ModelDomainError
    where fewer than two realisations stay clear of singular poses.
    """
    surviving = np.isfinite(realized[..., 0]).sum(axis=0)
    if surviving.min() < 2:
        raise ModelDomainError(
            "fewer than two realisations avoid singular poses: they have no standard deviation",
            step=int(np.argmax(surviving < 2)),
            key="simulation",
        )
    spread = realized
    if mode == "one_step":
        nominal = q[:, :-1] + chain.nominal_step(q[:, :-1], v)
        spread = np.concatenate([np.zeros_like(q[:, :1]), realized[:, 1:] - nominal], axis=1)
    mean, deviation = np.nanmean(realized, axis=0), np.nanstd(spread, axis=0, ddof=1)
    try:
        model.covariance(chain, q[0, :-1], v)
    except ModelDomainError as error:
        return mean, np.full_like(deviation, np.nan), str(error)
    return mean, deviation, None
