"""ROS messages of depth cameras: the pixels, points and intrinsics that were put in come out, in
every layout that ROS allows.
"""

from __future__ import annotations

import numpy as np
import pytest
from ros_bags import camera_info as info
from ros_bags import cloud, image

from pipeline.core.errors import RecordingError
from pipeline.formats.depth.intrinsics import Intrinsics
from pipeline.formats.depth.messages import camera_info, cloud_points, image_pixels

GENERATOR = np.random.default_rng(2)
MATRIX = [525.0, 0, 319.5, 0, 524.0, 239.5, 0, 0, 1]


@pytest.mark.parametrize("padding", [0, 3])
@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("kind", [np.uint16, np.float32])
def test_images_of_either_byte_order_and_any_padding_keep_their_pixels(kind, big, padding):
    pixels = (GENERATOR.random((5, 7)) * 5000).astype(kind)
    message = image(pixels, 1.0, big=big, padding=padding).for_version("ros2")
    result = image_pixels(message, shape=(5, 7))
    assert result.dtype == kind
    np.testing.assert_array_equal(result, pixels)


NO_IMAGE = [({"encoding": "bgr8"}, "'bgr8'"), ({"height": 4}, "7 × 4")]
NO_IMAGE += [({"step": 13}, "bytes in 5 rows"), ({"data": np.zeros(69, np.uint8)}, "69 bytes")]


@pytest.mark.parametrize(("changes", "words"), NO_IMAGE)
def test_images_that_are_no_depth_or_not_whole_are_refused(changes, words):
    message = image(np.ones((5, 7), np.uint16), 1.0)
    message.fields.update(changes)
    with pytest.raises(RecordingError, match=words) as refused:
        image_pixels(message.for_version("ros1"), shape=(5, 7), file="take.bag", number=3)
    assert refused.value.evidence == {"file": "take.bag", "number": 3}


X, Y, Z = ("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1)  # name, offset, type, count
LAYOUTS = {
    "xyz of a depth camera": ([X, Y, Z, ("rgb", 16, 7, 1)], 32),
    "another order": ([("intensity", 0, 2, 1), ("z", 1, 7, 1), ("x", 9, 7, 1), ("y", 5, 7, 1)], 13),
    "doubles among floats": ([("x", 0, 8, 1), ("y", 12, 7, 1), ("z", 16, 8, 1)], 24),
}


@pytest.mark.parametrize("rows", [1, 4])
@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_clouds_of_any_layout_keep_their_points(layout, big, rows):
    points = GENERATOR.normal(size=(12, 3)).astype(np.float32).astype(float)
    points[4, 1] = np.nan
    message = cloud(points, 1.0, *LAYOUTS[layout], big=big, rows=rows).for_version("ros2")
    np.testing.assert_array_equal(cloud_points(message), points)


NO_CLOUD = [({"fields": [X, Y, ("w", 8, 7, 1)]}, "no field z")]
NO_CLOUD += [({"fields": [X, Y, ("z", *z)]}, "field z") for z in ((14, 7, 1), (8, 7, 2), (8, 5, 1))]
NO_CLOUD += [({"width": 13}, "13 points"), ({"data": np.zeros(10, np.uint8)}, "10 bytes")]


@pytest.mark.parametrize(("changes", "words"), NO_CLOUD)
def test_clouds_whose_points_are_not_there_are_refused(changes, words):
    message = cloud(np.ones((12, 3)), 1.0, [X, Y, Z], 16)
    message.fields.update(changes)
    with pytest.raises(RecordingError, match=words):
        cloud_points(message.for_version("ros1"), file="take.bag")


@pytest.mark.parametrize("version", ["ros1", "ros2"])
def test_a_camera_has_the_intrinsics_of_its_info(version):
    message = info(MATRIX, [0.1, -0.2, 0, 0, 0.05], (640, 480)).for_version(version)
    result = camera_info(message, width=640, height=480)
    assert result == Intrinsics(525, 524, 319.5, 239.5, 640, 480, (0.1, -0.2, 0, 0, 0.05))
    undistorted = info(MATRIX, [0.0] * 5, (640, 480), model="equidistant").for_version(version)
    assert camera_info(undistorted, width=640, height=480).distortion == ()
    for other, words in (
        (info(MATRIX, [], (320, 240)), "320 × 240"),
        (info([0.0] * 9, [], (640, 480)), "camera matrix"),
        (info(MATRIX, [0.1, 0.2, 0.3, 0.4], (640, 480), model="equidistant"), "equidistant"),
    ):
        with pytest.raises(RecordingError, match=words):
            camera_info(other.for_version(version), width=640, height=480, file="take.bag")
