"""Joint angles from motion-capture markers: labels put right, a rigid-body fit per link, relative rotation about the joint axes.

Markers are compared with the places that the arm itself predicts for them (template on the chain), so that one distance, the
gate, decides everywhere whether a sample can be the marker that its label says. It has to exceed the error of the registration
of the base frame and stay below half the distance between markers.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np
import pandas as pd
from scipy.optimize import linear_sum_assignment

from pipeline.arm.chain import PlanarChain
from pipeline.arm.model import Arm
from pipeline.errors import ConfigError, RecordingError
from pipeline.schema import Mocap

NEIGHBOURS = 5  # solved frames from which a frame's pose is predicted: enough to damp noise, few enough for a straight line
MIN_LEVER = 0.01  # m; two markers closer than this in the plane give no angle worth having


@dataclass(frozen=True)
class JointTrack:
    """Joint angles of one take.

    ``q`` (N, 3) rad, continuous in time. ``residual`` (N,) rms distance of the markers to the fitted links in m, NaN where the
    frame was filled in. ``counts``: samples ``missing`` (label without a position), ``relabelled`` (moved to another label),
    ``adopted`` (taken from the unlabelled markers), ``rejected`` (labelled, but no marker of the arm); ``two_marker_fits`` (link
    and frame); frames ``interpolated`` (linearly in q) and ``held`` (before the first or after the last solved frame).
    """

    q: np.ndarray
    residual: np.ndarray
    counts: dict[str, int]


def track_rows(rows: pd.DataFrame, mocap: Mocap, arm: Arm, *, take: str) -> JointTrack:
    """Joint angles of one take from its ``rows`` of the table ``markers``; see :func:`track_joints`."""
    template = np.array([list(link.values()) for link in mocap.markers.values()])
    positions = rows.sort_values(["link", "marker", "k"], kind="stable")
    labelled, stray = positions[positions.link > 0], positions[positions.link == 0]
    frames = labelled.k.nunique()
    xyz = labelled[["x", "y", "z"]].to_numpy().reshape(3, 3, frames, 3).transpose(2, 0, 1, 3)
    extra = stray[["x", "y", "z"]].to_numpy().reshape(-1, frames, 3).transpose(1, 0, 2)
    return track_joints(xyz, template, arm, unlabelled=extra, gate=mocap.gate, max_gap=mocap.max_gap, take=take)


def track_joints(
    positions: np.ndarray,
    template: np.ndarray,
    arm: Arm,
    *,
    unlabelled: np.ndarray | None = None,
    gate: float = 0.01,
    max_gap: int = 10,
    take: str = "",
) -> JointTrack:
    """Joint angles of one take from its markers.

    ``positions`` (N, 3 links, 3 markers, 3) in the base frame, m, not finite where a label has no position; ``unlabelled`` (N, U, 3)
    further positions, likewise; ``template`` (3, 3, 3) the markers in the frames of their segments, m. Samples farther than ``gate``
    (m) from where the arm puts their label are relabelled, or left out. Runs of up to ``max_gap`` frames in which a link has fewer
    than two markers are filled. Raises RecordingError (take and frames) for longer gaps or markers that never fit the arm,
    ConfigError for a template that determines no angle.
    """
    check_template(template)
    if positions.ndim != 4 or positions.shape[1:] != (3, 3, 3) or (unlabelled is not None and len(unlabelled) != len(positions)):
        raise RecordingError("marker positions are not of shape (frames, 3 links, 3 markers, 3)", take=take, shape=positions.shape)
    if not len(positions):
        raise RecordingError("the take has no frame", take=take)
    markers = arm.to_plane(np.where(np.isfinite(positions), positions, np.nan))
    extra = np.empty((len(positions), 0, 3)) if unlabelled is None else arm.to_plane(np.where(np.isfinite(unlabelled), unlabelled, np.nan))
    counts = {"missing": int(np.isnan(markers).any(axis=-1).sum())}
    markers, q, solved, moved = _put_labels_right(markers, extra, template, arm.chain, gate, take)
    counts |= moved
    _, square = fit_segments(markers[solved], template)
    seen = np.isfinite(markers[solved]).all(axis=-1)
    counts["two_marker_fits"] = int((seen.sum(axis=-1) == 2).sum())
    residual = np.full(len(q), np.nan)
    residual[solved] = np.sqrt(square.sum(axis=-1) / seen.sum(axis=(-2, -1)))
    q, filled = _fill_gaps(q, solved, max_gap, take)
    return JointTrack(q, residual, counts | filled)


def check_template(template: np.ndarray) -> None:
    """Raise ConfigError unless the three markers of each link, (3, 3, 3) m, span a triangle seen along the plane's normal too."""
    if np.shape(template) != (3, 3, 3) or not np.isfinite(template).all():
        raise ConfigError("the marker template is not of shape (3 links, 3 markers, 3), or not finite", shape=np.shape(template))
    for link, corners in enumerate(template, start=1):
        spread = np.linalg.svd(corners - corners.mean(axis=0), compute_uv=False)[1]
        sides = np.linalg.norm((corners - np.roll(corners, 1, axis=0))[:, [0, 2]], axis=1)
        if spread < MIN_LEVER / 2 or sides.min() < MIN_LEVER:
            raise ConfigError("the markers of a link are in line, or two of them are too close in the plane of the arm", link=link)


def fit_segments(markers: np.ndarray, template: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angles ψ (..., 3) rad of the segments and the sums of squared residuals (..., 3) m² of a least-squares rigid-body fit per link.

    ``markers`` (..., 3, 3, 3) in the plane's frame, NaN where missing. Three markers: the rotation of Kabsch (1976), of which ψ is
    the twist about the normal, so that a base frame tilted out of the plane does not enter. Two markers: the rotation about the
    normal alone. Fewer: NaN.
    """
    seen = np.isfinite(markers).all(axis=-1)
    number = seen.sum(axis=-1)
    weight = (seen / np.maximum(number, 1)[..., None])[..., None]
    measured = np.where(seen[..., None], markers, 0.0)
    measured = (measured - (weight * measured).sum(axis=-2, keepdims=True)) * seen[..., None]
    reference = (template - (weight * template).sum(axis=-2, keepdims=True)) * seen[..., None]
    rotation = np.swapaxes(measured, -1, -2) @ reference
    three = number == 3
    u, _, vt = np.linalg.svd(rotation[three])
    u[..., 2] *= np.linalg.det(u @ vt)[..., None]
    rotation[three] = u @ vt
    # the same formula maximises tr(R_y(ψ)ᵀ M) for a rotation M and for the cross-covariance of two markers
    psi = np.arctan2(rotation[..., 0, 2] - rotation[..., 2, 0], rotation[..., 0, 0] + rotation[..., 2, 2])
    rotation[~three] = _about_normal(psi[~three])
    square = ((measured - reference @ np.swapaxes(rotation, -1, -2)) ** 2).sum(axis=(-2, -1))
    return np.where(number >= 2, psi, np.nan), np.where(number >= 2, square, np.nan)


def marker_places(q: np.ndarray, template: np.ndarray, chain: PlanarChain) -> np.ndarray:
    """(..., 3, 3, 3) where the arm at ``q`` (..., 3) rad carries the markers of ``template``, in the plane's frame, m."""
    origins = np.zeros((*np.shape(q), 3))
    origins[..., [0, 2]] = chain.points(q)[..., :3, :]
    return origins[..., None, :] + template @ np.swapaxes(_about_normal(chain.segment_headings(q)), -1, -2)


def _about_normal(psi: np.ndarray) -> np.ndarray:
    sine, cosine, zero = np.sin(psi), np.cos(psi), np.zeros_like(psi)
    rows = [[cosine, zero, sine], [zero, zero + 1.0, zero], [-sine, zero, cosine]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _solve(markers: np.ndarray, template: np.ndarray, chain: PlanarChain, gate: float) -> tuple[np.ndarray, np.ndarray]:
    """Joint angles (N, 3) of markers (N, 3, 3, 3), and whether (N,) every marker seen lies within the gate of the arm there."""
    q = chain.joints_from_segments(fit_segments(markers, template)[0])
    distance = np.linalg.norm(markers - marker_places(q, template, chain), axis=-1)
    fits = ((distance <= gate) | np.isnan(markers).any(axis=-1)).all(axis=(-2, -1))
    return q, fits & np.isfinite(q).all(axis=-1)


def _put_labels_right(
    markers: np.ndarray, extra: np.ndarray, template: np.ndarray, chain: PlanarChain, gate: float, take: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, int]]:
    """Markers with the right labels, joint angles, which frames have them, and the counts of samples moved.

    Frames that fit the arm as they are labelled stand. In the others every position, labelled or not, goes to the label whose
    place, predicted from the nearest solved frames, it fits best: an optimal assignment under the gate.
    """
    q, solved = _solve(markers, template, chain, gate)
    moved = {"relabelled": 0, "adopted": 0, "rejected": 0}
    incomplete = np.isnan(markers).any(axis=(-3, -2, -1)) & np.isfinite(extra).all(axis=-1).any(axis=-1)
    doubtful = ~solved | incomplete
    if not doubtful.any():
        return markers, q, solved, moved
    markers = markers.copy()
    start, pose = (int(np.argmax(solved)), None) if solved.any() else _first_pose(markers, extra, template, chain, gate, take)
    # outwards from the first pose that is sure, so that each frame has a solved neighbour
    for k in [*np.flatnonzero(doubtful[start:]) + start, *np.flatnonzero(doubtful[:start])[::-1]]:
        expected = _predict(q, solved, k) if solved.any() else pose
        labelled, found = markers[k].reshape(9, 3), extra[k][np.isfinite(extra[k]).all(axis=-1)]
        candidates = np.concatenate([labelled, found])
        square = ((marker_places(expected, template, chain).reshape(9, 1, 3) - candidates) ** 2).sum(axis=-1)
        square[np.isnan(square)] = np.inf
        label, sample = linear_sum_assignment(np.minimum(square, gate**2))
        close = square[label, sample] <= gate**2
        label, sample = label[close], sample[close]
        relabelled = np.full((9, 3), np.nan)
        relabelled[label] = candidates[sample]
        present = np.isfinite(labelled).all(axis=-1)
        markers[k] = relabelled.reshape(3, 3, 3)
        q[k : k + 1], solved[k : k + 1] = _solve(markers[k : k + 1], template, chain, gate)
        moved["relabelled"] += int(((sample < 9) & (sample != label)).sum())
        moved["adopted"] += int((sample >= 9).sum())
        moved["rejected"] += int(present.sum() - (sample < 9).sum())
    return markers, q, solved, moved


def _predict(q: np.ndarray, solved: np.ndarray, k: int) -> np.ndarray:
    """Joint angles at frame ``k`` on the straight line through the solved frames nearest to it."""
    frames = np.flatnonzero(solved)
    frames = frames[np.argsort(np.abs(frames - k), kind="stable")[:NEIGHBOURS]]
    time = frames - frames.mean()
    near = np.unwrap(q[frames], axis=0)
    slope = time @ near / max(time @ time, 1.0)
    return near.mean(axis=0) + slope * (k - frames.mean())


def _first_pose(
    markers: np.ndarray, extra: np.ndarray, template: np.ndarray, chain: PlanarChain, gate: float, take: str
) -> tuple[int, np.ndarray]:
    """A frame and its joint angles (3,) where no frame fits as it is labelled: from the shape of the triangles and the chain alone.

    Link by link, the ordered triple of positions that has the template's shape and starts where the link before it ends.
    """
    for k in range(len(markers)):
        points = np.concatenate([markers[k].reshape(9, 3), extra[k]])
        points = points[np.isfinite(points).all(axis=-1)]
        if len(points) < 9:
            continue
        ordered = points[list(permutations(range(len(points)), 3))]
        q = np.zeros(3)
        for j in range(3):
            # two markers that lie within the gate of their places are as far apart as these, but for twice the gate
            triples = ordered[(np.abs(_sides(ordered) - _sides(template[j])) <= 2 * gate).all(axis=-1)]
            if not len(triples):
                break
            alone = np.full((len(triples), 3, 3, 3), np.nan)
            alone[:, j] = triples
            psi = fit_segments(alone, template)[0][:, j]
            heading = chain.segment_headings(np.broadcast_to(q, (len(triples), 3))).copy()
            heading[:, j] = psi
            trial = chain.joints_from_segments(heading)
            error = np.abs(marker_places(trial, template, chain)[:, j] - triples).max(axis=(-2, -1))
            q = trial[np.argmin(error)]
            if error.min() > gate:
                break
        else:
            return k, q
    raise RecordingError("no frame has markers that fit the arm: check the template, the base frame, the units and the gate", take=take)


def _sides(triangles: np.ndarray) -> np.ndarray:
    """(..., 3) m lengths of the sides of triangles (..., 3, 3)."""
    return np.linalg.norm(triangles - np.roll(triangles, 1, axis=-2), axis=-1)


def _fill_gaps(q: np.ndarray, solved: np.ndarray, max_gap: int, take: str) -> tuple[np.ndarray, dict[str, int]]:
    """Continuous angles, linear in time across gaps, held at the ends of the take."""
    frames = np.flatnonzero(solved)
    if not len(frames):
        raise RecordingError("no frame shows two markers of every link", take=take)
    edges = np.concatenate([[-1], frames, [len(q)]])
    longest = int(np.argmax(np.diff(edges)))
    if edges[longest + 1] - edges[longest] - 1 > max_gap:
        raise RecordingError(
            f"markers give no joint angles for longer than {max_gap} frames: repair the labels, or leave the take out",
            take=take,
            frames=f"{edges[longest] + 1} to {edges[longest + 1] - 1}",
        )
    known = np.unwrap(q[frames], axis=0)
    q = np.stack([np.interp(np.arange(len(q)), frames, known[:, j]) for j in range(3)], axis=1)
    held = int(frames[0] + len(q) - 1 - frames[-1])
    return q, {"interpolated": len(q) - len(frames) - held, "held": held}
