"""Depth takes on the motion clock: as stated, or as the motion tells it."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from made_options import made

from pipeline.arm.model import Arm, load_arm
from pipeline.core.errors import RecordingError
from pipeline.core.options.depth_camera import Depth
from pipeline.recordings.depth_clock import on_motion_clock, with_markers

TIME, MOTION = np.arange(40) / 30.0, np.arange(160) / 100.0  # s


@pytest.fixture(scope="module")
def arm() -> Arm:
    joints = ["joint_2", "joint_3", "joint_4"]
    return load_arm("pipeline/arm/ur5.urdf", joints, "wrist_centre", {})


def path(time: np.ndarray) -> np.ndarray:
    """Where the middle of the arm is: a smooth path in its plane."""
    return np.column_stack([np.sin(2 * time), np.cos(3 * time)])


def frames(centroid: np.ndarray, take: str = "test_001") -> pd.DataFrame:
    """Rows of the table ``frames`` of a camera that sees the arm at ``centroid``."""
    columns = {"take": take, "part": "test", "frame": np.arange(len(TIME)), "t": TIME}
    x, z = centroid.T
    return pd.DataFrame(columns | {"file": f"kinect/{take}", "points": 5, "x": x, "z": z})


@pytest.fixture
def markers(arm) -> pd.DataFrame:
    """Rows of the table ``markers``: one, that runs along the path in the arm's plane."""
    plane = path(MOTION)
    axes = [arm.to_plane(row)[[0, 2]] - arm.to_plane(np.zeros(3))[[0, 2]] for row in np.eye(3)]
    at, *_ = np.linalg.lstsq(
        np.array(axes).T, (plane - arm.to_plane(np.zeros(3))[[0, 2]]).T, rcond=None
    )
    table = pd.DataFrame({"take": "test_001", "part": "test", "k": np.arange(160), "t": MOTION})
    return table.assign(link=1, marker=1, x=at[0], y=at[1], z=at[2])


def test_an_offset_that_nobody_states_is_that_of_the_motion(arm, markers):
    filmed = frames(path(TIME + 0.12))
    rows, quality = on_motion_clock((filmed, markers), made(Depth, search=0.3), arm)
    values = {row["quantity"]: row["value"] for row in quality}
    assert abs(values["clock_offset"] - 0.12) < 1e-4
    np.testing.assert_allclose(rows["t"], TIME + values["clock_offset"])
    assert {"clock_offset_standard_error", "clock_correlation", "clock_drift"} <= {*values}


def test_an_offset_that_is_stated_is_taken_as_given_whatever_the_motion_says(arm, markers):
    filmed, depth = frames(path(TIME + 0.12)), made(Depth, search=0.3, clock_offset=-0.25)
    rows, quality = on_motion_clock((filmed, markers), depth, arm)
    np.testing.assert_allclose(rows["t"], TIME - 0.25)
    assert [(row["quantity"], row["value"]) for row in quality] == [("clock_offset", -0.25)]


def test_a_motion_that_tells_no_offset_needs_one_stated(arm, markers):
    still = frames(np.ones((len(TIME), 2)))
    with pytest.raises(RecordingError, match="no motion to compare the clocks by"):
        on_motion_clock((still, markers), made(Depth, search=0.3), arm)
    stated = made(Depth, search=0.3, clock_offset=0.0)
    assert on_motion_clock((still, markers), stated, arm)[0]["t"].tolist() == TIME.tolist()


def test_frames_that_never_show_the_arm_tell_no_offset_and_are_refused_by_their_take(arm, markers):
    empty = frames(np.full((len(TIME), 2), np.nan)).assign(points=0)
    with pytest.raises(RecordingError, match="no frame shows the arm") as refused:
        on_motion_clock((empty, markers), made(Depth, search=0.3), arm)
    assert refused.value.evidence["take"] == "test_001"


def test_a_take_without_motion_capture_is_refused_by_its_name(markers):
    both = pd.concat([frames(path(TIME)), frames(path(TIME), "test_002")])
    with pytest.raises(RecordingError, match="no motion-capture take") as refused:
        with_markers(both, markers)
    assert refused.value.evidence["take"] == "test_002"
    ((rows, of_take),) = with_markers(frames(path(TIME)), markers)
    assert len(rows) == len(TIME) and of_take["take"].unique().tolist() == ["test_001"]
