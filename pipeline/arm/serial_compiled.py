"""Kinematics of a serial chain for compiled code, a block of poses at a time.

A block lies in a *room*: a C matrix (rows, WIDTH) whose columns are poses. Each function goes
through rows and, inside, through poses, with neither branches nor calls of the C library there, so
that the compiler makes of the inner loop one over four poses at once. That the distance of rows is
a constant lets it see which do not overlap, whatever the numbers of joints and of task rows.
"""

from __future__ import annotations

import numpy as np

from pipeline.arm import folded
from pipeline.arm.compiled import sine_cosine
from pipeline.arm.numbers import Arm
from pipeline.core.compiled import compiled, inlined, inner

WIDTH = 64  # poses of a room
# coefficients of atan(t)/t in t²: up to t = tan(π/16) the first left out is below the last place
ARC = tuple((-1.0) ** k / (2 * k + 1) for k in range(12))
# rows of a room; the first twelve are the tip's pose
POSITION, ROTATION = 0, 3  # of the tip: (3) in m, and (9) row by row
SINE, COSINE = 12, 13  # of the turn of one frame
TURN = 12  # the rotation vector (3) of a displacement, when the joints are done
JOINTS = 15  # for each joint its axis (3) and a point of it (3, m)


@compiled()
def jacobian_at(n: int) -> int:
    """The first of the m·n rows of the Jacobian of ``n`` joints, row by row."""
    return JOINTS + 6 * n


@compiled()
def lower_at(n: int, m: int) -> int:
    """The first of the m·m rows of L of J = LQ, row by row."""
    return JOINTS + 6 * n + m * n


@compiled()
def spare_at(n: int, m: int) -> int:
    """The first row of a room that the kinematics of ``n`` joints and ``m`` task rows leaves
    free.
    """
    return JOINTS + 6 * n + m * n + m * m


@inner
def tip(arm: Arm, q: np.ndarray, start: int, count: int, room: np.ndarray) -> None:
    """Put into ``room`` rotation and position of the tip, and axis and a point of every joint, all
    in the base's axes, of the ``count`` poses of ``q`` (n, P) from ``start`` on, in rad, m of
    prismatic joints.

    Each frame is turned by the joint before, shifted and tilted (:mod:`pipeline.arm.folded`).
    """
    rows, n = room.reshape(-1), len(arm.sliding)
    for k in range(12):
        for i in range(count):
            rows[k * WIDTH + i] = 0.0
    for k in range(3):
        for i in range(count):
            rows[(ROTATION + 4 * k) * WIDTH + i] = 1.0
    for frame in range(n + 2):
        turn, joint = arm.frames[frame, folded.TURN], frame - 1
        if 0 <= joint < n and arm.sliding[joint] == 0.0:
            angle = q[joint, start : start + count]
            for i in range(count):
                sine, cosine = sine_cosine(angle[i] + turn)
                rows[SINE * WIDTH + i] = sine
                rows[COSINE * WIDTH + i] = cosine
        else:
            sine, cosine = sine_cosine(turn)
            for i in range(count):
                rows[SINE * WIDTH + i] = sine
                rows[COSINE * WIDTH + i] = cosine
        _follow(0, arm.frames[frame], rows, count)
        _follow(1, arm.frames[frame], rows, count)
        _follow(2, arm.frames[frame], rows, count)
        if frame < n:
            if arm.sliding[frame] > 0.0:
                _slide(q[frame, start : start + count], rows, count)
            for k in range(3):
                axis, point = room[JOINTS + 6 * frame + k], room[JOINTS + 6 * frame + 3 + k]
                along, here = room[ROTATION + 3 * k + 2], room[POSITION + k]
                for i in range(count):
                    axis[i] = along[i]
                    point[i] = here[i]


@inlined
def _follow(k: int, frame: np.ndarray, rows: np.ndarray, count: int) -> None:
    """Make of row ``k`` of the frames in ``rows`` that of those which are turned about their z
    axes, then shifted and tilted as ``frame`` (6,) says.

    The compiler computes several poses at once only where ``k`` is a number in the text of the
    call.
    """
    c, s = frame[folded.COSINE], frame[folded.SINE]
    px, py, pz = frame[folded.SHIFT], frame[folded.SHIFT + 1], frame[folded.SHIFT + 2]
    for i in range(count):
        at = (ROTATION + 3 * k) * WIDTH + i
        sine, cosine = rows[SINE * WIDTH + i], rows[COSINE * WIDTH + i]
        x, y, z = rows[at], rows[at + WIDTH], rows[at + 2 * WIDTH]
        turned, across = x * cosine + y * sine, y * cosine - x * sine
        rows[(POSITION + k) * WIDTH + i] += turned * px + across * py + z * pz
        rows[at] = turned
        rows[at + WIDTH] = across * c + z * s
        rows[at + 2 * WIDTH] = z * c - across * s


@inlined
def _slide(way: np.ndarray, rows: np.ndarray, count: int) -> None:
    """Move the frames in ``rows`` by ``way`` (count,) in m along their z axes."""
    for k in range(3):
        for i in range(count):
            along = rows[(ROTATION + 3 * k + 2) * WIDTH + i]
            rows[(POSITION + k) * WIDTH + i] += along * way[i]


@inner
def task_jacobian(arm: Arm, room: np.ndarray, count: int) -> None:
    """Put the task's rows of the Jacobian into ``room`` (from row :func:`jacobian_at` on, entry (r,
    j) in row r·n + j) of the first ``count`` poses, whose :func:`tip` it holds.

    A joint gives the tip the velocity of its axis × the way from it, or that of its axis where it
    slides; angular rows are multiplied by their unit.
    """
    n = len(arm.sliding)
    for r in range(len(arm.rows)):
        row, unit = arm.rows[r], arm.units[r]
        y, z = (row + 1) % 3, (row + 2) % 3
        to_y, to_z = room[POSITION + y], room[POSITION + z]
        for j in range(n):
            entry, first = room[jacobian_at(n) + r * n + j], JOINTS + 6 * j
            along, across_y, across_z = room[first + row % 3], room[first + y], room[first + z]
            from_y, from_z = room[first + 3 + y], room[first + 3 + z]
            sliding = arm.sliding[j] > 0.0
            if row < 3 and not sliding:
                for i in range(count):
                    entry[i] = across_y[i] * (to_z[i] - from_z[i]) - across_z[i] * (
                        to_y[i] - from_y[i]
                    )
            elif row < 3 or not sliding:
                for i in range(count):
                    entry[i] = unit * along[i]
            else:
                for i in range(count):
                    entry[i] = 0.0


@inner
def displacement_rows(
    arm: Arm, target: np.ndarray, room: np.ndarray, count: int, out: np.ndarray, share: float
) -> None:
    """Add to ``out`` (m, count or more) ``share`` times the task's rows of the displacement from
    the first ``count`` poses, whose :func:`tip` ``room`` holds, to ``target`` (12,).

    The way in m and the rotation vector of R_target·Rᵀ, which angular rows multiply by their unit,
    in the base's axes; exact to rounding up to angles of π.
    """
    if np.any(arm.rows > 2):
        _turn(target, room.reshape(-1), count)
    for r in range(len(arm.rows)):
        row, entry, factor = arm.rows[r], out[r], share * arm.units[r]
        if row < 3:
            here = room[POSITION + row]
            for i in range(count):
                entry[i] += factor * (target[row] - here[i])
        else:
            turn = room[TURN + row - 3]
            for i in range(count):
                entry[i] += factor * turn[i]


@inlined
def _turn(target: np.ndarray, rows: np.ndarray, count: int) -> None:
    """Put the rotation vector of R_target·Rᵀ into its rows.

    By the unit quaternion, taken from the greatest column of 4qqᵀ, whose entries are sums of those
    of the rotation; its angle by half angles and a series, as the C library's takes one pose at a
    time.
    """
    axx, axy, axz = target[3], target[4], target[5]
    ayx, ayy, ayz = target[6], target[7], target[8]
    azx, azy, azz = target[9], target[10], target[11]
    for i in range(count):
        at = ROTATION * WIDTH + i
        bxx, bxy, bxz = rows[at], rows[at + WIDTH], rows[at + 2 * WIDTH]
        byx, byy, byz = rows[at + 3 * WIDTH], rows[at + 4 * WIDTH], rows[at + 5 * WIDTH]
        bzx, bzy, bzz = rows[at + 6 * WIDTH], rows[at + 7 * WIDTH], rows[at + 8 * WIDTH]
        xx = axx * bxx + axy * bxy + axz * bxz
        xy = axx * byx + axy * byy + axz * byz
        xz = axx * bzx + axy * bzy + axz * bzz
        yx = ayx * bxx + ayy * bxy + ayz * bxz
        yy = ayx * byx + ayy * byy + ayz * byz
        yz = ayx * bzx + ayy * bzy + ayz * bzz
        zx = azx * bxx + azy * bxy + azz * bxz
        zy = azx * byx + azy * byy + azz * byz
        zz = azx * bzx + azy * bzy + azz * bzz
        ww, vx = 1.0 + xx + yy + zz, 1.0 + xx - yy - zz
        vy, vz = 1.0 - xx + yy - zz, 1.0 - xx - yy + zz
        # the greater of the first two columns, and of the last two
        by_w, by_y = ww >= vx, vy >= vz
        w1, x1 = ww if by_w else zy - yz, zy - yz if by_w else vx
        y1, z1 = xz - zx if by_w else xy + yx, yx - xy if by_w else xz + zx
        w2, x2 = xz - zx if by_y else yx - xy, xy + yx if by_y else xz + zx
        y2, z2 = vy if by_y else yz + zy, yz + zy if by_y else vz
        first = max(ww, vx) >= max(vy, vz)
        w, x = w1 if first else w2, x1 if first else x2
        y, z = y1 if first else y2, z1 if first else z2
        over = np.copysign(1.0 / np.sqrt(w * w + x * x + y * y + z * z), w)
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
        rows[TURN * WIDTH + i] = length * x
        rows[(TURN + 1) * WIDTH + i] = length * y
        rows[(TURN + 2) * WIDTH + i] = length * z
