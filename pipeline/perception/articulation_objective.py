"""The paper's objective of an articulation, Eq. (KinObj), of one point cloud; compiled.

What a search varies, and how it keeps to the bounds on the lengths of the segments, is said in
:mod:`pipeline.perception.articulation_end`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pipeline.core.compiled import inner


class Frame(NamedTuple):
    """The I points of one frame, what is given of its pose, and buffers of an evaluation."""

    points: np.ndarray  # (2, I) x and z, m
    o1: np.ndarray  # (2,) m
    ee: np.ndarray  # (2,) m, where it is commanded to be
    bounds: np.ndarray  # (3, 2) of the segments' lengths, m
    gamma1: float
    gamma2: float
    distance: np.ndarray  # (I,) to its segment, m
    signed: np.ndarray  # (4, I) by piece, as _assign writes it, m²
    bits: np.ndarray  # (4, I) the same memory read as integers with a sign
    unsigned: np.ndarray  # and without


def frame_of(
    points: np.ndarray,
    o1: np.ndarray,
    ee: np.ndarray,
    lengths: np.ndarray,
    length_range: float,
    gammas: tuple[float, float],
) -> Frame:
    """A frame.

    Args:
        points: (2, I) x and z, m.
        o1: (2,) first joint, m.
        ee: (2,) commanded end-effector, m.
        lengths: (3,) nominal lengths of the segments, m.
        length_range: each length lies within ± this share of the nominal one.
        gammas: γ1 and γ2.
    """
    signed = np.empty((4, points.shape[1]))
    distance = np.empty(points.shape[1])
    bounds = lengths[:, None] * np.array([1 - length_range, 1 + length_range])
    points, o1, ee, bounds = (np.array(array, order="C") for array in (points, o1, ee, bounds))
    return Frame(
        points,
        o1,
        ee,
        bounds,
        *gammas,
        distance,
        signed,
        signed.view(np.int64),
        signed.view(np.uint64),
    )


@inner
def excess(frame: Frame, nodes: tuple) -> float:
    """How far the segments between ``nodes`` overstep the bounds on their lengths, summed, m."""
    total = 0.0
    for j in range(3):
        length = np.sqrt(
            (nodes[j + 1][0] - nodes[j][0]) ** 2 + (nodes[j + 1][1] - nodes[j][1]) ** 2
        )
        short, long = frame.bounds[j, 0] - length, length - frame.bounds[j, 1]
        total += short if short > 0.0 else (long if long > 0.0 else 0.0)
    return total


@inner
def value(frame: Frame, nodes: tuple, pieces: int) -> float:
    """Eq. (KinObj), m, of a ``frame`` at the ``nodes`` (x, z) O1, O2, O3 and EE, m.

    A point belongs to the segment nearest to it, one nearest to a common node to both. d_a and d_u
    are the greatest distances of a segment's points on either side of its line, 0 where there are
    none. The three ``pieces`` that have both are the segments; of four, the last segment is two.
    """
    signed = frame.signed
    _assign(
        frame.points[0], frame.points[1], nodes, frame.distance, signed[0], signed[1], signed[2]
    )
    if pieces == 4:
        _halve(frame.points[0], frame.points[1], nodes[2], nodes[3], signed[2], signed[3])
    asymmetry = 0.0
    for j in range(pieces):
        above, under = _greatest(signed[j], frame.bits[j], frame.unsigned[j])
        asymmetry += abs(np.sqrt(above) - np.sqrt(under))
    return frame.gamma1 * _sum(frame.distance) / frame.distance.size + frame.gamma2 * asymmetry


@inner
def _assign(
    x: np.ndarray,
    z: np.ndarray,
    nodes: tuple,
    distance: np.ndarray,
    first: np.ndarray,
    second: np.ndarray,
    third: np.ndarray,
) -> None:
    """Distance of every point to its segment, and by segment its square: positive above the line,
    negative below, 0 for others' points.

    No branch and no sum within the loop, and every row an array of its own: so the compiler takes
    several points at once.
    """
    for i in range(x.size):
        to_first, side_first = _to_segment(x[i], z[i], nodes[0], nodes[1])
        to_second, side_second = _to_segment(x[i], z[i], nodes[1], nodes[2])
        to_third, side_third = _to_segment(x[i], z[i], nodes[2], nodes[3])
        nearest = to_first if to_first < to_second else to_second
        nearest = nearest if nearest < to_third else to_third
        distance[i] = np.sqrt(nearest)
        first[i] = _signed(nearest if to_first == nearest else 0.0, side_first)
        second[i] = _signed(nearest if to_second == nearest else 0.0, side_second)
        third[i] = _signed(nearest if to_third == nearest else 0.0, side_third)


@inner
def _halve(
    x: np.ndarray,
    z: np.ndarray,
    start: tuple[float, float],
    end: tuple[float, float],
    near: np.ndarray,
    far: np.ndarray,
) -> None:
    """What ``near`` holds of points beyond the middle of the segment moves to ``far``."""
    ux, uz = end[0] - start[0], end[1] - start[1]
    mx, mz = 0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1])
    for i in range(x.size):
        beyond = (x[i] - mx) * ux + (z[i] - mz) * uz > 0.0
        far[i] = near[i] if beyond else 0.0
        near[i] = 0.0 if beyond else near[i]


@inner
def _to_segment(
    x: float, z: float, start: tuple[float, float], end: tuple[float, float]
) -> tuple[float, float]:
    """Squared distance to the segment, and the side of its line.

    That to the node itself beyond an end, so that both of the node's segments find the very same
    number.
    """
    ux, uz = end[0] - start[0], end[1] - start[1]
    wx, wz = x - start[0], z - start[1]
    squared, along, side = ux * ux + uz * uz, wx * ux + wz * uz, wx * uz - wz * ux
    from_start, from_end = (
        wx * wx + wz * wz,
        (x - end[0]) * (x - end[0]) + (z - end[1]) * (z - end[1]),
    )
    return from_start if along <= 0.0 else (
        from_end if along >= squared else side * side * (1.0 / squared)
    ), side


@inner
def _signed(square: float, side: float) -> float:
    return square if side > 0.0 else -square


@inner
def _greatest(signed: np.ndarray, bits: np.ndarray, unsigned: np.ndarray) -> tuple[float, float]:
    """The greatest of the positive numbers and the size of the least of the negative ones, 0 where
    there are none; ``signed`` is used up.

    Read as integers, with a sign (``bits``) the positive doubles and without one (``unsigned``) the
    negative ones are greatest, and by size. Unlike a maximum of doubles, which has to look out for
    NaN, that of integers is taken of several at once. The first place turns them back into doubles.
    """
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
    """In four parts: none waits for the one before."""
    part = (0.0, 0.0, 0.0, 0.0)
    whole = values.size - values.size % 4
    for i in range(0, whole, 4):
        part = (
            part[0] + values[i],
            part[1] + values[i + 1],
            part[2] + values[i + 2],
            part[3] + values[i + 3],
        )
    for i in range(whole, values.size):
        part = part[0] + values[i], part[1], part[2], part[3]
    return (part[0] + part[1]) + (part[2] + part[3])
