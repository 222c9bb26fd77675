"""The paper's objective of an articulation, Eq. (KinObj), of one point cloud; compiled.

The tool ends at the commanded end-effector, as in the paper, or where the points say (fitted): with
its nominal length, as a free one would grow to its bound, and with an asymmetry of each half.
"""

from typing import NamedTuple

import numpy as np

from pipeline.core.compiled import inner
from pipeline.core.elementary import sine_cosine

# m; above every value of the objective that points within reach of an arm can give
INFEASIBLE = 1e3
STEP = 0.02  # m; first extent of the simplex: how far a node moves between frames at 30 Hz
# 1/m; a variable that moves by STEP takes a length from its nominal value to its bound
STRETCH = np.pi / 2 / STEP
Node = tuple[float, float]


class Frame(NamedTuple):
    """The I points of one frame, its known nodes, and buffers of an evaluation."""

    points: np.ndarray  # (2, I) x and z, m
    o1: np.ndarray  # (2,) m
    ee: np.ndarray  # (2,) m, as commanded
    bounds: np.ndarray  # (3, 2) of the segments' lengths, m
    gamma1: float
    gamma2: float
    distance: np.ndarray  # (I,) to its segment, m
    signed: np.ndarray  # (4, I) by piece, as _assign writes it, m²
    bits: np.ndarray  # (4, I) the same memory read as integers with a sign
    unsigned: np.ndarray  # and without


def frame_of(
    points: np.ndarray, o1: np.ndarray, ee: np.ndarray, bounds: np.ndarray, gammas: tuple
) -> Frame:
    """Return the frame with its buffers; weights ``gammas`` of mean distance and asymmetry."""
    signed, distance = np.empty((4, points.shape[1])), np.empty(points.shape[1])
    arrays = (np.array(array, order="C") for array in (points, o1, ee, bounds))
    return Frame(*arrays, *gammas, distance, signed, signed.view(np.int64), signed.view(np.uint64))


@inner
def rank(frame: Frame, v: np.ndarray) -> float:
    """Eq. (KinObj), m, at v = (O2, O3), m, of the commanded end; outside the bounds on the lengths
    INFEASIBLE and the excess, so that poses within rank first (feasibility rules, Deb 2000).

    Of the fitted end v = (λ1, λ2, l1ψ1, l2ψ2, l3ψ3), l nominal lengths and ψ headings; the first
    two lengths l(1 + r·sin(STRETCH·λ)) keep their bounds at any λ (James and Roos 1975).
    """
    o1 = (frame.o1[0], frame.o1[1])
    if v.size == 5:
        o2 = _end(o1, frame.bounds[0], v[0], v[2])
        o3 = _end(o2, frame.bounds[1], v[1], v[3])
        return value(frame, (o1, o2, o3, _end(o3, frame.bounds[2], 0.0, v[4])), 4)
    nodes, violation = (o1, (v[0], v[1]), (v[2], v[3]), (frame.ee[0], frame.ee[1])), 0.0
    for j in range(3):
        start, end = nodes[j], nodes[j + 1]
        length = np.sqrt((end[0] - start[0]) ** 2 + (end[1] - start[1]) ** 2)
        short, long = frame.bounds[j, 0] - length, length - frame.bounds[j, 1]
        violation += short if short > 0.0 else (long if long > 0.0 else 0.0)
    return value(frame, nodes, 3) if violation == 0.0 else INFEASIBLE + violation


@inner
def _end(start: Node, bounds: np.ndarray, stretch: float, arc: float) -> Node:
    """End of a segment from ``start``, its length within ``bounds`` (2,)."""
    middle, half = 0.5 * (bounds[0] + bounds[1]), 0.5 * (bounds[1] - bounds[0])
    stretched, _ = sine_cosine(STRETCH * stretch)
    sine, cosine = sine_cosine(arc / middle)
    length = middle + half * stretched
    return start[0] + length * sine, start[1] + length * cosine


@inner
def value(frame: Frame, nodes: tuple, pieces: int) -> float:
    """Eq. (KinObj), m, of a ``frame`` at the ``nodes`` (x, z) O1, O2, O3 and EE, m; of four
    ``pieces`` the last segment is two. A point belongs to the nearest segment, one nearest to a
    node to both; d_a and d_u are the greatest distances on either side of a segment's line.
    """
    x, z, signed = frame.points[0], frame.points[1], frame.signed
    _assign(x, z, nodes, frame.distance, signed[0], signed[1], signed[2])
    if pieces == 4:  # points beyond the middle of the tool
        (ax, az), (bx, bz) = nodes[2], nodes[3]
        for i in range(x.size):
            aside = (x[i] - 0.5 * (ax + bx)) * (bx - ax) + (z[i] - 0.5 * (az + bz)) * (bz - az)
            signed[3, i] = signed[2, i] if aside > 0.0 else 0.0
            signed[2, i] = 0.0 if aside > 0.0 else signed[2, i]
    asymmetry = 0.0
    for j in range(pieces):
        above, under = _greatest(signed[j], frame.bits[j], frame.unsigned[j])
        asymmetry += abs(np.sqrt(above) - np.sqrt(under))
    return frame.gamma1 * _sum(frame.distance) / frame.distance.size + frame.gamma2 * asymmetry


@inner
def _assign(x, z, nodes, distance, first, second, third):
    """Distance of every point to its segment, and by segment its square: positive above the line,
    negative below, 0 for others' points. Without branches the compiler takes several at once.
    """
    for i in range(x.size):
        to_first, side_first = _to_segment(x[i], z[i], nodes[0], nodes[1])
        to_second, side_second = _to_segment(x[i], z[i], nodes[1], nodes[2])
        to_third, side_third = _to_segment(x[i], z[i], nodes[2], nodes[3])
        nearest = to_first if to_first < to_second else to_second
        nearest = nearest if nearest < to_third else to_third
        distance[i] = np.sqrt(nearest)
        own = nearest if to_first == nearest else 0.0
        first[i] = own if side_first > 0.0 else -own
        own = nearest if to_second == nearest else 0.0
        second[i] = own if side_second > 0.0 else -own
        own = nearest if to_third == nearest else 0.0
        third[i] = own if side_third > 0.0 else -own


@inner
def _to_segment(x: float, z: float, start: Node, end: Node) -> tuple[float, float]:
    """Squared distance to the segment (beyond an end to the node) and the side of its line."""
    ux, uz = end[0] - start[0], end[1] - start[1]
    wx, wz, ex, ez = x - start[0], z - start[1], x - end[0], z - end[1]
    squared, along, side = ux * ux + uz * uz, wx * ux + wz * uz, wx * uz - wz * ux
    from_start, from_end = wx * wx + wz * wz, ex * ex + ez * ez
    inside = from_end if along >= squared else side * side * (1.0 / squared)
    return from_start if along <= 0.0 else inside, side


@inner
def _greatest(signed: np.ndarray, bits: np.ndarray, unsigned: np.ndarray) -> tuple[float, float]:
    """Greatest positive number and size of the least negative one; ``signed`` is used up."""
    above, under = np.int64(0), np.uint64(0)
    for i in range(signed.size):
        above = bits[i] if bits[i] > above else above
        under = unsigned[i] if unsigned[i] > under else under
    bits[0] = above
    greatest = signed[0]
    unsigned[0] = under
    return greatest, (-signed[0] if signed[0] < 0.0 else 0.0)


@inner
def _sum(values: np.ndarray) -> float:
    """Sum in four parts: none waits for the one before."""
    a = b = c = d = 0.0
    whole = values.size - values.size % 4
    for i in range(0, whole, 4):
        a, b, c, d = a + values[i], b + values[i + 1], c + values[i + 2], d + values[i + 3]
    for i in range(whole, values.size):
        a += values[i]
    return (a + b) + (c + d)


# The first extent of each run of the simplex, and the extent at which it has ended, m: 1e-5 m are
# 1e-4 rad on a link. The fitted end has minima beside the least, which a wider simplex leaves.
RUNS = {
    "commanded": ((STEP, 1e-3), (-STEP / 2, 1e-5)),
    "fitted": ((2 * STEP, 4e-3), (-2 * STEP, 4e-3), (STEP, 1e-4)),
}


def variables(frame: Frame, nodes: np.ndarray, end: str) -> np.ndarray:
    """Return the pose v of :func:`rank` of ``nodes`` (3, 2) O2, O3, EE, m, with the ``end``."""
    if end == "commanded":
        return nodes[:2].ravel()
    x, z = np.diff(np.vstack([frame.o1, nodes]), axis=0).T
    (short, long), last = frame.bounds.T, slice(-1)
    middle, half = (short + long) / 2, (long - short) / 2
    share = np.clip((np.hypot(x, z) - middle)[last] / half[last], -1.0, 1.0)
    return np.concatenate([np.arcsin(share) / STRETCH, middle * np.arctan2(x, z)])


def nodes_of(frame: Frame, v: np.ndarray) -> np.ndarray:
    """Return the nodes (3, 2) O2, O3 and EE, m, of a pose ``v`` of :func:`rank`."""
    if v.size == 4:
        return np.vstack([v.reshape(2, 2), frame.ee])
    short, long = frame.bounds.T
    middle, half = (short + long) / 2, (long - short) / 2
    psi, lengths = v[2:] / middle, middle + half * np.append(np.sin(STRETCH * v[:2]), 0.0)
    steps = lengths[:, None] * np.stack([np.sin(psi), np.cos(psi)], axis=-1)
    return frame.o1 + np.cumsum(steps, axis=0)
