"""What six and seven revolute joints share on the way from a step of the tip's whole pose to one of
the joints, for compiled code: everything is seen from the third link (:mod:`.middle`).

Between the rows of a room scalars alone are kept, and no function branches, so that the compiler
computes several poses at once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pipeline.arm import folded, middle
from pipeline.arm.minors import dot
from pipeline.arm.numbers import Arm
from pipeline.arm.screws import back, cross, level, plus
from pipeline.arm.serial_compiled import WIDTH
from pipeline.core.compiled import inlined, inner
from pipeline.core.elementary import fma, sine_cosine

# rows of a room: sine and cosine of each joint's angle; the step of each joint; the reflection of
# the null vector to the last axis; how far from singular a pose is; from here on free ones
ANGLES, STEP, MIRROR, MARGIN, SPARE = 0, 14, 21, 27, 28


@inner
def turn(arm: Arm, q: np.ndarray, start: int, count: int, rows: np.ndarray) -> None:
    """Put sine and cosine of every joint's angle into ``rows`` (flat), of the ``count`` poses of
    ``q`` (n, P) from ``start`` on.
    """
    for j in range(len(arm.sliding)):
        offset, angle = arm.frames[j + 1, folded.TURN], q[j, start : start + count]
        for i in range(count):
            sine, cosine = sine_cosine(angle[i] + offset)
            at = (ANGLES + 2 * j) * WIDTH + i
            rows[at] = sine
            rows[at + WIDTH] = cosine


@inlined
def place(row: int, i: int) -> int:
    """Where pose ``i`` of a ``row`` of a room lies; without a sign, as ``i``, so that the compiler
    need not ask whether it counts from the end.
    """
    return np.uint64(row * WIDTH) + i


@inlined
def angle(rows: np.ndarray, joint: int, i: int) -> tuple[float, float]:
    """Sine and cosine of ``joint``, of which the first is 1, in pose ``i``."""
    at = ANGLES + 2 * joint - 2
    return rows[place(at, i)], rows[place(at + 1, i)]


class Column(NamedTuple):
    """A screw in the third link when the joints 3 and 4 are taken out of it: four rows that they do
    not move, and what they take up.
    """

    rows: tuple[float, float, float, float]
    fourth: float
    third: float


@inlined
def column(numbers: tuple, screw: tuple) -> Column:
    """That of a ``screw``; ``numbers`` are of :func:`reflection`."""
    (x, y, z), (mx, my, mz), (factor, u, v, w, _, _) = screw[0], screw[1], numbers
    share = factor * fma(u, mx, fma(v, my, fma(w, mz, y)))
    rows = x, fma(-u, share, mx), fma(-v, share, my), fma(-w, share, mz)
    return Column(rows, y - share, z)


@inlined
def reflection(arm: Arm, constants: np.ndarray) -> tuple[float, ...]:
    """The numbers by which the joints 3 and 4 are taken out, of the ``constants`` of the arm."""
    first = middle.VECTOR
    return (
        constants[middle.FACTOR],
        constants[first],
        constants[first + 1],
        constants[first + 2],
        constants[middle.OVER],
        arm.frames[3, folded.COSINE],
    )


@inlined
def commanded(
    links: tuple, angles: tuple, command: np.ndarray, i: int, base: tuple, over: float, tip: tuple
) -> tuple[tuple[float, ...], ...]:
    """The screw of the commanded step of pose ``i``, in the third link.

    Args:
        links: 0 to 2.
        angles: of the joints 1 to 3.
        command: (rows·WIDTH,) the steps of the tip are its first six rows.
        i: which pose.
        base: sine and cosine of the turn of the base.
        over: what angular rows are multiplied by.
        tip: place of the tip in the third link, m.
    """
    (l0, l1, l2), (a1, a2, a3) = links, angles
    x = six(command, 0, i)
    step = x[0], x[1], x[2]
    step = back(a1, level(l0, back(base, step)))
    step = back(a3, level(l2, back(a2, level(l1, step))))
    spin = over * x[3], over * x[4], over * x[5]
    spin = back(a1, level(l0, back(base, spin)))
    spin = back(a3, level(l2, back(a2, level(l1, spin))))
    return spin, plus(step, cross(tip, spin))


@inlined
def taken_up(numbers: tuple, columns: tuple, x: tuple, y: Column) -> tuple[float, float]:
    """The steps of the joints 3 and 4 that the steps ``x`` of the joints of four ``columns`` leave
    of ``y``.
    """
    fourth, third = passed_on(columns)
    four = (y.fourth - dot(fourth, x)) * numbers[4]
    return fma(-numbers[5], four, y.third - dot(third, x)), four


@inlined
def passed_on(columns: tuple) -> tuple[tuple[float, ...], ...]:
    """What the joints 4 and 3 take up of four ``columns``."""
    a, b, c, d = columns
    return (a.fourth, b.fourth, c.fourth, d.fourth), (a.third, b.third, c.third, d.third)


@inlined
def margin(
    numbers: tuple, columns: tuple, rows: tuple, det: float, tip: tuple, over: float, least: float
) -> float:
    """Above zero only where the least singular value of J is above the bound of a regular pose.

    It is no less than 1/‖J⁻¹‖, and that norm no more than the product of those of the inverse of
    the screws, row by row of what :func:`column` makes of them, and of the way from a step of the
    tip to the screw of one.

    Args:
        numbers: of :func:`reflection`.
        columns: those of the joints but 3 and 4.
        rows: their :func:`pipeline.arm.minors.adjugate`.
        det: their determinant.
        tip: place of the tip in the third link, m.
        over: the inverse of the unit of angular rows.
        least: the square of the bound, enlarged.
    """
    fourth, third = passed_on(columns)
    square, cosine = numbers[4] * numbers[4], numbers[5] * numbers[5]
    inverse = dot(rows[0], rows[0]) + dot(rows[1], rows[1])
    inverse += dot(rows[2], rows[2]) + dot(rows[3], rows[3])
    # (‖x‖ + ‖y‖)² ≤ 2‖x‖² + 2‖y‖², of what joint 3 takes up itself and by joint 4
    passed = fma(square * (1 + 2 * cosine), dot(fourth, fourth), 2 * dot(third, third))
    own = fma(square, 1 + cosine, 1.0)
    way = fma(over * over, fma(tip[0], tip[0], fma(tip[1], tip[1], fma(tip[2], tip[2], 1.0))), 1.0)
    return det * det - least * way * fma(inverse, 1 + passed, own * (det * det))


@inner
def all_regular(rows: np.ndarray, count: int) -> bool:
    """Whether the :func:`margin` of every pose is above zero."""
    near = 0
    for i in range(count):
        near += 0 if rows[MARGIN * WIDTH + i] > 0.0 else 1  # NaN too
    return near == 0


@inlined
def six(rows: np.ndarray, first: int, i: int) -> tuple[float, ...]:
    """The six numbers of pose ``i`` in ``rows`` (flat) from row ``first`` on."""
    return (
        rows[place(first, i)],
        rows[place(first + 1, i)],
        rows[place(first + 2, i)],
        rows[place(first + 3, i)],
        rows[place(first + 4, i)],
        rows[place(first + 5, i)],
    )


@inlined
def five(rows: np.ndarray, first: int, i: int) -> tuple[float, ...]:
    """The five numbers of pose ``i`` there."""
    return (
        rows[place(first, i)],
        rows[place(first + 1, i)],
        rows[place(first + 2, i)],
        rows[place(first + 3, i)],
        rows[place(first + 4, i)],
    )


@inlined
def put_six(rows: np.ndarray, first: int, i: int, x: tuple) -> None:
    """Put the six numbers ``x`` there."""
    rows[place(first, i)] = x[0]
    rows[place(first + 1, i)] = x[1]
    rows[place(first + 2, i)] = x[2]
    rows[place(first + 3, i)] = x[3]
    rows[place(first + 4, i)] = x[4]
    rows[place(first + 5, i)] = x[5]


@inlined
def dot_six(x: tuple, y: tuple) -> float:
    """The scalar product of six numbers and six."""
    return fma(x[0], y[0], fma(x[1], y[1], x[2] * y[2])) + fma(
        x[3], y[3], fma(x[4], y[4], x[5] * y[5])
    )


@inlined
def less(x: tuple, share: float, y: tuple) -> tuple[float, ...]:
    """The six numbers ``x`` − ``share``·``y``."""
    return (
        fma(-share, y[0], x[0]),
        fma(-share, y[1], x[1]),
        fma(-share, y[2], x[2]),
        fma(-share, y[3], x[3]),
        fma(-share, y[4], x[4]),
        fma(-share, y[5], x[5]),
    )
