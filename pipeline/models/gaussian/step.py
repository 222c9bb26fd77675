"""Compiled law of the Gaussian matrix model."""

from __future__ import annotations

import numpy as np

from pipeline.arm.compiled import plane_of
from pipeline.arm.numbers import Arm
from pipeline.core.compiled import passed
from pipeline.models.law import Numbers, Poses, at, jacobians, nominal_step, planar
from pipeline.models.serial import (
    finish,
    joints_at,
    nominal_steps,
    scratch_at,
    solve_lower,
)


@passed
def planar_gaussian(numbers: Numbers, parameters: np.ndarray, arm: Arm, poses: Poses) -> int:
    """A draw of N(q + J⁻¹v, s‖v‖²·I), s = α²(u² − ‖J⁻¹‖²)/9 or zero beyond u, which is counted;
    ``parameters`` (2,) α and u.
    """
    plane, (v, here, there) = plane_of(arm), planar(poses)
    noise, clipped = numbers.normal, 0
    alpha, u = parameters[0], parameters[1]
    jacobian = jacobians(plane, here, numbers.room)
    for i in range(poses.count):
        x, z, phi = at(v, i)
        square = 0.0
        for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)):
            column = nominal_step(plane, jacobian, i, axis)
            square += column[0] * column[0] + column[1] * column[1] + column[2] * column[2]
        norm = np.sqrt(square)
        clipped += norm > u
        bounded = norm if norm < u else u
        deviation = np.sqrt(
            alpha * alpha * (u * u - bounded * bounded) / 9 * (x * x + z * z + phi * phi)
        )
        dq = nominal_step(plane, jacobian, i, (x, z, phi))
        for j in range(3):
            there[j][i] = here[j][i] + dq[j] + deviation * noise[j, i]
    return clipped


@passed
def gaussian(numbers: Numbers, parameters: np.ndarray, arm: Arm, poses: Poses) -> int:
    """The same for any arm: N(q + J⁺v + (I − J⁺J)w, s‖v‖²·I), s = α²(u² − ‖J⁺‖²)/nm."""
    m, n, room, count = len(arm.rows), len(arm.sliding), numbers.room, poses.count
    alpha, u, clipped = parameters[0], parameters[1], 0
    nominal_steps(arm, poses, room)
    square, speed, column = scratch_at(n, m), scratch_at(n, m) + 1, scratch_at(n, m) + 2
    for i in range(count):
        room[square, i] = room[speed, i] = 0.0
    # ‖J⁺‖ = ‖L⁻¹‖, a column after the other
    for r in range(m):
        for s in range(m):
            for i in range(count):
                room[column + s, i] = 1.0 if s == r else 0.0
        solve_lower(room, column, n, m, count)
        for s in range(m):
            entry, total = room[column + s], room[square]
            for i in range(count):
                total[i] += entry[i] * entry[i]
        v, total = poses.command[r], room[speed]
        for i in range(count):
            total[i] += v[i] * v[i]
    deviation = room[speed]
    for i in range(count):
        norm = np.sqrt(room[square, i])
        clipped += norm > u
        bounded = norm if norm < u else u
        deviation[i] = np.sqrt(alpha * alpha * (u * u - bounded * bounded) / (n * m) * deviation[i])
    for j in range(n):
        dq, noise = room[joints_at(n, m) + j], numbers.normal[j]
        for i in range(count):
            dq[i] += deviation[i] * noise[i]
    finish(arm, poses, room)
    return clipped
