"""Compiled laws of the Gaussian matrix models: :mod:`pipeline.motion.gaussian` and :mod:`pipeline.motion.gaussian_forward`."""

from __future__ import annotations

import numpy as np

from pipeline.compiled import inlined, passed
from pipeline.motion.compiled.chain import Arm, joint_step, segments
from pipeline.motion.compiled.law import Numbers


@passed
def of_inverse(numbers: Numbers, parameters: np.ndarray, arm: Arm, v: tuple, q: tuple, moved: tuple) -> int:
    """A draw of N(q + J⁻¹v, s‖v‖²·I), s = α²(u² − ‖J⁻¹‖²)/9 or zero beyond u, which is counted; ``parameters`` (2,) α and u."""
    noise, clipped = numbers.normal, 0
    alpha, u = parameters[0], parameters[1]
    command = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    for i in range(len(q[0])):
        shape = segments(arm, q[0][i], q[1][i], q[2][i])
        square = 0.0
        for x, z, phi in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)):
            column = joint_step(arm, *shape, x, z, phi)
            square += column[0] * column[0] + column[1] * column[1] + column[2] * column[2]
        norm = np.sqrt(square)
        clipped += norm > u
        bounded = norm if norm < u else u
        deviation = np.sqrt(alpha * alpha * (u * u - bounded * bounded) / 9 * command)
        dq = joint_step(arm, *shape, *v)
        for j in range(3):
            moved[j][i] = q[j][i] + dq[j] + deviation * noise[j, i]
    return clipped


@inlined
def turned(arm: Arm, r1: float, r2: float, r3: float, x: tuple, z: tuple) -> tuple[float, float, float]:
    """Jᵀr in the columns of J, whose rows are ``z``, −``x`` and 1 times the joints' signs."""
    return (
        arm.s1 * (r1 * z[0] - r2 * x[0] + r3),
        arm.s2 * (r1 * z[1] - r2 * x[1] + r3),
        arm.s3 * (r1 * z[2] - r2 * x[2] + r3),
    )


@passed
def of_forward(numbers: Numbers, parameters: np.ndarray, arm: Arm, v: tuple, q: tuple, moved: tuple) -> int:
    """A draw of q + (J + J_ν)⁻¹v = q + ‖v‖·c/(a₁·c), c = a₂ × a₃ of the rows of Rᵀ(J + J_ν); ``parameters`` (2,) α and u.

    R has the first column v/‖v‖. Beyond u, ‖J‖ > u, the step is the nominal one, and counted.
    """
    noise, clipped = numbers.normal, 0
    alpha, u = parameters[0], parameters[1]
    speed = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    e1, e2, e3 = (v[0] / speed, v[1] / speed, v[2] / speed) if speed > 0 else (1.0, 0.0, 0.0)
    # the columns of R: Householder's reflection of the first axis to v/‖v‖, its sign turned
    sign = -1.0 if e1 < 0 else 1.0
    m1, reach = e1 + sign, 1.0 + abs(e1)
    for i in range(len(q[0])):
        ax, az, bx, bz, tx, tz = segments(arm, q[0][i], q[1][i], q[2][i])
        x, z = (ax + bx + tx, bx + tx, tx), (az + bz + tz, bz + tz, tz)
        norm = np.sqrt(x[0] ** 2 + x[1] ** 2 + x[2] ** 2 + z[0] ** 2 + z[1] ** 2 + z[2] ** 2 + 3)
        clipped += norm > u
        bounded = norm if norm < u else u
        deviation = np.sqrt(alpha * alpha * (u * u - bounded * bounded) / 9)
        along = turned(arm, e1, e2, e3, x, z)
        p1, p2, p3 = turned(arm, sign * m1 * e2 / reach, sign * (e2 * e2 / reach - 1), sign * e3 * e2 / reach, x, z)
        r1, r2, r3 = turned(arm, sign * m1 * e3 / reach, sign * e2 * e3 / reach, sign * (e3 * e3 / reach - 1), x, z)
        p1, p2, p3 = p1 + deviation * noise[0, i], p2 + deviation * noise[1, i], p3 + deviation * noise[2, i]
        r1, r2, r3 = r1 + deviation * noise[3, i], r2 + deviation * noise[4, i], r3 + deviation * noise[5, i]
        c1, c2, c3 = p2 * r3 - p3 * r2, p3 * r1 - p1 * r3, p1 * r2 - p2 * r1
        length = np.sqrt(c1 * c1 + c2 * c2 + c3 * c3)
        scale = speed / (along[0] * c1 + along[1] * c2 + along[2] * c3 + deviation * length * noise[6, i])
        dq = joint_step(arm, ax, az, bx, bz, tx, tz, *v)
        dq = (scale * c1, scale * c2, scale * c3) if deviation > 0 else dq
        for j in range(3):
            moved[j][i] = q[j][i] + dq[j]
    return clipped
