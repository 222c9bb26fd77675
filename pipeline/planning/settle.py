"""Poses of the joints that carry the tip to where the path wants it: Newton's method, for whole
batches.
"""

from __future__ import annotations

import numpy as np

from pipeline.arm.interface import Chain
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
        reached[lanes] = close = np.linalg.norm(off, axis=-1) <= CLOSE
        going = ~close & ~chain.singular(q[lanes])
        lanes, off = lanes[going], off[going]
        if left == 0 or len(lanes) == 0:
            break
        step = np.matvec(chain.inverse_jacobian(q[lanes]), off)
        length = np.linalg.norm(step, axis=-1, keepdims=True)
        q[lanes] += step * np.minimum(1.0, STRIDE / np.maximum(length, STRIDE))
    return q, reached
