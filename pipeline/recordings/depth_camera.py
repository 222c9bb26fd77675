"""Depth sequences on the motion clock: as the datasheet states it, else found by where the seen arm
moves as its markers do.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.arm.model import Arm
from pipeline.core.errors import RecordingError
from pipeline.core.options.depth_camera import Depth
from pipeline.recordings.clocks import find_offset
from pipeline.recordings.depth_sequence import DepthSequence, take_name, take_paths
from pipeline.recordings.quality import quality_row, require_text

CAMERA = "depth camera"
Signal = tuple[np.ndarray, np.ndarray]  # times (K,) in s, centroid (K, 2) in m in the plane


def marker_centroid(rows: pd.DataFrame, arm: Arm) -> Signal:
    """Times (K,) s and centroid (K, 2) m in the plane of the labelled markers, at the frames that
    show all of them.
    """
    labelled = rows[rows.link > 0]
    plane = pd.DataFrame(
        arm.to_plane(labelled[["x", "y", "z"]].to_numpy())[:, [0, 2]],
        index=labelled["t"].to_numpy(),
    )
    centroid = plane.groupby(level=0).agg(lambda values: values.mean(skipna=False)).dropna()
    return centroid.index.to_numpy(), centroid.to_numpy()


def frame_rows(
    path: Path, depth: Depth, arm: Arm, raw: Path, folder: Path
) -> tuple[pd.DataFrame, list[dict]]:
    """Rows of the table ``frames`` of the take in the folder or bag ``path``, on the camera's own
    clock; and their quality. The arm's points are written below ``folder`` (:func:`arm_points`), so
    that no frame is decoded twice.

    A frame whose points of the arm are the very same as in the one before was not measured: what a
    frozen camera shows is of an earlier time. ``frozen_frames`` are counted and left out.

    Raises RecordingError for frames that are no depth images.
    """
    take = take_name(path)
    sequence = DepthSequence(path, depth, arm, raw)
    frames = list(sequence.points(range(len(sequence.time))))
    clouds = [points for points, _ in frames]
    frozen = np.array([False] + [_same(points, before) for before, points in pairwise(clouds)])
    kept = [points for points, still in zip(clouds, frozen, strict=True) if not still]
    empty = np.full(2, np.nan)
    centroid = np.array([points.mean(axis=0) if len(points) else empty for points in kept])
    rows = pd.DataFrame(
        {"take": take, "part": "test", "frame": np.arange(len(frames)), "t": sequence.time}
        | {"file": sequence.references, "valid": [valid for _, valid in frames]}
    )[~frozen]
    rows = rows.assign(points=[len(points) for points in kept], x=centroid[:, 0], z=centroid[:, 1])
    np.save(folder / f"{take}.npy", np.concatenate(kept))
    dropped = int(np.sum(np.rint(np.diff(sequence.time) * depth.rate) - 1))
    counts = {"dropped_frames": dropped, "frozen_frames": frozen.sum()} | sequence.counts
    quality = [quality_row(take, "test", CAMERA, key, value) for key, value in counts.items()]
    share = dropped / (dropped + len(frames))
    return rows, [*quality, quality_row(take, "test", CAMERA, "dropped_share", share, "share")]


def arm_points(rows: pd.DataFrame, folder: Path) -> list[np.ndarray]:
    """Of each of a take's ``rows`` of the table ``frames``: the points (I, 2) of the arm in m in
    its plane, as :func:`frame_rows` wrote them below ``folder``.
    """
    take = rows["take"].iloc[0]
    return np.split(np.load(folder / f"{take}.npy"), np.cumsum(rows["points"])[:-1])


def on_motion_clock(
    take: tuple[pd.DataFrame, pd.DataFrame], depth: Depth, arm: Arm
) -> tuple[pd.DataFrame, list[dict]]:
    """The rows of the table ``frames`` of one take on the motion's clock, and how well the clocks'
    offset is known where the motion has to tell it.

    ``take`` holds the rows on the camera's clock and those of the table ``markers``. Raises
    RecordingError where the offset cannot be found.
    """
    rows, markers = take
    name, file = rows["take"].iloc[0], rows["file"].iloc[0]
    if depth.clock_offset is not None:
        offset, quality = depth.clock_offset, []
    else:
        observed = rows[rows["points"] > 0]
        if observed.empty:
            raise RecordingError(
                "no frame shows the arm: check the unit of depth, the camera's pose and the "
                "workspace",
                file=file,
                take=name,
            )
        result = find_offset(
            observed["t"].to_numpy(),
            np.ascontiguousarray(observed[["x", "z"]].to_numpy()),
            *marker_centroid(markers, arm),
            search=(-depth.search, depth.search),
            take=name,
        )
        offset = result.value
        quality = [
            ("clock_offset_standard_error", result.standard_error, "s"),
            ("clock_drift", result.drift, "s/s"),
            ("clock_drift_standard_error", result.drift_standard_error, "s/s"),
            ("clock_correlation", result.correlation, "1"),
        ]
    quality = [("clock_offset", offset, "s"), *quality]
    rows = rows.assign(t=rows["t"] + offset)
    return rows, [quality_row(name, "test", CAMERA, *row) for row in quality]


def _same(points: np.ndarray, before: np.ndarray) -> bool:
    return len(points) > 0 and np.array_equal(points, before)


def find_takes(raw: Path, depth: Depth) -> list[Path]:
    """Folder or bag of every depth take below ``raw``; RecordingError where the pattern matches
    none.
    """
    paths = list(take_paths(raw, depth).values())
    for path in paths:
        require_text(path)
    return paths


def with_markers(
    frames: pd.DataFrame, markers: pd.DataFrame
) -> list[tuple[pd.DataFrame, pd.DataFrame]]:
    """Of every take of the table ``frames`` its rows and those of the table ``markers``;
    RecordingError for a take without motion capture to set its clock by.
    """
    by_take = dict(list(markers.groupby("take")))
    for take, rows in frames.groupby("take"):
        if take not in by_take:
            raise RecordingError(
                "no motion-capture take of this name to set the clock by",
                file=rows["file"].iloc[0],
                take=take,
            )
    return [(rows, by_take[take]) for take, rows in frames.groupby("take", sort=False)]
