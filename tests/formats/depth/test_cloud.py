"""Point clouds of every form of PCD and PLY: the points that were put in come out, whatever else is
in the file. What is refused: tests/formats/test_refusals.py.
"""

from __future__ import annotations

import numpy as np
import pytest
from depth_files import CLOUDS, PCDS, positions, records

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


def test_a_real_sensors_cloud_is_read(shared):
    cloud = read_cloud(shared / "samples/kinect/cloud_compressed_viewpoint.pcd")
    assert (len(cloud.points), cloud.missing) == (249647, 57553)
    assert cloud.viewpoint == (0, 0, 0, 0, 1, 0, 0) and cloud.counts == {"surplus_bytes": 3912}
    assert (cloud.points[:, 2] > 0).all()  # before the camera
