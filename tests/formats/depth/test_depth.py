"""Depth images and what their values mean, point clouds, indexes, intrinsics of every tool, and ROS
messages: what was put in comes out. Refusals of files: tests/formats/test_refusals.py.
"""

import json
from dataclasses import replace
from functools import partial
from multiprocessing import get_context

import depth_files as made
import numpy as np
import pytest
from case_tables import cases_beside
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from ros_bags import Message, cloud, image
from ros_bags import camera_info as info
from written_logs import refusal as reject

from pipeline.core.errors import RecordingError
from pipeline.formats.depth.cloud import FORMAT, UNTURNED, PointCloud, read_cloud
from pipeline.formats.depth.image import (
    Encoding,
    RawDepth,
    dropped_frames,
    metres,
    numbered_frames,
    read_depth,
    read_index,
    write_depth,
    write_index,
)
from pipeline.formats.depth.intrinsics import (
    Intrinsics,
    read_intrinsics,
    write_intrinsics,
)
from pipeline.formats.format import Head
from pipeline.formats.rosbag import camera_info, cloud_points, image_pixels

cases = cases_beside(__file__)
SCALED = Encoding("plain", 1000, scale_key="scale")


def test_written_frames_read_back_without_loss_and_with_the_same_bytes(tmp_path):
    (tmp_path / "d.pgm").write_bytes(made.PGM)
    pixels = read_depth(tmp_path / "d.pgm", shape=(12, 16)).pixels
    assert_array_equal(pixels, made.SMALL)

    extremes = made.SMALL.copy()
    extremes[0, :4] = 0, 1, 65534, 65535
    first = tmp_path / "1.png"
    second = tmp_path / "2.png"
    write_depth(first, extremes)
    write_depth(second, extremes)

    assert_array_equal(read_depth(first, shape=(12, 16)).pixels, extremes)
    assert first.read_bytes() == second.read_bytes()


@pytest.mark.parametrize("compression", ["raw", "tiff_lzw", "tiff_adobe_deflate"])
@pytest.mark.parametrize("kind", [np.uint16, np.float32])
def test_tiffs_keep_their_values_and_their_description(tmp_path, kind, compression):
    file = tmp_path / "d.tif"
    image = made.SMALL.astype(kind)
    text = "depth scale=0.25"
    seen = image > 0
    file.write_bytes(made.tiff(image, text, compression=compression))

    raw = read_depth(file, shape=image.shape)
    depth = metres(raw, SCALED)

    assert (raw.pixels.dtype, raw.description) == (kind, text)
    assert_array_equal(raw.pixels, image)
    assert_allclose(depth[seen], image[seen] * 0.25e-3, rtol=1e-6)


@cases("scales")
def test_a_scale_of_a_description_multiplies_the_depth(text):
    raw = RawDepth(np.full((2, 2), 500, np.uint16), text)
    assert (metres(raw, SCALED) == 1).all()


@cases("no scales")
def test_a_description_without_one_positive_scale_is_refused(text):
    raw = RawDepth(np.full((2, 2), 500, np.uint16), text)
    with pytest.raises(RecordingError, match="'scale'"):
        metres(raw, SCALED)


NONE = np.nan
MILLIMETRES = np.array([0, 1, 1234, 8191], np.uint16)
ROTATED = MILLIMETRES << 3 | MILLIMETRES >> 13
DISPARITY = np.array([0, 500, 1000, 1092, 1093, 2047], np.uint16)
KINECT = Encoding("disparity", 1, disparity=(351.3, 1092.5))
BY_DISPARITY = 351.3 / (1092.5 - DISPARITY[1:4])
METRES = np.array([0, np.nan, np.inf, -1, 0.5, 7.9, 8, 9], np.float32)
ENDS = np.array([0, 1, 65535], np.uint16)
DEPTHS = [  # values, their encoding, depth in m
    (ROTATED, Encoding("rotated_bits", 1000), [NONE, 0.001, 1.234, 8.191]),
    (DISPARITY.byteswap(), KINECT, [NONE, *BY_DISPARITY, NONE, NONE]),
    (
        METRES,
        Encoding("plain", 1, saturation=8),
        [NONE, NONE, NONE, NONE, 0.5, 7.9, NONE, NONE],
    ),
    (ENDS, Encoding("plain", 1000, 65535), [NONE, 0.001, NONE]),
    (ENDS, Encoding("plain", 1000), [NONE, 0.001, 65.535]),
]


@pytest.mark.parametrize(("values", "encoding", "depth"), DEPTHS)
def test_values_become_depth_by_their_encoding_and_nan_where_there_is_none(
    values,
    encoding,
    depth,
):
    result = metres(RawDepth(values[None]), encoding)
    assert result.dtype == np.float32
    assert_allclose(result[0], depth, rtol=1e-6)


def test_disparities_whose_bytes_were_not_swapped_are_refused():
    with pytest.raises(RecordingError, match="11-bit"):
        metres(RawDepth(DISPARITY[None]), KINECT)


POINTS = made.positions(made.records())
BINARY = [name for name in made.CLOUDS if name.startswith("binary")]
REMAINDER = b"1 2 3 left of another cloud\n"


@pytest.mark.parametrize("name", made.CLOUDS)
def test_points_are_read_with_any_fields(tmp_path, name):
    (tmp_path / name).write_bytes(made.CLOUDS[name])
    cloud = read_cloud(tmp_path / name)

    assert_array_equal(cloud.points, POINTS)
    assert (cloud.missing, cloud.counts, cloud.viewpoint) == (2, {}, UNTURNED)


@pytest.mark.parametrize("name", made.PCDS)
@pytest.mark.parametrize("behind", [bytes(4096), REMAINDER])
def test_a_pcd_has_its_viewpoint_and_zeros_or_rows_behind_its_points(
    tmp_path,
    name,
    behind,
):
    file = tmp_path / name
    origin = b"VIEWPOINT 0 0 0 1 0 0 0"
    moved = b"VIEWPOINT 1 -2 0.5 0.8 0 0.6 0"
    file.write_bytes(made.CLOUDS[name].replace(origin, moved) + behind)
    if name in BINARY and behind == REMAINDER:
        with pytest.raises(RecordingError, match="not zeros as a padding"):
            read_cloud(file)
        return

    cloud = read_cloud(file)

    # the points stay in the frame of the sensor
    assert_array_equal(cloud.points, POINTS)
    assert cloud.viewpoint == (1, -2, 0.5, 0.8, 0, 0.6, 0)
    assert cloud.counts == {"surplus_bytes": len(behind)}


@pytest.mark.parametrize("share", [0.0, 0.4, 0.8])  # of the points, before the byte
@pytest.mark.parametrize("inserted", [b"\0", b"@", b"\n\r"])
@pytest.mark.parametrize("name", BINARY)
def test_bytes_inserted_in_binary_points_are_refused(tmp_path, name, inserted, share):
    file = tmp_path / name
    content = made.CLOUDS[name]
    last_line = b"DATA" if name.endswith("pcd") else b"end_header"
    start = content.index(b"\n", content.index(last_line)) + 1
    length = len(content) - start
    place = start + int(share * length)
    file.write_bytes(content[:place] + inserted + content[place:])

    error = reject(read_cloud, file)

    assert "damaged" in error.message or "beyond 1e+20" in error.message


@pytest.mark.parametrize("mark", [b"ply \n", b"ply\t\r\n", b"ply  \r"])
def test_blanks_behind_the_mark_of_a_ply_are_no_matter(tmp_path, mark):
    file = tmp_path / "cloud"
    content = made.CLOUDS["binary_little_endian.ply"]
    file.write_bytes(content.replace(b"ply\n", mark, 1))

    assert FORMAT.recognises(Head.read(file))
    assert_array_equal(read_cloud(file).points, POINTS)


def test_written_indexes_read_back(tmp_path):
    file = tmp_path / "depth.txt"
    stamps = 1305031102.175304 + np.arange(5) / 30
    names = tuple(f"depth/{n:04d}.png" for n in range(5))
    write_index(file, stamps, names)

    result = read_index(file)

    assert_allclose(result.time, stamps, rtol=0, atol=0.6e-6)
    assert (result.files, result.counts) == (names, {"cut_rows": 0})


def test_blanks_comments_and_line_ends_of_an_index_are_no_matter(tmp_path):
    file = tmp_path / "depth.txt"
    lines = [b"# depth maps\r\n", b"\n", b"0.16  depth/a.png  \r\n", b" \n"]
    lines += [b"0.6\tdepth/b c.png\n", b"# end\n"]
    file.write_bytes(b"".join(lines))

    result = read_index(file)

    assert result.time.tolist() == [0.16, 0.6]
    assert result.files == ("depth/a.png", "depth/b c.png")


def numbered(folder, *names: str) -> None:
    for name in names:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(b"")


def test_numbered_frames_are_seen_at_the_rate_and_missing_numbers_leave_their_time_out(
    tmp_path,
):
    names = tuple(f"depth/frame2-{n}.depth.png" for n in (9, 10, 11, 13, 100))
    numbered(tmp_path, *names, "depth/colour-1.jpg")

    result = numbered_frames(tmp_path, "depth/*.png", rate=30.0)

    assert result.files == names
    assert_allclose(result.time, np.array([0, 1, 2, 4, 91]) / 30)


@cases("even times")
def test_times_in_names_are_those_whose_steps_are_even(tmp_path, form, times):
    names = [f"{form.format(time)}.png" for time in times]
    numbered(tmp_path, *names)

    result = numbered_frames(tmp_path, "*.png", rate=1.0)

    assert result.files == tuple(names)
    assert_allclose(result.time, 0.04 * np.arange(len(names)), atol=1e-4)


@cases("unplain names")
def test_names_whose_number_is_not_plain_are_refused(tmp_path, names):
    with pytest.raises(RecordingError, match="no depth frame matches"):
        numbered_frames(tmp_path, "*.png", rate=30.0)

    numbered(tmp_path, *names)
    words = r"differ only in one number|time between frames"
    with pytest.raises(RecordingError, match=words):
        numbered_frames(tmp_path, "*.png", rate=30.0)


def test_dropped_frames_are_counted_by_the_indexs_own_times():
    rng = default_rng(1)
    time = np.arange(97) / 30 + rng.normal(scale=2e-3, size=97)

    assert dropped_frames(time) == 0  # at whatever rate the datasheet states
    assert dropped_frames(np.delete(time, [5, 40, 41])) == 3
    assert dropped_frames(time[:1]) == 0


SIZE = {"width": 640, "height": 480}
CAMERA = Intrinsics(525.5, 524, 319.5, 239.25, 640, 480, (0.25, 0, 0, 0, 0))


def read(file, content: str) -> Intrinsics:
    file.write_text(content)
    return read_intrinsics(file, **SIZE)


def refusal(file, content: str, **options: object) -> str:
    file.write_text(content)
    return reject(partial(read_intrinsics, **SIZE | options), file).message


def test_written_intrinsics_read_back_exactly_in_the_sensors_own_format(tmp_path):
    file = tmp_path / "ir.yaml"
    for distortion in ((0.1, -0.2, 1e-4, -1 / 3, 0.5), (0,) * 5):
        original = Intrinsics(365.456, 365.1, 254.878, 205.395, 512, 424, distortion)
        write_intrinsics(file, original)
        head = "%YAML:1.0\n---\ncameraMatrix: !!opencv-matrix\n   rows: 3\n"
        assert file.read_text().startswith(head)
        assert read_intrinsics(file, width=512, height=424) == original


@pytest.mark.parametrize("name", made.CALIBRATIONS)
def test_every_tools_format_gives_the_same_camera(tmp_path, name):
    assert read(tmp_path / name, made.CALIBRATIONS[name]) == CAMERA


@pytest.mark.parametrize("name", "ros.yaml printed.yaml plain.json opencv.xml".split())
def test_a_calibration_that_states_another_size_is_refused(tmp_path, name):
    smaller = {"width": 320, "height": 240}
    message = refusal(tmp_path / name, made.CALIBRATIONS[name], **smaller)
    assert "not 320 × 240" in message


def test_open3ds_matrix_runs_down_the_columns_and_may_stand_beside_its_pose(tmp_path):
    matrix = [525.5, 0, 0, 0, 524.0, 0, 319.5, 239.25, 1]
    file = tmp_path / "c.json"
    camera = SIZE | {"intrinsic_matrix": matrix}
    for stored in (camera, {"intrinsic": camera, "extrinsic": []}):
        text = json.dumps(stored)
        assert read(file, text) == replace(CAMERA, distortion=())
        assert "calibrated at 640" in refusal(file, text, width=9)


def test_several_cameras_in_one_file_are_told_apart_by_option_alone(tmp_path):
    file = tmp_path / "stereo.yaml"
    matrix = made.opencv("M{0}", 3, 3, "{1}, 0, 319.5, 0, 524, 239.25, 0, 0, 1")
    distortion = made.opencv("D{0}_coeffs", 5, 1, "0.25, 0, 0, 0, 0")
    camera = matrix + distortion
    both = "%YAML:1.0\n---\n" + camera.format(1, 525.5) + camera.format(2, 600)
    assert "M1, D1_coeffs, M2, D2_coeffs" in refusal(file, both)

    second = read_intrinsics(file, **SIZE, matrix="M2", distortion="D2_coeffs")
    assert second.fx == 600
    assert "0 of M3 are there" in refusal(file, both, matrix="M3")


def test_a_camera_info_that_ros_printed_is_read_however_often_it_is_there(tmp_path):
    message = made.CALIBRATIONS["printed.yaml"]
    assert read(tmp_path / "info.yaml", 2 * message) == CAMERA

    contradiction = message + message.replace("525.5", "499.0")
    assert "calibrations that differ" in refusal(tmp_path / "info.yaml", contradiction)


def test_distortion_of_another_model_is_refused_and_none_of_it_is_overlooked(tmp_path):
    file = tmp_path / "c.json"
    four = [0.1, 0.2, 0.3, 0.4]
    camera = {"K": [[500, 0, 320], [0, 501, 240], [0, 0, 1]]}
    fisheye = camera | {"distortion_model": "equidistant"}

    assert "equidistant" in refusal(file, json.dumps(fisheye | {"D": four}))
    for key in ("dist", "lens_distortion", "radial_coeffs", "k1"):
        assert key in refusal(file, json.dumps(camera | {key: four}))

    # the control: nothing is distorted
    undistorted = json.dumps(fisheye | {"D": [0, 0, 0, 0]})
    assert read(file, undistorted).distortion == (0, 0, 0, 0)


def test_the_distortion_of_a_realsense_needs_its_model(tmp_path):
    file = tmp_path / "c.json"
    keys = '"fx": 500, "fy": 501, "ppx": 320, "ppy": 240'
    camera = '{%s, "coeffs": [0.1, 0, 0, 0, 0]%s}'

    stated = read(file, camera % (keys, ', "model": "distortion.brown_conrady"'))

    assert (stated.fy, stated.cx, stated.distortion[0]) == (501, 320, 0.1)
    assert "not stated" in refusal(file, camera % (keys, ""))


GENERATOR = default_rng(2)
MATRIX = [525.0, 0, 319.5, 0, 524.0, 239.5, 0, 0, 1]


@pytest.mark.parametrize("padding", [0, 3])
@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("kind", [np.uint16, np.float32])
def test_images_of_either_byte_order_and_any_padding_keep_their_pixels(
    kind,
    big,
    padding,
):
    pixels = (GENERATOR.random((5, 7)) * 5000).astype(kind)
    message = image(pixels, 1.0, big=big, padding=padding).for_version("ros2")

    result = image_pixels(message, shape=(5, 7))

    assert result.dtype == kind
    assert_array_equal(result, pixels)


@pytest.mark.parametrize("rows", [1, 4])
@pytest.mark.parametrize("big", [False, True])
@cases("layouts")
def test_clouds_of_any_layout_keep_their_points(fields, step, big, rows):
    drawn = GENERATOR.normal(size=(12, 3))
    points = drawn.astype(np.float32).astype(float)
    points[4, 1] = np.nan
    points[5] = 0.0
    recorded = cloud(points, 1.0, fields, step, big=big, rows=rows)

    read = cloud_points(recorded.for_version("ros2"))

    assert_array_equal(read, points)
    assert PointCloud.measured(points).missing == 2


# name, offset, type, count
X = ("x", 0, 7, 1)
Y = ("y", 4, 7, 1)
Z = ("z", 8, 7, 1)
PIXELS = image(np.ones((5, 7), np.uint16), 1.0)
CLOUD = cloud(np.ones((12, 3)), 1.0, [X, Y, Z], 16)
depth_pixels = partial(image_pixels, shape=(5, 7))
NO_MESSAGE = [  # function, message, fields that are changed, words
    (depth_pixels, PIXELS, {"encoding": "bgr8"}, "'bgr8'"),
    (depth_pixels, PIXELS, {"height": 4}, "7 × 4"),
    (cloud_points, CLOUD, {"fields": [X, Y, ("w", 8, 7, 1)]}, "there are x, y, w"),
    (cloud_points, CLOUD, {"data": np.zeros(10, np.uint8)}, "10 bytes"),
]


@pytest.mark.parametrize(("convert", "sound", "changes", "words"), NO_MESSAGE)
def test_messages_that_are_no_depth_or_not_whole_are_refused(
    convert,
    sound,
    changes,
    words,
):
    message = Message(sound.kind, 1.0, **sound.fields | changes).for_version("ros1")
    with pytest.raises(RecordingError, match=words) as refused:
        convert(message, file="take.bag", number=3)
    assert refused.value.evidence == {"file": "take.bag", "number": 3}


@pytest.mark.parametrize("version", ["ros1", "ros2"])
def test_a_camera_has_the_intrinsics_of_its_info(version):
    distortion = 0.1, -0.2, 0, 0, 0.05
    message = info(MATRIX, [*distortion], (640, 480)).for_version(version)
    expected = Intrinsics(525, 524, 319.5, 239.5, 640, 480, distortion)
    assert camera_info(message, **SIZE) == expected

    undistorted = info(MATRIX, [0.0] * 5, (640, 480), model="equidistant")
    assert camera_info(undistorted.for_version(version), **SIZE).distortion == ()


FISHEYE = info(MATRIX, [0.1, 0.2, 0.3, 0.4], (640, 480), model="equidistant")
NO_INFO = {
    "320 × 240": info(MATRIX, [], (320, 240)),
    "camera matrix": info([0.0] * 9, [], (640, 480)),
    "equidistant": FISHEYE,
}


@pytest.mark.parametrize("words", NO_INFO)
def test_an_info_of_another_camera_is_refused(words):
    message = NO_INFO[words].for_version("ros2")
    with pytest.raises(RecordingError, match=words):
        camera_info(message, **SIZE, file="take.bag")


def test_a_worker_that_may_have_no_processes_reads_and_refuses_too(tmp_path):
    """The workers of Dask are daemons, as those of a pool are."""
    file = tmp_path / "c.yaml"
    file.write_text(made.CALIBRATIONS["ros.yaml"])
    with get_context("spawn").Pool(1) as pool:
        assert pool.apply(read_intrinsics, (file,), SIZE) == CAMERA
        file.write_text("a: [\n")
        with pytest.raises(RecordingError, match="no calibration"):
            pool.apply(read_intrinsics, (file,), SIZE)
