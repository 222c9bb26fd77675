"""Depth sequences on the motion clock: as the datasheet states it, else found by where the seen arm moves as its markers do."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import schema
from pipeline.arm.model import Arm
from pipeline.errors import RecordingError
from pipeline.perception.depth_sequence import DepthSequence, take_name, take_paths
from pipeline.perception.sync import find_offset
from pipeline.recordings.quality import quality_row, require_text

Signal = tuple[np.ndarray, np.ndarray]  # times (K,) in s, centroid (K, 2) in m in the plane


def marker_centroid(rows: pd.DataFrame, arm: Arm) -> Signal:
    """Times (K,) s and centroid (K, 2) m in the plane of the labelled markers, at the frames that show all of them."""
    labelled = rows[rows.link > 0]
    plane = pd.DataFrame(arm.to_plane(labelled[["x", "y", "z"]].to_numpy())[:, [0, 2]], index=labelled["t"].to_numpy())
    centroid = plane.groupby(level=0).agg(lambda values: values.mean(skipna=False)).dropna()
    return centroid.index.to_numpy(), centroid.to_numpy()


def frame_rows(trial: tuple[Path, Signal], depth: schema.Depth, arm: Arm, raw: Path) -> tuple[pd.DataFrame, list[dict]]:
    """Rows of the table ``frames`` of one take, from its folder or bag and its markers' centroid; and their quality.

    A frame whose points of the arm are the very same as in the one before was not measured: ``frozen_frames``, counted and left out.

    Raises RecordingError for frames that are no depth images, and where the clocks' offset cannot be found.
    """
    path, centroid = trial
    take = take_name(path)
    sequence = DepthSequence(path, depth, arm, raw)
    seen = list(sequence.points(range(len(sequence.time))))
    frozen = np.array([False] + [_same(points, before) for (before, _), (points, _) in pairwise(seen)])
    # what a frozen camera shows is of an earlier time
    moving = [points if live else points[:0] for (points, _), live in zip(seen, ~frozen, strict=True)]
    offset, clock = _clock_offset(sequence.time, moving, centroid, depth, path)
    rows = pd.DataFrame(
        {"take": take, "part": "test", "frame": np.arange(len(seen)), "t": sequence.time + offset}
        | {"file": sequence.references, "valid": [valid for _, valid in seen]}
    )[~frozen]
    dropped = int(np.sum(np.rint(np.diff(sequence.time) * depth.rate) - 1))
    quality = [
        quality_row(take, "test", "depth camera", "dropped_frames", dropped),
        quality_row(take, "test", "depth camera", "dropped_share", dropped / (dropped + len(seen)), "share"),
        quality_row(take, "test", "depth camera", "frozen_frames", frozen.sum()),
        quality_row(take, "test", "depth camera", "clock_offset", offset, "s"),
        *clock,
        *(quality_row(take, "test", "depth camera", key, value) for key, value in sequence.counts.items()),
    ]
    return rows, quality


def _clock_offset(
    time: np.ndarray, seen: list[np.ndarray], centroid: Signal, depth: schema.Depth, path: Path
) -> tuple[float, list[dict]]:  # fmt: skip
    """What to add to ``time`` (F,) s to read the motion clock, and how well it is known where the motion had to tell it."""
    if depth.clock_offset is not None:
        return depth.clock_offset, []
    take = take_name(path)
    usable = np.array([len(points) > 0 for points in seen])
    if not usable.any():
        raise RecordingError("no frame shows the arm: check the unit of depth, the camera's pose and the workspace", file=path, take=take)
    cloud = np.array([points.mean(axis=0) for points in seen if len(points)])
    found = find_offset(time[usable], cloud, *centroid, search=(-depth.search, depth.search), take=take)
    return found.value, [
        quality_row(take, "test", "depth camera", "clock_offset_standard_error", found.standard_error, "s"),
        quality_row(take, "test", "depth camera", "clock_drift", found.drift, "s/s"),
        quality_row(take, "test", "depth camera", "clock_drift_standard_error", found.drift_standard_error, "s/s"),
        quality_row(take, "test", "depth camera", "clock_correlation", found.correlation),
    ]


def _same(points: np.ndarray, before: np.ndarray) -> bool:
    return len(points) > 0 and np.array_equal(points, before)


def find_takes(raw: Path, depth: schema.Depth, markers: pd.DataFrame, arm: Arm) -> list[tuple[Path, Signal]]:
    """Folder or bag of every depth take below ``raw``, each with the centroid of the ``markers`` of the take of its name.

    Raises RecordingError where the pattern matches none, or a take has no motion capture to set its clock by.
    """
    paths = take_paths(raw, depth)
    seen = {take: rows for take, rows in markers.groupby("take") if take in paths}
    for take, path in paths.items():
        require_text(path)
        if take not in seen:
            raise RecordingError("no motion-capture take of this name to set the clock by", file=path, take=take)
    return [(path, marker_centroid(seen[take], arm)) for take, path in paths.items()]
