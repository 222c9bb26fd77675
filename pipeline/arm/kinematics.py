"""Kinematics of any serial chain in compiled code, a block of poses at a time
(:mod:`pipeline.arm.rows`).
"""

import numpy as np

from pipeline.arm.interface import ArmConstants
from pipeline.arm.rows import (
    COSINE,
    JOINTS,
    POSITION,
    ROTATION,
    SINE,
    TURN,
    WIDTH,
    add_dot,
    dot,
    fill,
    scale,
)
from pipeline.arm.serial import FRAME_COSINE, FRAME_SHIFT, FRAME_SINE, FRAME_TURN
from pipeline.core.compiled import inlined, inner
from pipeline.core.elementary import sine_cosine

# coefficients of atan(t)/t in t²: up to t = tan(π/16) the first omitted one is below the last place
ARC = tuple((-1.0) ** k / (2 * k + 1) for k in range(12))


@inner
def tip(arm: ArmConstants, q: np.ndarray, start: int, count: int, block: np.ndarray) -> None:
    """Fill rotation and position of the tip, and axis and a point of every joint, in the base's
    axes, of ``count`` poses of ``q`` (n, P) from ``start`` on, in rad, m of prismatic joints.
    """
    flat, n = block.reshape(-1), len(arm.sliding)
    for k in range(12):
        fill(block, k, 1.0 if k in (3, 7, 11) else 0.0, count)
    for frame in range(n + 2):
        turn, joint = arm.frames[frame, FRAME_TURN], frame - 1
        if 0 <= joint < n and arm.sliding[joint] == 0.0:
            angle = q[joint, start : start + count]
            for i in range(count):
                sine, cosine = sine_cosine(turn + angle[i])
                flat[SINE * WIDTH + i], flat[COSINE * WIDTH + i] = sine, cosine
        else:
            sine, cosine = sine_cosine(turn)
            fill(block, SINE, sine, count)
            fill(block, COSINE, cosine, count)
        _follow(0, arm.frames[frame], flat, count)
        _follow(1, arm.frames[frame], flat, count)
        _follow(2, arm.frames[frame], flat, count)
        if frame < n:
            first = JOINTS + 6 * frame
            if arm.sliding[frame] > 0.0:
                way = q[frame, start : start + count]
                for k in range(3):
                    for i in range(count):
                        block[POSITION + k, i] += block[ROTATION + 3 * k + 2, i] * way[i]
            for k in range(3):
                for i in range(count):
                    block[first + k, i] = block[ROTATION + 3 * k + 2, i]
                    block[first + 3 + k, i] = block[POSITION + k, i]


@inlined
def _follow(k: int, frame: np.ndarray, flat: np.ndarray, count: int) -> None:
    """Row ``k``, a literal, of the frames: turned about their z axes, shifted and tilted."""
    c, s = frame[FRAME_COSINE], frame[FRAME_SINE]
    px, py, pz = frame[FRAME_SHIFT], frame[FRAME_SHIFT + 1], frame[FRAME_SHIFT + 2]
    for i in range(count):
        at = (ROTATION + 3 * k) * WIDTH + i
        sine, cosine = flat[SINE * WIDTH + i], flat[COSINE * WIDTH + i]
        x, y, z = flat[at], flat[at + WIDTH], flat[at + 2 * WIDTH]
        along, across = x * cosine + y * sine, y * cosine - x * sine
        flat[(POSITION + k) * WIDTH + i] += along * px + across * py + z * pz
        flat[at] = along
        flat[at + WIDTH] = across * c + z * s
        flat[at + 2 * WIDTH] = z * c - across * s


@inner
def task_jacobian(arm: ArmConstants, block: np.ndarray, first: int, count: int) -> None:
    """Fill the m·n rows of J, row by row, from ``first`` on, of poses whose :func:`tip` the
    ``block`` holds: velocities axis × (tip − point), or the axis of a joint that slides.
    """
    n = len(arm.sliding)
    for r in range(len(arm.rows)):
        row, unit = arm.rows[r], arm.units[r]
        y, z = (row + 1) % 3, (row + 2) % 3
        for j in range(n):
            entry, axis, sliding = first + r * n + j, JOINTS + 6 * j, arm.sliding[j] > 0.0
            ay, az, py, pz = axis + y, axis + z, axis + 3 + y, axis + 3 + z
            if row < 3 and not sliding:
                for i in range(count):
                    block[entry, i] = block[ay, i] * (
                        block[POSITION + z, i] - block[pz, i]
                    ) - block[az, i] * (block[POSITION + y, i] - block[py, i])
            else:
                factor = unit if row < 3 or not sliding else 0.0
                for i in range(count):
                    block[entry, i] = factor * block[axis + row % 3, i]


@inner
def cholesky(block, jacobian, lower, inverse, m: int, n: int, shift: float, count: int) -> None:
    """Rows from ``lower`` on (m·m) = L of JJᵀ − ``shift``·I = LLᵀ, from ``inverse`` on 1/L_rr; NaN
    where that matrix is not positive definite. Solutions lose digits by κ(J)²: at the least
    singular value of a regular pose, a thousandth of the greatest, J⁺ is exact to 1e-10.
    """
    for r in range(m):
        for s in range(r + 1):
            entry = lower + r * m + s
            dot(block, entry, jacobian + r * n, jacobian + s * n, n, count)
            add_dot(block, entry, -1.0, lower + r * m, lower + s * m, s, count)
            if s < r:
                scale(block, entry, inverse + s, count)
            else:
                for i in range(count):
                    root = np.sqrt(block[entry, i] - shift)
                    block[entry, i] = root
                    block[inverse + r, i] = 1.0 / root


@inner
def mark_singular(block, arm: ArmConstants, jacobian, lower, spare, out, count: int) -> None:
    """Row ``out`` = 1 where the least singular value of J is below the arm's, else 0; L of J from
    ``lower`` on, m·m + m rows of scratch from ``spare`` on.

    JJᵀ − least²·I is positive definite where no singular value is below. Blocks far from singular
    need no factor of it: (det L)² is at most the least squared singular value times the (m − 1)th
    power of the others' mean.
    """
    m, n, least = len(arm.rows), len(arm.sliding), arm.least
    fill(block, out, 1.0, count)
    fill(block, spare, 0.0, count)
    for r in range(m):
        add_dot(block, spare, 1.0, lower + r * m, lower + r * m, r + 1, count)
    for r in range(m):
        for i in range(count):
            square = block[lower + r * m + r, i] * block[lower + r * m + r, i]
            block[out, i] *= square * ((m - 1) / block[spare, i] if r > 0 else 1.0)
    near = 0
    for i in range(count):
        near += 0 if block[out, i] > 4.0 * least * least else 1  # NaN too
    fill(block, out, 0.0, count)
    if near == 0:
        return
    cholesky(block, jacobian, spare, spare + m * m, m, n, least * least, count)
    for r in range(m):
        for i in range(count):
            block[out, i] = block[out, i] if block[spare + r * m + r, i] > 0.0 else 1.0


@inner
def solve_lower(block: np.ndarray, lower: int, inverse: int, m: int, x: int, count: int) -> None:
    """The m rows x = L⁻¹x, by L and 1/L_rr of :func:`cholesky`."""
    for r in range(m):
        add_dot(block, x + r, -1.0, lower + r * m, x, r, count)
        scale(block, x + r, inverse + r, count)


@inner
def solve_upper(block: np.ndarray, lower: int, inverse: int, m: int, x: int, count: int) -> None:
    """The m rows x = L⁻ᵀx, likewise."""
    for r in range(m - 1, -1, -1):
        at = lower + (r + 1) * m + r
        add_dot(block, x + r, -1.0, at, x + r + 1, m - r - 1, count, m)
        scale(block, x + r, inverse + r, count)


@inner
def add_displacement(
    arm: ArmConstants, target: np.ndarray, block: np.ndarray, out: int, share: float, count: int
) -> None:
    """Add to the m rows from ``out`` on ``share`` times the task's rows of the displacement
    from the poses whose :func:`tip` the ``block`` holds to ``target`` (12,): the way in m and the
    rotation vector of R_target·Rᵀ times the unit of angular rows, in the base's axes.
    """
    if np.any(arm.rows > 2):
        rotation_vectors(target, block.reshape(-1), count)
    for r in range(len(arm.rows)):
        row, factor = arm.rows[r], share * arm.units[r]
        for i in range(count):
            block[out + r, i] += factor * (
                target[row] - block[POSITION + row, i] if row < 3 else block[TURN + row - 3, i]
            )


@inner
def rotation_vectors(target: np.ndarray, flat: np.ndarray, count: int) -> None:
    """Fill the rows TURN with the rotation vector of R = R_target·Rᵀ by the unit quaternion, whose
    real part is (1 + tr R)/4 by its square, half angles and a series. The error is 1e-15/(π −
    angle), 1e-12 a thousandth of a radian below half a turn.
    """
    ax, ay, az = target[3:6], target[6:9], target[9:12]
    for i in range(count):
        at = ROTATION * WIDTH + i
        bxx, bxy, bxz = flat[at], flat[at + WIDTH], flat[at + 2 * WIDTH]
        byx, byy, byz = flat[at + 3 * WIDTH], flat[at + 4 * WIDTH], flat[at + 5 * WIDTH]
        bzx, bzy, bzz = flat[at + 6 * WIDTH], flat[at + 7 * WIDTH], flat[at + 8 * WIDTH]
        xx = ax[0] * bxx + ax[1] * bxy + ax[2] * bxz
        yy = ay[0] * byx + ay[1] * byy + ay[2] * byz
        zz = az[0] * bzx + az[1] * bzy + az[2] * bzz
        # 4w(w, x, y, z)
        w = max(1.0 + xx + yy + zz, 1e-300)
        x = az[0] * byx + az[1] * byy + az[2] * byz - (ay[0] * bzx + ay[1] * bzy + ay[2] * bzz)
        y = ax[0] * bzx + ax[1] * bzy + ax[2] * bzz - (az[0] * bxx + az[1] * bxy + az[2] * bxz)
        z = ay[0] * bxx + ay[1] * bxy + ay[2] * bxz - (ax[0] * byx + ax[1] * byy + ax[2] * byz)
        over = 1.0 / np.sqrt(w * w + x * x + y * y + z * z)
        w, x, y, z = over * w, over * x, over * y, over * z
        # tan of a quarter, an eighth and a sixteenth of the angle over sin of its half
        quarter = 1.0 / (1.0 + w)
        square = x * x + y * y + z * z
        eighth = quarter / (1.0 + np.sqrt(1.0 + square * quarter * quarter))
        sixteenth = eighth / (1.0 + np.sqrt(1.0 + square * eighth * eighth))
        square *= sixteenth * sixteenth
        series = ARC[11]
        for k in range(10, -1, -1):
            series = series * square + ARC[k]
        length = 16.0 * sixteenth * series
        flat[TURN * WIDTH + i] = length * x
        flat[(TURN + 1) * WIDTH + i] = length * y
        flat[(TURN + 2) * WIDTH + i] = length * z
