"""Poses of the joints that carry the tip to where the path wants it: Newton's method, for whole
batches.
"""

from __future__ import annotations

import numpy as np

from pipeline.arm.interface import Chain
from pipeline.core.errors import SingularJacobianError
from pipeline.planning.problem import REACHED

STRIDE = 0.5  # rad, of the longest step of Newton's method
CLOSE = REACHED / 100


def settle(
    chain: Chain, q: np.ndarray, target: np.ndarray, rounds: int
) -> tuple[np.ndarray, np.ndarray]:
    """(P, n) in rad the poses that the steps J⁺(target − x) lead to from ``q`` (P, n), and (P,)
    whether they reach the poses ``target`` (P, p); a lane that meets a singular pose does not.
    """
    q, reached = np.array(q, dtype=float), np.zeros(len(q), dtype=bool)
    lanes = np.arange(len(q))
    for left in range(rounds, -1, -1):
        off = chain.displacement(chain.pose(q[lanes]), target[lanes])
        far = ~(length_of(off) <= CLOSE)
        reached[lanes] = ~far
        lanes, off = lanes[far], off[far]
        if left == 0 or len(lanes) == 0:
            break
        inverse, regular = inverses(chain, q[lanes])
        lanes = lanes[regular]
        step = np.matvec(inverse, off[regular])
        q[lanes] += step * (STRIDE / np.maximum(length_of(step), STRIDE))[:, None]
    return q, reached


def inverses(chain: Chain, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(R, n, m) J⁺ at those of ``q`` (P, n) that are regular, and which they are (P,)."""
    try:
        return chain.inverse_jacobian(q), np.ones(len(q), dtype=bool)
    except SingularJacobianError:
        regular = ~chain.singular(q)
        return chain.inverse_jacobian(q[regular]), regular


def length_of(steps: np.ndarray) -> np.ndarray:
    """(...,) norms of ``steps`` (..., n)."""
    return np.sqrt(np.vecdot(steps, steps))
