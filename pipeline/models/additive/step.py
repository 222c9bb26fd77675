"""Compiled law of the additive model."""

from __future__ import annotations

import numpy as np

from pipeline.arm.compiled import Arm
from pipeline.core.compiled import passed
from pipeline.models.law import Numbers, at, nominal_step, transformed


@passed
def additive(
    numbers: Numbers, parameters: np.ndarray, arm: Arm, v: tuple, q: tuple, moved: tuple
) -> int:
    """q + J⁻¹v + ω, ω ~ N(0, Σ_ω); ``parameters`` (n·n,) the root of Σ_ω."""
    noise = numbers.normal
    for i in range(len(q[0])):
        dq = nominal_step(arm, q, i, at(v, i))
        omega = transformed(parameters, (noise[0, i], noise[1, i], noise[2, i]))
        for j in range(len(q)):
            moved[j][i] = q[j][i] + dq[j] + omega[j]
    return 0
