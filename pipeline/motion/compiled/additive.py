"""Compiled laws of the models that add noise to the nominal step: :mod:`pipeline.motion.additive`, ``scaled`` and ``student``."""

from __future__ import annotations

import numpy as np

from pipeline.compiled import inlined, passed
from pipeline.motion.compiled.chain import Arm, joint_step, segments
from pipeline.motion.compiled.law import Numbers


@inlined
def coloured(root: np.ndarray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Normals of covariance root² from independent ones, ``root`` (9,) a symmetric matrix row by row."""
    return (
        root[0] * x + root[1] * y + root[2] * z,
        root[3] * x + root[4] * y + root[5] * z,
        root[6] * x + root[7] * y + root[8] * z,
    )


@passed
def additive(numbers: Numbers, parameters: np.ndarray, arm: Arm, v: tuple, q: tuple, moved: tuple) -> int:
    """q + J⁻¹v + ω, ω ~ N(0, Σ_ω); ``parameters`` (9,) the root of Σ_ω."""
    noise = numbers.normal
    for i in range(len(q[0])):
        dq = joint_step(arm, *segments(arm, q[0][i], q[1][i], q[2][i]), *v)
        omega = coloured(parameters, noise[0, i], noise[1, i], noise[2, i])
        for j in range(3):
            moved[j][i] = q[j][i] + dq[j] + omega[j]
    return 0


@passed
def scaled(numbers: Numbers, parameters: np.ndarray, arm: Arm, v: tuple, q: tuple, moved: tuple) -> int:
    """q + q̇ + η + D(q̇)ε, η ~ N(0, A), ε ~ N(0, B), q̇ = J⁻¹v; ``parameters`` (18,) the roots of A and B."""
    noise = numbers.normal
    for i in range(len(q[0])):
        dq = joint_step(arm, *segments(arm, q[0][i], q[1][i], q[2][i]), *v)
        eta = coloured(parameters[:9], noise[0, i], noise[1, i], noise[2, i])
        epsilon = coloured(parameters[9:], noise[3, i], noise[4, i], noise[5, i])
        for j in range(3):
            moved[j][i] = q[j][i] + dq[j] + eta[j] + dq[j] * epsilon[j]
    return 0


@passed
def student(numbers: Numbers, parameters: np.ndarray, arm: Arm, v: tuple, q: tuple, moved: tuple) -> int:
    """q + J⁻¹v + ω, ω | τ ~ N(0, Λ/τ), ντ ~ χ²(ν); ``parameters`` (10,) ν and the root of Λ."""
    nu, root = parameters[0], parameters[1:]
    tau, noise = numbers.chi_square, numbers.normal
    for i in range(len(q[0])):
        dq = joint_step(arm, *segments(arm, q[0][i], q[1][i], q[2][i]), *v)
        omega = coloured(root, noise[0, i], noise[1, i], noise[2, i])
        wide = 1.0 / np.sqrt(tau[i] / nu)
        for j in range(3):
            moved[j][i] = q[j][i] + dq[j] + wide * omega[j]
    return 0
