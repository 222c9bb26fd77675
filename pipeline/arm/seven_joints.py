"""A step of seven revolute joints for one of the tip's whole pose, and J's null vector, a block of
poses at a time.
"""

from __future__ import annotations

import numpy as np

from pipeline.arm import middle
from pipeline.arm.minors import adjugate, dot, mirror, null, product, without
from pipeline.arm.numbers import Arm
from pipeline.arm.screws import at_end, at_start, inward, link_behind, outward, placed
from pipeline.arm.whole_pose import (
    MARGIN,
    MIRROR,
    STEP,
    Column,
    all_regular,
    angle,
    column,
    commanded,
    margin,
    place,
    put_six,
    reflection,
    taken_up,
    turn,
)
from pipeline.core.compiled import inlined, inner


@inner
def joint_steps(
    arm: Arm,
    constants: np.ndarray,
    q: np.ndarray,
    first: int,
    count: int,
    command: np.ndarray,
    room: np.ndarray,
) -> bool:
    """Put a step that does the task v, which is J⁺v but for a multiple of the null vector, of the
    ``count`` poses of ``q`` (7, P) from ``first`` on into ``room``, from row STEP on, and t of the
    reflection (t, 1) of the null vector to the last axis from row MIRROR on; whether all poses are
    far enough from singular for both to be exact to 1e-12 of their size.

    ``constants`` are those of the arm by :mod:`pipeline.arm.middle`; the first six rows of
    ``command`` (6 or more, WIDTH) are v.
    """
    rows, v = room.reshape(-1), command.reshape(-1)
    turn(arm, q, first, count, rows)
    numbers, over = reflection(arm, constants), constants[middle.ANGULAR]
    least = constants[middle.LEAST]
    base = constants[middle.BASE], constants[middle.BASE + 1]
    links = link_behind(arm, 0), link_behind(arm, 1), link_behind(arm, 2)
    l1, l2, l3, l4 = links[1], links[2], link_behind(arm, 3), link_behind(arm, 4)
    l5, l6, l7 = link_behind(arm, 5), link_behind(arm, 6), link_behind(arm, 7)
    for i in range(np.uint64(count)):
        a2, a3, a4 = angle(rows, 2, i), angle(rows, 3, i), angle(rows, 4, i)
        a5, a6 = angle(rows, 5, i), angle(rows, 6, i)
        tip = placed(l4, a5, placed(l5, a6, placed(l6, angle(rows, 7, i), l7.shift)))
        tip = placed(l3, a4, tip)
        y = commanded(links, (angle(rows, 1, i), a2, a3), v, i, base, over, tip)
        one = column(numbers, outward(l2, a3, at_start(l1, a2)))
        two = column(numbers, at_start(l2, a3))
        five = column(numbers, inward(l3, a4, at_end(l4)))
        six = column(numbers, inward(l3, a4, inward(l4, a5, at_end(l5))))
        seven = column(numbers, inward(l3, a4, inward(l4, a5, inward(l5, a6, at_end(l6)))))
        whole, columns = column(numbers, y), (one, two, five, six)
        # of the four rows without the joints 3 and 4: their null vector
        n = null(one.rows, two.rows, five.rows, six.rows, seven.rows)
        beside = Column(whole.rows, -n[4] * seven.fourth, -n[4] * seven.third)
        n3, n4 = taken_up(numbers, columns, n, beside)
        # its reflection leaves four columns, as far from singular as the five were
        t = mirror(n)
        one, two = _left(one, t[0], seven), _left(two, t[1], seven)
        five, six = _left(five, t[2], seven), _left(six, t[3], seven)
        columns = one, two, five, six
        inverse = adjugate(one.rows, two.rows, five.rows, six.rows)
        det = dot(one.rows, inverse[0])
        x = product(inverse, 1 / det, whole.rows)
        three, four = taken_up(numbers, columns, x, whole)
        put_six(rows, STEP, i, (x[0], x[1], three, four, x[2], x[3]))
        rows[place(STEP + 6, i)] = -dot(t, x)
        rows[place(MARGIN, i)] = margin(numbers, columns, inverse, det, tip, over, least)
        length = np.sqrt(dot(n, n) + n[4] * n[4] + n3 * n3 + n4 * n4)
        share = 1 / (n[4] + np.copysign(length, n[4]))
        h = share * n[0], share * n[1], share * n3, share * n4, share * n[2], share * n[3]
        put_six(rows, MIRROR, i, h)
    return all_regular(rows, count)


@inlined
def _left(one: Column, share: float, other: Column) -> Column:
    """``one`` − ``share``·``other``."""
    rows = without(one.rows, share, other.rows)
    return Column(rows, one.fourth - share * other.fourth, one.third - share * other.third)
