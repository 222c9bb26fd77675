"""Compiled law of the model whose noise grows with the joint speed."""

from __future__ import annotations

import numpy as np

from pipeline.arm.compiled import plane_of
from pipeline.arm.numbers import Arm
from pipeline.core.compiled import passed
from pipeline.models.law import Numbers, Poses, at, jacobians, nominal_step, planar, transformed
from pipeline.models.serial import finish, joints_at, nominal_steps, scratch_at


@passed
def planar_scaled(numbers: Numbers, parameters: np.ndarray, arm: Arm, poses: Poses) -> int:
    """q + q̇ + η + D(q̇)ε, η ~ N(0, A), ε ~ N(0, B), q̇ = J⁻¹v; ``parameters`` (2·n·n,) the roots
    of A and B.
    """
    plane, (v, here, there) = plane_of(arm), planar(poses)
    noise, half = numbers.normal, len(parameters) // 2
    floor, gain = parameters[:half], parameters[half:]
    jacobian = jacobians(plane, here, numbers.room)
    for i in range(poses.count):
        dq = nominal_step(plane, jacobian, i, at(v, i))
        eta = transformed(floor, (noise[0, i], noise[1, i], noise[2, i]))
        epsilon = transformed(gain, (noise[3, i], noise[4, i], noise[5, i]))
        for j in range(3):
            there[j][i] = here[j][i] + dq[j] + eta[j] + dq[j] * epsilon[j]
    return 0


@passed
def scaled(numbers: Numbers, parameters: np.ndarray, arm: Arm, poses: Poses) -> int:
    """The same for any arm."""
    m, n, room = len(arm.rows), len(arm.sliding), numbers.room
    nominal_steps(arm, poses, room)
    own = room[scratch_at(n, m)]
    for j in range(n):
        dq = room[joints_at(n, m) + j]
        for i in range(poses.count):
            own[i] = dq[i]
        for k in range(n):
            floor, eta = parameters[j * n + k], numbers.normal[k]
            gain, epsilon = parameters[n * n + j * n + k], numbers.normal[n + k]
            for i in range(poses.count):
                dq[i] += floor * eta[i] + own[i] * (gain * epsilon[i])
    finish(arm, poses, room)
    return 0
