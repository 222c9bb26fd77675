"""The articulation of the arm in one point cloud: the paper's Eq. (KinObj), minimised by a Nelder–Mead simplex; all of it compiled.

The objective has kinks and jumps (a point that changes its segment changes a maximum), so a search that only compares values is used.
That also gives the bounds on the lengths of the segments their exact and simplest form: any pose within the bounds ranks before any pose
outside, and of two outside the one that violates them less (feasibility rules, Deb 2000); no weight has to be chosen and no bound is
overstepped.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pipeline.compiled import compiled, inner

INFEASIBLE = 1e3  # m; above every value of the objective that points within reach of an arm can give
TOLERANCE = 1e-5  # m; extent of the simplex at which a search has ended: 1e-4 rad on a link, a hundredth of the errors of the sensor
STEP = 0.02  # m; first extent of the simplex: how far a node moves between frames at 30 Hz
NEAR = 1e-3  # m; extent at which the first of two searches has done its part
MAX_STEPS = 2000
VARIABLES = 4  # x and z of O2 and of O3


class Frame(NamedTuple):
    """The I points of one frame, what is given of its pose, and room for what an evaluation finds of every point.

    Room is made once for a frame: compiled code that asks for memory takes longer to compile, and longer at every evaluation.
    """

    points: np.ndarray  # (2, I) x and z, m
    o1: np.ndarray  # (2,) m
    ee: np.ndarray  # (2,) m
    bounds: np.ndarray  # (3, 2) of the segments' lengths, m
    gamma1: float
    gamma2: float
    distance: np.ndarray  # (I,) to its segment, m
    signed: np.ndarray  # (3, I) by segment, as _assign writes it, m²
    bits: np.ndarray  # (3, I) the same memory read as integers with a sign
    unsigned: np.ndarray  # and without


def frame_of(points: np.ndarray, o1: np.ndarray, ee: np.ndarray, bounds: np.ndarray, gamma1: float, gamma2: float) -> Frame:
    """The frame of ``points`` (2, I) in m between ``o1`` and ``ee`` (2,)."""
    signed = np.empty((3, points.shape[1]))
    distance = np.empty(points.shape[1])
    return Frame(points, o1, ee, bounds, gamma1, gamma2, distance, signed, signed.view(np.int64), signed.view(np.uint64))


@inner
def rank_value(frame: Frame, v: np.ndarray) -> float:
    """Eq. (KinObj), m, of a ``frame`` at ``v`` = (O2, O3); outside the bounds on the lengths INFEASIBLE and the excess, m.

    A point belongs to the segment nearest to it, one nearest to a common node to both. d_a and d_u are the greatest distances of
    a segment's points on either side of its line, 0 where there are none.
    """
    nodes = ((frame.o1[0], frame.o1[1]), (v[0], v[1]), (v[2], v[3]), (frame.ee[0], frame.ee[1]))
    violation = 0.0
    for j in range(3):
        length = np.sqrt((nodes[j + 1][0] - nodes[j][0]) ** 2 + (nodes[j + 1][1] - nodes[j][1]) ** 2)
        violation += max(frame.bounds[j, 0] - length, 0.0) + max(length - frame.bounds[j, 1], 0.0)
    if not violation == 0.0:
        return INFEASIBLE + violation
    signed = frame.signed
    _assign(frame.points[0], frame.points[1], nodes, frame.distance, signed[0], signed[1], signed[2])
    asymmetry = 0.0
    for j in range(3):
        above, under = _greatest(signed[j], frame.bits[j], frame.unsigned[j])
        asymmetry += abs(np.sqrt(above) - np.sqrt(under))
    return frame.gamma1 * _sum(frame.distance) / frame.distance.size + frame.gamma2 * asymmetry


@inner
def _assign(
    x: np.ndarray, z: np.ndarray, nodes: tuple, distance: np.ndarray, first: np.ndarray, second: np.ndarray, third: np.ndarray
) -> None:
    """Distance of every point to its segment, and by segment its square: positive above the line, negative below, 0 for others' points.

    No branch and no sum within the loop, and every row an array of its own: so the compiler takes several points at once.
    """
    for i in range(x.size):
        of_first, side_first = _to_segment(x[i], z[i], nodes[0], nodes[1])
        of_second, side_second = _to_segment(x[i], z[i], nodes[1], nodes[2])
        of_third, side_third = _to_segment(x[i], z[i], nodes[2], nodes[3])
        nearest = of_first if of_first < of_second else of_second
        nearest = nearest if nearest < of_third else of_third
        distance[i] = np.sqrt(nearest)
        first[i] = _signed(nearest if of_first == nearest else 0.0, side_first)
        second[i] = _signed(nearest if of_second == nearest else 0.0, side_second)
        third[i] = _signed(nearest if of_third == nearest else 0.0, side_third)


@inner
def _to_segment(x: float, z: float, start: tuple[float, float], end: tuple[float, float]) -> tuple[float, float]:
    """Squared distance to the segment, and the side of its line.

    That to the node itself beyond an end, so that both of the node's segments find the very same number.
    """
    ux, uz = end[0] - start[0], end[1] - start[1]
    wx, wz = x - start[0], z - start[1]
    squared, along, side = ux * ux + uz * uz, wx * ux + wz * uz, wx * uz - wz * ux
    from_start, from_end = wx * wx + wz * wz, (x - end[0]) * (x - end[0]) + (z - end[1]) * (z - end[1])
    return from_start if along <= 0.0 else (from_end if along >= squared else side * side * (1.0 / squared)), side


@inner
def _signed(square: float, side: float) -> float:
    return square if side > 0.0 else -square


@inner
def _greatest(signed: np.ndarray, bits: np.ndarray, unsigned: np.ndarray) -> tuple[float, float]:
    """The greatest of the positive numbers and the size of the least of the negative ones, 0 where there are none; ``signed`` is used up.

    Read as integers, with a sign (``bits``) the positive doubles and without one (``unsigned``) the negative ones are greatest, and by
    size. Unlike a maximum of doubles, which has to look out for NaN, that of integers is taken of several at once. The first place turns
    them back into doubles.
    """
    above, under = np.int64(0), np.uint64(0)
    for i in range(signed.size):
        above = bits[i] if bits[i] > above else above
        under = unsigned[i] if unsigned[i] > under else under
    bits[0] = above
    greatest = signed[0]
    unsigned[0] = under
    return greatest, max(-signed[0], 0.0)


@inner
def _sum(values: np.ndarray) -> float:
    """In four parts: none waits for the one before."""
    part = (0.0, 0.0, 0.0, 0.0)
    whole = values.size - values.size % 4
    for i in range(0, whole, 4):
        part = part[0] + values[i], part[1] + values[i + 1], part[2] + values[i + 2], part[3] + values[i + 3]
    for i in range(whole, values.size):
        part = part[0] + values[i], part[1], part[2], part[3]
    return (part[0] + part[1]) + (part[2] + part[3])


def fit_frame(
    points: np.ndarray, o1: np.ndarray, ee: np.ndarray, start: np.ndarray, bounds: np.ndarray, gamma1: float, gamma2: float
) -> tuple[np.ndarray, float, bool]:
    """(O2, O3), value, ended: Nelder–Mead from ``start`` (4,), and once more from near its end with half the simplex, turned the other way.

    More restarts lower the objective by about 0.1 mm and the error of the angles not at all; nor does a first search that goes on to the
    TOLERANCE, which takes 1.7 times as long.
    """
    frame = frame_of(points, o1, ee, bounds, gamma1, gamma2)
    corners, values, room = np.empty((VARIABLES + 1, VARIABLES)), np.empty(VARIABLES + 1), np.empty((3, VARIABLES))
    corners[0], ended = start, False
    for step, extent in ((STEP, NEAR), (-STEP / 2, TOLERANCE)):
        ended = _simplex(frame, step, extent, corners, values, *room)
    return corners[0].copy(), float(values[0]), ended


@compiled()
def _simplex(
    frame: Frame, step: float, extent: float, corners: np.ndarray, values: np.ndarray, middle: np.ndarray, reflected: np.ndarray,
    tried: np.ndarray,
) -> bool:  # fmt: skip
    """One run of Nelder and Mead (1965), coefficients 1, 2, ½, ½, until the simplex is smaller than ``extent`` in every variable; whether
    it came to that.

    It begins at ``corners[0]`` of ``corners`` (n+1, n), and leaves the best there and its value in ``values[0]`` of ``values`` (n+1,);
    the other arrays (n,) are room. The values do not decide when to end: across a jump of the objective they never meet.
    """
    n = values.size - 1
    worst = corners[n]
    for i in range(1, n + 1):
        _copy(corners[i], corners[0])
        corners[i, i - 1] += step
    unknown = 0  # the first corner without a value
    for _ in range(MAX_STEPS):
        for i in range(unknown, n + 1):
            values[i] = rank_value(frame, corners[i])
        unknown = n + 1
        _order(corners, values)
        if _extent(corners) <= extent:
            return True
        at_worst = values[n]
        _mean(corners, middle)
        _place(reflected, middle, worst, -1.0)
        at_reflected = rank_value(frame, reflected)
        best, outside = at_reflected < values[0], at_reflected < at_worst
        if not best and at_reflected < values[n - 1]:
            _copy(worst, reflected)
            values[n] = at_reflected
            continue
        # expanded beyond the best, or contracted from what is hardly better than the worst
        _place(tried, middle, worst, -2.0 if best else (-0.5 if outside else 0.5))
        at_tried = rank_value(frame, tried)
        if at_tried < at_reflected and at_tried < at_worst:
            _copy(worst, tried)
            values[n] = at_tried
        elif best:
            _copy(worst, reflected)
            values[n] = at_reflected
        else:
            for i in range(1, n + 1):
                _place(corners[i], corners[0], corners[i], 0.5)
            unknown = 1
    return False


# Loops over four numbers, where array expressions would do: those take seconds more to compile
@inner
def _copy(corner: np.ndarray, other: np.ndarray) -> None:
    for j in range(corner.size):
        corner[j] = other[j]


@inner
def _place(corner: np.ndarray, middle: np.ndarray, other: np.ndarray, factor: float) -> None:
    """``corner`` at middle + factor·(other − middle)."""
    for j in range(corner.size):
        corner[j] = middle[j] + factor * (other[j] - middle[j])


@inner
def _mean(corners: np.ndarray, middle: np.ndarray) -> None:
    """``middle`` of all ``corners`` but the last."""
    for j in range(middle.size):
        total = 0.0
        for i in range(middle.size):
            total += corners[i, j]
        middle[j] = total / middle.size


@inner
def _extent(corners: np.ndarray) -> float:
    """Greatest distance from the first corner along any axis."""
    extent = 0.0
    for i in range(1, len(corners)):
        for j in range(corners.shape[1]):
            extent = max(extent, abs(corners[i, j] - corners[0, j]))
    return extent


@inner
def _order(corners: np.ndarray, values: np.ndarray) -> None:
    """Insertion sort in place: of a simplex mostly one corner changes, and equal ones stay in their order."""
    for i in range(1, values.size):
        place = i
        while place > 0 and values[place - 1] > values[place]:
            values[place - 1], values[place] = values[place], values[place - 1]
            for j in range(corners.shape[1]):
                corners[place - 1, j], corners[place, j] = corners[place, j], corners[place - 1, j]
            place -= 1
