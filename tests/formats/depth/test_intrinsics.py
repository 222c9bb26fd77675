"""Intrinsics from every format that calibration tools write, and what is refused of them."""

from __future__ import annotations

import json

import pytest

from pipeline.core.errors import RecordingError
from pipeline.formats.depth.intrinsics import Intrinsics, read_intrinsics, write_intrinsics


def refused(call, *arguments, **keywords) -> RecordingError:
    with pytest.raises(RecordingError) as caught:
        call(*arguments, **keywords)
    assert caught.value.evidence["file"] == arguments[0]
    return caught.value


def test_the_intrinsics_of_a_real_kinect_are_read_from_yaml_1_0(shared):
    result = read_intrinsics(
        shared / "samples/kinect/kinect2_ir_intrinsics.yaml", width=512, height=424
    )
    assert (result.fx, result.fy) == (366.94757270064110, 364.79117165721783)
    assert (result.cx, result.cy) == (242.98551682775121, 207.69853575457685)
    k1, k2, p1, p2, k3 = result.distortion
    assert (k1, k2, k3) == (0.096558110377123016, -0.28298244017989416, 0.10523948765859192)
    assert (p1, p2) == (1.5889951609432634e-04, -5.0751483524871712e-04)


def test_written_intrinsics_read_back_exactly_in_the_sensors_own_format(tmp_path):
    original = Intrinsics(
        365.456, 365.1, 254.878, 205.395, 512, 424, (0.1, -0.2, 1e-4, -1 / 3, 0.5)
    )
    write_intrinsics(tmp_path / "ir.yaml", original)
    assert (
        (tmp_path / "ir.yaml")
        .read_text()
        .startswith("%YAML:1.0\n---\ncameraMatrix: !!opencv-matrix\n   rows: 3\n")
    )
    assert read_intrinsics(tmp_path / "ir.yaml", width=512, height=424) == original
    write_intrinsics(tmp_path / "ir.yaml", Intrinsics(1.5, 1, 2, 3, 4, 5))
    assert read_intrinsics(tmp_path / "ir.yaml", width=4, height=5).distortion == (0,) * 5


@pytest.mark.slow
def test_a_calibration_cut_at_any_byte_is_refused_or_whole(tmp_path):
    file, original = (
        tmp_path / "ir.yaml",
        Intrinsics(365.456, 365.123, 254.878, 205.395, 512, 424, (0.125,) * 5),
    )
    write_intrinsics(file, original)
    content = file.read_bytes()
    for cut in range(len(content)):
        file.write_bytes(content[:cut])
        try:
            assert read_intrinsics(file, width=512, height=424) == original
        except RecordingError:
            pass


FORMS = {
    "opencv.yaml": "%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   "
    "dt: d\n"
    "   data: [ 525.5, 0., 319.5, 0., 524., 239.25,\n       0., 0., 1. ]\n"
    "distortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n   data: [ "
    "0.25, 0., 0., 0., 0. ]\n",
    "opencv.xml": '<?xml version="1.0"?>\n<opencv_storage>\n<image_width>640</image_width>\n'
    '<cameraMatrix type_id="opencv-matrix">\n'
    "<rows>3</rows><cols>3</cols><dt>d</dt>\n<data>525.5 0. 319.5 0. 524. 239.25 0. 0. "
    "1.</data></cameraMatrix>\n"
    '<distCoeffs type_id="opencv-matrix"><rows>1</rows><cols>5</cols><dt>d</dt><data>0.25 0. 0. '
    "0. 0.</data></distCoeffs>\n"
    "</opencv_storage>\n",
    "ros.yaml": "image_width: 640\nimage_height: 480\ncamera_name: depth\ncamera_matrix:\n  "
    "rows: 3\n  cols: 3\n"
    "  data: [525.5, 0, 319.5, 0, 524.0, 239.25, 0, 0, 1]\ndistortion_model: "
    "plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n"
    "  data: [2.5e-1, 0, 0, 0, 0]\n",
    "plain.yaml": "fx: 525.5\nfy: 524\ncx: 319.5\ncy: 239.25\ndist_coeffs: [0.25, 0, 0, 0, 0]\n",
    "rows.yaml": "K:\n- [525.5, 0, 319.5]\n- [0, 524, 239.25]\n- [0, 0, 1]\nD: [0.25, 0, 0, 0, "
    "0]\n",
    "plain.json": '{"width": 640, "height": 480, "fx": 525.5, "fy": 524, "cx": 319.5, "cy": '
    '239.25, "D": [0.25, 0, 0, 0, 0]}',
    "matrix.json": '{"K": [[525.5, 0, 319.5], [0, 524, 239.25], [0, 0, 1]], "D": [0.25, 0, 0, '
    "0, 0]}",
}


@pytest.mark.parametrize("name", FORMS)
def test_every_tools_format_gives_the_same_camera(tmp_path, name):
    (tmp_path / name).write_text(FORMS[name])
    assert read_intrinsics(tmp_path / name, width=640, height=480) == Intrinsics(
        525.5, 524, 319.5, 239.25, 640, 480, (0.25, 0, 0, 0, 0)
    )


def test_open3ds_matrix_runs_down_the_columns(tmp_path):
    stored = {
        "width": 640,
        "height": 480,
        "intrinsic_matrix": [525.5, 0, 0, 0, 524.0, 0, 319.5, 239.25, 1],
    }
    (tmp_path / "c.json").write_text(json.dumps(stored))
    assert read_intrinsics(tmp_path / "c.json", width=640, height=480) == Intrinsics(
        525.5, 524, 319.5, 239.25, 640, 480
    )


@pytest.mark.parametrize("name", ["ros.yaml", "plain.json", "opencv.xml"])
def test_a_calibration_at_another_image_size_is_refused(tmp_path, name):
    (tmp_path / name).write_text(FORMS[name])
    assert (
        "not 320 × 480" in refused(read_intrinsics, tmp_path / name, width=320, height=480).message
    )


def test_several_cameras_in_one_file_are_told_apart_by_option_alone(tmp_path):
    file = tmp_path / "stereo.yaml"
    first, second = (
        FORMS["opencv.yaml"],
        FORMS["opencv.yaml"].replace("525.5", "600.").split("---\n")[1],
    )
    file.write_text(
        first.replace("camera_matrix", "M1").replace("distortion_c", "D1_")
        + second.replace("camera_matrix", "M2").replace("distortion_c", "D2_")
    )
    message = refused(read_intrinsics, file, width=640, height=480).message
    assert "M1, D1_oefficients, M2, D2_oefficients" in message
    options = {"matrix": "M2", "distortion": "D2_oefficients"}
    assert read_intrinsics(file, width=640, height=480, **options).fx == 600
    assert (
        "no camera matrix 'M3'"
        in refused(read_intrinsics, file, width=640, height=480, matrix="M3").message
    )
    file.write_text(FORMS["rows.yaml"] + "camera_matrix: [1, 0, 2, 0, 3, 4, 0, 0, 1]\n")
    assert "camera_matrix and K" in refused(read_intrinsics, file, width=640, height=480).message
    assert read_intrinsics(file, width=640, height=480, matrix="K").fx == 525.5


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMS)
def test_every_format_cut_at_any_byte_is_refused_or_whole(tmp_path, name):
    (tmp_path / name).write_text(FORMS[name])
    whole = read_intrinsics(tmp_path / name, width=640, height=480)
    for cut in range(len(FORMS[name])):
        (tmp_path / name).write_text(FORMS[name][:cut])
        try:
            assert read_intrinsics(tmp_path / name, width=640, height=480) == whole
        except RecordingError:
            pass


def test_a_camera_info_that_ros_printed_is_read_however_often_it_is_there(tmp_path):
    file = tmp_path / "info.yaml"
    numbers = [
        "k: [500.0, 0.0, 4.0, 0.0, 501.0, 3.0, 0.0, 0.0, 1.0]",
        "d: [0.1, -0.2, 0.001, 0.002, 0.05]",
    ]
    message = "\n".join(
        [
            "header:",
            "  stamp: {sec: %d}",
            "width: 8",
            "height: 6",
            "distortion_model: plumb_bob",
            *numbers,
            "---",
            "",
        ]
    )
    for text in (
        message % 1,
        message % 1 + message % 2,
        (message % 1).replace("k:", "K:").replace("d:", "D:", 1),
    ):
        file.write_text(text)
        assert read_intrinsics(file, width=8, height=6) == Intrinsics(
            500, 501, 4, 3, 8, 6, (0.1, -0.2, 0.001, 0.002, 0.05)
        )
    file.write_text(message % 1 + (message % 2).replace("500.0", "499.0"))
    assert (
        "2 calibrations, not all of them equal"
        in refused(read_intrinsics, file, width=8, height=6).message
    )


def test_open3ds_camera_beside_its_pose_is_read(tmp_path):
    file = tmp_path / "camera.json"
    file.write_text(
        json.dumps(
            {
                "intrinsic": {
                    "width": 8,
                    "height": 6,
                    "intrinsic_matrix": [500, 0, 0, 0, 501, 0, 4, 3, 1],
                },
                "extrinsic": [],
            }
        )
    )
    assert read_intrinsics(file, width=8, height=6) == Intrinsics(500, 501, 4, 3, 8, 6)
    assert "calibrated at 8" in refused(read_intrinsics, file, width=9, height=6).message
