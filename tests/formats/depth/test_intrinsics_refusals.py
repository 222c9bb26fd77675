"""Calibrations that are refused: of no camera, of another camera, or without bound."""

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


def test_calibrations_that_are_none_are_refused(tmp_path):
    file = tmp_path / "ir.yaml"
    write_intrinsics(file, Intrinsics(365.5, 365.25, 254.5, 205.5, 512, 424))
    good = file.read_text()
    for old, new, words in [
        ("365.5", "-1.", "[fx 0 cx; 0 fy cy; 0 0 1]"),
        ("365.5", ".Nan", "[fx 0 cx; 0 fy cy; 0 0 1]"),
        ("254.5", "600.", "outside 512 × 424"),
        ("cameraMatrix", "camera", "no camera matrix under a usual name; the file has camera, "),
        ("distortionCoefficients", "distortion", "no distortionCoefficients"),
        ("rows: 3", "rows: 4", "no 3 × 3 cameraMatrix"),
        (good, "cameraMatrix: 5\n", "no 3 × 3 cameraMatrix"),
        (good, "%YAML:1.0\n---\ncameraMatrix: 5\n", "no 3 × 3 cameraMatrix"),
    ]:
        assert old in good
        file.write_text(good.replace(old, new, 1))
        assert words in refused(read_intrinsics, file, width=512, height=424).message
    refused(read_intrinsics, tmp_path / "absent.yaml", width=512, height=424)


@pytest.mark.parametrize(
    "content",
    [
        "a: [\n",
        "- 1\n- 2\n",
        "{",
        "{}",
        "[1]\n",
        "5\n",
        "K: text\nD: []\n",
        "K: [1, 2]\nD: []\n",
        "K: {data: {a: 1}}\nD: []\n",
        "a: &a [*a]\n",
        "!!python/object/apply:os.system ['true']\n",
        "fx: 1\nfy: 1\ncx: 1\n",
        '{"fx": [1, 2], "fy": 1, "cx": 1, "cy": 1}',
        "K: [1,0,1,0,1,1,0,0,1]\nD: [1]\n",
        "%YAML:1.0\n---\ncameraMatrix: {a: 1}\n",
        "\x01\x02\n",
        "{" * 2_000,
        "[" * 2_000 + "\n",
        "# a comment\n" * 100_000,
    ],
)
def test_files_that_hold_no_camera_are_refused(tmp_path, content):
    (tmp_path / "c.yaml").write_text(content)
    refused(read_intrinsics, tmp_path / "c.yaml", width=640, height=480)


def test_references_that_could_unfold_without_bound_are_refused_before_they_do(tmp_path):
    file = tmp_path / "bomb.yaml"
    levels = [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 12)]
    file.write_text(
        "\n".join(
            [
                "a0: &a0 [1, 1, 1]",
                *levels,
                "camera_matrix: *a11",
                "distortion_coefficients: [0, 0, 0, 0]",
                "",
            ]
        )
    )
    assert "refers to parts of itself" in str(refused(read_intrinsics, file, width=512, height=424))


def test_a_matrix_of_a_type_that_would_round_its_numbers_is_refused(tmp_path):
    file = tmp_path / "camera.yaml"
    write_intrinsics(file, Intrinsics(365.4, 365.4, 254.8, 205.3, 512, 424))
    file.write_text(file.read_text().replace("dt: d", "dt: u", 1))
    assert "a matrix of type u" in str(refused(read_intrinsics, file, width=512, height=424))


@pytest.mark.parametrize("levels", [60, 1000, 100_000])
@pytest.mark.parametrize("name", ["deep.json", "deep.yaml"])
def test_lists_far_inside_one_another_are_refused_whatever_the_parser_can_follow(
    levels, name, tmp_path
):
    file = tmp_path / name
    file.write_text('{"camera_matrix": ' + "[" * levels + "1.0" + "]" * levels + "}")
    with pytest.raises(RecordingError, match="deeper in one another"):
        read_intrinsics(file, width=640, height=480)


def test_distortion_of_another_model_is_refused_and_none_of_it_is_overlooked(tmp_path):
    file = tmp_path / "camera.json"
    camera = {"K": [[500, 0, 4], [0, 501, 3], [0, 0, 1]]}
    file.write_text(
        json.dumps(camera | {"D": [0.1, 0.2, 0.3, 0.4], "distortion_model": "equidistant"})
    )
    assert refused(read_intrinsics, file, width=8, height=6).evidence["key"] == "distortion_model"
    for key in ("dist", "distortion", "coeffs", "k1"):
        file.write_text(json.dumps(camera | {key: [0.1, 0.2, 0.3, 0.4]}))
        assert key in refused(read_intrinsics, file, width=8, height=6).message
    # the control: nothing is distorted
    file.write_text(json.dumps(camera | {"D": [0, 0, 0, 0], "distortion_model": "equidistant"}))
    assert read_intrinsics(file, width=8, height=6).distortion == (0, 0, 0, 0)


def test_a_whole_number_beyond_floating_point_is_refused(tmp_path):
    file = tmp_path / "camera.json"
    file.write_text(json.dumps({"fx": 10**400, "fy": 1, "cx": 4, "cy": 3}))
    assert "no decimal numbers" in refused(read_intrinsics, file, width=8, height=6).message


PLAIN = "fx: {}\nfy: 525.0\ncx: 319.5\ncy: 239.5\ndistortion_coefficients: [0, 0, 0, 0, 0]\n"
LISTED = "camera_matrix: {{rows: 3, cols: 3, data: [{}, 0, 319.5, 0, 525.0, 239.5, 0, 0, 1]}}\n"
OPENCV = (
    "%YAML:1.0\n---\ncameraMatrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
    "   data: [ {}, 0., 319.5, 0., 525., 239.5, 0., 0., 1. ]\ndistortionCoefficients: "
    "!!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [ 0., 0., 0., 0., 0. ]\n"
)
JSON = '{{"fx": {}, "fy": 525.0, "cx": 319.5, "cy": 239.5}}'


@pytest.mark.parametrize("word", ["yes", "true", "0525", "+0525", "0x20D", "8:45"])
@pytest.mark.parametrize(
    ("name", "form"),
    [
        ("plain.yaml", PLAIN),
        ("listed.yaml", LISTED + "distortion_coefficients: [0, 0, 0, 0, 0]\n"),
        ("opencv.yaml", OPENCV),
        ("camera.json", JSON),
    ],
)
def test_what_is_no_decimal_number_is_none(tmp_path, name, form, word):
    file = tmp_path / name
    file.write_text(form.format(word))
    refused(read_intrinsics, file, width=640, height=480)
    # the control
    file.write_text(form.format("525.0"))
    assert read_intrinsics(file, width=640, height=480).fx == 525.0
    file.write_text(form.format("525"))
    assert read_intrinsics(file, width=640, height=480).fx == 525.0


def test_a_focal_length_of_no_camera_is_refused(tmp_path):
    file, size = tmp_path / "camera.json", {"width": 640, "height": 480}
    for focal, sound in ((6e4, True), (7e4, False)):
        file.write_text(json.dumps({"fx": focal, "fy": 500, "cx": 320, "cy": 240}))
        if sound:
            assert read_intrinsics(file, **size).fx == focal
        else:
            assert "is of no camera" in refused(read_intrinsics, file, **size).message
