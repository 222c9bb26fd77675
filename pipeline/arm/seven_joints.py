"""A step of seven revolute joints for one of the tip's whole pose, and J's null vector, a block of
poses at a time.
"""

from __future__ import annotations

import numpy as np

from pipeline.arm import middle
from pipeline.arm.minors import dot, mirror, null, solved, without
from pipeline.arm.numbers import Arm
from pipeline.arm.screws import at_end, at_start, inward, link_behind, outward, placed
from pipeline.arm.whole_pose import (
    MIRROR,
    SQUARE,
    STEP,
    all_regular,
    angle,
    column,
    commanded,
    place,
    put_six,
    reflection,
    taken_up,
    turn,
)
from pipeline.core.compiled import inner


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
    base = constants[middle.BASE], constants[middle.BASE + 1]
    links = link_behind(arm, 0), link_behind(arm, 1), link_behind(arm, 2)
    l1, l2, l3, l4 = links[1], links[2], link_behind(arm, 3), link_behind(arm, 4)
    l5, l6, l7 = link_behind(arm, 5), link_behind(arm, 6), link_behind(arm, 7)
    for i in range(np.uint64(count)):
        a2, a3, a4 = angle(rows, 2, i), angle(rows, 3, i), angle(rows, 4, i)
        a5, a6 = angle(rows, 5, i), angle(rows, 6, i)
        tip = placed(l4, a5, placed(l5, a6, placed(l6, angle(rows, 7, i), l7.shift)))
        y = commanded(links, (angle(rows, 1, i), a2, a3), v, i, base, over, placed(l3, a4, tip))
        one = column(numbers, outward(l2, a3, at_start(l1, a2)))
        two = column(numbers, at_start(l2, a3))
        five = column(numbers, inward(l3, a4, at_end(l4)))
        six = column(numbers, inward(l3, a4, inward(l4, a5, at_end(l5))))
        seven = column(numbers, inward(l3, a4, inward(l4, a5, inward(l5, a6, at_end(l6)))))
        whole = column(numbers, y)
        fourth = one.fourth, two.fourth, five.fourth, six.fourth
        third = one.third, two.third, five.third, six.third
        # of the four rows without the joints 3 and 4: their null vector, whose reflection leaves
        # four columns and the equations as regular as they were
        n = null(one.rows, two.rows, five.rows, six.rows, seven.rows)
        left = -n[4] * seven.fourth, -n[4] * seven.third
        n3, n4 = taken_up(numbers, fourth, third, n, left)
        t = mirror(n)
        x, _ = solved(
            without(one.rows, t[0], seven.rows),
            without(two.rows, t[1], seven.rows),
            without(five.rows, t[2], seven.rows),
            without(six.rows, t[3], seven.rows),
            whole.rows,
        )
        last = -dot(t, x)
        left = whole.fourth - seven.fourth * last, whole.third - seven.third * last
        three, four = taken_up(numbers, fourth, third, x, left)
        put_six(rows, STEP, i, (x[0], x[1], three, four, x[2], x[3]))
        rows[place(STEP + 6, i)] = last
        square = dot(n, n) + n[4] * n[4] + n3 * n3 + n4 * n4
        share = 1 / (n[4] + np.copysign(np.sqrt(square), n[4]))
        h = share * n[0], share * n[1], share * n3, share * n4, share * n[2], share * n[3]
        put_six(rows, MIRROR, i, h)
        rows[place(SQUARE, i)] = square
    return all_regular(rows, constants[middle.LEAST], count)
