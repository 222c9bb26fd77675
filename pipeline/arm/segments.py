"""The frames that the arm's links carry: what is fixed to a link, a marker or a solid, moves with
its segment frame.
"""

from __future__ import annotations

import numpy as np

from pipeline.arm.chain import PlanarChain


def rotation_about_normal(psi: np.ndarray) -> np.ndarray:
    """Rotations (..., 3, 3) by ``psi`` (...) in rad about the plane's normal, from z towards x."""
    sine, cosine, zero = np.sin(psi), np.cos(psi), np.zeros_like(psi)
    rows = [[cosine, zero, sine], [zero, zero + 1.0, zero], [-sine, zero, cosine]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def segment_frames(chain: PlanarChain, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (..., n, 3, 3) and origins (..., n, 3) in m of the segment frames in the plane's
    frame (x, normal y, z).

    Segment j starts at O_j; its z axis points to O_{j+1}, its y axis along the normal, x = y × z.
    The columns of a rotation are these axes, so that a point p of segment j lies at ``rotation[...,
    j, :, :] @ p + origin[..., j, :]``. ``q`` (..., n) in rad.
    """
    origin = np.zeros((*np.shape(q), 3))
    origin[..., [0, 2]] = chain.points(q)[..., :-1, :]
    return rotation_about_normal(chain.segment_headings(q)), origin
