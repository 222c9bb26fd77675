"""Depth frames of a take as points in the arm's plane: a patch put at a known place is found
there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from depth_takes import ARM, CAMERA, HEIGHT, PATCH, PLACES, WIDTH, record
from ros_bags import image, write_bag

from pipeline.arm.model import Arm
from pipeline.core.errors import RecordingError
from pipeline.formats.depth.image import write_depth
from pipeline.recordings.depth_sequence import DepthSequence, take_paths


@pytest.fixture
def arm() -> Arm:
    return ARM


@pytest.mark.parametrize("units", [1000.0, 5000.0])
def test_a_patch_of_the_arm_is_found_where_it_is(arm, tmp_path, units):
    take, depth = record(tmp_path, arm, units)
    sequence = DepthSequence(take, depth, arm, tmp_path)
    for frame, place in enumerate(PLACES):
        points, valid = next(sequence.points([frame]))
        assert len(points) == (2 * PATCH + 1) ** 2
        # half a pixel in the middle of the patch, and the rounding of the depth
        assert np.abs(points.mean(axis=0) - place).max() < 0.5 * 1.2 / CAMERA.fx + 0.5 / units
        np.testing.assert_allclose(np.ptp(points, axis=0), 2 * PATCH * 1.15 / CAMERA.fx, rtol=0.1)
        assert valid == (2 * PATCH + 1) ** 2 / (WIDTH * HEIGHT)


def test_a_camera_that_stands_elsewhere_sees_the_arm_elsewhere(arm, tmp_path):
    take, depth = record(tmp_path, arm)
    depth.camera.position = (
        np.array(depth.camera.position) + arm.rotation @ [0.03, 0.0, 0.0]
    ).tolist()
    points, _ = next(DepthSequence(take, depth, arm, tmp_path).points([0]))
    np.testing.assert_allclose(points.mean(axis=0), PLACES[0] + [0.03, 0.0], atol=0.007)


def test_times_and_files_are_those_of_the_index(arm, tmp_path):
    take, depth = record(tmp_path, arm)
    sequence = DepthSequence(take, depth, arm, tmp_path)
    assert sequence.time.tolist() == [5.0, 5.033, 5.069]
    assert sequence.references == tuple(f"kinect/test_001/depth/{i}.png" for i in range(3))
    assert sequence.counts == {"cut_rows": 0}


def test_frames_are_read_when_they_are_asked_for(arm, tmp_path):
    take, depth = record(tmp_path, arm)
    sequence = DepthSequence(take, depth, arm, tmp_path)
    (take / "depth/1.png").unlink()
    observed = sequence.points([0, 2, 1])
    assert len(next(observed)[0])
    assert len(next(observed)[0])
    with pytest.raises(RecordingError) as refused:
        next(observed)
    assert refused.value.evidence["file"] == take / "depth/1.png"


def test_an_empty_frame_has_no_points(arm, tmp_path):
    take, depth = record(tmp_path, arm)
    write_depth(take / "depth/1.png", np.zeros((HEIGHT, WIDTH), dtype=np.uint16))
    points, valid = next(DepthSequence(take, depth, arm, tmp_path).points([1]))
    assert points.shape == (0, 2)
    assert valid == 0


def test_a_frame_of_another_size_than_the_camera_is_refused(arm, tmp_path):
    take, depth = record(tmp_path, arm)
    write_depth(take / "depth/1.png", np.zeros((HEIGHT, WIDTH - 1), dtype=np.uint16))
    with pytest.raises(RecordingError, match="127 × 106"):
        next(DepthSequence(take, depth, arm, tmp_path).points([1]))


@pytest.mark.parametrize("missing", ["kinect/test_001/depth.txt", "kinect/intrinsics.yaml"])
def test_a_take_without_its_index_or_its_camera_is_refused(arm, tmp_path, missing):
    take, depth = record(tmp_path, arm)
    (tmp_path / missing).unlink()
    with pytest.raises(RecordingError) as refused:
        DepthSequence(take, depth, arm, tmp_path)
    assert refused.value.evidence["file"] == tmp_path / missing


def test_two_takes_of_one_name_are_refused(arm, tmp_path):
    _, depth = record(tmp_path, arm)
    write_bag(
        tmp_path / "kinect", "ros1", {"/depth": [(5.0, image(np.ones((2, 2), np.uint16), 5.0))]}
    ).rename(tmp_path / "kinect/test_001.bag")
    with pytest.raises(RecordingError, match="are named 'test_001'"):
        take_paths(tmp_path, depth)
    with pytest.raises(RecordingError, match="no bag matches"):
        take_paths(tmp_path, replace(depth, takes="elsewhere/*"))
