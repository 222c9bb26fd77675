"""Joint angles of one take from its motion-capture markers or bodies, by least squares.

One distance, the gate, decides whether a sample can be the marker of its label: beyond the error of
the base frame's registration, below half the distance between markers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import permutations
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.arm.model import Arm, arm_of
from pipeline.core.errors import RecordingError
from pipeline.core.options.dataset import Robot
from pipeline.core.options.instruments import Mocap
from pipeline.perception.posture import LEAST_LEVER, Carried, points_in_plane, points_in_space

# solved frames from which a frame's pose is predicted: enough to damp noise, few enough for a
# straight line
NEIGHBOURS = 5
BLOCK = 16  # frames of an arm in space that are solved at once, from the one before them
OPEN = 0.1  # share of a joint's turn that lies among the motions that no point shows


class JointTrack(NamedTuple):
    """Joint angles of one take."""

    q: np.ndarray  # (N, n) rad, m of prismatic joints, continuous in time
    residual: np.ndarray  # (N,) m, rms distance of the markers to the arm; NaN where filled in
    counts: dict[str, int]  # losses and repairs, as the tracker names them
    samples: int  # of markers, of which some are missing
    errors: Mapping[str, float] = {}  # standard error of each joint's angle in a frame


def follower(robot: Robot, mocap: Mocap) -> Callable[..., JointTrack]:
    """Return the function of a take's rows of the table ``markers`` and its name ``take``."""
    options = {"gate": mocap.gate, "max_gap": mocap.max_gap}
    if robot.plane:
        arm = arm_of(robot)
        template = np.array([list(link.values()) for link in mocap.markers.values()])
        track = partial(track_plane, arm=arm, points=points_in_plane(arm, template), **options)
    else:
        points = points_in_space(robot, mocap)
        track = partial(track_space, points=points, joints=robot.joints, **options)

    def follow(rows: pd.DataFrame, *, take: str) -> JointTrack:
        positions = rows.sort_values(["link", "marker", "k"], kind="stable")
        frames = positions["k"].nunique()
        labelled, stray = (
            part[["x", "y", "z"]].to_numpy().reshape(-1, frames, 3).transpose(1, 0, 2)
            for part in (positions[positions["link"] > 0], positions[positions["link"] == 0])
        )
        return track(labelled, stray=stray, take=take)

    return follow


def track_plane(
    positions: np.ndarray,
    arm: Arm,
    points: Carried,
    *,
    gate: float,
    max_gap: int,
    stray: np.ndarray | None = None,
    take: str = "",
) -> JointTrack:
    """Return the joint angles of one ``take`` of a planar ``arm`` from the ``positions`` (N, P, 3)
    m of its ``points`` in the base frame, NaN where missing, and further ones ``stray`` (N, U, 3).

    Samples beyond the ``gate`` (m) are relabelled or left out; runs of at most ``max_gap`` frames
    are filled. Counts: samples ``missing``, ``relabelled``, ``adopted`` from the unlabelled,
    ``rejected``; ``two_marker_fits``; frames ``interpolated`` and ``held``. Raises RecordingError
    for longer gaps or markers that never fit.
    """
    if not len(positions):
        raise RecordingError("the take has no frame", take=take)
    extra = np.empty((len(positions), 0, 3)) if stray is None else stray
    missing = int(np.isnan(positions[..., 0]).sum())
    markers, q, residual, moved = _correct_labels(positions, extra, arm, points, gate, take)
    solved = np.isfinite(residual)
    present = ~np.isnan(markers[solved][..., 0])
    pairs = sum((present[:, mine].sum(axis=1) == 2).sum() for mine in points.of_links())
    q, filled = fill_gaps(q, solved, points.sliding, max_gap, take)
    counts = {"missing": missing} | moved | {"two_marker_fits": int(pairs)} | filled
    return JointTrack(q, residual, counts, samples=markers[..., 0].size)


def _headings(arm: Arm, points: np.ndarray, template: np.ndarray) -> np.ndarray:
    """(...) rad, turn about the normal from ``template`` (K, 3) to ``points`` (..., K, 3)."""
    present = np.isfinite(points).all(axis=-1)
    weight = (present / np.maximum(present.sum(axis=-1), 1)[..., None])[..., None]
    measured = np.where(present[..., None], arm.to_plane(points), 0.0)
    measured = (measured - (weight * measured).sum(axis=-2, keepdims=True)) * present[..., None]
    turn = np.swapaxes(measured, -1, -2) @ template
    psi = np.arctan2(turn[..., 0, 2] - turn[..., 2, 0], turn[..., 0, 0] + turn[..., 2, 2])
    return np.where(present.sum(axis=-1) >= 2, psi, np.nan)


def _correct_labels(
    positions: np.ndarray, extra: np.ndarray, arm: Arm, points: Carried, gate: float, take: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, int]]:
    """Markers (N, P, 3) with the right labels, joint angles (N, n), residuals (N,), NaN where there
    are none, and the counts moved. In frames that do not fit every position goes to the label whose
    place, predicted from the nearest solved frames, it fits best: an optimal assignment.
    """
    from scipy.optimize import linear_sum_assignment

    def solve(markers: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        solution = points.solve_all(markers, starts)
        fits = solution.decided & (solution.distances <= gate).all(axis=-1)
        return solution.q, np.where(fits, solution.residual, np.nan)

    labels, frames = len(points.owner), np.arange(len(positions))
    psi = [_headings(arm, positions[:, mine], points.places[mine]) for mine in points.of_links()]
    for heading in psi:
        known = np.isfinite(heading)
        turned = np.unwrap(heading[known])
        heading[~known] = np.interp(frames[~known], frames[known], turned) if known.any() else 0.0
    q, residual = solve(positions, arm.chain.joints_from_segments(np.stack(psi, axis=-1)))
    moved = {"relabelled": 0, "adopted": 0, "rejected": 0}
    strays = np.isfinite(extra).all(axis=-1)
    incomplete = np.isnan(positions[..., 0]).any(axis=-1) & strays.any(axis=-1)
    doubtful = np.isnan(residual) | incomplete
    if not doubtful.any():
        return positions, q, residual, moved
    markers = positions.copy()
    start, pose = int(np.argmax(np.isfinite(residual))), None
    if np.isnan(residual).all():
        start, pose = _first_pose(positions, extra, arm, points, gate, take)
    # outwards from the first pose that is sure, so that each frame has a solved neighbour
    for k in [*np.flatnonzero(doubtful[start:]) + start, *np.flatnonzero(doubtful[:start])[::-1]]:
        solved = np.flatnonzero(np.isfinite(residual))
        expected = _predict(q, solved, k) if len(solved) else pose
        candidates = np.concatenate([markers[k], extra[k][strays[k]]])
        square = ((points.carry(expected[None])[0][:, None] - candidates) ** 2).sum(axis=-1)
        square[np.isnan(square)] = np.inf
        label, sample = linear_sum_assignment(np.minimum(square, gate**2))
        close = square[label, sample] <= gate**2
        label, sample = label[close], sample[close]
        present, own = int(np.isfinite(markers[k]).all(axis=-1).sum()), sample < labels
        markers[k] = np.nan
        markers[k, label] = candidates[sample]
        q[k : k + 1], residual[k : k + 1] = solve(markers[k : k + 1], expected[None])
        moved["relabelled"] += int((own & (sample != label)).sum())
        moved["adopted"] += int((~own).sum())
        moved["rejected"] += present - int(own.sum())
    return markers, q, residual, moved


def _predict(q: np.ndarray, solved: np.ndarray, k: int) -> np.ndarray:
    """Joint angles at frame ``k`` on the straight line through the ``solved`` frames nearest."""
    frames = solved[np.argsort(np.abs(solved - k), kind="stable")[:NEIGHBOURS]]
    time = frames - frames.mean()
    near = np.unwrap(q[frames], axis=0)
    slope = time @ near / max(time @ time, 1.0)
    return near.mean(axis=0) + slope * (k - frames.mean())


def _first_pose(
    positions: np.ndarray, extra: np.ndarray, arm: Arm, points: Carried, gate: float, take: str
) -> tuple[int, np.ndarray]:
    """A frame and its joint angles (n,) where none fits as labelled: link by link, the ordered
    triple of positions that has the template's shape and starts where the link before ends.
    """
    links, chain = len(points.chains), arm.chain

    def sides(triangles: np.ndarray) -> np.ndarray:
        return np.linalg.norm(triangles - np.roll(triangles, 1, axis=-2), axis=-1)

    for k in range(len(positions)):
        found = np.concatenate([positions[k], extra[k]])
        found = found[np.isfinite(found).all(axis=-1)]
        if len(found) < 3 * links:
            continue
        ordered = found[list(permutations(range(len(found)), 3))]
        q = np.zeros(links)
        for j, mine in enumerate(points.of_links()):
            # two markers that lie within the gate of their places are as far apart as these, but
            # for twice the gate
            off = np.abs(sides(ordered) - sides(points.places[mine]))
            triples = ordered[(off <= 2 * gate).all(axis=-1)]
            if not len(triples):
                break
            heading = chain.segment_headings(np.broadcast_to(q, (len(triples), links))).copy()
            heading[:, j] = _headings(arm, triples, points.places[mine])
            trial = chain.joints_from_segments(heading)
            error = np.abs(points.carry(trial)[:, mine] - triples).max(axis=(-2, -1))
            q = trial[np.argmin(error)]
            if error.min() > gate:
                break
        else:
            return k, q
    message = "no frame has markers that fit the arm: check the template, the base frame, the units"
    raise RecordingError(f"{message} and the gate", take=take)


def track_space(
    positions: np.ndarray,
    points: Carried,
    joints: Sequence[str],
    *,
    gate: float,
    max_gap: int,
    stray: np.ndarray | None = None,
    take: str = "",
) -> JointTrack:
    """Return the joint angles of one take of an arm in space, as :func:`track_plane`; ``joints``:
    names of the n joints; ``stray`` stays unused.

    The first frame that one posture alone fits is the start, the others follow in blocks. A frame
    with a point beyond the gate goes without the link whose absence lets it fit best. Counts:
    samples ``missing`` and ``rejected``; frames ``unfit``, ``undecided``, ``interpolated`` and
    ``held``. Raises RecordingError where no frame is decided or fits, and for longer gaps.
    """
    frames, n = len(positions), len(joints)
    first, start = _first(positions, points, joints, gate, take)
    q, residual = np.full((frames, n), np.nan), np.full(frames, np.nan)
    errors, missing = np.full((frames, n), np.nan), np.isnan(positions[..., 0])
    counts = {"missing": int(missing.sum()), "rejected": 0, "unfit": 0, "undecided": 0}
    for way in (range(first, frames), range(first - 1, -1, -1)):
        last = start
        for begin in range(0, len(way), BLOCK):
            block = way[begin : begin + BLOCK]
            starts = np.broadcast_to(last, (len(block), n))
            solutions = points.solve_all(positions[block], starts).each()
            for k, solution in zip(block, solutions, strict=True):
                if not solution.decided:
                    counts["undecided"] += 1
                    continue
                if solution.distances.max() > gate:
                    solution = points.without_a_link(positions[k], last, gate)
                if solution is None:
                    counts["unfit"] += 1
                    continue
                counts["rejected"] += int((~missing[k] & ~solution.seen).sum())
                last = q[k] = solution.q
                residual[k], errors[k] = solution.residual, points.errors(solution)
    q, filled = fill_gaps(q, np.isfinite(residual), points.sliding, max_gap, take)
    known = np.isfinite(errors).all(axis=1)
    error = np.sqrt(np.mean(errors[known] ** 2, axis=0)).tolist() if known.any() else []
    stated = dict(zip(joints, error, strict=False))
    return JointTrack(q, residual, counts | filled, missing.size, stated)


def _first(
    positions: np.ndarray, points: Carried, joints: Sequence[str], gate: float, take: str
) -> tuple[int, np.ndarray]:
    """The first frame that one posture alone fits, and that posture (n,), or RecordingError."""
    several, undecided = 0, None
    for k, measured in enumerate(positions):
        if np.isnan(measured[:, 0]).all():
            continue
        postures = points.postures(measured, gate)
        decided = [one for one in postures if one.decided]
        if len(decided) == len(postures) == 1:
            return k, decided[0].q
        several = max(several, len(decided))
        undecided = next((one for one in postures if not one.decided), undecided)
    key = "markers"
    if undecided is not None:
        values, vectors = np.linalg.eigh(undecided.normal)
        share = (vectors[:, values < LEAST_LEVER**2] ** 2).sum(axis=1)
        left = [name for name, part in zip(joints, share, strict=True) if part > OPEN]
        message = f"the markers and bodies leave {', '.join(left)} open: follow another link"
    elif several > 1:
        key = "posture"
        message = f"{several} postures of the arm fit the markers and bodies: follow another link,"
        message += " or say about which one a take starts"
    else:
        message = f"no posture of the arm has all markers and bodies of a frame within {gate:g} m:"
        message += " check their places and mounts, the base, and the gate"
    raise RecordingError(message, take=take, key=f"dataset.mocap.{key}")


def fill_gaps(
    q: np.ndarray, solved: np.ndarray, sliding: np.ndarray, max_gap: int, take: str
) -> tuple[np.ndarray, dict[str, int]]:
    """Return ``q`` (N, n) without whole turns but of ``sliding`` (n,) joints, linear across gaps
    and held at the ends, and the frames ``interpolated`` and ``held``. Raises RecordingError where
    no frame is ``solved`` (N,), or more than ``max_gap`` in a row are not.
    """
    frames = np.flatnonzero(solved)
    if not len(frames):
        raise RecordingError("no frame has enough markers to determine every joint", take=take)
    edges = np.concatenate([[-1], frames, [len(q)]])
    longest = int(np.argmax(np.diff(edges)))
    if edges[longest + 1] - edges[longest] - 1 > max_gap:
        message = f"markers give no joint angles for longer than {max_gap} frames: repair the"
        where = {"frames": f"{edges[longest] + 1} to {edges[longest + 1] - 1}"}
        raise RecordingError(f"{message} labels, or leave the take out", take=take, **where)
    known = np.where(sliding, q[frames], np.unwrap(q[frames], axis=0))
    q = np.stack([np.interp(np.arange(len(q)), frames, joint) for joint in known.T], axis=1)
    held = int(frames[0] + len(q) - 1 - frames[-1])
    return q, {"interpolated": len(q) - len(frames) - held, "held": held}
