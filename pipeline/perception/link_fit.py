"""Rigid-body fits of the markers of each link, and the places that the arm predicts for them."""

from __future__ import annotations

import numpy as np

from pipeline.arm.chain import PlanarChain
from pipeline.arm.rigid import nearest_rotation
from pipeline.arm.segments import rotation_about_normal, segment_frames


def fit_segments(markers: np.ndarray, template: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angles ψ (..., n) rad of the segments and the sums of squared residuals (..., n) m² of a
    least-squares rigid-body fit per link.

    ``markers`` (..., n links, 3 markers, 3) in the plane's frame, NaN where missing. Three markers:
    the rotation of Kabsch (1976), of which ψ is the twist about the normal, so that a base frame
    tilted out of the plane does not enter. Two markers: the rotation about the normal alone.
    Fewer: NaN.
    """
    present = np.isfinite(markers).all(axis=-1)
    number = present.sum(axis=-1)
    weight = (present / np.maximum(number, 1)[..., None])[..., None]
    measured = np.where(present[..., None], markers, 0.0)
    measured = (measured - (weight * measured).sum(axis=-2, keepdims=True)) * present[..., None]
    reference = (template - (weight * template).sum(axis=-2, keepdims=True)) * present[..., None]
    rotation = np.swapaxes(measured, -1, -2) @ reference
    three = number == 3
    rotation[three] = nearest_rotation(rotation[three])
    # the same formula maximises tr(R_y(ψ)ᵀ M) for a rotation M and for the cross-covariance of two
    # markers
    psi = np.arctan2(
        rotation[..., 0, 2] - rotation[..., 2, 0], rotation[..., 0, 0] + rotation[..., 2, 2]
    )
    rotation[~three] = rotation_about_normal(psi[~three])
    square = ((measured - reference @ np.swapaxes(rotation, -1, -2)) ** 2).sum(axis=(-2, -1))
    return np.where(number >= 2, psi, np.nan), np.where(number >= 2, square, np.nan)


def marker_places(q: np.ndarray, template: np.ndarray, chain: PlanarChain) -> np.ndarray:
    """(..., n, 3, 3) where the arm at ``q`` (..., n) rad carries the markers of ``template``, in
    the plane's frame, m.
    """
    rotation, origin = segment_frames(chain, q)
    return origin[..., None, :] + template @ np.swapaxes(rotation, -1, -2)


def solve(
    markers: np.ndarray, template: np.ndarray, chain: PlanarChain, gate: float
) -> tuple[np.ndarray, np.ndarray]:
    """Joint angles (N, n) in rad of ``markers`` (N, n, 3, 3) in m, and whether (N,) every marker
    with a position lies within ``gate`` (m) of where the arm puts it there.
    """
    q = chain.joints_from_segments(fit_segments(markers, template)[0])
    distance = np.linalg.norm(markers - marker_places(q, template, chain), axis=-1)
    fits = ((distance <= gate) | np.isnan(markers).any(axis=-1)).all(axis=(-2, -1))
    return q, fits & np.isfinite(q).all(axis=-1)
