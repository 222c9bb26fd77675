"""Joint angles of an arm in a plane from motion-capture markers: labels corrected by the places
that the arm predicts, a rigid-body fit per link, relative rotation about the joint axes.

One distance, the gate, decides everywhere whether a sample can be the marker that its label says.
It has to exceed the error of the registration of the base frame and stay below half the distance
between markers.
"""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pandas as pd

from pipeline.arm.chain import PlanarChain
from pipeline.arm.frames import nearest_rotation, rotation_about_normal, segment_frames
from pipeline.arm.model import Arm
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.instruments import Mocap
from pipeline.perception.joint_track import JointTrack, fill_gaps


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


# solved frames from which a frame's pose is predicted: enough to damp noise, few enough for a
# straight line
NEIGHBOURS = 5


def correct_labels(
    markers: np.ndarray,
    extra: np.ndarray,
    template: np.ndarray,
    chain: PlanarChain,
    gate: float,
    take: str,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, int]]:
    """Markers (N, n, 3, 3) with the right labels, joint angles (N, n), which frames (N,) have
    them, and the counts of samples moved.

    Frames that fit the arm as they are labelled stay. In the others every position, labelled or
    not, goes to the label whose place, predicted from the nearest solved frames, it fits best: an
    optimal assignment under the gate.

    Args:
        markers: positions (N, n links, 3 markers, 3) in the plane's frame, m, NaN where missing.
        extra: (N, U, 3) further positions, likewise.
        template: (n, 3, 3) markers in the frames of their segments, m.
        chain: the arm's kinematics.
        gate: greatest distance in m of a sample from the place of its label.
        take: name of the take, for messages.
    """
    from scipy.optimize import linear_sum_assignment

    q, solved = solve(markers, template, chain, gate)
    moved = {"relabelled": 0, "adopted": 0, "rejected": 0}
    incomplete = np.isnan(markers).any(axis=(-3, -2, -1)) & np.isfinite(extra).all(axis=-1).any(
        axis=-1
    )
    doubtful = ~solved | incomplete
    if not doubtful.any():
        return markers, q, solved, moved
    markers, labels = markers.copy(), template.shape[0] * template.shape[1]
    start, pose = (
        (int(np.argmax(solved)), None)
        if solved.any()
        else _first_pose(markers, extra, template, chain, gate, take)
    )
    # outwards from the first pose that is sure, so that each frame has a solved neighbour
    for k in [*np.flatnonzero(doubtful[start:]) + start, *np.flatnonzero(doubtful[:start])[::-1]]:
        expected = _predict(q, solved, k) if solved.any() else pose
        labelled = markers[k].reshape(labels, 3)
        candidates = np.concatenate([labelled, extra[k][np.isfinite(extra[k]).all(axis=-1)]])
        places = marker_places(expected, template, chain).reshape(labels, 1, 3)
        square = ((places - candidates) ** 2).sum(axis=-1)
        square[np.isnan(square)] = np.inf
        label, sample = linear_sum_assignment(np.minimum(square, gate**2))
        close = square[label, sample] <= gate**2
        label, sample = label[close], sample[close]
        relabelled = np.full((labels, 3), np.nan)
        relabelled[label] = candidates[sample]
        present = np.isfinite(labelled).all(axis=-1)
        markers[k] = relabelled.reshape(template.shape)
        q[k : k + 1], solved[k : k + 1] = solve(markers[k : k + 1], template, chain, gate)
        moved["relabelled"] += int(((sample < labels) & (sample != label)).sum())
        moved["adopted"] += int((sample >= labels).sum())
        moved["rejected"] += int(present.sum() - (sample < labels).sum())
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
    markers: np.ndarray,
    extra: np.ndarray,
    template: np.ndarray,
    chain: PlanarChain,
    gate: float,
    take: str,
) -> tuple[int, np.ndarray]:
    """A frame and its joint angles (n,) where no frame fits as it is labelled: from the shape of
    the triangles and the chain alone.

    Link by link, the ordered triple of positions that has the template's shape and starts where the
    link before it ends. Arguments as for :func:`correct_labels`; RecordingError where no frame has
    such triples.
    """
    links = len(template)
    for k in range(len(markers)):
        points = np.concatenate([markers[k].reshape(-1, 3), extra[k]])
        points = points[np.isfinite(points).all(axis=-1)]
        if len(points) < 3 * links:
            continue
        ordered = points[list(permutations(range(len(points)), 3))]
        q = np.zeros(links)
        for j in range(links):
            # two markers that lie within the gate of their places are as far apart as these, but
            # for twice the gate
            triples = ordered[
                (np.abs(_sides(ordered) - _sides(template[j])) <= 2 * gate).all(axis=-1)
            ]
            if not len(triples):
                break
            alone = np.full((len(triples), *template.shape), np.nan)
            alone[:, j] = triples
            psi = fit_segments(alone, template)[0][:, j]
            heading = chain.segment_headings(np.broadcast_to(q, (len(triples), links))).copy()
            heading[:, j] = psi
            trial = chain.joints_from_segments(heading)
            error = np.abs(marker_places(trial, template, chain)[:, j] - triples).max(axis=(-2, -1))
            q = trial[np.argmin(error)]
            if error.min() > gate:
                break
        else:
            return k, q
    raise RecordingError(
        "no frame has markers that fit the arm: check the template, the base frame, the units "
        "and the gate",
        take=take,
    )


def _sides(triangles: np.ndarray) -> np.ndarray:
    """(..., 3) m lengths of the sides of triangles (..., 3, 3)."""
    return np.linalg.norm(triangles - np.roll(triangles, 1, axis=-2), axis=-1)


MIN_LEVER = 0.01  # m; two markers closer than this in the plane give no angle worth having


def track_rows(rows: pd.DataFrame, mocap: Mocap, arm: Arm, *, take: str) -> JointTrack:
    """Joint angles of one take from its ``rows`` of the table ``markers``; see
    :func:`track_joints`.
    """
    template = np.array([list(link.values()) for link in mocap.markers.values()])
    positions = rows.sort_values(["link", "marker", "k"], kind="stable")
    labelled, stray = positions[positions.link > 0], positions[positions.link == 0]
    frames = labelled.k.nunique()
    xyz = (
        labelled[["x", "y", "z"]]
        .to_numpy()
        .reshape(*template.shape[:2], frames, 3)
        .transpose(2, 0, 1, 3)
    )
    extra = stray[["x", "y", "z"]].to_numpy().reshape(-1, frames, 3).transpose(1, 0, 2)
    return track_joints(
        xyz, template, arm, unlabelled=extra, gate=mocap.gate, max_gap=mocap.max_gap, take=take
    )


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

    Its counts: samples ``missing`` (label without a position), ``relabelled`` (moved to another
    label), ``adopted`` (taken from the unlabelled markers), ``rejected`` (labelled, but no marker
    of the arm); ``two_marker_fits`` (link and frame); frames ``interpolated`` and ``held``.

    Raises RecordingError (take and frames) for longer gaps than ``max_gap`` or markers that never
    fit the arm, ConfigError for a template that determines no angle.

    Args:
        positions: (N, n links, 3 markers, 3) in the base frame, m, not finite where a label has no
            position.
        template: (n, 3, 3) the markers in the frames of their segments, m.
        arm: the robot.
        unlabelled: (N, U, 3) further positions, likewise.
        gate: m; samples farther from where the arm puts their label are relabelled, or left out.
        max_gap: frames; shorter runs in which a link has fewer than two markers are filled.
        take: name of the take, for messages.
    """
    check_template(template)
    if (
        positions.ndim != 4
        or positions.shape[1:] != template.shape
        or (unlabelled is not None and len(unlabelled) != len(positions))
    ):
        raise RecordingError(
            "marker positions are not of shape (frames, links, 3 markers, 3)",
            take=take,
            shape=positions.shape,
        )
    if not len(positions):
        raise RecordingError("the take has no frame", take=take)
    markers = arm.to_plane(np.where(np.isfinite(positions), positions, np.nan))
    extra = (
        np.empty((len(positions), 0, 3))
        if unlabelled is None
        else arm.to_plane(np.where(np.isfinite(unlabelled), unlabelled, np.nan))
    )
    counts = {"missing": int(np.isnan(markers).any(axis=-1).sum())}
    markers, q, solved, moved = correct_labels(markers, extra, template, arm.chain, gate, take)
    counts |= moved
    _, square = fit_segments(markers[solved], template)
    present = np.isfinite(markers[solved]).all(axis=-1)
    counts["two_marker_fits"] = int((present.sum(axis=-1) == 2).sum())
    residual = np.full(len(q), np.nan)
    residual[solved] = np.sqrt(square.sum(axis=-1) / present.sum(axis=(-2, -1)))
    q, filled = fill_gaps(q, solved, max_gap, take, lack="shows two markers of every link")
    return JointTrack(q, residual, counts | filled, samples=markers[..., 0].size)


def check_template(template: np.ndarray) -> None:
    """Raise ConfigError unless the three markers of each link, (n, 3, 3) m, span a triangle, along
    the plane's normal too.
    """
    if np.ndim(template) != 3 or template.shape[1:] != (3, 3) or not np.isfinite(template).all():
        raise ConfigError(
            "the marker template is not of shape (links, 3 markers, 3), or not finite",
            shape=np.shape(template),
        )
    for link, corners in enumerate(template, start=1):
        spread = np.linalg.svd(corners - corners.mean(axis=0), compute_uv=False)[1]
        sides = np.linalg.norm((corners - np.roll(corners, 1, axis=0))[:, [0, 2]], axis=1)
        if spread < MIN_LEVER / 2 or sides.min() < MIN_LEVER:
            raise ConfigError(
                "the markers of a link are in line, or two of them are too close in the plane of "
                "the arm",
                link=link,
            )
