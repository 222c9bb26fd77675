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
    nearest, sides = _distances(points, nodes)
    asymmetry = sum(_asymmetry(d, s) for d, s in sides)
    return gamma1 * nearest.mean() + gamma2 * asymmetry


def plain_halved(v, points, o1, bounds, gamma1: float, gamma2: float) -> float:
    """The objective of the fitted end at ``v`` (5,), with an asymmetry for each half of the tool;
    written with complex numbers.
    """
    middle, half = bounds.mean(axis=1), (bounds[:, 1] - bounds[:, 0]) / 2
    lengths = middle + half * np.append(np.sin(np.pi / 2 * v[:2] / 0.02), 0.0)
    steps = lengths * np.exp(1j * v[2:] / middle)
    nodes = o1 + np.cumsum(np.append(0.0, steps)).view(float).reshape(-1, 2)[:, ::-1]
    nearest, sides = _distances(points, nodes)
    beyond = (points - nodes[2:].mean(axis=0)) @ (nodes[3] - nodes[2]) > 0
    distance, side = sides.pop()
    sides += [(distance[part], side[part]) for part in (beyond, ~beyond)]
    return gamma1 * nearest.mean() + gamma2 * sum(_asymmetry(d, s) for d, s in sides)


def _distances(
    points: np.ndarray, nodes: np.ndarray
) -> tuple[np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
    """Distance of every point to the nearest segment; of every segment the distances of its own
    points, and of the others 0, and on which side all are.
    """
    distance, side = [], []
    for a, b in pairwise(nodes):
        share = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        distance.append(np.linalg.norm(points - a - share[:, None] * (b - a), axis=1))
        side.append((points - a) @ np.array([(b - a)[1], -(b - a)[0]]))
    nearest = np.min(distance, axis=0)
    own = [np.where(d <= nearest + 1e-12, d, 0.0) for d in distance]
    return nearest, list(zip(own, side, strict=True))


def _asymmetry(distance: np.ndarray, side: np.ndarray) -> float:
    return abs(distance[side > 0].max(initial=0.0) - distance[side <= 0].max(initial=0.0))


def plain_rank(v, points, o1, ee, bounds, gamma1: float, gamma2: float) -> float:
    """The same at ``v`` = (O2, O3), and behind every feasible pose by the violation of the
    ``bounds`` (3, 2) on the lengths.
    """
    nodes = np.vstack([o1, v.reshape(2, 2), ee])
    length = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    excess = np.maximum(bounds[:, 0] - length, 0) + np.maximum(length - bounds[:, 1], 0)
    if excess.sum() > 0:
        return INFEASIBLE + excess.sum()
    return plain_objective(points, nodes, gamma1, gamma2)
