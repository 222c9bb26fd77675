"""Poses of rigid bodies nearest to measured points, and the frames of a planar arm's links."""

from __future__ import annotations

import numpy as np

from pipeline.arm.chain import PlanarChain


def nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    """(..., 3, 3) rotations R of the greatest tr(RᵀM) for ``matrix`` M (..., 3, 3): Kabsch
    (1976).
    """
    u, _, vt = np.linalg.svd(matrix)
    u[..., 2] *= np.linalg.det(u @ vt)[..., None]
    return u @ vt


def rigid_motion(places: np.ndarray, measured: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (..., 3, 3) and translations (..., 3) in m that carry the points at ``places`` (K,
    3) nearest to where they were ``measured`` (..., K, 3), in m, by least squares.

    Missing points are not finite; with fewer than three, or all in one line, the pose is NaN.
    """
    present = np.isfinite(measured).all(axis=-1)
    weight = (present / np.maximum(present.sum(axis=-1), 1)[..., None])[..., None]
    known = np.where(present[..., None], measured, 0.0)
    centres = [(weight * points).sum(axis=-2) for points in (places, known)]
    local, rotated = (
        (p - c[..., None, :]) * present[..., None]
        for p, c in zip((places, known), centres, strict=True)
    )
    spread = np.linalg.svd(local, compute_uv=False)
    decided = spread[..., 1] > 1e-6 * np.maximum(spread[..., 0], 1e-300)
    rotation = nearest_rotation(np.swapaxes(rotated, -1, -2) @ local)
    translation = centres[1] - np.matvec(rotation, centres[0])
    gone = ~(decided & (present.sum(axis=-1) >= 3))
    rotation[gone], translation[gone] = np.nan, np.nan
    return rotation, translation


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
