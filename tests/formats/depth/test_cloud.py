"""Point clouds of every form of PCD and PLY: the points that were put in come out, whatever else is
in the file, or it is refused.
"""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.core.errors import RecordingError
from pipeline.formats.depth.cloud import UNTURNED, read_cloud

FIELDS = "FIELDS rgb z _ x label y _\nSIZE 4 8 1 8 2 8 1\nTYPE U F U F I F U\nCOUNT 1 1 3 1 1 1 5\n"
POINT = np.dtype(
    [
        *(("rgb", "<u4"), ("z", "<f8"), ("pad", "u1", 3), ("x", "<f8"), ("label", "<i2")),
        *(("y", "<f8"), ("tail", "u1", 5)),
    ]
)


def records(count: int = 12) -> np.ndarray:
    generator, table = np.random.default_rng(3), np.zeros(count, POINT)
    for axis in "xyz":
        table[axis] = generator.normal(size=count)
    table["rgb"], table["pad"], table["label"] = 0x00FF7F00, 9, -4
    table["z"][2], table["y"][5] = np.nan, np.inf
    return table


def positions(table: np.ndarray) -> np.ndarray:
    points = np.stack([table[axis] for axis in "xyz"], axis=-1)
    return points[np.isfinite(points).all(axis=1)]


def pcd(form: str, table: np.ndarray, *, viewpoint: str = "0 0 0 1 0 0 0") -> bytes:
    header = (
        f"# .PCD v0.7\nVERSION 0.7\n{FIELDS}WIDTH 4\nHEIGHT {len(table) // 4}\n"
        f"VIEWPOINT {viewpoint}\nPOINTS {len(table)}\nDATA {form}\n"
    ).encode()
    if form == "binary":
        return header + table.tobytes()
    if form == "binary_compressed":  # LZF of literal runs
        data = b"".join(np.ascontiguousarray(table[name]).tobytes() for name in POINT.names)
        runs = [data[i : i + 32] for i in range(0, len(data), 32)]
        packed = b"".join(bytes([len(run) - 1]) + run for run in runs)
        return header + struct.pack("<II", len(packed), len(data)) + packed
    rows = [f"1 {p['z']} 9 9 9 {p['x']} {p['label']} {p['y']} 0 0 0 0 0\n" for p in table]
    return header + "".join(rows).encode()


def ply(form: str, table: np.ndarray) -> bytes:
    header = (
        f"ply\nformat {form} 1.0\ncomment made for a test\nelement vertex {len(table)}\n"
        "property double z\nproperty uchar red\nproperty double x\nproperty float64 y\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode()
    if form == "ascii":
        rows = "".join(f"{p['z']} 255 {p['x']} {p['y']}\n" for p in table)
        return header + rows.encode() + b"3 0 1 2\n"
    order = ">" if form == "binary_big_endian" else "<"
    vertices = np.zeros(
        len(table), [("z", order + "f8"), ("red", "u1"), ("x", order + "f8"), ("y", order + "f8")]
    )
    for axis in "xyz":
        vertices[axis] = table[axis]
    return header + vertices.tobytes() + struct.pack(order + "Biii", 3, 0, 1, 2)


PCDS = {f"{form}.pcd": pcd(form, records()) for form in ("ascii", "binary", "binary_compressed")}
FILES = PCDS | {
    f"{form}.ply": ply(form, records())
    for form in ("ascii", "binary_little_endian", "binary_big_endian")
}
FILES["crlf.ply"] = ply("ascii", records()).replace(b"\n", b"\r\n")


def refused(file) -> RecordingError:
    with pytest.raises(RecordingError) as caught:
        read_cloud(file)
    assert caught.value.evidence["file"] == file
    return caught.value


@pytest.mark.parametrize("name", FILES)
def test_the_points_are_read_whatever_the_order_and_types_of_the_fields(tmp_path, name):
    (tmp_path / name).write_bytes(FILES[name])
    cloud = read_cloud(tmp_path / name)
    np.testing.assert_array_equal(cloud.points, positions(records()))
    assert (cloud.missing, cloud.counts, cloud.viewpoint) == (2, {}, UNTURNED)


def test_single_precision_is_read_as_it_is(tmp_path):
    points = np.random.default_rng(1).normal(size=(9, 3)).astype("<f4")
    header = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 9\nHEIGHT 1\nPOINTS 9\nDATA binary\n"
    (tmp_path / "c.pcd").write_bytes(f"VERSION .7\n{header}".encode() + points.tobytes())
    np.testing.assert_array_equal(read_cloud(tmp_path / "c.pcd").points, points.astype(float))


@pytest.mark.parametrize("name", PCDS)
def test_the_viewpoint_is_told_and_the_points_stay_in_the_sensors_frame(tmp_path, name):
    content = FILES[name].replace(b"VIEWPOINT 0 0 0 1 0 0 0", b"VIEWPOINT 1 -2 0.5 0.8 0 0.6 0")
    (tmp_path / name).write_bytes(content)
    cloud = read_cloud(tmp_path / name)
    np.testing.assert_array_equal(cloud.points, positions(records()))
    assert cloud.viewpoint == (1, -2, 0.5, 0.8, 0, 0.6, 0)


@pytest.mark.parametrize("behind", [b"\0" * 4096, b"1 2 3 left of another cloud\n"])
@pytest.mark.parametrize("name", PCDS)
def test_bytes_behind_the_points_are_passed_over_and_counted(tmp_path, name, behind):
    (tmp_path / name).write_bytes(FILES[name] + behind)
    cloud = read_cloud(tmp_path / name)
    np.testing.assert_array_equal(cloud.points, positions(records()))
    assert cloud.counts == {"surplus_bytes": len(behind)}


@pytest.mark.parametrize("name", ["ascii.pcd", "ascii.ply"])
def test_a_last_line_without_its_end_is_whole(tmp_path, name):
    content = FILES[name].replace(b"3 0 1 2\n", b"").rstrip(b"\n")
    (tmp_path / name).write_bytes(content)
    assert len(read_cloud(tmp_path / name).points) == 10


REFUSALS = [
    ("binary.pcd", b"POINTS 12", b"POINTS 13", "3 rows of 4 are 12"),
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
    ("binary.pcd", b"WIDTH 4\nHEIGHT 3", b"WIDTH 99999999\nHEIGHT 999", "are 99899999001"),
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
    assert old in FILES[name]
    (tmp_path / name).write_bytes(FILES[name].replace(old, new, 1))
    error = refused(tmp_path / name)
    assert words in error.message
    if name == "ascii.pcd":
        assert error.evidence["line"] in (12, 14)


@pytest.mark.parametrize(
    "content", [b"", b"ply", b"no cloud at all\n", bytes(20_000), b"VERSION 0.7\n"]
)
def test_files_that_are_no_clouds_are_refused(tmp_path, content):
    for name in ("c.pcd", "c.ply"):
        (tmp_path / name).write_bytes(content)
        refused(tmp_path / name)
    refused(tmp_path / "absent.pcd")


@settings(max_examples=30, deadline=None)
@given(st.data())
@pytest.mark.parametrize("name", FILES)
def test_a_cloud_cut_at_any_byte_is_refused_or_has_every_point(tmp_path_factory, name, data):
    file, cut = tmp_path_factory.getbasetemp() / f"cut_{name}", len(FILES[name]) - 1
    file.write_bytes(FILES[name][: data.draw(st.integers(0, cut))])
    try:
        cloud = read_cloud(file)
    except RecordingError as error:
        assert error.evidence["file"] == file
        return
    # the last cell of a text without its line end may lack digits, and all else is there
    np.testing.assert_array_equal(cloud.points[:-1], positions(records())[:-1])
    assert len(cloud.points) == 10 and name != "binary.pcd"


@settings(max_examples=40, deadline=None)
@given(st.data())
@pytest.mark.parametrize("name", FILES)
def test_damaged_bytes_never_raise_anything_but_a_refusal(tmp_path_factory, name, data):
    file, content = tmp_path_factory.getbasetemp() / f"damaged_{name}", bytearray(FILES[name])
    for place in data.draw(st.lists(st.integers(0, len(content) - 1), min_size=1, max_size=3)):
        content[place] = data.draw(st.integers(0, 255))
    file.write_bytes(content)
    try:
        assert read_cloud(file).points.shape[1:] == (3,)
    except RecordingError as error:
        assert error.evidence["file"] == file


def test_a_real_sensors_cloud_is_read(shared):
    cloud = read_cloud(shared / "samples/kinect/cloud_compressed_viewpoint.pcd")
    assert (len(cloud.points), cloud.missing) == (249647, 57553)
    assert cloud.viewpoint == (0, 0, 0, 0, 1, 0, 0) and cloud.counts == {"surplus_bytes": 3912}
    assert (cloud.points[:, 2] > 0).all()  # before the camera
