"""Compiled functions that compiled functions alone can call, called from tests: inner ones, laws and schemes."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numba import njit

from pipeline.arm.chain import PlanarChain
from pipeline.motion.compiled.chain import arm_of
from pipeline.motion.compiled.draws import draw, room_for
from pipeline.motion.model import Law


@cache
def from_python(function: Callable) -> Callable:
    """``function`` within a compiled one of the same arguments; numba does not keep it, as it would be another in every process."""

    @njit
    def call(*arguments):
        return function(*arguments)

    return call


def chosen_by(scheme: Callable, weights: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(P,) indices that a resampling ``scheme`` chooses under ``weights`` (P,)."""
    chosen = np.full(len(weights), -1)
    from_python(scheme)(weights, chosen, np.full((2, len(weights)), np.nan), rng)
    return chosen


DRAW = from_python(draw)


def moved_by(law: Law, chain: PlanarChain, q: np.ndarray, v: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, int]:
    """What :meth:`MotionModel.sample` returns, by the compiled law of a model."""
    numbers, moved = room_for(law, len(q)), np.empty((3, len(q)))
    DRAW(numbers, len(q), rng)
    joints = tuple(np.ascontiguousarray(q.T)), tuple(moved)
    clipped = from_python(law.step)(numbers, law.parameters, arm_of(chain), tuple(v.tolist()), *joints)
    return moved.T, clipped
