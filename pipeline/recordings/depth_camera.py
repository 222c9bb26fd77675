"""Depth sequences on the motion clock: found by where the seen arm moves as its markers do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import schema
from pipeline.arm.model import Arm
from pipeline.errors import RecordingError
from pipeline.perception.depth_sequence import DepthSequence
from pipeline.perception.sync import find_offset
from pipeline.recordings.quality import quality_row

Signal = tuple[np.ndarray, np.ndarray]  # times (K,) in s, centroid (K, 2) in m in the plane


def marker_centroid(rows: pd.DataFrame, arm: Arm) -> Signal:
    """Times (K,) s and centroid (K, 2) m in the plane of the labelled markers, at the frames that show all of them."""
    labelled = rows[rows.link > 0]
    plane = pd.DataFrame(arm.to_plane(labelled[["x", "y", "z"]].to_numpy())[:, [0, 2]], index=labelled["t"].to_numpy())
    centroid = plane.groupby(level=0).agg(lambda values: values.mean(skipna=False)).dropna()
    return centroid.index.to_numpy(), centroid.to_numpy()


def frame_rows(trial: tuple[Path, Signal], depth: schema.Depth, arm: Arm, raw: Path) -> tuple[pd.DataFrame, list[dict]]:
    """Rows of the table ``frames`` of one take, from its folder and its markers' centroid; and their quality.

    Raises RecordingError for frames that are no depth images, and where the clocks' offset cannot be found.
    """
    path, centroid = trial
    take = path.name
    sequence = DepthSequence(path, depth, arm, raw)
    seen = [sequence.points(frame) for frame in range(len(sequence.time))]
    usable = np.array([len(points) > 0 for points, _ in seen])
    cloud = np.array([points.mean(axis=0) for points, _ in seen if len(points)])
    offset = find_offset(sequence.time[usable], cloud, *centroid, search=(-depth.search, depth.search), take=take)
    rows = pd.DataFrame(
        {"take": take, "part": "test", "frame": np.arange(len(seen)), "t": sequence.time + offset.value}
        | {"file": [str(file.relative_to(raw)) for file in sequence.files], "valid": [valid for _, valid in seen]}
    )
    dropped = int(np.sum(np.rint(np.diff(sequence.time) * depth.rate) - 1))
    quality = [
        quality_row(take, "test", "depth camera", "dropped_frames", dropped),
        quality_row(take, "test", "depth camera", "clock_offset", offset.value, "s"),
        quality_row(take, "test", "depth camera", "clock_offset_standard_error", offset.standard_error, "s"),
        quality_row(take, "test", "depth camera", "clock_correlation", offset.correlation),
        *(quality_row(take, "test", "depth camera", key, value) for key, value in sequence.counts.items()),
    ]
    return rows, quality


def find_takes(raw: Path, depth: schema.Depth, markers: pd.DataFrame, arm: Arm) -> list[tuple[Path, Signal]]:
    """Folder of every depth take below ``raw``, each with the centroid of the ``markers`` of the take of its name.

    Raises RecordingError where the pattern matches none, or a take has no motion capture to set its clock by.
    """
    folders = sorted(path for path in raw.glob(depth.takes) if path.is_dir())
    if not folders:
        raise RecordingError(f"no folder of depth frames matches {depth.takes!r}", file=raw)
    seen = {take: rows for take, rows in markers.groupby("take") if take in {folder.name for folder in folders}}
    for folder in folders:
        if folder.name not in seen:
            raise RecordingError("no motion-capture take of this name to set the clock by", file=folder, take=folder.name)
    return [(folder, marker_centroid(seen[folder.name], arm)) for folder in folders]
