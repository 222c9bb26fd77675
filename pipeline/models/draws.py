"""Draws of a step by its compiled law, whose random numbers are NumPy's own, bit for bit."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import int64

from pipeline.arm.chain import PlanarChain
from pipeline.arm.compiled import ARM
from pipeline.arm.interface import Chain
from pipeline.arm.numbers import Arm
from pipeline.arm.serial_compiled import WIDTH
from pipeline.core.aligned import aligned
from pipeline.core.compiled import MATRIX, VECTOR, compiled, inlined, inner
from pipeline.core.errors import ModelDomainError
from pipeline.core.passing import addressed
from pipeline.models.correction import correction
from pipeline.models.law import CORRECTION, CUBE, NUMBERS, ROWS, STEP, Numbers, Poses
from pipeline.models.model import Law, MotionModel
from pipeline.models.serial import rows_of_room
from pipeline.randommatrix.variates import gamma_law, standard_gamma
from pipeline.randommatrix.words import WORDS, close, opened, words_of
from pipeline.randommatrix.ziggurat import standard_normal

# poses that are moved at once, of a planar chain; of any other arm as many as its room is wide
BLOCK = 256


def numbers_for(law: Law, chain: Chain, poses: int | None = None) -> Numbers:
    """Room for the random numbers that a block of at most so many ``poses`` takes under ``law``,
    and for the kinematics of ``chain``.
    """
    sets, each = law.normals
    m, n, planar = len(chain.task), len(chain.lower), isinstance(chain, PlanarChain)
    size = poses or (BLOCK if planar else WIDTH)
    command = aligned(m if m == n else m + n, size)
    command[:] = 0.0  # a command of the task alone leaves the rows of the joints as they are
    return Numbers(
        np.array([gamma_law(each / 2.0) for each in law.degrees]).reshape(-1, 3),
        each,
        aligned(len(law.degrees), size),
        aligned(sets * each, size),
        command,
        aligned(ROWS if planar else rows_of_room(n, m), size),
    )


@inner
def draw(numbers: Numbers, count: int, words: np.ndarray) -> None:
    """Fill ``numbers`` for the first ``count`` poses of a block from ``words`` (4,): the χ²
    variates of all of them, one after the other, then set by set the normals, those of one pose in
    a row.
    """
    state = opened(words)
    for k in range(len(numbers.gamma)):
        law = (numbers.gamma[k, 0], numbers.gamma[k, 1], numbers.gamma[k, 2])
        for i in range(count):
            half, state = standard_gamma(law, state)
            numbers.chi_square[k, i] = 2.0 * half
    for first in range(0, len(numbers.normal), max(numbers.each, 1)):
        for i in range(count):
            for j in range(first, first + numbers.each):
                numbers.normal[j, i], state = standard_normal(state)
    close(words, state)


@inlined
def move_block(
    step: Callable,
    correct: Callable,
    numbers: Numbers,
    parameters: np.ndarray,
    arm: Arm,
    v: np.ndarray,
    target: np.ndarray,
    share: float,
    q: np.ndarray,
    moved: np.ndarray,
    start: int,
    count: int,
    words: np.ndarray,
) -> int:
    """Fill ``count`` columns of ``moved`` from ``start`` on with draws of the next poses under
    ``v + share·(target − x(q))``; for how many the noise was clipped. A call, with all that it
    is handed, would take a tenth of a planar arm's step.

    Args:
        step: the law, with its ``parameters``, and room for its ``numbers``.
        correct: the chain's correction (:mod:`pipeline.models.correction`).
        arm: the chain's numbers.
        v: (m,) or (m + n,) commanded step.
        target: pose that the loop holds the arm to; not looked at where ``share`` is 0.
        share: κ, of the deviation that the step corrects; 0 of an open loop.
        q: (n, P) poses in rad, and ``moved`` (n, P) their next ones.
        start: of the block, and ``count`` its poses.
        words: (4,) of the random numbers (:mod:`pipeline.randommatrix.words`).
    """
    draw(numbers, count, words)
    poses = Poses(numbers.command, q, moved, start, count)
    for r in range(len(v)):
        for i in range(count):
            poses.command[r, i] = v[r]
    if share > 0.0:
        correct(arm, target, share, poses, numbers.room)
    return step(numbers, parameters, arm, poses)


def draw_steps(
    model: MotionModel,
    chain: Chain,
    q: np.ndarray,
    v: np.ndarray,
    rng: np.random.Generator,
) -> tuple[np.ndarray, int]:
    """One draw of q_{k+1} for each of the poses ``q`` (..., n) in rad, of the same shape, and for
    how many of them the noise was clipped at zero.

    ``v`` (m,) or (M, m), or m + n of an arm with more joints than task rows, are commanded steps
    (m, m, rad): all poses take the one, or those at ``q`` (..., M, n) each its own. Draws are made
    command by command, of all poses under one, in blocks.

    Raises:
        SingularJacobianError: at a singular pose, where no model is defined.
        ModelDomainError: where a draw is not finite, as where a command is not.
    """
    chain.require_regular(q)
    law, commands = model.law(chain), np.atleast_2d(np.asarray(v, dtype=float))
    n = q.shape[-1]
    # (M, poses under one command, n), whose joints come first in memory for the law
    if np.ndim(v) == 1:
        together = q.reshape(1, -1, n)
    else:
        together = np.swapaxes(q.reshape(-1, len(v), n), 0, 1)
    before = np.ascontiguousarray(np.moveaxis(together, -1, 1), dtype=float)
    moved = np.empty_like(before)
    clipped = _draw_steps(
        addressed(law.step, STEP),
        addressed(correction(chain), CORRECTION),
        numbers_for(law, chain),
        law.parameters,
        chain.numbers(),
        np.ascontiguousarray(commands),
        before,
        moved,
        words_of(rng),
    )
    drawn = np.moveaxis(moved, 1, -1)
    drawn = (drawn if np.ndim(v) == 1 else np.swapaxes(drawn, 0, 1)).reshape(q.shape)
    lost = ~np.isfinite(drawn).all(axis=-1)
    if np.any(lost):
        index = tuple(int(i) for i in np.argwhere(lost)[0])
        raise ModelDomainError(
            f"the model's draw of the next pose is not finite at {int(lost.sum())} pose(s)",
            index=index,
            q=np.asarray(q, dtype=float)[index].round(4).tolist(),
        )
    return drawn, clipped


@compiled(
    int64(
        STEP,
        CORRECTION,
        NUMBERS,
        VECTOR,
        ARM,
        MATRIX,
        CUBE,
        CUBE,
        WORDS,
    )
)
def _draw_steps(
    step: Callable,
    correct: Callable,
    numbers: Numbers,
    parameters: np.ndarray,
    arm: Arm,
    v: np.ndarray,
    q: np.ndarray,
    moved: np.ndarray,
    words: np.ndarray,
) -> int:
    """Fill ``moved`` (M, n, N) with draws of the next poses after ``q`` (M, n, N) under ``v`` (M,
    m); for how many the noise was clipped.
    """
    clipped, poses, size = 0, q.shape[2], numbers.command.shape[1]
    for k in range(len(v)):
        for start in range(0, poses, size):
            count = size if start + size < poses else poses - start
            clipped += move_block(
                step,
                correct,
                numbers,
                parameters,
                arm,
                v[k],
                v[k],
                0.0,
                q[k],
                moved[k],
                start,
                count,
                words,
            )
    return clipped
