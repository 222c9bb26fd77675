"""Compiled law of the additive model."""

from __future__ import annotations

import numpy as np

from pipeline.arm.compiled import plane_of
from pipeline.arm.numbers import Arm
from pipeline.core.compiled import passed
from pipeline.models.law import Numbers, Poses, at, jacobians, nominal_step, planar, transformed
from pipeline.models.serial import finish, joints_at, nominal_steps


@passed
def planar_additive(numbers: Numbers, parameters: np.ndarray, arm: Arm, poses: Poses) -> int:
    """q + J⁻¹v + ω, ω ~ N(0, Σ_ω); ``parameters`` (n·n,) the root of Σ_ω."""
    plane, (v, here, there) = plane_of(arm), planar(poses)
    jacobian, noise = jacobians(plane, here, numbers.room), numbers.normal
    for i in range(poses.count):
        dq = nominal_step(plane, jacobian, i, at(v, i))
        omega = transformed(parameters, (noise[0, i], noise[1, i], noise[2, i]))
        for j in range(3):
            there[j][i] = here[j][i] + dq[j] + omega[j]
    return 0


@passed
def additive(numbers: Numbers, parameters: np.ndarray, arm: Arm, poses: Poses) -> int:
    """The same for any arm."""
    m, n, room = len(arm.rows), len(arm.sliding), numbers.room
    nominal_steps(arm, poses, room)
    for j in range(n):
        dq = room[joints_at(n, m) + j]
        for k in range(n):
            share, noise = parameters[j * n + k], numbers.normal[k]
            for i in range(poses.count):
                dq[i] += share * noise[i]
    finish(arm, poses, room)
    return 0
