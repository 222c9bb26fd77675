"""Frames of a depth sequence: images and what their values mean, point clouds, indexes, numbered
names. What is refused of files: tests/formats/test_refusals.py.
"""

from __future__ import annotations

import numpy as np
import pytest
from depth_files import (
    CLOUDS,
    PCDS,
    PGM,
    SHAPE,
    SMALL,
    ZIPPED,
    encoded,
    frame,
    png,
    positions,
    records,
    tiff,
)

from pipeline.core.errors import RecordingError
from pipeline.formats.depth.cloud import UNTURNED, read_cloud
from pipeline.formats.depth.image import Encoding, RawDepth, metres, read_depth, write_depth
from pipeline.formats.depth.index import dropped_frames, numbered_frames, read_index, write_index

REAL = [
    ("depth_millimetres.png", 2702, 0.1304, 1000),
    ("depth_tum_scale5000.png", 46655, 0.1919, 5000),
]


@pytest.mark.parametrize(("name", "largest", "zeros", "units"), REAL)
def test_frames_of_real_sensors_keep_all_sixteen_bits(shared, name, largest, zeros, units):
    raw = read_depth(shared / "samples/kinect" / name, shape=(480, 640)).pixels
    assert (raw.dtype, raw.shape, raw.max()) == (np.uint16, (480, 640), largest)
    assert abs((raw == 0).mean() - zeros) < 1e-4
    depth = metres(RawDepth(raw), Encoding("plain", units))
    assert depth.dtype == np.float32 and (np.isnan(depth) == (raw == 0)).all()
    np.testing.assert_allclose(np.nanmax(depth), largest / units, rtol=1e-6)


def test_written_frames_read_back_without_loss_and_with_the_same_bytes(tmp_path):
    extremes = frame()
    extremes[0, :4] = 0, 1, 65534, 65535
    for file in (tmp_path / "1.png", tmp_path / "2.png"):
        write_depth(file, extremes)
    np.testing.assert_array_equal(read_depth(tmp_path / "1.png", shape=SHAPE).pixels, extremes)
    assert (tmp_path / "1.png").read_bytes() == (tmp_path / "2.png").read_bytes()
    with pytest.raises(TypeError):
        write_depth(tmp_path / "d.png", SMALL.astype(np.int32))


@pytest.mark.parametrize("compression", ["raw", "tiff_lzw", "tiff_adobe_deflate"])
@pytest.mark.parametrize("kind", [np.uint16, np.float32])
def test_tiffs_keep_their_values_and_their_description(tmp_path, kind, compression):
    image = SMALL.astype(kind)
    (tmp_path / "d.tif").write_bytes(tiff(image, "depth scale=0.25", compression=compression))
    raw = read_depth(tmp_path / "d.tif", shape=SMALL.shape)
    assert (raw.pixels.dtype, raw.description) == (kind, "depth scale=0.25")
    np.testing.assert_array_equal(raw.pixels, image)
    depth = metres(raw, Encoding("plain", 1000, scale_key="scale"))
    np.testing.assert_allclose(depth[image > 0], image[image > 0] * 0.25e-3, rtol=1e-6)


def test_whole_images_of_other_programs_are_decoded(tmp_path):
    thirds = (SMALL / 3.0).astype(np.float32)
    images = [(png(ZIPPED, 16, 12), SMALL), (PGM, SMALL), (encoded(".tif", SMALL / 3.0), thirds)]
    for content, values in images:
        (tmp_path / "d").write_bytes(content)
        pixels = read_depth(tmp_path / "d", shape=(12, 16)).pixels
        assert pixels.dtype == values.dtype
        np.testing.assert_array_equal(pixels, values)


def test_a_scale_of_a_description_is_one_positive_number():
    encoding, raw = Encoding("plain", 1000, scale_key="scale"), np.full((2, 2), 500, np.uint16)
    for text in ("scale=2", "scale: 2.0", '{"scale": 2}', "unit scale 2 (mm)"):
        assert (metres(RawDepth(raw, text), encoding) == 1).all()
    for text in ("", "scale=x", "rescale=2", "scale=1 scale=2", "scale=-1", "scale=1e999"):
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
    found = metres(RawDepth(values[None]), encoding)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found[0], depth, rtol=1e-6)


def test_values_that_an_encoding_does_not_have_are_refused():
    # bytes that were not swapped are no disparities of eleven bits
    with pytest.raises(RecordingError, match="11-bit"):
        metres(RawDepth(DELTA[None]), KINECT)
    with pytest.raises(RecordingError, match="float32"):
        metres(RawDepth(np.ones((1, 2), np.float32)), DEPTHS[0][1])


@pytest.mark.parametrize("name", CLOUDS)
def test_points_are_read_with_any_fields_and_the_viewpoint_and_surplus_bytes_told(tmp_path, name):
    (tmp_path / name).write_bytes(CLOUDS[name])
    cloud = read_cloud(tmp_path / name)
    np.testing.assert_array_equal(cloud.points, positions(records()))
    assert (cloud.missing, cloud.counts, cloud.viewpoint) == (2, {}, UNTURNED)
    if name not in PCDS:
        return
    moved = CLOUDS[name].replace(b"VIEWPOINT 0 0 0 1 0 0 0", b"VIEWPOINT 1 -2 0.5 0.8 0 0.6 0")
    for behind in (b"\0" * 4096, b"1 2 3 left of another cloud\n"):
        (tmp_path / name).write_bytes(moved + behind)
        cloud = read_cloud(tmp_path / name)
        # the points stay in the frame of the sensor
        np.testing.assert_array_equal(cloud.points, positions(records()))
        assert cloud.viewpoint == (1, -2, 0.5, 0.8, 0, 0.6, 0)
        assert cloud.counts == {"surplus_bytes": len(behind)}


@pytest.mark.parametrize("name", ["ascii.pcd", "ascii.ply"])
def test_a_last_line_without_its_end_is_whole(tmp_path, name):
    content = CLOUDS[name].replace(b"3 0 1 2\n", b"").rstrip(b"\n")
    (tmp_path / name).write_bytes(content)
    assert len(read_cloud(tmp_path / name).points) == 10


def test_a_real_sensors_cloud_is_read(shared):
    cloud = read_cloud(shared / "samples/kinect/cloud_compressed_viewpoint.pcd")
    assert (len(cloud.points), cloud.missing) == (249647, 57553)
    assert cloud.viewpoint == (0, 0, 0, 0, 1, 0, 0) and cloud.counts == {"surplus_bytes": 3912}
    assert (cloud.points[:, 2] > 0).all()  # before the camera


def test_indexes_read_back_and_blanks_comments_and_line_ends_are_no_matter(tmp_path):
    stamps, file = 1305031102.175304 + np.arange(5) / 30, tmp_path / "depth.txt"
    names = tuple(f"depth/{n:04d}.png" for n in range(5))
    write_index(file, stamps, names)
    result = read_index(file)
    np.testing.assert_allclose(result.time, stamps, rtol=0, atol=0.6e-6)
    assert (result.files, result.counts) == (names, {"cut_rows": 0})
    file.write_bytes(b"# depth maps\r\n\n0.16  depth/a.png  \r\n \n0.6\tdepth/b c.png\n# end\n")
    result = read_index(file)
    assert (result.time.tolist(), result.files) == ([0.16, 0.6], ("depth/a.png", "depth/b c.png"))


def numbered(folder, *names: str) -> None:
    for name in names:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(b"")


def test_numbered_frames_are_seen_at_the_rate_and_missing_numbers_leave_their_time_out(tmp_path):
    names = tuple(f"depth/frame2-{n}.depth.png" for n in (9, 10, 11, 13, 100))
    numbered(tmp_path, *names, "depth/colour-1.jpg")
    result = numbered_frames(tmp_path, "depth/*.png", rate=30.0)
    assert result.files == names
    np.testing.assert_allclose(result.time, np.array([0, 1, 2, 4, 91]) / 30)


UNPLAIN = [["a.png", "b.png"], ["7.png", "007.png"], ["left1.png", "right1.png"]]
UNPLAIN += [["1305031102.175304.png", "1305031103.205304.png"]]


@pytest.mark.parametrize("names", UNPLAIN)
def test_names_whose_number_is_not_plain_are_refused(tmp_path, names):
    with pytest.raises(RecordingError, match="no depth frame matches"):
        numbered_frames(tmp_path, "*.png", rate=30.0)
    numbered(tmp_path, *names)
    with pytest.raises(RecordingError, match="differ in one number"):
        numbered_frames(tmp_path, "*.png", rate=30.0)


def test_dropped_frames_are_counted_by_the_indexs_own_times():
    rng = np.random.default_rng(1)
    time = np.arange(97) / 30 + rng.normal(scale=2e-3, size=97)
    assert dropped_frames(time) == 0  # at whatever rate the datasheet states
    assert dropped_frames(np.delete(time, [5, 40, 41])) == 3
    assert dropped_frames(time[:1]) == 0
