"""Draws of a step by the compiled law of a model; the variates are NumPy's own, bit for bit."""

from __future__ import annotations

import numpy as np

from pipeline.arm.chain import PlanarChain
from pipeline.arm.interface import Chain
from pipeline.arm.kinematics import WIDTH
from pipeline.arm.planar import BLOCK
from pipeline.arm.rows import block_rows
from pipeline.core.errors import ModelDomainError
from pipeline.models.kernel import move
from pipeline.models.model import MotionModel


def block_for(chain: Chain) -> np.ndarray:
    """Buffer (rows, poses) of a block of the ``chain``, of zeros."""
    rows = block_rows(len(chain.lower), len(chain.task))
    return np.zeros((rows.size, WIDTH if space_of(chain) else BLOCK))


def space_of(chain: Chain) -> int | None:
    """None of a planar chain, 1 of a serial one: numba compiles the kinematics of one of them."""
    return None if isinstance(chain, PlanarChain) else 1


def draw_steps(
    model: MotionModel, chain: Chain, q: np.ndarray, v: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, int]:
    """One draw of q_{k+1} for each of the poses ``q`` (..., n) in rad, of the same shape, and for
    how many of them the noise was clipped at zero.

    ``v`` (m,) or (M, m), or m + n of an arm with more joints than task rows, are commanded steps
    (m, m, rad): all poses take the one, or those at ``q`` (..., M, n) each its own. Raises
    SingularJacobianError at a singular pose, where no model is defined, and ModelDomainError where
    a draw is not finite.
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
