"""The frames that the arm's links carry: what is fixed to a link, a marker or a solid, moves with its segment frame."""

from __future__ import annotations

import numpy as np

from pipeline.arm.chain import PlanarChain


def segment_frames(chain: PlanarChain, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (..., 3, 3, 3) and origins (..., 3, 3) in m of the three segment frames in the plane's frame (x, normal y, z).

    Segment j starts at O_j; its z axis points to O_{j+1}, its y axis along the normal, x = y × z. The columns of a rotation
    are these axes, so that a point p of segment j lies at ``rotation[..., j, :, :] @ p + origin[..., j, :]``. ``q`` (..., 3) in rad.
    """
    psi = chain.segment_headings(q)
    sine, cosine, zero = np.sin(psi), np.cos(psi), np.zeros_like(psi)
    rotation = np.stack(
        [
            np.stack([cosine, zero, sine], axis=-1),
            np.stack([zero, zero + 1.0, zero], axis=-1),
            np.stack([-sine, zero, cosine], axis=-1),
        ],
        axis=-2,
    )
    joints = chain.points(q)[..., :3, :]
    return rotation, np.stack([joints[..., 0], zero, joints[..., 1]], axis=-1)
