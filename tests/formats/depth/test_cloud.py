"""Point clouds of every form of PCD and PLY: the points that were put in come out, whatever else is
in the file, or it is refused.
"""

from __future__ import annotations

import numpy as np
import pytest
from depth_files import CLOUDS, PCDS, positions, records, refused

from pipeline.formats.depth.cloud import UNTURNED, read_cloud


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


REFUSALS = [
    ("binary.pcd", b"POINTS 12", b"POINTS 13", "3 rows of 4"),
    ("binary.pcd", b"WIDTH 4", b"WIDTH 1e3", "damaged"),
    ("binary.pcd", b"POINTS 12", b"", "damaged"),
    ("binary.pcd", b"FIELDS rgb z", b"FIELDS rgb q", "no single x, y and z"),
    ("binary.pcd", b"SIZE 4 8 1", b"SIZE 4 8", "damaged"),
    ("binary.pcd", b"SIZE 4 8", b"SIZE 4 4", "of one floating-point type"),
    ("binary.pcd", b"SIZE 4 8", b"SIZE 4 5", "damaged"),
    ("binary.pcd", b"COUNT 1 1 3", b"COUNT 1 2 3", "no single x, y and z"),
    ("binary.pcd", b"COUNT 1 1 3", b"COUNT 1 1 0", "damaged"),
    ("binary.pcd", b"TYPE U F", b"TYPE U I", "no single x, y and z"),
    ("binary.pcd", b"VIEWPOINT 0 0 0 1", b"VIEWPOINT 0 0 0 0", "VIEWPOINT"),
    ("binary.pcd", b"VIEWPOINT 0 0 0 1 0 0 0", b"VIEWPOINT 0 0", "VIEWPOINT"),
    ("binary.pcd", b"DATA binary", b"DATA zipped", "none of ascii"),
    ("binary.pcd", b"WIDTH 4\nHEIGHT 3", b"WIDTH 99999999\nHEIGHT 999", "999 rows of 99999999"),
    ("ascii.ply", b"vertex 12", b"vertex 9999999999", "announces"),
    ("ascii.ply", b"vertex 12", b"vertex 0", "announces 0 points"),
    ("ascii.ply", b"property double x", b"property list uchar double x", "more than single"),
    ("binary_big_endian.ply", b"float64 y", b"float64 w", "no single x, y and z"),
    ("ascii.ply", b"vertex", b"edge", "does not begin"),
    ("ascii.pcd", b"nan 9", b"n/a 9", "'n/a'"),
    ("ascii.pcd", b" 9 9 9 ", b" 9 9 ", "12 numbers where a point has 13"),
]


@pytest.mark.parametrize(("name", "old", "new", "words"), REFUSALS)
def test_a_cloud_that_does_not_fit_its_header_is_refused(tmp_path, name, old, new, words):
    assert old in CLOUDS[name]
    (tmp_path / name).write_bytes(CLOUDS[name].replace(old, new, 1))
    error = refused(read_cloud, tmp_path / name)
    assert words in error.message
    if name == "ascii.pcd":
        assert error.evidence["line"] in (12, 14)


@pytest.mark.parametrize(
    "content", [b"", b"ply", b"no cloud at all\n", bytes(20_000), b"VERSION 0.7\n"]
)
def test_files_that_are_no_clouds_are_refused(tmp_path, content):
    for name in ("c.pcd", "c.ply"):
        (tmp_path / name).write_bytes(content)
        refused(read_cloud, tmp_path / name)
    refused(read_cloud, tmp_path / "absent.pcd")


def test_a_real_sensors_cloud_is_read(shared):
    cloud = read_cloud(shared / "samples/kinect/cloud_compressed_viewpoint.pcd")
    assert (len(cloud.points), cloud.missing) == (249647, 57553)
    assert cloud.viewpoint == (0, 0, 0, 0, 1, 0, 0) and cloud.counts == {"surplus_bytes": 3912}
    assert (cloud.points[:, 2] > 0).all()  # before the camera
