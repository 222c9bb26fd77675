"""Intrinsics from every format that calibration tools write, and ROS messages of depth cameras:
what was put in comes out, in every layout that ROS allows.
"""

from __future__ import annotations

import json
from functools import partial
from multiprocessing import get_context

import numpy as np
import pytest
from depth_files import CALIBRATIONS
from ros_bags import Message, cloud, image
from ros_bags import camera_info as info
from written_logs import refusal as reject

from pipeline.core.errors import RecordingError
from pipeline.formats.depth.intrinsics import Intrinsics, read_intrinsics, write_intrinsics
from pipeline.formats.depth.messages import camera_info, cloud_points, image_pixels

SIZE = {"width": 640, "height": 480}
CAMERA = Intrinsics(525.5, 524, 319.5, 239.25, 640, 480, (0.25, 0, 0, 0, 0))


def read(file, content: str) -> Intrinsics:
    file.write_text(content)
    return read_intrinsics(file, **SIZE)


def refusal(file, content: str, **options: object) -> str:
    file.write_text(content)
    return reject(partial(read_intrinsics, **SIZE | options), file).message


def test_the_intrinsics_of_a_real_kinect_are_read_from_yaml_1_0(shared):
    file = shared / "samples/kinect/kinect2_ir_intrinsics.yaml"
    found = read_intrinsics(file, width=512, height=424)
    assert (found.fx, found.fy) == (366.94757270064110, 364.79117165721783)
    assert (found.cx, found.cy) == (242.98551682775121, 207.69853575457685)
    radial, tangential = found.distortion[:2], found.distortion[2:4]
    assert radial == (0.096558110377123016, -0.28298244017989416)
    assert tangential == (1.5889951609432634e-04, -5.0751483524871712e-04)
    assert found.distortion[4:] == (0.10523948765859192,)


def test_written_intrinsics_read_back_exactly_in_the_sensors_own_format(tmp_path):
    for distortion in ((0.1, -0.2, 1e-4, -1 / 3, 0.5), (0,) * 5):
        original = Intrinsics(365.456, 365.1, 254.878, 205.395, 512, 424, distortion)
        write_intrinsics(tmp_path / "ir.yaml", original)
        head = "%YAML:1.0\n---\ncameraMatrix: !!opencv-matrix\n   rows: 3\n"
        assert (tmp_path / "ir.yaml").read_text().startswith(head)
        assert read_intrinsics(tmp_path / "ir.yaml", width=512, height=424) == original


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_every_tools_format_gives_the_same_camera(tmp_path, name):
    assert read(tmp_path / name, CALIBRATIONS[name]) == CAMERA
    if name in ("ros.yaml", "plain.json", "opencv.xml"):  # they state their size
        message = refusal(tmp_path / name, CALIBRATIONS[name], width=320, height=240)
        assert "not 320 × 240" in message


def test_open3ds_matrix_runs_down_the_columns_and_may_stand_beside_its_pose(tmp_path):
    matrix = [525.5, 0, 0, 0, 524.0, 0, 319.5, 239.25, 1]
    camera = SIZE | {"intrinsic_matrix": matrix}
    for stored in (camera, {"intrinsic": camera, "extrinsic": []}):
        found = read(tmp_path / "c.json", json.dumps(stored))
        assert found == Intrinsics(525.5, 524, 319.5, 239.25, 640, 480)
        assert "calibrated at 640" in refusal(tmp_path / "c.json", json.dumps(stored), width=9)


def test_several_cameras_in_one_file_are_told_apart_by_option_alone(tmp_path):
    file, first = tmp_path / "stereo.yaml", CALIBRATIONS["opencv.yaml"]
    second = first.replace("525.5", "600.").split("---\n")[1]
    names = ("camera_matrix", "distortion_coefficients")
    for old, one, other in zip(names, ("M1", "D1_coeffs"), ("M2", "D2_coeffs"), strict=True):
        first, second = first.replace(old, one), second.replace(old, other)
    assert "M1, D1_coeffs, M2, D2_coeffs" in refusal(file, first + second)
    assert read_intrinsics(file, **SIZE, matrix="M2", distortion="D2_coeffs").fx == 600
    assert "0 of M3 are there, one camera matrix is needed" in refusal(
        file, first + second, matrix="M3"
    )
    both = CALIBRATIONS["rows.yaml"] + "camera_matrix: [1, 0, 2, 0, 3, 4, 0, 0, 1]\n"
    assert "2 of camera_matrix, K are there" in refusal(file, both)
    assert read_intrinsics(file, **SIZE, matrix="K").fx == 525.5


def test_a_camera_info_that_ros_printed_is_read_however_often_it_is_there(tmp_path):
    file = tmp_path / "info.yaml"
    message = (
        "header:\n  stamp: {sec: 1}\nwidth: 640\nheight: 480\ndistortion_model: plumb_bob\n"
        "k: [525.5, 0.0, 319.5, 0.0, 524.0, 239.25, 0.0, 0.0, 1.0]\nd: [0.25, 0, 0, 0, 0]\n---\n"
    )
    again = message.replace("sec: 1", "sec: 2")
    for text in (message, message + again, message.replace("k:", "K:").replace("\nd:", "\nD:")):
        assert read(file, text) == CAMERA
    other = message + again.replace("525.5", "499.0")
    assert "not all equal" in refusal(file, other)


def test_distortion_of_another_model_is_refused_and_none_of_it_is_overlooked(tmp_path):
    file, camera = tmp_path / "c.json", {"K": [[500, 0, 4], [0, 501, 3], [0, 0, 1]]}
    other = {"distortion_model": "equidistant"}
    stated = json.dumps(camera | other | {"D": [0.1, 0.2, 0.3, 0.4]})
    assert "equidistant" in refusal(file, stated)
    for key in ("dist", "distortion", "coeffs", "k1"):
        assert key in refusal(file, json.dumps(camera | {key: [0.1, 0.2, 0.3, 0.4]}))
    realsense = {"fx": 5, "fy": 6, "ppx": 4, "ppy": 3, "coeffs": [0.1, 0, 0, 0, 0]}
    found = read(file, json.dumps(realsense | {"model": "distortion.brown_conrady"}))
    assert (found.fy, found.cx, found.distortion[0]) == (6, 4, 0.1)
    assert "not stated" in refusal(file, json.dumps(realsense))
    # the control: nothing is distorted
    assert read(file, json.dumps(camera | other | {"D": [0] * 4})).distortion == (0, 0, 0, 0)


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


PIXELS, CLOUD = image(np.ones((5, 7), np.uint16), 1.0), cloud(np.ones((12, 3)), 1.0, [X, Y, Z], 16)
depth_pixels = partial(image_pixels, shape=(5, 7))
NO_MESSAGE = [  # function, message, fields that are changed, words
    (depth_pixels, PIXELS, {"encoding": "bgr8"}, "'bgr8'"),
    (depth_pixels, PIXELS, {"height": 4}, "7 × 4"),
    (depth_pixels, PIXELS, {"step": 13}, "bytes in 5 rows"),
    (depth_pixels, PIXELS, {"data": np.zeros(69, np.uint8)}, "69 bytes"),
    (cloud_points, CLOUD, {"fields": [X, Y, ("w", 8, 7, 1)]}, "there are x, y, w"),
    *((cloud_points, CLOUD, {"fields": [X, Y, ("z", *z)]}, "x, y and z must")
      for z in ((14, 7, 1), (8, 7, 2), (8, 5, 1))),
    (cloud_points, CLOUD, {"width": 13}, "13 points"),
    (cloud_points, CLOUD, {"data": np.zeros(10, np.uint8)}, "10 bytes"),
]  # fmt: skip


@pytest.mark.parametrize(("convert", "sound", "changes", "words"), NO_MESSAGE)
def test_messages_that_are_no_depth_or_not_whole_are_refused(convert, sound, changes, words):
    message = Message(sound.kind, 1.0, **sound.fields | changes).for_version("ros1")
    with pytest.raises(RecordingError, match=words) as refused:
        convert(message, file="take.bag", number=3)
    assert refused.value.evidence == {"file": "take.bag", "number": 3}


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


def test_a_worker_that_may_have_no_processes_reads_and_refuses_too(tmp_path):
    """The workers of Dask are daemons, as those of a pool are."""
    file = tmp_path / "c.yaml"
    file.write_text(CALIBRATIONS["ros.yaml"])
    with get_context("fork").Pool(1) as pool:
        assert pool.apply(read_intrinsics, (file,), SIZE) == CAMERA
        file.write_text("a: [\n")
        with pytest.raises(RecordingError, match="no calibration"):
            pool.apply(read_intrinsics, (file,), SIZE)
