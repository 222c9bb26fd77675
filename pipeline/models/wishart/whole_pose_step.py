"""Compiled laws of the Wishart model by QR of Jᵀ for six and seven revolute joints whose task is
the whole pose of the tip: that of :func:`.serial_step.qr_transposed`, more than twice as fast.

With J = LQ the step is QᵀB⁻¹Q·J⁺v, and as UB⁻¹Uᵀ has the law of B⁻¹ for every orthonormal U,
neither factor is needed: what B⁻¹ does to J⁺v may be drawn along any orthonormal axes of J's row
space. For six joints these are the joints themselves; for seven the first six after the reflection
of the null vector to the last.

Blocks with a pose that is nearly singular take the general way, which tells what is singular.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.arm import seven_joints, six_joints
from pipeline.arm.middle import middle_of
from pipeline.arm.numbers import Arm
from pipeline.arm.serial import SerialChain
from pipeline.arm.whole_pose import MIRROR, SPARE, STEP, dot_six, less, place, put_six, six
from pipeline.core.compiled import inlined, passed
from pipeline.models.law import Numbers, Poses
from pipeline.models.wishart.action import act
from pipeline.models.wishart.serial_step import qr_transposed


def law_of(chain: SerialChain) -> tuple[Callable, list[float]]:
    """The law of QR of Jᵀ of a ``chain``; its parameters after d."""
    constants = middle_of(chain)
    if constants is None:
        return qr_transposed, []
    return {6: of_six, 7: of_seven}[len(chain.sliding)], constants.tolist()


@passed
def of_six(numbers: Numbers, parameters: np.ndarray, arm: Arm, poses: Poses) -> int:
    """A step of six joints; ``parameters`` (1 + middle.SIZE,) d and the constants of
    :mod:`pipeline.arm.middle`.
    """
    q, first, count, room = poses.q, poses.start, poses.count, numbers.room
    if not six_joints.joint_steps(arm, parameters[1:], q, first, count, poses.command, room):
        return qr_transposed(numbers, parameters, arm, poses)
    act(numbers, parameters[0], STEP, 6, SPARE, count)
    _move(poses, room)
    return 0


@passed
def of_seven(numbers: Numbers, parameters: np.ndarray, arm: Arm, poses: Poses) -> int:
    """The same of seven joints."""
    q, first, count, room = poses.q, poses.start, poses.count, numbers.room
    if not seven_joints.joint_steps(arm, parameters[1:], q, first, count, poses.command, room):
        return qr_transposed(numbers, parameters, arm, poses)
    _to_row_space(poses.command, room, count)
    act(numbers, parameters[0], STEP, 6, SPARE, count)
    _from_row_space(room, count)
    _move(poses, room)
    return 0


@inlined
def _to_row_space(command: np.ndarray, room: np.ndarray, count: int) -> None:
    """Reflect the joints' steps: six rows along J's row space; of the last, along the null vector,
    what the joints are commanded takes the place.
    """
    rows, w = room.reshape(-1), command.reshape(-1)
    for i in range(np.uint64(count)):
        h, x, commanded = six(rows, MIRROR, i), six(rows, STEP, i), six(w, 6, i)
        factor, seventh = 2 / (1 + dot_six(h, h)), w[place(12, i)]
        share = factor * (dot_six(h, x) + rows[place(STEP + 6, i)])
        put_six(rows, STEP, i, less(x, share, h))
        rows[place(STEP + 6, i)] = seventh - factor * (dot_six(h, commanded) + seventh)


@inlined
def _from_row_space(room: np.ndarray, count: int) -> None:
    """Reflect the steps back to the joints."""
    rows = room.reshape(-1)
    for i in range(np.uint64(count)):
        h, x, seventh = six(rows, MIRROR, i), six(rows, STEP, i), rows[place(STEP + 6, i)]
        share = 2 / (1 + dot_six(h, h)) * (dot_six(h, x) + seventh)
        put_six(rows, STEP, i, less(x, share, h))
        rows[place(STEP + 6, i)] = seventh - share


@inlined
def _move(poses: Poses, room: np.ndarray) -> None:
    """The next poses by the joints' steps."""
    start, stop = poses.start, poses.start + poses.count
    for j in range(len(poses.q)):
        step, here, there = room[STEP + j], poses.q[j, start:stop], poses.moved[j, start:stop]
        for i in range(poses.count):
            there[i] = here[i] + step[i]
