"""Joint angles of an arm in space from motion capture: of rigid bodies on its links, or of single
markers.

A rigid body comes as the points that it carries (see ``pipeline/recordings/motion_capture.py``):
so one law, the least sum of squared distances over the joint angles, serves bodies and markers, in
metres alone. Where the points of a body are its own markers, its turn has by this the weight that
its markers give it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from pipeline.core.errors import RecordingError
from pipeline.core.options.motion_capture import Mocap
from pipeline.perception.carried import LEAST_LEVER, Carried
from pipeline.perception.joint_track import JointTrack, fill_gaps

BLOCK = 16  # frames that are solved at once, from the one before them
OPEN = 0.1  # share of a joint's turn that lies among the motions that no point shows


def track_rows(
    rows: pd.DataFrame, mocap: Mocap, points: Carried, joints: Sequence[str], *, take: str
) -> JointTrack:
    """Angles of the ``joints`` of one take from its ``rows`` of the table ``markers``; markers
    without a label stay unused. See :func:`track_joints`.
    """
    labelled = rows[rows.link > 0].sort_values(["link", "marker", "k"], kind="stable")
    positions = labelled[["x", "y", "z"]].to_numpy().reshape(len(points.owner), -1, 3)
    gates = {"gate": mocap.gate, "max_gap": mocap.max_gap}
    return track_joints(positions.transpose(1, 0, 2), points, joints, **gates, take=take)


def track_joints(
    positions: np.ndarray,
    points: Carried,
    joints: Sequence[str],
    *,
    gate: float,
    max_gap: int,
    take: str = "",
) -> JointTrack:
    """Joint angles of one take.

    The first frame that one posture alone fits is the start, the others follow from it in blocks. A
    frame with a point beyond the gate goes without the link whose absence lets it fit best; one
    that does not fit then, or whose points do not decide every joint, is missing. Counts: samples
    ``missing`` and ``rejected``; frames ``unfit``, ``undecided``, ``interpolated`` and ``held``.
    Raises RecordingError where no frame is decided, or fits, and for longer gaps than ``max_gap``.

    Args:
        positions: (N, P, 3) of the points in the base frame, m, NaN where missing.
        points: where the arm carries them.
        joints: names of the n joints, for messages.
        gate: m; how far a point may lie from where the arm carries it.
        max_gap: frames; shorter runs of missing ones are filled.
        take: name of the take, for messages.
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
            for k, solution in zip(block, points.solve_all(positions[block], starts), strict=True):
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
    q, filled = fill_gaps(q, np.isfinite(residual), max_gap, take, lack="is decided")
    known = np.isfinite(errors).all(axis=1)
    error = np.sqrt(np.mean(errors[known] ** 2, axis=0)).tolist() if known.any() else []
    stated = dict(zip(joints, error, strict=False))
    return JointTrack(q, residual, counts | filled, missing.size, stated)


def _first(
    positions: np.ndarray, points: Carried, joints: Sequence[str], gate: float, take: str
) -> tuple[int, np.ndarray]:
    """The first frame that one posture alone fits, and that posture (n,); RecordingError where
    there is none.
    """
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
    key = "dataset.mocap.markers"
    if undecided is not None:
        values, vectors = np.linalg.eigh(undecided.normal)
        share = (vectors[:, values < LEAST_LEVER**2] ** 2).sum(axis=1)
        left = [name for name, part in zip(joints, share, strict=True) if part > OPEN]
        raise RecordingError(
            f"the markers and bodies leave {', '.join(left)} open: follow another link",
            take=take,
            key=key,
        )
    if several > 1:
        raise RecordingError(
            f"{several} postures of the arm fit the markers and bodies: follow another link, or say"
            " about which one a take starts",
            take=take,
            key="dataset.mocap.posture",
        )
    raise RecordingError(
        f"no posture of the arm has all markers and bodies of a frame within {gate:g} m: check "
        "their places and mounts, the base, and the gate",
        take=take,
        key=key,
    )
