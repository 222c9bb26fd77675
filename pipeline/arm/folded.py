"""The frames of a serial chain as compiled code takes them: each a turn, a shift and a tilt."""

from __future__ import annotations

import numpy as np

# columns: the turn about z (rad), cosine and sine of the tilt about x, the shift before it (3, m)
TURN, COSINE, SINE, SHIFT = 0, 1, 2, 3


def folded(placements: np.ndarray) -> np.ndarray:
    """(n + 2, 6) of the ``placements`` (n + 1, 12) of :class:`pipeline.arm.serial.SerialChain`.

    A rotation is R_z(β)R_x(α)R_z(γ), and a revolute joint a turn about the z axis too: so β is
    joined to the turn of the joint before and γ to that of its own, and of nine products with the
    rotation's entries four are left. The last row is the turn after the tip's tilt.
    """
    result, own = np.zeros((len(placements) + 1, 6)), 0.0
    for row, placement in zip(result, placements, strict=False):
        rotation = placement[:9].reshape(3, 3)
        x, y = rotation[:2, 2]
        # of the two that leave the z axis tilted about x alone that of at most a right angle
        turn = np.arctan2(-x if y >= 0 else x, abs(y))
        back = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        rotation, shift = rotation.copy(), placement[9:].copy()
        rotation[:2], shift[:2] = back @ rotation[:2], back @ shift[:2]
        row[:] = own + turn, rotation[2, 2], -rotation[1, 2], *shift
        own = np.arctan2(-rotation[0, 1], rotation[0, 0])
    result[-1, [TURN, COSINE]] = own, 1.0
    return result
