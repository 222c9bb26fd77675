"""A step of the additive model of a planar arm, one pose after the other: the plain loop that the
vectorised kernel is held against.
"""

from __future__ import annotations

import math

import numba
import numpy as np


@numba.njit
def plain_steps(links, signs, q, v, root, rng):
    """(P, 3) draws of q + J⁻¹v + Lε, L = ``root``."""
    moved, jacobian, point, epsilon = q.copy(), np.ones((3, 3)), np.empty((4, 2)), np.empty(3)
    for i in range(len(q)):
        for k in range(3):
            epsilon[k] = rng.standard_normal()
        heading = 0.0
        point[0] = 0.0
        for j in range(3):
            heading += signs[j] * q[i, j]
            sine, cosine = math.sin(heading), math.cos(heading)
            point[j + 1, 0] = point[j, 0] + cosine * links[j, 0] + sine * links[j, 1]
            point[j + 1, 1] = point[j, 1] + cosine * links[j, 1] - sine * links[j, 0]
        for j in range(3):
            jacobian[0, j] = signs[j] * (point[3, 1] - point[j, 1])
            jacobian[1, j] = -signs[j] * (point[3, 0] - point[j, 0])
            jacobian[2, j] = signs[j]
        moved[i] += np.linalg.solve(jacobian, v) + root @ epsilon
    return moved
