"""Depth takes as tables: of every frame its time on the camera's own clock and the arm's points."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.arm.model import Arm
from pipeline.core.options.instruments import Depth
from pipeline.formats.depth.index import dropped_frames
from pipeline.recordings.depth_points import write_points
from pipeline.recordings.depth_sequence import DepthSequence
from pipeline.recordings.quality import DEPTH_CAMERA, quality_row


def frame_rows(
    named: tuple[str, Path], depth: Depth, arm: Arm, raw: Path, folder: Path
) -> tuple[pd.DataFrame, list[dict]]:
    """Rows of the table ``frames`` of a take, of its name and its folder or bag, on the camera's
    own clock; and their quality. The arm's points are written below ``folder``
    (:func:`pipeline.recordings.depth_points.write_points`), so that no frame is decoded twice.

    A frame whose points of the arm are the very same as in the one before was not measured: what a
    frozen camera shows is of an earlier time. ``frozen_frames`` are counted and left out.

    Raises RecordingError for frames that are no depth images.
    """
    take, path = named
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
    write_points(kept, take, folder)
    dropped = dropped_frames(sequence.time)
    counts = {"dropped_frames": dropped, "frozen_frames": frozen.sum()} | sequence.counts
    quality = [quality_row(take, "test", DEPTH_CAMERA, key, value) for key, value in counts.items()]
    share = dropped / (dropped + len(frames))
    quality.append(quality_row(take, "test", DEPTH_CAMERA, "dropped_share", share, "share"))
    return rows, quality


def _same(points: np.ndarray, before: np.ndarray) -> bool:
    return len(points) > 0 and np.array_equal(points, before)
