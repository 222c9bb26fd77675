"""Draws of a step by its compiled law, whose random numbers are NumPy's own, bit for bit."""

from __future__ import annotations

import numpy as np
from numba import int64, types

from pipeline.arm.chain import JOINTS, PlanarChain
from pipeline.arm.compiled import ARM, Arm, arm_numbers, pose
from pipeline.core.compiled import MATRIX, VECTOR, compiled, inlined, inner
from pipeline.core.errors import ModelDomainError
from pipeline.models.law import CUBE, GENERATOR, NUMBERS, STEP, Numbers, at, block
from pipeline.models.model import Law, MotionModel
from pipeline.randommatrix.variates import gamma_law, standard_gamma, standard_normal

BLOCK = 256  # poses that are moved at once


def numbers_for(law: Law, poses: int = BLOCK) -> Numbers:
    """Room for the random numbers that a block of at most so many ``poses`` takes under ``law``."""
    sets, each = law.normals
    return Numbers(
        gamma_law(law.degrees / 2.0),
        each,
        np.empty(poses),
        np.empty((sets * each, poses)),
        np.empty((JOINTS, poses)),
    )


@inner
def draw(numbers: Numbers, count: int, rng: np.random.Generator) -> None:
    """Fill ``numbers`` for the first ``count`` poses of a block: the χ² variates of all of them, if
    there are any, then set by set the normals, those of one pose in a row.
    """
    if numbers.gamma[0] > 0.0:
        for i in range(count):
            numbers.chi_square[i] = 2.0 * standard_gamma(numbers.gamma, rng)
    for first in range(0, len(numbers.normal), numbers.each):
        for i in range(count):
            for j in range(first, first + numbers.each):
                numbers.normal[j, i] = standard_normal(rng)


@inlined
def move_block(
    step: object,
    numbers: Numbers,
    parameters: np.ndarray,
    arm: Arm,
    v: np.ndarray,
    target: np.ndarray,
    share: float,
    here: tuple,
    there: tuple,
    rng: np.random.Generator,
) -> int:
    """Fill ``there`` with draws of the next poses after those of the block ``here`` under ``v +
    share·(target − x(q))``; for how many the noise was clipped.

    Args:
        step: the law, with its ``parameters``, and room for its ``numbers``.
        arm: the chain's numbers.
        v: (m,) commanded step.
        target: (m,) pose that the loop holds the arm to; not looked at where ``share`` is 0.
        share: κ, of the deviation that the step corrects; 0 of an open loop.
        here: a block of poses, and ``there`` their next ones.
        rng: of the random numbers.
    """
    count, command = len(here[0]), numbers.command
    draw(numbers, count, rng)
    for r in range(len(v)):
        for i in range(count):
            command[r, i] = v[r]
    if share > 0.0:
        for i in range(count):
            x, z, phi = pose(arm, at(here, i))
            command[0, i] += share * (target[0] - x)
            command[1, i] += share * (target[1] - z)
            command[2, i] += share * (target[2] - phi)
    return step(numbers, parameters, arm, block(command, 0, count), here, there)


def draw_steps(
    model: MotionModel,
    chain: PlanarChain,
    q: np.ndarray,
    v: np.ndarray,
    rng: np.random.Generator,
) -> tuple[np.ndarray, int]:
    """One draw of q_{k+1} for each of the poses ``q`` (..., n) in rad, of the same shape, and for
    how many of them the noise was clipped at zero.

    ``v`` (n,) or (M, n) are commanded steps (m, m, rad): all poses take the one, or those at ``q``
    (..., M, n) each its own. Draws are made command by command, of all poses under one, in blocks.

    Raises:
        SingularJacobianError: at a singular pose, where no model is defined.
        ModelDomainError: where a draw is not finite, as at poses without a decomposition.
    """
    chain.require_regular(q)
    law, commands = model.law(), np.atleast_2d(np.asarray(v, dtype=float))
    n = q.shape[-1]
    # (M, poses under one command, n), whose joints come first in memory for the law
    if np.ndim(v) == 1:
        together = q.reshape(1, -1, n)
    else:
        together = np.swapaxes(q.reshape(-1, len(v), n), 0, 1)
    before = np.ascontiguousarray(np.moveaxis(together, -1, 1), dtype=float)
    moved = np.empty_like(before)
    clipped = _draw_steps(
        law.step,
        numbers_for(law),
        law.parameters,
        arm_numbers(chain),
        np.ascontiguousarray(commands),
        before,
        moved,
        rng,
    )
    drawn = np.moveaxis(moved, 1, -1)
    drawn = (drawn if np.ndim(v) == 1 else np.swapaxes(drawn, 0, 1)).reshape(q.shape)
    lost = ~np.isfinite(drawn).all(axis=-1)
    if np.any(lost):
        index = tuple(int(i) for i in np.argwhere(lost)[0])
        raise ModelDomainError(
            f"the model has no next step at {int(lost.sum())} pose(s): a Wishart model by LU "
            "without pivoting has none where a pivot is small; name another order of rows or "
            "joints in the dataset's option elimination, or another decomposition in the model's",
            index=index,
            q=np.asarray(q, dtype=float)[index].round(4).tolist(),
        )
    return drawn, clipped


@compiled(int64(types.FunctionType(STEP), NUMBERS, VECTOR, ARM, MATRIX, CUBE, CUBE, GENERATOR))
def _draw_steps(
    step: object,
    numbers: Numbers,
    parameters: np.ndarray,
    arm: Arm,
    v: np.ndarray,
    q: np.ndarray,
    moved: np.ndarray,
    rng: np.random.Generator,
) -> int:
    """Fill ``moved`` (M, n, N) with draws of the next poses after ``q`` (M, n, N) under ``v`` (M,
    n); for how many the noise was clipped.
    """
    clipped, count = 0, q.shape[2]
    for k in range(len(v)):
        for start in range(0, count, BLOCK):
            stop = start + BLOCK if start + BLOCK < count else count
            here, there = block(q[k], start, stop), block(moved[k], start, stop)
            clipped += move_block(step, numbers, parameters, arm, v[k], v[k], 0.0, here, there, rng)
    return clipped
