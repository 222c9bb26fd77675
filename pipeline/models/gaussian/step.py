"""Compiled law of the Gaussian matrix model."""

from __future__ import annotations

import numpy as np

from pipeline.arm.compiled import Arm, joint_step, segments
from pipeline.core.compiled import passed
from pipeline.models.law import Numbers, at


@passed
def gaussian(
    numbers: Numbers, parameters: np.ndarray, arm: Arm, v: tuple, q: tuple, moved: tuple
) -> int:
    """A draw of N(q + J⁻¹v, s‖v‖²·I), s = α²(u² − ‖J⁻¹‖²)/9 or zero beyond u, which is counted;
    ``parameters`` (2,) α and u.
    """
    noise, clipped = numbers.normal, 0
    alpha, u = parameters[0], parameters[1]
    for i in range(len(q[0])):
        shape, (x, z, phi) = segments(arm, at(q, i)), at(v, i)
        square = 0.0
        for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)):
            column = joint_step(arm, shape, axis)
            square += column[0] * column[0] + column[1] * column[1] + column[2] * column[2]
        norm = np.sqrt(square)
        clipped += norm > u
        bounded = norm if norm < u else u
        deviation = np.sqrt(
            alpha * alpha * (u * u - bounded * bounded) / 9 * (x * x + z * z + phi * phi)
        )
        dq = joint_step(arm, shape, (x, z, phi))
        for j in range(len(q)):
            moved[j][i] = q[j][i] + dq[j] + deviation * noise[j, i]
    return clipped
