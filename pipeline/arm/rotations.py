"""Rotation vectors, and the rigid motion between two sets of points."""

import numpy as np
from numpy import ndarray

NEXT, LAST = [1, 2, 0], [2, 0, 1]  # entries of a cross product


def rotation_vector(rotation: ndarray) -> ndarray:
    """(..., 3) axis times angle in rad, up to half a turn, of ``rotation`` (..., 3, 3), by the unit
    quaternion (w, v): first row of 4(w, v)(w, v)ᵀ if w² > 1/4, else row of the greatest diagonal.
    """
    w = 1 + rotation[..., 0, 0] + rotation[..., 1, 1] + rotation[..., 2, 2]
    v = rotation[..., LAST, NEXT] - rotation[..., NEXT, LAST]
    if (far := ~(w > 1)).any():
        part = rotation[far]
        square = np.empty((len(part), 4, 4))
        square[:, 0, 0], square[:, 0, 1:] = w[far], v[far]
        square[:, 1:, 0] = v[far]
        square[:, 1:, 1:] = (
            part + part.swapaxes(1, 2) + (2 - w[far])[:, None, None] * np.eye(3)
        )
        greatest = np.diagonal(square, axis1=1, axis2=2).argmax(axis=1)
        row = square[np.arange(len(part)), greatest]
        row = np.where(row[:, :1] < 0, -row, row)
        w, v[far] = np.where(far, 0.0, w), row[:, 1:]
        w[far] = row[:, 0]
    sine = np.sqrt(np.vecdot(v, v))
    angle = 2 * np.arctan2(sine, w)
    return (
        v * np.divide(angle, sine, out=np.zeros_like(sine), where=sine > 0)[..., None]
    )


def rigid_motion(places: ndarray, measured: ndarray) -> tuple[ndarray, ndarray]:
    """Rotations (..., 3, 3) and translations (..., 3) in m that move the points ``places`` (K, 3)
    to the ``measured`` points (..., K, 3), in m, by least squares: Kabsch (1976). Missing points
    are not finite. The result is NaN for fewer than three points and for points in one line.
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
