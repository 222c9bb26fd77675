"""Rotation vectors, and the rigid motion between two sets of points."""

import numpy as np
from numpy import ndarray

# entries of a cross product
NEXT = [1, 2, 0]
LAST = [2, 0, 1]


def rotation_vector(rotation: ndarray) -> ndarray:
    """(..., 3) axis times angle in rad, up to half a turn, of ``rotation`` (..., 3, 3), by the unit
    quaternion (w, v): first row of 4(w, v)(w, v)ᵀ if w² > 1/4, else row of the greatest diagonal.
    """
    xx = rotation[..., 0, 0]
    yy = rotation[..., 1, 1]
    zz = rotation[..., 2, 2]
    w = 1 + xx + yy + zz
    v = rotation[..., LAST, NEXT] - rotation[..., NEXT, LAST]
    far = ~(w > 1)
    if far.any():
        row = _greatest_row(rotation[far], w[far], v[far])
        w = np.where(far, 0.0, w)
        w[far] = row[:, 0]
        v[far] = row[:, 1:]
    sine = np.sqrt(np.vecdot(v, v))
    angle = 2 * np.arctan2(sine, w)
    factor = np.divide(angle, sine, out=np.zeros_like(sine), where=sine > 0)
    return v * factor[..., None]


def _greatest_row(rotation: ndarray, w: ndarray, v: ndarray) -> ndarray:
    """(N, 4) row of 4(w, v)(w, v)ᵀ with the greatest diagonal entry, its first entry positive."""
    outer = np.empty((len(rotation), 4, 4))
    outer[:, 0, 0] = w
    outer[:, 0, 1:] = v
    outer[:, 1:, 0] = v
    diagonal = (2 - w)[:, None, None] * np.eye(3)
    outer[:, 1:, 1:] = rotation + rotation.swapaxes(1, 2) + diagonal
    greatest = np.diagonal(outer, axis1=1, axis2=2).argmax(axis=1)
    matrices = np.arange(len(outer))
    row = outer[matrices, greatest]
    return np.where(row[:, :1] < 0, -row, row)


def rigid_motion(places: ndarray, measured: ndarray) -> tuple[ndarray, ndarray]:
    """Rotations (..., 3, 3) and translations (..., 3) in m that move the points ``places`` (K, 3)
    to the ``measured`` points (..., K, 3), in m, by least squares: Kabsch (1976). Missing points
    are not finite. The result is NaN for fewer than three points and for points in one line.
    """
    present = np.isfinite(measured).all(axis=-1)
    is_present = present[..., None]
    count = present.sum(axis=-1)
    divisor = np.maximum(count, 1)[..., None]
    weight = (present / divisor)[..., None]
    measured = np.where(is_present, measured, 0.0)
    centre = (weight * places).sum(axis=-2)
    measured_centre = (weight * measured).sum(axis=-2)
    local = (places - centre[..., None, :]) * is_present
    rotated = (measured - measured_centre[..., None, :]) * is_present

    sizes = np.linalg.svd(local, compute_uv=False)
    greatest = np.maximum(sizes[..., 0], 1e-300)
    in_line = ~(sizes[..., 1] > 1e-6 * greatest)
    u, _, vt = np.linalg.svd(np.swapaxes(rotated, -1, -2) @ local)
    u[..., 2] *= np.linalg.det(u @ vt)[..., None]
    rotation = u @ vt
    translation = measured_centre - np.matvec(rotation, centre)
    undetermined = in_line | (count < 3)
    rotation[undetermined] = np.nan
    translation[undetermined] = np.nan
    return rotation, translation
