"""Depth images and what their values mean, point clouds, indexes, intrinsics of every tool, and ROS
messages: what was put in comes out. Refusals of files: tests/formats/test_refusals.py.
"""

import json
from functools import partial
from multiprocessing import get_context

import depth_files as made
import numpy as np
import pytest
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


def test_written_frames_read_back_without_loss_and_with_the_same_bytes(tmp_path):
    (tmp_path / "d.pgm").write_bytes(made.PGM)
    pixels = read_depth(tmp_path / "d.pgm", shape=(12, 16)).pixels
    assert_array_equal(pixels, made.SMALL)
    extremes = made.SMALL.copy()
    extremes[0, :4] = 0, 1, 65534, 65535
    for file in (tmp_path / "1.png", tmp_path / "2.png"):
        write_depth(file, extremes)
    assert_array_equal(read_depth(tmp_path / "1.png", shape=(12, 16)).pixels, extremes)
    assert (tmp_path / "1.png").read_bytes() == (tmp_path / "2.png").read_bytes()


@pytest.mark.parametrize("compression", ["raw", "tiff_lzw", "tiff_adobe_deflate"])
@pytest.mark.parametrize("kind", [np.uint16, np.float32])
def test_tiffs_keep_their_values_and_their_description(tmp_path, kind, compression):
    file, image = tmp_path / "d.tif", made.SMALL.astype(kind)
    text = "depth scale=0.25"
    file.write_bytes(made.tiff(image, text, compression=compression))
    raw = read_depth(file, shape=made.SMALL.shape)
    assert (raw.pixels.dtype, raw.description) == (kind, text)
    assert_array_equal(raw.pixels, image)
    depth = metres(raw, Encoding("plain", 1000, scale_key="scale"))
    seen = image > 0
    assert_allclose(depth[seen], image[seen] * 0.25e-3, rtol=1e-6)


def test_a_scale_of_a_description_is_one_positive_number():
    encoding, raw = (
        Encoding("plain", 1000, scale_key="scale"),
        np.full((2, 2), 500, np.uint16),
    )
    for text in ("scale=2", "scale: 2.0", '{"scale": 2}', "unit scale 2 (mm)"):
        assert (metres(RawDepth(raw, text), encoding) == 1).all()
    for text in ("", "scale=x", "rescale=2", "scale=1 scale=2", "scale=-1"):
        with pytest.raises(RecordingError, match="'scale'"):
            metres(RawDepth(raw, text), encoding)


ROTATED, WORD = np.array([0, 1, 1234, 8191], np.uint16), np.uint16
DELTA = np.array([0, 500, 1000, 1092, 1093, 2047], WORD)
KINECT = Encoding("disparity", 1, disparity=(351.3, 1092.5))
DEPTHS = [  # values, their encoding, depth in m
    (ROTATED << 3 | ROTATED >> 13, Encoding("rotated_bits", 1000), [np.nan, 0.001, 1.234, 8.191]),
    (DELTA.byteswap(), KINECT, [np.nan, *(351.3 / (1092.5 - DELTA[1:4])), np.nan, np.nan]),
    (np.array([0, np.nan, np.inf, -1, 0.5, 7.9, 8, 9], np.float32),
     Encoding("plain", 1, saturation=8), [np.nan] * 4 + [0.5, 7.9] + [np.nan] * 2),
    (np.array([0, 1, 65535], WORD), Encoding("plain", 1000, 65535), [np.nan, 0.001, np.nan]),
    (np.array([0, 1, 65535], WORD), Encoding("plain", 1000), [np.nan, 0.001, 65.535]),
]  # fmt: skip


@pytest.mark.parametrize("number", range(len(DEPTHS)))
def test_values_become_depth_by_their_encoding_and_nan_where_there_is_none(number):
    values, encoding, depth = DEPTHS[number]
    result = metres(RawDepth(values[None]), encoding)
    assert result.dtype == np.float32
    assert_allclose(result[0], depth, rtol=1e-6)


def test_disparities_whose_bytes_were_not_swapped_are_refused():
    with pytest.raises(RecordingError, match="11-bit"):
        metres(RawDepth(DELTA[None]), KINECT)


@pytest.mark.parametrize("name", made.CLOUDS)
def test_points_are_read_with_any_fields_viewpoint_and_surplus_bytes(tmp_path, name):
    (tmp_path / name).write_bytes(made.CLOUDS[name])
    cloud = read_cloud(tmp_path / name)
    assert_array_equal(cloud.points, made.positions(made.records()))
    assert (cloud.missing, cloud.counts, cloud.viewpoint) == (2, {}, UNTURNED)
    if not name.endswith(".pcd"):
        return
    moved = made.CLOUDS[name].replace(
        b"VIEWPOINT 0 0 0 1 0 0 0",
        b"VIEWPOINT 1 -2 0.5 0.8 0 0.6 0",
    )
    text = b"1 2 3 left of another cloud\n"
    is_text = b"DATA ascii" in moved
    if not is_text:
        (tmp_path / name).write_bytes(moved + text)
        with pytest.raises(RecordingError, match="not zeros as a padding"):
            read_cloud(tmp_path / name)
    for behind in (b"\0" * 4096, *[text] * is_text):
        (tmp_path / name).write_bytes(moved + behind)
        cloud = read_cloud(tmp_path / name)
        # the points stay in the frame of the sensor
        assert_array_equal(cloud.points, made.positions(made.records()))
        assert cloud.viewpoint == (1, -2, 0.5, 0.8, 0, 0.6, 0)
        assert cloud.counts == {"surplus_bytes": len(behind)}


BINARY = [n for n in made.CLOUDS if "ascii" not in n and "crlf" not in n]


@pytest.mark.parametrize("share", [0.0, 0.4, 0.8])  # of the points, before the byte
@pytest.mark.parametrize("inserted", [b"\0", b"@", b"\n\r"])
@pytest.mark.parametrize("name", BINARY)
def test_bytes_inserted_in_binary_points_are_refused(tmp_path, name, inserted, share):
    content, file = made.CLOUDS[name], tmp_path / name
    mark = content.index(b"DATA" if name.endswith("pcd") else b"end_header")
    start = content.index(b"\n", mark) + 1
    length = len(content) - start
    place = start + int(share * length)
    file.write_bytes(content[:place] + inserted + content[place:])
    with pytest.raises(RecordingError, match=r"damaged|beyond 1e\+20") as refused:
        read_cloud(file)
    assert refused.value.evidence["file"] == file


@pytest.mark.parametrize("mark", [b"ply \n", b"ply\t\r\n", b"ply  \r"])
def test_blanks_behind_the_mark_of_a_ply_are_no_matter(tmp_path, mark):
    content = made.CLOUDS["binary_little_endian.ply"].replace(b"ply\n", mark, 1)
    (tmp_path / "cloud").write_bytes(content)
    head = Head.read(tmp_path / "cloud")
    assert FORMAT.recognises(head)
    points = read_cloud(tmp_path / "cloud").points
    assert_array_equal(points, made.positions(made.records()))


def test_indexes_read_back_and_blanks_comments_and_line_ends_are_no_matter(tmp_path):
    stamps, file = 1305031102.175304 + np.arange(5) / 30, tmp_path / "depth.txt"
    names = tuple(f"depth/{n:04d}.png" for n in range(5))
    write_index(file, stamps, names)
    result = read_index(file)
    assert_allclose(result.time, stamps, rtol=0, atol=0.6e-6)
    assert (result.files, result.counts) == (names, {"cut_rows": 0})
    file.write_bytes(
        b"# depth maps\r\n\n0.16  depth/a.png  \r\n \n0.6\tdepth/b c.png\n# end\n",
    )
    result = read_index(file)
    assert (result.time.tolist(), result.files) == (
        [0.16, 0.6],
        ("depth/a.png", "depth/b c.png"),
    )


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


EVEN = [
    "1700000000.{} 0 40 80 120",
    "1700000000.{} 56 6 64 68 72",
    "1700000000_{} 0 40000 80000",
]
EVEN += ["{} 1700000000.960000000 1700000001.0 1700000001.40000000 1700000001.80000000"]
EVEN += [
    "{} 10-15-59.92 10-15-59.96 10-16-00.00",
    "d{} 23:59:59.960 00:00:00.000 00:00:00.040",
]
EVEN += ["{} 1700000000_960000000 1700000001_40000 1700000001_40040000"]


@pytest.mark.parametrize("names", EVEN)
def test_times_in_names_are_those_whose_steps_are_even(tmp_path, names):
    form, *stated = names.split()
    numbered(
        tmp_path,
        *(frames := tuple(f"{form.format(time)}.png" for time in stated)),
    )
    result = numbered_frames(tmp_path, "*.png", rate=1.0)
    assert result.files == frames
    assert_allclose(result.time, 0.04 * np.arange(len(frames)), atol=1e-4)


UNPLAIN = [
    "a.png b.png",
    "7.png 007.png",
    "left1.png right1.png",
    "1305031102.1.png 1305031202.2.png",
]


@pytest.mark.parametrize("names", UNPLAIN)
def test_names_whose_number_is_not_plain_are_refused(tmp_path, names):
    with pytest.raises(RecordingError, match="no depth frame matches"):
        numbered_frames(tmp_path, "*.png", rate=30.0)
    numbered(tmp_path, *names.split())
    with pytest.raises(
        RecordingError,
        match=r"differ only in one number|time between frames",
    ):
        numbered_frames(tmp_path, "*.png", rate=30.0)


def test_dropped_frames_are_counted_by_the_indexs_own_times():
    rng = np.random.default_rng(1)
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
    for distortion in ((0.1, -0.2, 1e-4, -1 / 3, 0.5), (0,) * 5):
        original = Intrinsics(365.456, 365.1, 254.878, 205.395, 512, 424, distortion)
        write_intrinsics(tmp_path / "ir.yaml", original)
        head = "%YAML:1.0\n---\ncameraMatrix: !!opencv-matrix\n   rows: 3\n"
        assert (tmp_path / "ir.yaml").read_text().startswith(head)
        assert read_intrinsics(tmp_path / "ir.yaml", width=512, height=424) == original


@pytest.mark.parametrize("name", made.CALIBRATIONS)
def test_every_tools_format_gives_the_same_camera(tmp_path, name):
    assert read(tmp_path / name, made.CALIBRATIONS[name]) == CAMERA
    # they state their size
    if name in (
        "ros.yaml",
        "printed.yaml",
        "plain.json",
        "opencv.xml",
    ):
        message = refusal(
            tmp_path / name,
            made.CALIBRATIONS[name],
            width=320,
            height=240,
        )
        assert "not 320 × 240" in message


def test_open3ds_matrix_runs_down_the_columns_and_may_stand_beside_its_pose(tmp_path):
    matrix = [525.5, 0, 0, 0, 524.0, 0, 319.5, 239.25, 1]
    file, camera = tmp_path / "c.json", SIZE | {"intrinsic_matrix": matrix}
    for stored in (camera, {"intrinsic": camera, "extrinsic": []}):
        text = json.dumps(stored)
        assert read(file, text) == Intrinsics(525.5, 524, 319.5, 239.25, 640, 480)
        assert "calibrated at 640" in refusal(file, text, width=9)


def test_several_cameras_in_one_file_are_told_apart_by_option_alone(tmp_path):
    file, camera = tmp_path / "stereo.yaml", made.CALIBRATIONS["opencv.yaml"]
    keys = camera.replace("camera_matrix", "M1")
    first = keys.replace("distortion_coefficients", "D1_coeffs")
    second = first.replace("525.5", "600.").split("---\n")[1]
    both = first + second.replace("M1", "M2").replace("D1", "D2")
    assert "M1, D1_coeffs, M2, D2_coeffs" in refusal(file, both)
    assert read_intrinsics(file, **SIZE, matrix="M2", distortion="D2_coeffs").fx == 600
    assert "0 of M3 are there" in refusal(file, both, matrix="M3")


def test_a_camera_info_that_ros_printed_is_read_however_often_it_is_there(tmp_path):
    message = made.CALIBRATIONS["printed.yaml"]
    assert read(tmp_path / "info.yaml", 2 * message) == CAMERA
    contradiction = message + message.replace("525.5", "499.0")
    assert "calibrations that differ" in refusal(tmp_path / "info.yaml", contradiction)


def test_distortion_of_another_model_is_refused_and_none_of_it_is_overlooked(tmp_path):
    file, camera = tmp_path / "c.json", {"K": [[500, 0, 320], [0, 501, 240], [0, 0, 1]]}
    fisheye, four = camera | {"distortion_model": "equidistant"}, [0.1, 0.2, 0.3, 0.4]
    assert "equidistant" in refusal(file, json.dumps(fisheye | {"D": four}))
    for key in ("dist", "lens_distortion", "radial_coeffs", "k1"):
        assert key in refusal(file, json.dumps(camera | {key: four}))
    realsense = {
        "fx": 500,
        "fy": 501,
        "ppx": 320,
        "ppy": 240,
        "coeffs": [0.1, 0, 0, 0, 0],
    }
    stated = json.dumps(realsense | {"model": "distortion.brown_conrady"})
    intrinsics = read(file, stated)
    assert (intrinsics.fy, intrinsics.cx, intrinsics.distortion[0]) == (501, 320, 0.1)
    assert "not stated" in refusal(file, json.dumps(realsense))
    # the control: nothing is distorted
    assert read(file, json.dumps(fisheye | {"D": [0] * 4})).distortion == (0, 0, 0, 0)


GENERATOR = np.random.default_rng(2)
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


X, Y, Z = ("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1)  # name, offset, type, count
LAYOUTS = {
    "xyz of a depth camera": ([X, Y, Z, ("rgb", 16, 7, 1)], 32),
    "another order": (
        [("intensity", 0, 2, 1), ("z", 1, 7, 1), ("x", 9, 7, 1), ("y", 5, 7, 1)],
        13,
    ),
    "doubles among floats": ([("x", 0, 8, 1), ("y", 12, 7, 1), ("z", 16, 8, 1)], 24),
}


@pytest.mark.parametrize("rows", [1, 4])
@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_clouds_of_any_layout_keep_their_points(layout, big, rows):
    drawn = GENERATOR.normal(size=(12, 3))
    points = drawn.astype(np.float32).astype(float)
    points[4, 1] = np.nan
    points[5] = 0.0
    recorded = cloud(points, 1.0, *LAYOUTS[layout], big=big, rows=rows)
    message = recorded.for_version("ros2")
    assert_array_equal(cloud_points(message), points)
    assert PointCloud.measured(points).missing == 2


PIXELS, CLOUD = (
    image(np.ones((5, 7), np.uint16), 1.0),
    cloud(np.ones((12, 3)), 1.0, [X, Y, Z], 16),
)
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
    message = info(MATRIX, [0.1, -0.2, 0, 0, 0.05], (640, 480)).for_version(version)
    result = camera_info(message, width=640, height=480)
    assert result == Intrinsics(
        525,
        524,
        319.5,
        239.5,
        640,
        480,
        (0.1, -0.2, 0, 0, 0.05),
    )
    undistorted = info(MATRIX, [0.0] * 5, (640, 480), model="equidistant").for_version(
        version,
    )
    assert camera_info(undistorted, width=640, height=480).distortion == ()
    four = [0.1, 0.2, 0.3, 0.4]
    wrong = {
        "320 × 240": info(MATRIX, [], (320, 240)),
        "camera matrix": info([0.0] * 9, [], (640, 480)),
        "equidistant": info(MATRIX, four, (640, 480), model="equidistant"),
    }
    for words, recorded in wrong.items():
        message = recorded.for_version(version)
        with pytest.raises(RecordingError, match=words):
            camera_info(message, width=640, height=480, file="take.bag")


def test_a_worker_that_may_have_no_processes_reads_and_refuses_too(tmp_path):
    """The workers of Dask are daemons, as those of a pool are."""
    file = tmp_path / "c.yaml"
    file.write_text(made.CALIBRATIONS["ros.yaml"])
    with get_context("spawn").Pool(1) as pool:
        assert pool.apply(read_intrinsics, (file,), SIZE) == CAMERA
        file.write_text("a: [\n")
        with pytest.raises(RecordingError, match="no calibration"):
            pool.apply(read_intrinsics, (file,), SIZE)
