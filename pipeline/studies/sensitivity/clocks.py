"""The depth camera on each clock that the paper may have had."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.cases.camera import Camera, camera_of

# ways to put the frames on the clock of the motion, which the paper does not state
CLOCKS = ("aligned", "not aligned", "a frame late", "a frame early", "nearest step")


def retimed(
    angles: pd.DataFrame, clock: str, offsets: pd.Series, frame: float, step: float
) -> pd.DataFrame:
    """``angles`` (columns take and t in s, among others) with the times that the frames have by
    another of the CLOCKS.

    Given are the times by the offset between the clocks as it was found for each take, and that
    offset in s by take; ``frame`` and ``step`` are the periods of camera and motion in s. Only the
    times of the measurements change: the joint angles remain those that were articulated with an
    end-effector at the right time.
    """
    t = angles["t"]
    times = {
        "aligned": t,
        "not aligned": t - angles["take"].map(offsets),
        "a frame late": t + frame,
        "a frame early": t - frame,
        "nearest step": np.rint(t / step) * step,
    }
    return angles.assign(t=times[clock])


def camera_on(
    clock: str,
    angles: pd.DataFrame,
    joints: pd.DataFrame,
    offsets: pd.Series,
    *,
    frame: float,
    step: float,
    window: int,
) -> Camera:
    """The camera on a clock of CLOCKS, its noise estimated on that clock too, over ``window``
    frames on either side.

    ``angles`` and ``joints``: tables of the depth camera and the motion capture; the other
    arguments as in :func:`retimed`. Raises RecordingError as :func:`camera_of`.
    """
    return camera_of(retimed(angles, clock, offsets, frame, step), joints, window=window)
