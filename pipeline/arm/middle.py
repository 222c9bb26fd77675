"""Numbers of an arm whose whole pose is the task, as seen from its third link
(:mod:`pipeline.arm.whole_pose`).

The frame of the third link has its z axis along joint 3. In it the joints 3 and 4 do not move, so
that what takes them out of the six equations of a step is the same at every pose, and the columns
of the others hang on three angles at most.
"""

from __future__ import annotations

import numpy as np

from pipeline.arm.folded import COSINE, SHIFT, SINE, TURN
from pipeline.arm.serial import SerialChain

JOINTS = (6, 7)  # of such an arm
# where each number stands: the Householder reflection that leaves one row of the column of joint 4
# (its factor; its vector but for the first entry, which is 1; the inverse of what is left), sine
# and cosine of the turn of the base, the inverse of the unit of angular rows, the square of twice
# the bound of the least singular value, as for seven joints √2 of it may be lost
FACTOR, VECTOR, OVER, BASE, ANGULAR, LEAST, SIZE = 0, 1, 4, 5, 7, 8, 9


def middle_of(chain: SerialChain) -> np.ndarray | None:
    """(SIZE,) those of a ``chain``; None where its task is not the whole pose, where it has not six
    or seven joints, all revolute, or where the joints 3 and 4 turn about one axis.
    """
    whole = chain.task == ("x", "y", "z", "rx", "ry", "rz")
    if not whole or len(chain.sliding) not in JOINTS or chain.sliding.any():
        return None
    frames = chain.numbers().frames
    sine, cosine = frames[3, SINE], frames[3, COSINE]
    axis, shift = np.array([0.0, -sine, cosine]), frames[3, SHIFT:]
    column = np.array([axis[1], *np.cross(shift, axis)])
    length = np.linalg.norm(column)
    if length < 1e-3 * chain.scale:
        return None
    left = -np.copysign(length, column[0])
    vector = column[1:] / (column[0] - left)
    turn = frames[0, TURN]
    result = np.empty(SIZE)
    result[FACTOR] = 2 / (1 + vector @ vector)
    result[VECTOR:OVER] = vector
    result[OVER] = 1 / left
    result[BASE : BASE + 2] = np.sin(turn), np.cos(turn)
    result[ANGULAR] = 1 / chain.length
    result[LEAST] = (2 * chain.numbers().least) ** 2
    return result
