"""Constants of a chain as compiled code takes them, the same for planar and serial chains."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

POSE, JACOBIAN, SINGULAR, INVERSE = range(4)  # parts of the kinematics
# columns of a frame: the turn about z (rad), cosine and sine of the tilt about x, the shift before
# the tilt (3, m)
FRAME_TURN, FRAME_COSINE, FRAME_SINE, FRAME_SHIFT = 0, 1, 2, 3


class Arm(NamedTuple):
    """A chain of n joints and a task of m rows."""

    # (11,) of a planar chain its links' x and z (3·2, m), its signs (3) and its origin's x and z
    # (m); (0,) of a serial one
    plane: np.ndarray
    frames: np.ndarray  # (n + 2, 6) of a serial chain, by :func:`joint_frames`; (0, 6) of a planar
    sliding: np.ndarray  # (n,) 1 of a prismatic joint, 0 of a revolute one
    rows: np.ndarray  # (m,) the task's rows: 0 to 2 of velocity, 3 to 5 of angular velocity
    units: np.ndarray  # (m,) factor of a row: 1, or a length in m of an angular one
    least: float  # least singular value of the Jacobian at a regular pose


def joint_frames(placements: np.ndarray) -> np.ndarray:
    """(n + 2, 6) turn, tilt and shift of the ``placements`` (n + 1, 12) of a serial chain.

    A rotation is R_z(β)R_x(α)R_z(γ), and a revolute joint a turn about the z axis: β is added to
    the turn of the joint before and γ to that of its own joint, so that four products with the
    entries of a rotation remain of nine. The last row is the turn after the tip's tilt.
    """
    result, own = np.zeros((len(placements) + 1, 6)), 0.0
    for row, placement in zip(result, placements, strict=False):
        rotation, shift = placement[:9].reshape(3, 3).copy(), placement[9:].copy()
        x, y = rotation[:2, 2]
        # of the two turns that leave the z axis tilted about x alone the one of at most a right
        # angle
        turn = np.arctan2(-x if y >= 0 else x, abs(y))
        back = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        rotation[:2], shift[:2] = back @ rotation[:2], back @ shift[:2]
        row[:] = own + turn, rotation[2, 2], -rotation[1, 2], *shift
        own = np.arctan2(-rotation[0, 1], rotation[0, 0])
    result[-1, [FRAME_TURN, FRAME_COSINE]] = own, 1.0
    return result
