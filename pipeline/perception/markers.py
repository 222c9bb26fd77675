"""Joint angles from motion-capture markers: corrected labels, a rigid-body fit per link, relative
rotation about the joint axes.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.arm.model import Arm
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.motion_capture import Mocap
from pipeline.perception.joint_track import JointTrack, fill_gaps
from pipeline.perception.labels import correct_labels
from pipeline.perception.link_fit import fit_segments

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
        xyz,
        template,
        arm,
        unlabelled=extra,
        gate=mocap.gate,
        max_gap=mocap.max_gap,
        take=take,
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
