"""Poses of rigid bodies nearest to measured points, and the frames of a planar arm's links."""

import numpy as np

from pipeline.arm.chain import PlanarChain


def rigid_motion(places: np.ndarray, measured: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (..., 3, 3) and translations (..., 3) in m that carry the points at ``places`` (K,
    3) nearest to where they were ``measured`` (..., K, 3), in m, by least squares: Kabsch (1976).
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
    u, _, vt = np.linalg.svd(np.swapaxes(rotated, -1, -2) @ local)
    u[..., 2] *= np.linalg.det(u @ vt)[..., None]
    rotation = u @ vt
    translation = centres[1] - np.matvec(rotation, centres[0])
    gone = ~(decided & (present.sum(axis=-1) >= 3))
    rotation[gone], translation[gone] = np.nan, np.nan
    return rotation, translation


def segment_frames(chain: PlanarChain, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (..., n, 3, 3) and origins (..., n, 3) in m of the segment frames in the plane's
    frame (x, normal y, z); ``q`` (..., n) in rad. Segment j starts at O_j; its axes, the columns of
    its rotation, are z towards O_{j+1}, y along the normal, x = y × z.
    """
    origin, psi = np.zeros((*np.shape(q), 3)), chain.segment_headings(q)
    origin[..., [0, 2]] = chain.points(q)[..., :-1, :]
    rotation = np.zeros((*psi.shape, 3, 3))
    rotation[..., 0, 0] = rotation[..., 2, 2] = np.cos(psi)
    rotation[..., 0, 2], rotation[..., 2, 0] = np.sin(psi), -np.sin(psi)
    rotation[..., 1, 1] = 1.0
    return rotation, origin
