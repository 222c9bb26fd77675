"""The planar chain of :mod:`pipeline.arm.chain` for compiled code: one pose at a time.

Every function is inlined into the loop over a block of poses. None of them branches or calls the C
library, so that the compiler makes of the loop one over four poses at once. The closed form of
three joints is written out here and nowhere else in compiled code: callers hand over tuples.
"""

from __future__ import annotations

from math import factorial, pi, sin
from typing import NamedTuple

import numpy as np
from numba import float64, int64, types

from pipeline.arm.numbers import Arm
from pipeline.core.compiled import MATRIX, VECTOR, inlined

# Taylor coefficients of sine and cosine: within π/4 of zero the first term left out is below half a
# unit in the last place
SINE = tuple((-1.0) ** k / factorial(2 * k + 1) for k in range(8))
COSINE = tuple((-1.0) ** k / factorial(2 * k) for k in range(9))
# 2π in two parts, the first of so few digits that its product with a number of turns is exact;
# sin(pi) is what π lacks as a double
TURN = 6.28125
REST_OF_TURN = (2 * pi - TURN) + 2 * sin(pi)


class Plane(NamedTuple):
    """What one step needs of a planar chain."""

    links: tuple[tuple[float, float], ...]  # x and z of each link at q = 0, m
    signs: tuple[float, ...]  # sense of each joint about the plane's normal
    origin: tuple[float, float]  # x and z of O1, m


ARM = types.NamedTuple((VECTOR, MATRIX, VECTOR, types.Array(int64, 1, "C"), VECTOR, float64), Arm)


@inlined
def plane_of(arm: Arm) -> Plane:
    """The numbers of a planar chain, one by one, so that loops hold them in registers."""
    x1, z1, x2, z2, x3, z3, s1, s2, s3, x, z = (
        arm.plane[0],
        arm.plane[1],
        arm.plane[2],
        arm.plane[3],
        arm.plane[4],
        arm.plane[5],
        arm.plane[6],
        arm.plane[7],
        arm.plane[8],
        arm.plane[9],
        arm.plane[10],
    )
    return Plane(((x1, z1), (x2, z2), (x3, z3)), (s1, s2, s3), (x, z))


@inlined
def sine_cosine(angle: float) -> tuple[float, float]:
    """sin and cos of ``angle`` in rad to within 2e-15: the C library's are as good, but take one
    pose at a time, and the particle filter 1.7 times as long.

    The angle is brought within π of zero and divided by four, where Taylor's series converge at
    once; then it is doubled twice.
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
def segments(arm: Plane, q: tuple) -> tuple[float, ...]:
    """x and z in m of the segments O1O2, O2O3, O3EE, one after the other, at joint angles ``q`` in
    rad.
    """
    ((x1, z1), (x2, z2), (x3, z3)), (s1, s2, s3) = arm.links, arm.signs
    heading = s1 * q[0]
    sine, cosine = sine_cosine(heading)
    ax, az = cosine * x1 + sine * z1, cosine * z1 - sine * x1
    heading += s2 * q[1]
    sine, cosine = sine_cosine(heading)
    bx, bz = cosine * x2 + sine * z2, cosine * z2 - sine * x2
    heading += s3 * q[2]
    sine, cosine = sine_cosine(heading)
    tx, tz = cosine * x3 + sine * z3, cosine * z3 - sine * x3
    return ax, az, bx, bz, tx, tz


@inlined
def pose(arm: Plane, q: tuple) -> tuple[float, ...]:
    """x, z and φ (m, m, rad) of the end-effector at joint angles ``q`` in rad; φ in whole turns
    too.
    """
    (ax, az, bx, bz, tx, tz), (x, z), (s1, s2, s3) = segments(arm, q), arm.origin, arm.signs
    return x + ax + bx + tx, z + az + bz + tz, s1 * q[0] + s2 * q[1] + s3 * q[2]


@inlined
def joint_step(arm: Plane, shape: tuple, w: tuple) -> tuple[float, ...]:
    """J⁻¹w in rad for the task-space step ``w`` (m, m, rad) at the pose whose :func:`segments` are
    ``shape``.

    No matrix is formed: the first two joints give the wrist O3 its velocity w − φ·k×(EE − O3), the
    third takes up the rest of φ.
    """
    (ax, az, bx, bz, tx, tz), (x, z, phi) = shape, w
    over = 1 / (az * bx - ax * bz)
    x, z = x - phi * tz, z + phi * tx
    first = (bx * x + bz * z) * over
    second = -((ax + bx) * x + (az + bz) * z) * over
    s1, s2, s3 = arm.signs
    return s1 * first, s2 * second, s3 * (phi - first - second)
