"""J⁻¹v of six revolute joints and the whole pose of the tip, a block of poses at a time."""

from __future__ import annotations

import numpy as np

from pipeline.arm import middle
from pipeline.arm.minors import adjugate, dot, product
from pipeline.arm.numbers import Arm
from pipeline.arm.screws import at_end, at_start, inward, link_behind, outward, placed
from pipeline.arm.whole_pose import (
    MARGIN,
    STEP,
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
    """Put J⁻¹v of the ``count`` poses of ``q`` (6, P) from ``first`` on into ``room``, from row
    STEP on; whether all are far enough from singular for it to be exact to 1e-12 of its size.

    ``constants`` are those of the arm by :mod:`pipeline.arm.middle`; ``command`` (6, WIDTH) is v.
    """
    rows, v = room.reshape(-1), command.reshape(-1)
    turn(arm, q, first, count, rows)
    numbers, over = reflection(arm, constants), constants[middle.ANGULAR]
    least = constants[middle.LEAST]
    base = constants[middle.BASE], constants[middle.BASE + 1]
    links = link_behind(arm, 0), link_behind(arm, 1), link_behind(arm, 2)
    l1, l2, l3, l4 = links[1], links[2], link_behind(arm, 3), link_behind(arm, 4)
    l5, l6 = link_behind(arm, 5), link_behind(arm, 6)
    for i in range(np.uint64(count)):
        a2, a3, a4, a5 = angle(rows, 2, i), angle(rows, 3, i), angle(rows, 4, i), angle(rows, 5, i)
        tip = placed(l3, a4, placed(l4, a5, placed(l5, angle(rows, 6, i), l6.shift)))
        y = commanded(links, (angle(rows, 1, i), a2, a3), v, i, base, over, tip)
        one = column(numbers, outward(l2, a3, at_start(l1, a2)))
        two = column(numbers, at_start(l2, a3))
        five = column(numbers, inward(l3, a4, at_end(l4)))
        six = column(numbers, inward(l3, a4, inward(l4, a5, at_end(l5))))
        whole, columns = column(numbers, y), (one, two, five, six)
        inverse = adjugate(one.rows, two.rows, five.rows, six.rows)
        det = dot(one.rows, inverse[0])
        x = product(inverse, 1 / det, whole.rows)
        three, four = taken_up(numbers, columns, x, whole)
        put_six(rows, STEP, i, (x[0], x[1], three, four, x[2], x[3]))
        rows[place(MARGIN, i)] = margin(numbers, columns, inverse, det, tip, over, least)
    return all_regular(rows, count)
