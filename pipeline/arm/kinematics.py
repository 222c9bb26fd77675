"""Compiled kinematics of any serial chain, a block of poses at a time (:mod:`pipeline.arm.rows`).

The argument ``arm`` is the chain's :class:`pipeline.arm.interface.ArmConstants`.
"""

import numpy as np

from pipeline.arm.rows import (
    JOINTS,
    POSITION,
    ROTATION,
    SINE,
    TURN,
    WIDTH,
    add_dot,
    fill,
    scale,
)
from pipeline.arm.serial import FRAME_COSINE, FRAME_SHIFT, FRAME_SINE, FRAME_TURN
from pipeline.core.compiled import inlined, inner
from pipeline.core.elementary import sine_cosine

COSINE = SINE + 1
# coefficients of atan(t)/t in t²; up to t = tan(π/16) the first omitted term is below rounding
ARC = tuple((-1.0) ** k / (2 * k + 1) for k in range(12))


@inner
def tip(arm, q, start, count, block):
    """Fill the tip's rotation and position, and each joint's axis and a point of the axis, in the
    base frame, at ``count`` poses of ``q`` (n, P) in rad or m from ``start`` on.
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
                        block[POSITION + k, i] += (
                            block[ROTATION + 3 * k + 2, i] * way[i]
                        )
            for k in range(3):
                for i in range(count):
                    block[first + k, i] = block[ROTATION + 3 * k + 2, i]
                    block[first + 3 + k, i] = block[POSITION + k, i]


@inlined
def _follow(k, frame, flat, count):
    """Rotate row ``k`` (a literal) of the frames about the z axis, then shift and tilt it."""
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
def task_jacobian(arm, block, first, count):
    """Fill the m·n rows of J from ``first`` on, row by row, at the poses whose :func:`tip` is in
    the ``block``. Velocities are axis × (tip − point), or the axis of a prismatic joint.
    """
    n = len(arm.sliding)
    for r in range(len(arm.rows)):
        row, unit = arm.rows[r], arm.units[r]
        y, z = (row + 1) % 3, (row + 2) % 3
        for j in range(n):
            entry, axis, sliding = (
                first + r * n + j,
                JOINTS + 6 * j,
                arm.sliding[j] > 0.0,
            )
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
def cholesky(block, jacobian, lower, inverse, m, n, shift, count):
    """Fill L of JJᵀ − ``shift``·I = LLᵀ from row ``lower`` on (m·m) and 1/L_rr from ``inverse`` on;
    NaN if there is no factor. The relative error of J⁺ is at most 1e-10 at a regular pose.
    """
    for r in range(m):
        for s in range(r + 1):
            entry = lower + r * m + s
            fill(block, entry, 0.0, count)
            add_dot(block, entry, 1.0, jacobian + r * n, jacobian + s * n, n, count)
            add_dot(block, entry, -1.0, lower + r * m, lower + s * m, s, count)
            if s < r:
                scale(block, entry, inverse + s, count)
            else:
                for i in range(count):
                    root = np.sqrt(block[entry, i] - shift)
                    block[entry, i] = root
                    block[inverse + r, i] = 1.0 / root


@inner
def mark_singular(block, arm, jacobian, lower, spare, out, count):
    """Set row ``out`` to 1 where a singular value of J is below ``arm.least``, i.e. JJᵀ − least²·I
    has no factor, else to 0; m·m + m rows from ``spare`` on are scratch. Most blocks need no such
    factor: (det L)² is at most the least squared singular value times the (m − 1)th power of the
    mean of the other squares.
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
def solve_lower(block, lower, inverse, m, x, count):
    """Replace the m rows x by L⁻¹x, with L and 1/L_rr of :func:`cholesky`."""
    for r in range(m):
        add_dot(block, x + r, -1.0, lower + r * m, x, r, count)
        scale(block, x + r, inverse + r, count)


@inner
def solve_upper(block, lower, inverse, m, x, count):
    """Replace the m rows x by L⁻ᵀx."""
    for r in range(m - 1, -1, -1):
        at = lower + (r + 1) * m + r
        add_dot(block, x + r, -1.0, at, x + r + 1, m - r - 1, count, m)
        scale(block, x + r, inverse + r, count)


@inner
def add_displacement(arm, target, block, out, share, count):
    """Add ``share`` times the displacement to ``target`` (12,), in task rows, to the m rows from
    ``out`` on, at the poses whose :func:`tip` is in the ``block``.
    """
    if np.any(arm.rows > 2):
        rotation_vectors(target, block.reshape(-1), count)
    for r in range(len(arm.rows)):
        row, factor = arm.rows[r], share * arm.units[r]
        for i in range(count):
            block[out + r, i] += factor * (
                target[row] - block[POSITION + row, i]
                if row < 3
                else block[TURN + row - 3, i]
            )


@inner
def rotation_vectors(target, flat, count):
    """Fill the rows TURN with the rotation vector in rad of R_target·Rᵀ, by the unit quaternion,
    half angles and a series. The error is 1e-15/(π − angle).
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
        x = (
            az[0] * byx
            + az[1] * byy
            + az[2] * byz
            - (ay[0] * bzx + ay[1] * bzy + ay[2] * bzz)
        )
        y = (
            ax[0] * bzx
            + ax[1] * bzy
            + ax[2] * bzz
            - (az[0] * bxx + az[1] * bxy + az[2] * bxz)
        )
        z = (
            ay[0] * bxx
            + ay[1] * bxy
            + ay[2] * bxz
            - (ax[0] * byx + ax[1] * byy + ax[2] * byz)
        )
        over = 1.0 / np.sqrt(w * w + x * x + y * y + z * z)
        w, x, y, z = over * w, over * x, over * y, over * z
        # tan of a quarter, an eighth and a sixteenth of the angle, divided by sin of its half
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
