"""The planar chain of :mod:`pipeline.arm.chain` for compiled code: one particle at a time, in scalars.

Every function is inlined into the loop over a block of particles. None of them branches or calls the C library, so that the compiler
makes of the loop one over four particles at once.
"""

from __future__ import annotations

from math import factorial, pi, sin
from typing import NamedTuple

import numpy as np

from pipeline.arm.chain import PlanarChain
from pipeline.compiled import inlined

# Taylor coefficients of sine and cosine: within π/4 of zero the first term left out is below half a unit in the last place
SINE = tuple((-1.0) ** k / factorial(2 * k + 1) for k in range(8))
COSINE = tuple((-1.0) ** k / factorial(2 * k) for k in range(9))
# 2π in two parts, the first of so few digits that its product with a number of turns is exact; sin(pi) is what π lacks as a double
TURN = 6.28125
REST_OF_TURN = (2 * pi - TURN) + 2 * sin(pi)


class Arm(NamedTuple):
    """What one step needs of the chain: link vectors at q = 0 in m and the senses of the joints."""

    x1: float
    z1: float
    x2: float
    z2: float
    x3: float
    z3: float
    s1: float
    s2: float
    s3: float


def arm_of(chain: PlanarChain) -> Arm:
    """The numbers of ``chain``."""
    return Arm(*chain.links.ravel().tolist(), *np.asarray(chain.signs, dtype=float).tolist())


@inlined
def sine_cosine(angle: float) -> tuple[float, float]:
    """sin and cos of ``angle`` in rad to within 2e-15: the C library's are as good, but take one particle at a time.

    The angle is brought within π of zero and divided by four, where Taylor's series converge at once; then it is doubled twice.
    """
    turns = np.floor(angle / (2 * pi) + 0.5)
    quarter = 0.25 * ((angle - turns * TURN) - turns * REST_OF_TURN)
    square = quarter * quarter
    sine, cosine = SINE[7], COSINE[8]
    for k in range(6, -1, -1):
        sine = sine * square + SINE[k]
    for k in range(7, -1, -1):
        cosine = cosine * square + COSINE[k]
    sine *= quarter
    sine, cosine = 2 * sine * cosine, 1 - 2 * sine * sine
    return 2 * sine * cosine, 1 - 2 * sine * sine


@inlined
def segments(arm: Arm, q1: float, q2: float, q3: float) -> tuple[float, float, float, float, float, float]:
    """x and z in m of the segments O1O2, O2O3, O3EE at joint angles in rad."""
    heading = arm.s1 * q1
    sine, cosine = sine_cosine(heading)
    ax, az = cosine * arm.x1 + sine * arm.z1, cosine * arm.z1 - sine * arm.x1
    heading += arm.s2 * q2
    sine, cosine = sine_cosine(heading)
    bx, bz = cosine * arm.x2 + sine * arm.z2, cosine * arm.z2 - sine * arm.x2
    heading += arm.s3 * q3
    sine, cosine = sine_cosine(heading)
    tx, tz = cosine * arm.x3 + sine * arm.z3, cosine * arm.z3 - sine * arm.x3
    return ax, az, bx, bz, tx, tz


@inlined
def joint_step(
    arm: Arm, ax: float, az: float, bx: float, bz: float, tx: float, tz: float, x: float, z: float, phi: float
) -> tuple[float, float, float]:
    """J⁻¹w in rad for w = (``x``, ``z``, ``phi``) in m, m, rad at the pose of these segments.

    No matrix is formed: the first two joints give the wrist O3 its velocity w − φ·k×(EE − O3), the third takes up the rest of φ.
    """
    over = 1 / (az * bx - ax * bz)
    x, z = x - phi * tz, z + phi * tx
    first = (bx * x + bz * z) * over
    second = -((ax + bx) * x + (az + bz) * z) * over
    return arm.s1 * first, arm.s2 * second, arm.s3 * (phi - first - second)
