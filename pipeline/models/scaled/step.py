"""Compiled law of the model whose noise grows with the joint speed."""

from __future__ import annotations

import numpy as np

from pipeline.arm.compiled import Arm
from pipeline.core.compiled import passed
from pipeline.models.law import Numbers, at, nominal_step, transformed


@passed
def scaled(
    numbers: Numbers, parameters: np.ndarray, arm: Arm, v: tuple, q: tuple, moved: tuple
) -> int:
    """q + q̇ + η + D(q̇)ε, η ~ N(0, A), ε ~ N(0, B), q̇ = J⁻¹v; ``parameters`` (2·n·n,) the roots
    of A and B.
    """
    noise, half = numbers.normal, len(parameters) // 2
    for i in range(len(q[0])):
        dq = nominal_step(arm, q, i, at(v, i))
        eta = transformed(parameters[:half], (noise[0, i], noise[1, i], noise[2, i]))
        epsilon = transformed(parameters[half:], (noise[3, i], noise[4, i], noise[5, i]))
        for j in range(len(q)):
            moved[j][i] = q[j][i] + dq[j] + eta[j] + dq[j] * epsilon[j]
    return 0
