"""Compiled closed-form kinematics of a planar chain of three joints, in blocks of WIDTH poses
(:mod:`pipeline.arm.rows`). Loops index the flat block: LLVM sees that its rows do not overlap.
"""

from numpy import ndarray

from pipeline.arm.rows import WIDTH, block_rows
from pipeline.core.compiled import inlined, inner
from pipeline.core.elementary import sine_cosine

PLANAR = block_rows(3, 3)


@inlined
def rotate_link(x: float, z: float, heading: float) -> tuple[float, float]:
    """Coordinates x and z in m of a link (``x``, ``z``) rotated by ``heading`` in rad."""
    sine, cosine = sine_cosine(heading)
    return cosine * x + sine * z, cosine * z - sine * x


@inner
def planar_jacobian(arm, q, start, count, block):
    """Fill J, without the signs of the joints, at ``count`` poses of ``q`` (3, P) in rad from
    ``start`` on. Column j is (z, −x, 1) for the vector (x, z) in m from joint j to the tip.
    """
    s1, s2, s3 = arm.plane[6], arm.plane[7], arm.plane[8]
    flat, first = block.reshape(-1), PLANAR.jacobian * WIDTH
    stop = start + count
    q1, q2, q3 = q[0, start:stop], q[1, start:stop], q[2, start:stop]
    lx, lz = arm.plane[4], arm.plane[5]
    for i in range(
        count
    ):  # one loop per link, as a single loop needs too many registers
        x, z = rotate_link(lx, lz, s1 * q1[i] + s2 * q2[i] + s3 * q3[i])
        flat[first + 2 * WIDTH + i] = z
        flat[first + 5 * WIDTH + i] = -x
        flat[first + 6 * WIDTH + i] = 1.0
        flat[first + 7 * WIDTH + i] = 1.0
        flat[first + 8 * WIDTH + i] = 1.0
    lx, lz = arm.plane[2], arm.plane[3]
    for i in range(count):
        x, z = rotate_link(lx, lz, s1 * q1[i] + s2 * q2[i])
        flat[first + WIDTH + i] = flat[first + 2 * WIDTH + i] + z
        flat[first + 4 * WIDTH + i] = flat[first + 5 * WIDTH + i] - x
    lx, lz = arm.plane[0], arm.plane[1]
    for i in range(count):
        x, z = rotate_link(lx, lz, s1 * q1[i])
        flat[first + i] = flat[first + WIDTH + i] + z
        flat[first + 3 * WIDTH + i] = flat[first + 4 * WIDTH + i] - x


@inlined
def joint_step(flat: ndarray, i: int, vx: float, vz: float, phi: float) -> tuple:
    """J⁻¹v at pose ``i`` for the task step v = (``vx``, ``vz``, ``phi``), without the signs of the
    joints; formula of :meth:`pipeline.arm.chain.PlanarChain.inverse_jacobian`.
    """
    first = PLANAR.jacobian * WIDTH
    x3, z3 = flat[first + 2 * WIDTH + i], flat[first + 5 * WIDTH + i]
    x1, x2 = flat[first + i] - x3, flat[first + WIDTH + i] - x3
    z1, z2 = flat[first + 3 * WIDTH + i] - z3, flat[first + 4 * WIDTH + i] - z3
    vx, vz = vx - phi * x3, vz - phi * z3
    over = 1.0 / (x1 * z2 - x2 * z1)
    one, two = (z2 * vx - x2 * vz) * over, (x1 * vz - z1 * vx) * over
    return one, two, phi - one - two


@inner
def planar_steps(arm, block, count):
    """Set the joint-step rows to J⁻¹x for the task step x."""
    flat, x, y = block.reshape(-1), PLANAR.task * WIDTH, PLANAR.joints * WIDTH
    s1, s2, s3 = arm.plane[6], arm.plane[7], arm.plane[8]
    for i in range(count):
        vx, vz, phi = flat[x + i], flat[x + WIDTH + i], flat[x + 2 * WIDTH + i]
        one, two, three = joint_step(flat, i, vx, vz, phi)
        flat[y + i] = s1 * one
        flat[y + WIDTH + i] = s2 * two
        flat[y + 2 * WIDTH + i] = s3 * three


@inner
def planar_inverse_square(block, count):
    """Set the first scratch row to ‖J⁻¹‖_F²."""
    flat, out = block.reshape(-1), PLANAR.spare * WIDTH
    for i in range(count):
        x1, x2, x3 = joint_step(flat, i, 1.0, 0.0, 0.0)
        z1, z2, z3 = joint_step(flat, i, 0.0, 1.0, 0.0)
        p1, p2, p3 = joint_step(flat, i, 0.0, 0.0, 1.0)
        square = (x1 * x1 + x2 * x2 + x3 * x3) + (z1 * z1 + z2 * z2 + z3 * z3)
        flat[out + i] = square + (p1 * p1 + p2 * p2 + p3 * p3)


@inner
def add_planar_displacement(arm, target, q, start, count, share, block):
    """Add ``share``·(``target`` − x(q)) to the task step; φ keeps its whole turns."""
    flat, task, jacobian = (
        block.reshape(-1),
        PLANAR.task * WIDTH,
        PLANAR.jacobian * WIDTH,
    )
    s1, s2, s3 = arm.plane[6], arm.plane[7], arm.plane[8]
    stop = start + count
    q1, q2, q3 = q[0, start:stop], q[1, start:stop], q[2, start:stop]
    # column 1 of J is the vector from O1 to the tip, rotated by π/2
    x, z = target[0] - arm.plane[9], target[1] - arm.plane[10]
    for i in range(count):
        flat[task + i] += share * (x + flat[jacobian + 3 * WIDTH + i])
        flat[task + WIDTH + i] += share * (z - flat[jacobian + i])
        phi = s1 * q1[i] + s2 * q2[i] + s3 * q3[i]
        flat[task + 2 * WIDTH + i] += share * (target[2] - phi)
