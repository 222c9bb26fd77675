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
# share of a joint in undetermined motions above which an error names the joint
UNDETERMINED = 0.1


class JointTrack(NamedTuple):
    """Joint angles of one take."""

    q: np.ndarray  # (N, n) rad, m of prismatic joints, continuous in time
    # (N,) m, rms distance of the markers to the arm; NaN where filled in
    residual: np.ndarray
    counts: dict[str, int]  # losses and repairs, named in :func:`track`
    samples: int  # number of the markers' samples, missing ones included


def follower(robot: Robot, mocap: Mocap) -> Callable[..., JointTrack]:
    """Return a function that tracks one ``take`` from its rows of the table ``markers``."""
    if robot.plane:
        places = [list(link.values()) for link in mocap.markers.values()]
        points = points_in_plane(arm_of(robot), np.array(places), mocap.gate)
    else:
        points = points_in_space(robot, mocap)

    def follow(rows: pd.DataFrame, *, take: str) -> JointTrack:
        rows = rows.sort_values(["link", "marker", "k"], kind="stable")
        frames = rows["k"].nunique()
        by_marker = rows[["x", "y", "z"]].to_numpy().reshape(-1, frames, 3)
        positions = by_marker.transpose(1, 0, 2)
        unlabelled = np.count_nonzero(rows["link"] == 0) // frames  # moved to the end
        positions = np.roll(positions, -unlabelled, axis=1)
        return track(positions, points, max_gap=mocap.max_gap, take=take)

    return follow


def track(
    positions: np.ndarray,
    points: MarkedArm,
    *,
    max_gap: int,
    take: str = "",
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
    pairs = 0
    for on_link in points.link_masks():
        number = present[:, on_link].sum(axis=1)
        pairs += int(np.sum(number == 2))

    q, filled = fill_gaps(q, solved, points.sliding, max_gap, take)
    counts = {"missing": int(missing.sum())} | moved
    counts |= {"two_marker_fits": pairs} | filled
    return JointTrack(q, residual, counts, missing.size)


def _heading_angles(positions: np.ndarray, points: MarkedArm) -> np.ndarray:
    """Return the joint angles (N, n) in rad of a planar arm from the headings of its links."""
    psi = []
    for on_link in points.link_masks():
        measured = positions[:, on_link]
        present = np.isfinite(measured).all(axis=-1)
        in_plane = points.arm.to_plane(measured)
        heading = _headings(in_plane, present, points.places[on_link])
        determined = present.sum(axis=-1) >= 2
        psi.append(_interpolated(heading, determined))
    return points.arm.chain.joints_from_segments(np.stack(psi, axis=-1))


def _headings(
    measured: np.ndarray,
    present: np.ndarray,
    template: np.ndarray,
) -> np.ndarray:
    """Return the headings (N,) in rad that turn the ``template`` (P, 3) m of a link onto its
    ``measured`` markers (N, P, 3) m in the arm's plane, by least squares over the ``present`` ones
    (N, P).
    """
    is_present = present[..., None]
    number = np.maximum(present.sum(axis=-1), 1)
    weight = is_present / number[:, None, None]
    measured = np.where(is_present, measured, 0.0)
    centre = (weight * measured).sum(axis=-2, keepdims=True)
    centred = (measured - centre) * is_present

    turn = np.swapaxes(centred, -1, -2) @ template
    sine = turn[..., 0, 2] - turn[..., 2, 0]
    cosine = turn[..., 0, 0] + turn[..., 2, 2]
    return np.arctan2(sine, cosine)


def _interpolated(heading: np.ndarray, determined: np.ndarray) -> np.ndarray:
    """Return the ``heading`` (N,) in rad, interpolated where it is not ``determined`` (N,); 0 where
    no frame determines it.
    """
    if not determined.any():
        return np.zeros_like(heading)
    frames = np.arange(len(heading))
    unwrapped = np.unwrap(heading[determined])
    between = np.interp(frames, frames[determined], unwrapped)
    return np.where(determined, heading, between)


def _solve_blocks(
    positions: np.ndarray,
    points: MarkedArm,
    take: str,
) -> tuple[np.ndarray, ...]:
    """Return joint angles (N, n) and residuals (N,) m, solved both ways from the start frame."""
    frames = len(positions)
    first, start = _start_frame(positions, points, take)
    q = np.full((frames, len(start)), np.nan)
    residual = np.full(frames, np.nan)
    for way in (np.arange(first, frames), np.arange(first)[::-1]):
        last = start
        for begin in range(0, len(way), BLOCK):
            block = way[begin : begin + BLOCK]
            starts = np.broadcast_to(last, (len(block), len(start)))
            solution = points.solve(positions[block], starts)
            q[block] = solution.q
            residual[block] = solution.residual
            solved = block[np.isfinite(residual[block])]
            if len(solved):
                last = q[solved[-1]]
    return q, residual


def _start_frame(
    positions: np.ndarray,
    points: MarkedArm,
    take: str,
) -> tuple[int, np.ndarray]:
    """Return the first frame that exactly one posture fits, and the posture; or RecordingError."""
    key = "markers"
    message = (
        "no posture of the arm has all markers and bodies of a frame within "
        f"{points.gate:g} m: check their places and mounts, the base, and the gate"
    )
    for k in np.flatnonzero(np.isfinite(positions[..., 0]).any(axis=1)):
        postures = points.postures(positions[k])
        undecided = [posture for posture in postures if not posture.decided]
        if undecided:
            values, vectors = np.linalg.eigh(undecided[0].normal)
            share = (vectors[:, values < LEAST_LEVER**2] ** 2).sum(axis=1)
            joints = ", ".join(np.array(points.joints)[share > UNDETERMINED])
            key = "markers"
            fault = f"the markers and bodies do not determine {joints}"
            message = f"{fault}: track another link"
        elif len(postures) == 1:
            return k, postures[0].q
        elif postures:
            key = "posture"
            message = (
                f"{len(postures)} postures of the arm fit the markers and bodies: track "
                "another link, or state the posture at the start of a take"
            )
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
    labels = len(points.owner)
    moved = {"relabelled": 0, "adopted": 0, "rejected": 0}
    present = np.isfinite(positions).all(axis=-1)
    markers = positions[:, :labels].copy()
    complete = present[:, :labels].all(axis=-1)
    has_unlabelled = present[:, labels:].any(axis=-1)
    incomplete = has_unlabelled & ~complete
    doubtful = np.isnan(residual) | incomplete
    if not doubtful.any():
        return markers, moved
    if np.isnan(residual).all():
        raise RecordingError(
            "no frame has markers that fit the arm: check the template, the labels, the base "
            "frame, the units and the gate",
            take=take,
        )
    # outwards from the first solved frame, so that each frame has a solved neighbour
    start = int(np.argmax(np.isfinite(residual)))
    after = np.flatnonzero(doubtful[start:]) + start
    before = np.flatnonzero(doubtful[:start])[::-1]
    for k in (*after, *before):
        solved = np.flatnonzero(np.isfinite(residual))
        expected = _predict(q, solved, k)[None]
        (modelled,) = points.carry(expected)
        label, sample = _assignment(modelled, positions[k], points.gate)
        labelled = sample < labels
        markers[k] = np.nan
        markers[k, label] = positions[k, sample]
        solution = points.solve(markers[[k]], expected)
        q[[k]] = solution.q
        residual[[k]] = solution.residual
        moved["relabelled"] += int((labelled & (sample != label)).sum())
        moved["adopted"] += int((~labelled).sum())
        recorded = int(present[k, :labels].sum())
        moved["rejected"] += recorded - int(labelled.sum())
    return markers, moved


def _assignment(
    modelled: np.ndarray,
    measured: np.ndarray,
    gate: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices (pairs,) of ``modelled`` points (P, 3) m and of their ``measured`` samples
    (S, 3) m, at most the ``gate`` in m apart, with the least sum of squared distances.
    """
    from scipy.optimize import linear_sum_assignment

    most = gate**2
    square = ((modelled[:, None] - measured) ** 2).sum(axis=-1)
    square[np.isnan(square)] = np.inf
    label, sample = linear_sum_assignment(np.minimum(square, most))
    close = square[label, sample] <= most
    return label[close], sample[close]


def _predict(q: np.ndarray, solved: np.ndarray, k: int) -> np.ndarray:
    """Return the joint angles at frame ``k`` on a line fitted to the nearest ``solved`` frames."""
    by_distance = np.argsort(np.abs(solved - k), kind="stable")
    frames = solved[by_distance[:NEIGHBOURS]]
    middle = frames.mean()
    time = frames - middle
    near = np.unwrap(q[frames], axis=0)
    slope = time @ near / max(time @ time, 1.0)
    return near.mean(axis=0) + slope * (k - middle)


def fill_gaps(
    q: np.ndarray,
    solved: np.ndarray,
    sliding: np.ndarray,
    max_gap: int,
    take: str,
) -> tuple[np.ndarray, dict[str, int]]:
    """Return ``q`` (N, n) without gaps, and the numbers of frames ``interpolated`` and ``held`` at
    the ends. Angles are unwrapped except of ``sliding`` (n,) joints. Raises RecordingError if more
    than ``max_gap`` frames in a row are not ``solved`` (N,).
    """
    frames = np.flatnonzero(solved)
    edges = np.concatenate([[-1], frames, [len(q)]])
    longest = int(np.argmax(np.diff(edges)))
    first = edges[longest] + 1
    last = edges[longest + 1] - 1
    if last - first + 1 > max_gap or not len(frames):
        raise RecordingError(
            f"markers give no joint angles for longer than {max_gap} frames: repair the "
            "labels, or leave the take out",
            take=take,
            frames=f"{first} to {last}",
        )

    unwrapped = np.unwrap(q[frames], axis=0)
    continuous = np.where(sliding, q[frames], unwrapped)
    k = np.arange(len(q))
    joints = [np.interp(k, frames, joint) for joint in continuous.T]
    held_at_end = len(q) - 1 - frames[-1]
    held = int(frames[0] + held_at_end)
    interpolated = len(q) - len(frames) - held
    return np.stack(joints, axis=1), {"interpolated": interpolated, "held": held}
