"""The numbers of a chain that compiled code needs, the same for both kinds of chain."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

POSE, JACOBIAN, SINGULAR, INVERSE = range(4)  # parts of the kinematics


class Arm(NamedTuple):
    """A chain of n joints and a task of m rows."""

    # (11,) of a planar chain its links' x and z (3·2, m), its signs (3) and its origin's x and z
    # (m); (0,) of a serial one
    plane: np.ndarray
    # (n + 2, 6) of a serial chain its frames (:mod:`pipeline.arm.folded`); (0, 6) of a planar one
    frames: np.ndarray
    sliding: np.ndarray  # (n,) 1 of a prismatic joint, 0 of a revolute one
    rows: np.ndarray  # (m,) the task's rows: 0 to 2 of velocity, 3 to 5 of angular velocity
    units: np.ndarray  # (m,) by which a row is multiplied: 1, or a length in m of an angular one
    least: float  # least singular value of the Jacobian at a regular pose
