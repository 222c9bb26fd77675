"""The planar chain of :mod:`pipeline.arm.chain` for compiled code: one pose at a time.

Every function is inlined into the loop over a block of poses. None of them branches or calls the C
library, so that the compiler makes of the loop one over four poses at once. The closed form of
three joints is written out here and nowhere else in compiled code: callers hand over tuples.
"""

from __future__ import annotations

from typing import NamedTuple

from numba import float64, int64, types

from pipeline.arm.numbers import Arm
from pipeline.core.compiled import MATRIX, VECTOR, inlined
from pipeline.core.elementary import fma, sine_cosine


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
def turned(link: tuple, heading: float) -> tuple[float, float]:
    """x and z in m of a ``link`` that is turned by ``heading`` in rad."""
    (x, z), (sine, cosine) = link, sine_cosine(heading)
    return fma(cosine, x, sine * z), fma(cosine, z, -sine * x)


@inlined
def pose(arm: Plane, q: tuple) -> tuple[float, ...]:
    """x, z and φ (m, m, rad) of the end-effector at joint angles ``q`` in rad; φ in whole turns
    too.
    """
    (x, z), (s1, s2, s3) = arm.origin, arm.signs
    first, second, third = s1 * q[0], s1 * q[0] + s2 * q[1], s1 * q[0] + s2 * q[1] + s3 * q[2]
    ax, az = turned(arm.links[0], first)
    bx, bz = turned(arm.links[1], second)
    tx, tz = turned(arm.links[2], third)
    return x + ax + bx + tx, z + az + bz + tz, third


@inlined
def joint_step(arm: Plane, x: tuple, z: tuple, w: tuple) -> tuple[float, ...]:
    """J⁻¹w in rad for the task-space step ``w`` (m, m, rad) at the pose where the rows of J are,
    but for the joints' signs, ``x``, ``z`` and ones.

    No matrix is inverted: the first two joints give the wrist O3 its velocity w − φ·k×(EE − O3),
    the third takes up the rest of φ.
    """
    (x1, x2, x3), (z1, z2, z3), (vx, vz, phi) = x, z, w
    vx, vz = fma(-phi, x3, vx), fma(-phi, z3, vz)
    # of the wrist by the first two joints
    x1, x2, z1, z2 = x1 - x3, x2 - x3, z1 - z3, z2 - z3
    over = 1 / fma(x1, z2, -x2 * z1)
    first, second = fma(z2, vx, -x2 * vz) * over, fma(x1, vz, -z1 * vx) * over
    s1, s2, s3 = arm.signs
    return s1 * first, s2 * second, s3 * (phi - first - second)
