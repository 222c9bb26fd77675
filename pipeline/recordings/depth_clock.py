"""Depth takes on the motion clock: as the datasheet states it, else found by where the seen arm
moves as its markers do.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.arm.model import Arm
from pipeline.core.errors import RecordingError
from pipeline.core.options.instruments import Depth
from pipeline.recordings.clocks import find_offset
from pipeline.recordings.quality import DEPTH_CAMERA, quality_row

Signal = tuple[np.ndarray, np.ndarray]  # times (K,) in s, centroid (K, 2) in m in the plane


def marker_centroid(rows: pd.DataFrame, arm: Arm) -> Signal:
    """Times (K,) s and centroid (K, 2) m in the plane of the labelled markers, at the frames that
    show all of them.
    """
    labelled = rows[rows.link > 0]
    plane = arm.to_plane(labelled[["x", "y", "z"]].to_numpy())
    time, frame, number = np.unique(
        labelled["t"].to_numpy(), return_inverse=True, return_counts=True
    )
    order, first = np.argsort(frame, kind="stable"), np.cumsum(number) - number
    centroid = np.empty((2, len(time)))
    for markers in np.unique(number):  # the frames that have as many are averaged at once
        chosen = number == markers
        shown = order[first[chosen, None] + np.arange(markers)]
        centroid[:, chosen] = [plane[shown, i].mean(axis=1) for i in (0, 2)]
    whole = ~np.isnan(centroid).any(axis=0)
    return time[whole], centroid.compress(whole, axis=1).T


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
    return rows, [quality_row(name, "test", DEPTH_CAMERA, *row) for row in quality]
