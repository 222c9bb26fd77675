"""Joint angles that bring the points an arm carries nearest to where they were measured, compiled:
Levenberg–Marquardt from a start.

A frame takes two or three steps from the frame before it. The step comes from the eigenvalues of
JᵀJ, J the derivatives of all points with respect to the joints: they also say which joints the
points decide, and JᵀJ is the angles' inverse covariance in units of a coordinate's noise.
"""

from __future__ import annotations

import numpy as np

from pipeline.arm.kinematics import WIDTH, tip
from pipeline.arm.numbers import Arm
from pipeline.arm.rows import JOINTS, POSITION, ROTATION
from pipeline.core.compiled import compiled, inner

STEPS = 100  # at most; from a far start some twenty, from the frame before two or three
SETTLED = 1e-10  # rad, or m of a prismatic joint: the last step
# m a radian, or 1: a turn of the joints that moves all points together by less is not decided by
# them
LEAST_LEVER = 0.01


@inner
def _equations(
    arm: Arm,
    links: np.ndarray,
    joints: np.ndarray,
    owner: np.ndarray,
    places: np.ndarray,
    measured: np.ndarray,
    q: np.ndarray,
    block: np.ndarray,
    normal: np.ndarray,
    gradient: np.ndarray,
    distances: np.ndarray,
) -> float:
    """Fill ``normal`` JᵀJ (n, n), ``gradient`` Jᵀr (n,) and ``distances`` |r| (P,) in m of the ways
    r from the points at ``q`` (n, 1) to ``measured`` (P, 3); the sum of their squares in m².

    The other arguments are those of :func:`solve`.
    """
    normal[:], gradient[:], distances[:] = 0.0, 0.0, 0.0
    row, total = np.zeros((3, len(gradient))), 0.0
    for link in range(len(links)):
        n = joints[link]
        frames, sliding = links[link, : n + 2], arm.sliding[:n]
        part = Arm(arm.plane, frames, sliding, arm.rows, arm.units, arm.least)
        tip(part, q, 0, 1, block)
        for p in range(len(owner)):
            if owner[p] != link or np.isnan(measured[p, 0]):
                continue
            place = np.empty(3)
            for k in range(3):
                place[k] = block[POSITION + k, 0]
                for i in range(3):
                    place[k] += block[ROTATION + 3 * k + i, 0] * places[p, i]
            for j in range(n):
                for k in range(3):
                    first, y, z = JOINTS + 6 * j, (k + 1) % 3, (k + 2) % 3
                    if sliding[j] > 0.0:
                        row[k, j] = block[first + k, 0]
                    else:
                        to_y = place[y] - block[first + 3 + y, 0]
                        to_z = place[z] - block[first + 3 + z, 0]
                        row[k, j] = block[first + y, 0] * to_z - block[first + z, 0] * to_y
            before = total
            for k in range(3):
                way = measured[p, k] - place[k]
                total += way * way
                for j in range(n):
                    gradient[j] += row[k, j] * way
                    for i in range(j + 1):
                        normal[j, i] += row[k, j] * row[k, i]
            distances[p] = np.sqrt(total - before)
    for j in range(len(gradient)):
        for i in range(j):
            normal[i, j] = normal[j, i]
    return total


@compiled
def solve(
    arm: Arm,
    links: np.ndarray,
    joints: np.ndarray,
    owner: np.ndarray,
    places: np.ndarray,
    measured: np.ndarray,
    start: np.ndarray,
    normal: np.ndarray,
    distances: np.ndarray,
) -> float:
    """Replace ``start`` (n,) by the joint angles of the least sum of squares near it, in rad, m of
    prismatic joints; that sum in m².

    Along directions that the points do not decide the angles stay about where they were.

    Args:
        arm: numbers of the arm's chain.
        links: (L, n + 2, 6) frames of the chain to each link, of which
        joints: (L,) says how many joints move it; rows beyond its own are not read.
        owner: (P,) the link of each point.
        places: (P, 3) m, of the points in their links' frames.
        measured: (P, 3) m, in the base frame, not a number where missing.
        start: (n,) where to begin, and the result.
        normal: (n, n) to be filled with JᵀJ at the result.
        distances: (P,) to be filled with those of the points from where the arm carries them there,
            m; zero of missing ones.
    """
    n = len(start)
    block = np.empty((JOINTS + 6 * n, WIDTH))
    q, other = start.copy().reshape(n, 1), np.empty((n, 1))
    gradient, step = np.empty(n), np.empty(n)
    further, next_gradient, next_distances = np.empty((n, n)), np.empty(n), np.empty(len(owner))
    cost = _equations(
        arm, links, joints, owner, places, measured, q, block, normal, gradient, distances
    )
    damping = 0.0
    for _ in range(STEPS):
        values, vectors = np.linalg.eigh(normal)
        step[:] = 0.0
        for k in range(n):
            along = 0.0
            for j in range(n):
                along += vectors[j, k] * gradient[j]
            along /= max(values[k], LEAST_LEVER * LEAST_LEVER) + damping
            for j in range(n):
                step[j] += along * vectors[j, k]
        if np.abs(step).max() < SETTLED:
            break
        for j in range(n):
            other[j, 0] = q[j, 0] + step[j]
        lower = _equations(
            arm,
            links,
            joints,
            owner,
            places,
            measured,
            other,
            block,
            further,
            next_gradient,
            next_distances,
        )
        if lower <= cost:
            q[:], normal[:], gradient[:] = other, further, next_gradient
            distances[:] = next_distances
            cost, damping = lower, 0.1 * damping if damping > 1e-9 * values[-1] else 0.0
        else:
            damping = max(10.0 * damping, 1e-3 * values[-1])
    start[:] = q[:, 0]
    return cost
