"""The depth camera as a filter knows it: the noise of its joint angles and, by take, its
measurements.
"""

from __future__ import annotations

from typing import NamedTuple

import pandas as pd

from pipeline.filtering.measurement import Measurements, measurements
from pipeline.perception.depth_noise import errors_of, leave_one_out


class Camera(NamedTuple):
    """The depth camera, its frames on one clock and articulated in one way."""

    noise: pd.DataFrame  # as of leave_one_out
    takes: dict[str, Measurements]


def camera_of(angles: pd.DataFrame, joints: pd.DataFrame, *, window: int) -> Camera:
    """The camera that measured ``angles``, its noise estimated over ``window`` frames on either
    side.

    ``angles`` and ``joints``: tables of the depth camera and the motion capture. Raises
    RecordingError where the takes are too few to estimate the noise from.
    """
    noise = leave_one_out(errors_of(angles, joints), window=window)
    return Camera(noise, {take.take: take for take in measurements(angles, noise)})
