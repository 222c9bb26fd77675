"""Joint angles of one take from its motion-capture markers or bodies, by least squares.

A sample farther than the gate from its modelled marker is relabelled or rejected. The gate must
exceed the registration error of the base frame and be below half the distance between markers.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.arm.model import arm_of
from pipeline.core.errors import RecordingError
from pipeline.core.options.dataset import Mocap, Robot
from pipeline.perception.posture import (
    LEAST_LEVER,
    MarkedArm,
    points_in_plane,
    points_in_space,
)

NEIGHBOURS = 5  # solved frames in the linear prediction of a frame's joint angles
BLOCK = 16  # frames of an arm in space that are solved at once, from the frame before the block
UNDETERMINED = (
    0.1  # share of a joint in undetermined motions above which an error names the joint
)


class JointTrack(NamedTuple):
    """Joint angles of one take."""

    q: np.ndarray  # (N, n) rad, m of prismatic joints, continuous in time
    residual: (
        np.ndarray
    )  # (N,) m, rms distance of the markers to the arm; NaN where filled in
    counts: dict[str, int]  # losses and repairs, named in :func:`track`
    samples: int  # number of the markers' samples, missing ones included


def follower(robot: Robot, mocap: Mocap) -> Callable[..., JointTrack]:
    """Return a function that tracks one ``take`` from its rows of the table ``markers``."""
    if robot.plane:
        template = np.array([list(link.values()) for link in mocap.markers.values()])
        points = points_in_plane(arm_of(robot), template, mocap.gate)
    else:
        points = points_in_space(robot, mocap)

    def follow(rows: pd.DataFrame, *, take: str) -> JointTrack:
        rows = rows.sort_values(["link", "marker", "k"], kind="stable")
        frames = rows["k"].nunique()
        positions = (
            rows[["x", "y", "z"]].to_numpy().reshape(-1, frames, 3).transpose(1, 0, 2)
        )
        unlabelled = np.count_nonzero(rows["link"] == 0) // frames  # moved to the end
        positions = np.roll(positions, -unlabelled, axis=1)
        return track(positions, points, max_gap=mocap.max_gap, take=take)

    return follow


def track(
    positions: np.ndarray, points: MarkedArm, *, max_gap: int, take: str = ""
) -> JointTrack:
    """Return the joint angles of one ``take`` from the ``positions`` (N, P + U, 3) m of its P
    ``points`` and of U unlabelled markers in the base frame, NaN where missing.

    Samples beyond the gate are relabelled or rejected; gaps of at most ``max_gap`` frames are
    filled. Counts: samples ``missing``, ``relabelled``, ``adopted`` from unlabelled markers,
    ``rejected``; ``two_marker_fits``; frames ``interpolated`` and ``held``. Raises RecordingError
    for longer gaps, for markers that never fit and for points that do not determine the posture.
    """
    if not len(positions):
        raise RecordingError("the take has no frame", take=take)
    labelled = positions[:, : len(points.owner)]
    if points.arm is None:
        q, residual = _solve_blocks(labelled, points, take)
    else:
        q, residual, *_ = points.solve(labelled, _heading_angles(labelled, points))
    missing = np.isnan(labelled[..., 0])
    markers, moved = _correct_labels(positions, q, residual, points, take)
    solved = np.isfinite(residual)
    present = ~np.isnan(markers[solved][..., 0])
    pairs = sum(
        (present[:, mine].sum(axis=1) == 2).sum() for mine in points.link_masks()
    )
    q, filled = fill_gaps(q, solved, points.sliding, max_gap, take)
    counts = (
        {"missing": int(missing.sum())}
        | moved
        | {"two_marker_fits": int(pairs)}
        | filled
    )
    return JointTrack(q, residual, counts, missing.size)


def _heading_angles(positions: np.ndarray, points: MarkedArm) -> np.ndarray:
    """Return the joint angles (N, n) in rad of a planar arm from the headings of its links."""
    frames, psi = np.arange(len(positions)), []
    for mine in points.link_masks():
        measured, template = positions[:, mine], points.places[mine]
        present = np.isfinite(measured).all(axis=-1)
        weight = (present / np.maximum(present.sum(axis=-1), 1)[..., None])[..., None]
        measured = np.where(present[..., None], points.arm.to_plane(measured), 0.0)
        measured = (
            measured - (weight * measured).sum(axis=-2, keepdims=True)
        ) * present[..., None]
        turn = np.swapaxes(measured, -1, -2) @ template
        heading = np.arctan2(
            turn[..., 0, 2] - turn[..., 2, 0], turn[..., 0, 0] + turn[..., 2, 2]
        )
        known = present.sum(axis=-1) >= 2
        turned = np.unwrap(heading[known])
        heading[~known] = (
            np.interp(frames[~known], frames[known], turned) if known.any() else 0.0
        )
        psi.append(heading)
    return points.arm.chain.joints_from_segments(np.stack(psi, axis=-1))


def _solve_blocks(
    positions: np.ndarray, points: MarkedArm, take: str
) -> tuple[np.ndarray, ...]:
    """Return joint angles (N, n) and residuals (N,) m, solved both ways from the start frame."""
    frames = len(positions)
    first, start = _start_frame(positions, points, take)
    q, residual = np.full((frames, len(start)), np.nan), np.full(frames, np.nan)
    for way in (np.arange(first, frames), np.arange(first)[::-1]):
        last = start
        for begin in range(0, len(way), BLOCK):
            block = way[begin : begin + BLOCK]
            starts = np.broadcast_to(last, (len(block), len(start)))
            q[block], residual[block], *_ = points.solve(positions[block], starts)
            last = next((q[k] for k in block[::-1] if np.isfinite(residual[k])), last)
    return q, residual


def _start_frame(
    positions: np.ndarray, points: MarkedArm, take: str
) -> tuple[int, np.ndarray]:
    """Return the first frame that exactly one posture fits, and the posture; or RecordingError."""
    key, message = (
        "markers",
        "no posture of the arm has all markers and bodies of a frame within",
    )
    message += (
        f" {points.gate:g} m: check their places and mounts, the base, and the gate"
    )
    for k in np.flatnonzero(np.isfinite(positions[..., 0]).any(axis=1)):
        postures = points.postures(positions[k])
        if undecided := [one for one in postures if not one.decided]:
            values, vectors = np.linalg.eigh(undecided[0].normal)
            share = (vectors[:, values < LEAST_LEVER**2] ** 2).sum(axis=1)
            left = ", ".join(np.array(points.joints)[share > UNDETERMINED])
            key, message = "markers", f"the markers and bodies do not determine {left}"
            message += ": track another link"
        elif len(postures) == 1:
            return k, postures[0].q
        elif postures:
            key, message = (
                "posture",
                f"{len(postures)} postures of the arm fit the markers and",
            )
            message += " bodies: track another link, or state the posture at the start of a take"
    raise RecordingError(message, take=take, key=f"dataset.mocap.{key}")


def _correct_labels(
    positions: np.ndarray,
    q: np.ndarray,
    residual: np.ndarray,
    points: MarkedArm,
    take: str,
) -> tuple[np.ndarray, dict[str, int]]:
    """Return the correctly labelled markers (N, P, 3), and counts of the corrections.

    Frames that do not fit, and incomplete frames with unlabelled markers, are solved again in ``q``
    and ``residual``. The assignment of labels to positions minimises the sum of squared distances
    from the positions that the nearest solved frames predict.
    """
    from scipy.optimize import linear_sum_assignment

    labels, moved = len(points.owner), {"relabelled": 0, "adopted": 0, "rejected": 0}
    there, markers = np.isfinite(positions).all(axis=-1), positions[:, :labels].copy()
    incomplete = ~there[:, :labels].all(axis=-1) & there[:, labels:].any(axis=-1)
    doubtful = np.isnan(residual) | incomplete
    if not doubtful.any():
        return markers, moved
    if np.isnan(residual).all():
        message = "no frame has markers that fit the arm: check the template, the labels, the base"
        raise RecordingError(f"{message} frame, the units and the gate", take=take)
    start, most = int(np.argmax(np.isfinite(residual))), points.gate**2
    # outwards from the first solved frame, so that each frame has a solved neighbour
    for k in [
        *np.flatnonzero(doubtful[start:]) + start,
        *np.flatnonzero(doubtful[:start])[::-1],
    ]:
        expected = _predict(q, np.flatnonzero(np.isfinite(residual)), k)[None]
        square = ((points.carry(expected)[0][:, None] - positions[k]) ** 2).sum(axis=-1)
        square[np.isnan(square)] = np.inf
        label, sample = linear_sum_assignment(np.minimum(square, most))
        close = square[label, sample] <= most
        label, sample = label[close], sample[close]
        labelled = sample < labels
        markers[k] = np.nan
        markers[k, label] = positions[k, sample]
        q[[k]], residual[[k]], *_ = points.solve(markers[[k]], expected)
        moved["relabelled"] += int((labelled & (sample != label)).sum())
        moved["adopted"] += int((~labelled).sum())
        moved["rejected"] += int(there[k, :labels].sum()) - int(labelled.sum())
    return markers, moved


def _predict(q: np.ndarray, solved: np.ndarray, k: int) -> np.ndarray:
    """Return the joint angles at frame ``k`` on a line fitted to the nearest ``solved`` frames."""
    frames = solved[np.argsort(np.abs(solved - k), kind="stable")[:NEIGHBOURS]]
    time = frames - frames.mean()
    near = np.unwrap(q[frames], axis=0)
    slope = time @ near / max(time @ time, 1.0)
    return near.mean(axis=0) + slope * (k - frames.mean())


def fill_gaps(
    q: np.ndarray, solved: np.ndarray, sliding: np.ndarray, max_gap: int, take: str
) -> tuple[np.ndarray, dict[str, int]]:
    """Return ``q`` (N, n) without gaps, and the numbers of frames ``interpolated`` and ``held`` at
    the ends. Angles are unwrapped except of ``sliding`` (n,) joints. Raises RecordingError if more
    than ``max_gap`` frames in a row are not ``solved`` (N,).
    """
    frames = np.flatnonzero(solved)
    edges = np.concatenate([[-1], frames, [len(q)]])
    longest = int(np.argmax(np.diff(edges)))
    if edges[longest + 1] - edges[longest] - 1 > max_gap or not len(frames):
        message = (
            f"markers give no joint angles for longer than {max_gap} frames: repair the"
        )
        where = {"frames": f"{edges[longest] + 1} to {edges[longest + 1] - 1}"}
        raise RecordingError(
            f"{message} labels, or leave the take out", take=take, **where
        )
    known = np.where(sliding, q[frames], np.unwrap(q[frames], axis=0))
    q = np.stack(
        [np.interp(np.arange(len(q)), frames, joint) for joint in known.T], axis=1
    )
    held = int(frames[0] + len(q) - 1 - frames[-1])
    return q, {"interpolated": len(q) - len(frames) - held, "held": held}
