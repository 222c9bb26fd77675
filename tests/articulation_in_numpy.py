"""The paper's articulation written out with arrays: the oracle of the compiled one, and what a user
of SciPy would minimise.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from pipeline.perception.articulation_objective import INFEASIBLE


def plain_objective(points: np.ndarray, nodes: np.ndarray, gamma1: float, gamma2: float) -> float:
    """Eq. (KinObj) of ``points`` (I, 2) at ``nodes`` (4, 2), every distance as the distance to the
    closest point of the segment.
    """
    distance, side = [], []
    for a, b in pairwise(nodes):
        share = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        distance.append(np.linalg.norm(points - a - share[:, None] * (b - a), axis=1))
        side.append((points - a) @ np.array([(b - a)[1], -(b - a)[0]]))
    nearest = np.min(distance, axis=0)
    asymmetry = 0.0
    for d, s in zip(distance, side, strict=True):
        own = d <= nearest + 1e-12
        asymmetry += abs(d[own & (s > 0)].max(initial=0.0) - d[own & (s <= 0)].max(initial=0.0))
    return gamma1 * nearest.mean() + gamma2 * asymmetry


def plain_rank(
    v: np.ndarray,
    points: np.ndarray,
    o1: np.ndarray,
    ee: np.ndarray,
    bounds: np.ndarray,
    gamma1: float,
    gamma2: float,
) -> float:
    """The same at ``v`` = (O2, O3), and behind every feasible pose by the violation of the
    ``bounds`` (3, 2) on the lengths.
    """
    nodes = np.vstack([o1, v.reshape(2, 2), ee])
    length = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    excess = np.maximum(bounds[:, 0] - length, 0) + np.maximum(length - bounds[:, 1], 0)
    return (
        INFEASIBLE + excess.sum()
        if excess.sum() > 0
        else plain_objective(points, nodes, gamma1, gamma2)
    )
