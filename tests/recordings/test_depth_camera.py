"""Depth takes on the motion clock: as stated, or as the motion tells it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import RecordingError
from pipeline.recordings import depth_camera
from pipeline.schema import Depth

TIME = np.arange(40) / 30.0
TAKE = Path("test_001")
MOTION = np.arange(160) / 100.0


def seen(time: np.ndarray) -> list[np.ndarray]:
    """Points of an arm, one cloud a frame, whose centroid runs along a smooth path."""
    return [np.array([[np.sin(2 * t), np.cos(3 * t)]] * 5) for t in time]


def path(time: np.ndarray) -> np.ndarray:
    return np.column_stack([np.sin(2 * time), np.cos(3 * time)])


def test_an_offset_that_nobody_states_is_that_of_the_motion():
    offset, quality = depth_camera._clock_offset(TIME, seen(TIME + 0.12), (MOTION, path(MOTION)), Depth(search=0.3), TAKE)
    assert abs(offset - 0.12) < 1e-4
    assert {"clock_offset_standard_error", "clock_correlation"} <= {row["quantity"] for row in quality}


def test_an_offset_that_is_stated_is_taken_as_given_whatever_the_motion_says():
    depth = Depth(search=0.3, clock_offset=-0.25)
    assert depth_camera._clock_offset(TIME, seen(TIME + 0.12), (MOTION, path(MOTION)), depth, TAKE) == (-0.25, [])


def test_a_motion_that_tells_no_offset_needs_one_stated():
    still = [np.ones((5, 2))] * len(TIME)
    with pytest.raises(RecordingError, match="no motion to compare the clocks by"):
        depth_camera._clock_offset(TIME, still, (MOTION, path(MOTION)), Depth(search=0.3), TAKE)
    assert depth_camera._clock_offset(TIME, still, (MOTION, path(MOTION)), Depth(search=0.3, clock_offset=0.0), TAKE) == (0.0, [])
