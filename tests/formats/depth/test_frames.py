"""Frames of a depth sequence: point clouds of every form of PCD and PLY, indexes and numbered
names. What is refused of files: tests/formats/test_refusals.py.
"""

from __future__ import annotations

import numpy as np
import pytest
from depth_files import CLOUDS, PCDS, positions, records
from written_logs import refusal

from pipeline.core.errors import RecordingError
from pipeline.formats.depth.cloud import UNTURNED, read_cloud
from pipeline.formats.depth.index import dropped_frames, numbered_frames, read_index, write_index


@pytest.mark.parametrize("name", CLOUDS)
def test_the_points_are_read_whatever_the_order_and_types_of_the_fields(tmp_path, name):
    (tmp_path / name).write_bytes(CLOUDS[name])
    cloud = read_cloud(tmp_path / name)
    np.testing.assert_array_equal(cloud.points, positions(records()))
    assert (cloud.missing, cloud.counts, cloud.viewpoint) == (2, {}, UNTURNED)


@pytest.mark.parametrize("name", PCDS)
def test_the_viewpoint_is_told_and_the_points_stay_in_the_sensors_frame(tmp_path, name):
    content = CLOUDS[name].replace(b"VIEWPOINT 0 0 0 1 0 0 0", b"VIEWPOINT 1 -2 0.5 0.8 0 0.6 0")
    (tmp_path / name).write_bytes(content)
    cloud = read_cloud(tmp_path / name)
    np.testing.assert_array_equal(cloud.points, positions(records()))
    assert cloud.viewpoint == (1, -2, 0.5, 0.8, 0, 0.6, 0)


@pytest.mark.parametrize("behind", [b"\0" * 4096, b"1 2 3 left of another cloud\n"])
@pytest.mark.parametrize("name", PCDS)
def test_bytes_behind_the_points_are_passed_over_and_counted(tmp_path, name, behind):
    (tmp_path / name).write_bytes(CLOUDS[name] + behind)
    cloud = read_cloud(tmp_path / name)
    np.testing.assert_array_equal(cloud.points, positions(records()))
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


def test_written_indexes_read_back(tmp_path):
    stamps = 1305031102.175304 + np.arange(5) / 30
    files = tuple(f"depth/{n:04d}.png" for n in range(5))
    write_index(tmp_path / "depth.txt", stamps, files)
    result = read_index(tmp_path / "depth.txt")
    np.testing.assert_allclose(result.time, stamps, rtol=0, atol=0.6e-6)
    assert (result.files, result.counts) == (files, {"cut_rows": 0})


def test_blanks_comments_and_the_line_ends_of_tums_lists_are_no_matter(tmp_path):
    (tmp_path / "depth.txt").write_bytes(
        b"# depth maps\r\n\n0.160407  depth/a.png  \r\n \n0.6\tdepth/b c.png\n# end\n"
    )
    result = read_index(tmp_path / "depth.txt")
    assert result.time.tolist() == [0.160407, 0.6]
    assert result.files == ("depth/a.png", "depth/b c.png")


@pytest.mark.parametrize("units", [1e3, 1e6, 1e9], ids=["ms", "us", "ns"])
def test_times_in_another_unit_than_seconds_are_refused(tmp_path, units):
    file = tmp_path / "depth.txt"
    write_index(file, 1305031102.0 + np.arange(5) / 30, tuple(f"{n}.png" for n in range(5)))
    assert len(read_index(file).time) == 5
    lines = [f"{(1305031102.0 + n / 30) * units:.0f} {n}.png\n" for n in range(5)]
    file.write_text("".join(lines))
    assert "write the times in s" in refusal(read_index, file).message


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


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["a.png", "b.png"], "no number"),
        (["7.png", "007.png"], "twice"),
        (["1305031102.175304.png", "1305031103.205304.png"], "differ in more than a number"),
        (["left1.png", "right1.png"], "differ in more than a number"),
        ([], "no depth frame matches"),
    ],
)
def test_names_whose_number_is_not_plain_are_refused(tmp_path, names, words):
    numbered(tmp_path, *names)
    with pytest.raises(RecordingError, match=words):
        numbered_frames(tmp_path, "*.png", rate=30.0)


def test_dropped_frames_are_counted_by_the_indexs_own_times():
    rng = np.random.default_rng(1)
    time = np.arange(97) / 30 + rng.normal(scale=2e-3, size=97)
    assert dropped_frames(time) == 0  # at whatever rate the datasheet states
    assert dropped_frames(np.delete(time, [5, 40, 41])) == 3
    assert dropped_frames(time[:1]) == 0
