"""Compiled frames, Jacobians and displacements of a serial chain, a block of poses at a time
(:mod:`pipeline.arm.rows`).

The argument ``arm`` is the chain's :class:`ArmConstants`. Loops over :func:`lanes` also run on
arrays of poses without a compiler, as in an exported model.
"""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from pipeline.arm.rows import (
    COSINE,
    JOINTS,
    POSITION,
    ROTATION,
    SINE,
    TURN,
    WIDTH,
    fill,
    rows_of,
)
from pipeline.core.compiled import compiled, inlined, inner, lanes
from pipeline.core.elementary import sine_cosine

# columns of a link: turn about z (rad), cosine and sine of the tilt about x, shift before the
# tilt (3, m)
LINK_TURN = 0
LINK_COSINE = 1
LINK_SINE = 2
LINK_SHIFT = 3
# coefficients of atan(t)/t in t²; up to t = tan(π/16) the first omitted term is below rounding
ARC = tuple((-1.0) ** k / (2 * k + 1) for k in range(12))


class ArmConstants(NamedTuple):
    """Constants of a chain of n joints with m task rows."""

    base: ndarray  # (12,) position (m) and rotation, row by row, of the first joint's frame
    links: ndarray  # (n, 6) from a joint's frame to the next or the tip: :func:`link_constants`
    tip_turn: float  # rad, turn of the tip about the z axis of the last frame
    sliding: ndarray  # (n,) 1 for a prismatic, 0 for a revolute joint
    rows: ndarray  # (m,) task rows: 0 to 2 are velocity, 3 to 5 angular velocity
    units: ndarray  # (m,) factor of a row: 1, or a length in m for an angular row
    reach: float  # m, by which rows of velocity are divided to be without unit
    # least singular value, at a regular pose, of the Jacobian without units
    least: float


def link_constants(placements: ndarray) -> tuple[ndarray, ndarray, float]:
    """Return ``base``, ``links`` and ``tip_turn`` of :class:`ArmConstants` for the ``placements``
    (n + 1, 12), rotation (9) and translation (3, m). A placement's rotation is R_z(β)R_x(α)R_z(γ):
    β is added to the turn of the previous joint, γ to the turn of the next one.
    """
    base = np.concatenate([placements[0, 9:], placements[0, :9]])
    links = np.zeros((len(placements) - 1, 6))
    turn = 0.0
    for link, placement in zip(links, placements[1:], strict=True):
        rotation = placement[:9].reshape(3, 3)
        shift = placement[9:]
        # turn of at most a right angle after which z is tilted only about x
        x, y = rotation[:2, 2]
        before = np.arctan2(-x if y >= 0 else x, abs(y))
        cosine = np.cos(before)
        sine = np.sin(before)
        back = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        rotation = back @ rotation
        link[LINK_TURN] = turn + before
        link[LINK_COSINE] = rotation[2, 2]
        link[LINK_SINE] = -rotation[1, 2]
        link[LINK_SHIFT:] = back @ shift
        turn = np.arctan2(-rotation[0, 1], rotation[0, 0])
    return base, links, float(turn)


@compiled
def evaluate(arm, q):
    """Return the rows of a block up to the Jacobian's (``lower``, P), at the poses ``q`` (n, P) in
    rad or m: tip, axes of the joints, and J row by row.
    """
    rows = rows_of(len(arm.sliding), len(arm.rows))
    poses = q.shape[1]
    block = np.zeros((rows.lower, WIDTH))
    result = np.empty((rows.lower, poses))
    for start in range(0, poses, WIDTH):
        count = min(WIDTH, poses - start)
        tip(arm, q, start, count, block)
        task_jacobian(arm, block, rows.jacobian, count)
        turn_tip(arm, block, count)
        result[:, start : start + count] = block[:, :count]
    return result


@inner
def tip(arm, q, start, count, block):
    """Fill the tip's position, its rotation before the turn of :func:`turn_tip`, and each joint's
    axis and a point of the axis, in the base frame, at ``count`` poses of ``q`` (n, P) in rad or m
    from ``start`` on.
    """
    flat = block.reshape(-1)
    for k in range(12):
        fill(block, POSITION + k, arm.base[k], count)
    for joint in range(len(arm.sliding)):
        coordinate = q[joint, start : start + count]
        link = arm.links[joint]
        turn = link[LINK_TURN]
        sliding = arm.sliding[joint] > 0.0
        if sliding:
            for k in range(3):
                for i in lanes(count):
                    way = block[ROTATION + 3 * k + 2, i] * coordinate[i]
                    block[POSITION + k, i] += way
        axis = JOINTS + 6 * joint
        for k in range(3):
            for i in lanes(count):
                block[axis + k, i] = block[ROTATION + 3 * k + 2, i]
                block[axis + 3 + k, i] = block[POSITION + k, i]
        if sliding:
            sine, cosine = sine_cosine(turn)
            fill(block, SINE, sine, count)
            fill(block, COSINE, cosine, count)
        else:
            for i in lanes(count):
                sine, cosine = sine_cosine(turn + coordinate[i])
                flat[SINE * WIDTH + i] = sine
                flat[COSINE * WIDTH + i] = cosine
        _follow(0, link, flat, count)
        _follow(1, link, flat, count)
        _follow(2, link, flat, count)


@inlined
def _follow(k, link, flat, count):
    """Rotate row ``k`` (a literal) of the frames about the z axis, then shift and tilt it."""
    tilt_cosine = link[LINK_COSINE]
    tilt_sine = link[LINK_SINE]
    shift = link[LINK_SHIFT:]
    # first poses of the rows in the flat block
    position = (POSITION + k) * WIDTH
    x_axis = (ROTATION + 3 * k) * WIDTH
    y_axis = x_axis + WIDTH
    z_axis = y_axis + WIDTH
    for i in lanes(count):
        sine = flat[SINE * WIDTH + i]
        cosine = flat[COSINE * WIDTH + i]
        x = flat[x_axis + i]
        y = flat[y_axis + i]
        z = flat[z_axis + i]
        along = x * cosine + y * sine
        across = y * cosine - x * sine
        flat[position + i] += along * shift[0] + across * shift[1] + z * shift[2]
        flat[x_axis + i] = along
        flat[y_axis + i] = across * tilt_cosine + z * tilt_sine
        flat[z_axis + i] = z * tilt_cosine - across * tilt_sine


@inner
def turn_tip(arm, block, count):
    """Turn the last frame of :func:`tip` about its z axis into the tip's frame."""
    sine, cosine = sine_cosine(arm.tip_turn)
    for k in range(3):
        first = ROTATION + 3 * k
        second = first + 1
        for i in lanes(count):
            x = block[first, i]
            y = block[second, i]
            block[first, i] = x * cosine + y * sine
            block[second, i] = y * cosine - x * sine


@inner
def task_jacobian(arm, block, first, count):
    """Fill the m·n rows of J from ``first`` on, row by row, at the poses whose :func:`tip` is in
    the ``block``. Velocities are axis × (tip − point), or the axis of a prismatic joint.
    """
    n = len(arm.sliding)
    for r in range(len(arm.rows)):
        row = arm.rows[r]
        unit = arm.units[r]
        y = (row + 1) % 3
        z = (row + 2) % 3
        for j in range(n):
            entry = first + r * n + j
            axis = JOINTS + 6 * j
            sliding = arm.sliding[j] > 0.0
            if row < 3 and not sliding:
                point = axis + 3
                for i in lanes(count):
                    lever_y = block[POSITION + y, i] - block[point + y, i]
                    lever_z = block[POSITION + z, i] - block[point + z, i]
                    axis_y = block[axis + y, i]
                    axis_z = block[axis + z, i]
                    block[entry, i] = axis_y * lever_z - axis_z * lever_y
            else:
                factor = unit if row < 3 or not sliding else 0.0
                for i in lanes(count):
                    block[entry, i] = factor * block[axis + row % 3, i]


@inner
def add_displacement(arm, target, block, out, share, count):
    """Add ``share`` times the displacement to ``target`` (12,), in task rows, to the m rows from
    ``out`` on, at the poses whose :func:`tip` is in the ``block``.
    """
    if np.any(arm.rows > 2):
        turn_tip(arm, block, count)
        rotation_vectors(target, block.reshape(-1), count)
    for r in range(len(arm.rows)):
        row = arm.rows[r]
        factor = share * arm.units[r]
        if row < 3:
            for i in range(count):
                block[out + r, i] += factor * (target[row] - block[POSITION + row, i])
        else:
            for i in range(count):
                block[out + r, i] += factor * block[TURN + row - 3, i]


@inlined
def _product(row, x, y, z):
    return row[0] * x + row[1] * y + row[2] * z


@inner
def rotation_vectors(target, flat, count):
    """Fill the rows TURN with the rotation vector in rad of R_target·Rᵀ, by the unit quaternion,
    half angles and a series. The error is 1e-15/(π − angle).
    """
    ax = target[3:6]
    ay = target[6:9]
    az = target[9:12]
    for i in range(count):
        at = ROTATION * WIDTH + i
        bxx = flat[at]
        bxy = flat[at + WIDTH]
        bxz = flat[at + 2 * WIDTH]
        byx = flat[at + 3 * WIDTH]
        byy = flat[at + 4 * WIDTH]
        byz = flat[at + 5 * WIDTH]
        bzx = flat[at + 6 * WIDTH]
        bzy = flat[at + 7 * WIDTH]
        bzz = flat[at + 8 * WIDTH]
        xx = _product(ax, bxx, bxy, bxz)
        yy = _product(ay, byx, byy, byz)
        zz = _product(az, bzx, bzy, bzz)
        # 4w(w, x, y, z)
        w = max(1.0 + xx + yy + zz, 1e-300)
        x = _product(az, byx, byy, byz) - _product(ay, bzx, bzy, bzz)
        y = _product(ax, bzx, bzy, bzz) - _product(az, bxx, bxy, bxz)
        z = _product(ay, bxx, bxy, bxz) - _product(ax, byx, byy, byz)
        over = 1.0 / np.sqrt(w * w + x * x + y * y + z * z)
        w = over * w
        x = over * x
        y = over * y
        z = over * z
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
