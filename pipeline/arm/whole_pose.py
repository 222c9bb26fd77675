"""What six and seven revolute joints share on the way from a step of the tip's whole pose to one of
the joints, for compiled code: everything is seen from the third link (:mod:`.middle`).

Between the rows of a room scalars alone are kept, and no function branches, so that the compiler
computes several poses at once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pipeline.arm import folded, middle
from pipeline.arm.compiled import sine_cosine
from pipeline.arm.minors import combined, dot
from pipeline.arm.numbers import Arm
from pipeline.arm.screws import back, cross, level, plus
from pipeline.arm.serial_compiled import WIDTH
from pipeline.core.compiled import inlined, inner

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
    share = factor * (y + u * mx + v * my + w * mz)
    return Column((x, mx - u * share, my - v * share, mz - w * share), y - share, z)


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
    return y.third - dot(third, x) - numbers[5] * four, four


@inlined
def passed_on(columns: tuple) -> tuple[tuple[float, ...], ...]:
    """What the joints 4 and 3 take up of four ``columns``."""
    a, b, c, d = columns
    return (a.fourth, b.fourth, c.fourth, d.fourth), (a.third, b.third, c.third, d.third)


@inlined
def margin(
    numbers: tuple, columns: tuple, rows: tuple, det: float, tip: tuple, over: float, least: float
) -> float:
    """Above zero only where the least singular value of J is above the root of ``least``, as it is
    no less than 1/‖J⁻¹‖: the square of ``det`` less that of ‖det·J⁻¹‖ times ``least``.

    Args:
        numbers: of :func:`reflection`.
        columns: those of the joints but 3 and 4.
        rows: their :func:`pipeline.arm.minors.adjugate`.
        det: their determinant.
        tip: place of the tip in the third link, m.
        over: the inverse of the unit of angular rows.
        least: the square of the bound.
    """
    fourth, third = passed_on(columns)
    up, by, cosine = det * numbers[4], -numbers[4], numbers[5]
    u, w = combined(rows, fourth), combined(rows, third)
    four = by * u[0], by * u[1], by * u[2], by * u[3]
    three = (
        -w[0] - cosine * four[0],
        -w[1] - cosine * four[1],
        -w[2] - cosine * four[2],
        -w[3] - cosine * four[3],
    )
    total = _square(numbers, rows[0], 0.0, 0.0, tip, over)
    total += _square(numbers, rows[1], 0.0, 0.0, tip, over)
    total += _square(numbers, rows[2], 0.0, 0.0, tip, over)
    total += _square(numbers, rows[3], 0.0, 0.0, tip, over)
    total += _square(numbers, four, up, 0.0, tip, over)
    total += _square(numbers, three, -cosine * up, det, tip, over)
    return det * det - least * total


@inlined
def _square(
    numbers: tuple, x: tuple, fourth: float, third: float, tip: tuple, over: float
) -> float:
    """The square of the length of a row of J⁻¹, which is ``x`` of a column's rows, ``fourth`` and
    ``third`` of what joints take up.
    """
    factor, u, v, w, _, _ = numbers
    share = factor * (fourth + u * x[1] + v * x[2] + w * x[3])
    moment = x[1] - u * share, x[2] - v * share, x[3] - w * share
    a, b, c = plus((x[0], fourth - share, third), cross(moment, tip))
    velocity = moment[0] * moment[0] + moment[1] * moment[1] + moment[2] * moment[2]
    return velocity + over * over * (a * a + b * b + c * c)


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
    return (x[0] * y[0] + x[1] * y[1] + x[2] * y[2]) + (x[3] * y[3] + x[4] * y[4] + x[5] * y[5])


@inlined
def less(x: tuple, share: float, y: tuple) -> tuple[float, ...]:
    """The six numbers ``x`` − ``share``·``y``."""
    return (
        x[0] - share * y[0],
        x[1] - share * y[1],
        x[2] - share * y[2],
        x[3] - share * y[3],
        x[4] - share * y[4],
        x[5] - share * y[5],
    )
