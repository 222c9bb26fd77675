"""Point clouds from every form of PCD and PLY: the points that were put in come out, whatever else
is in the file, or it is refused.
"""

from __future__ import annotations

import ctypes
import struct

import libusb_package
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pipeline.core.errors import RecordingError
from pipeline.formats.depth.cloud import read_cloud

POINT = np.dtype(
    [("rgb", "<u4"), ("z", "<f4"), ("pad", "u1", 3), ("x", "<f8"), ("label", "<i2"), ("y", "<f4")]
)


FIELDS = "FIELDS rgb z _ x label y\nSIZE 4 4 1 8 2 4\nTYPE U F U F I F\nCOUNT 1 1 3 1 1 1\n"


@pytest.fixture(scope="module")
def open3d():
    ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
    import open3d

    return open3d


def records(count: int = 12) -> np.ndarray:
    generator, table = np.random.default_rng(3), np.zeros(count, POINT)
    for axis in "xyz":
        table[axis] = generator.normal(size=count)
    table["rgb"], table["pad"], table["label"] = 0x00FF7F00, 9, -4
    table["z"][2], table["y"][5] = np.nan, np.inf
    return table


def positions(table: np.ndarray) -> np.ndarray:
    points = np.stack([table[axis].astype(float) for axis in "xyz"], axis=-1)
    return points[np.isfinite(points).all(axis=1)]


def literal_lzf(data: bytes) -> bytes:
    return b"".join(
        bytes([len(data[i : i + 32]) - 1]) + data[i : i + 32] for i in range(0, len(data), 32)
    )


def pcd(
    form: str, table: np.ndarray, *, width: int | None = None, viewpoint: str = "0 0 0 1 0 0 0"
) -> bytes:
    width = width or len(table)
    size = (
        f"WIDTH {width}\nHEIGHT {len(table) // width}\nVIEWPOINT {viewpoint}\nPOINTS "
        f"{len(table)}\nDATA {form}\n"
    )
    header = f"# .PCD v0.7\nVERSION 0.7\n{FIELDS}{size}".encode()
    if form == "binary":
        return header + table.tobytes()
    if form == "binary_compressed":
        columns = b"".join(np.ascontiguousarray(table[name]).tobytes() for name in POINT.names)
        packed = literal_lzf(columns)
        return header + struct.pack("<II", len(packed), len(columns)) + packed
    rows = [f"{int(p['rgb'])} {p['z']} 9 9 9 {p['x']} {p['label']} {p['y']}\n" for p in table]
    return header + "".join(rows).encode()


def ply(form: str, table: np.ndarray) -> bytes:
    order = {"binary_big_endian": ">"}.get(form, "<")
    header = (
        f"ply\nformat {form} 1.0\ncomment made for a test\nelement vertex {len(table)}\nproperty "
        "float z\nproperty uchar red\n"
        "property double x\nproperty float32 y\nelement face 1\nproperty list uchar int "
        "vertex_indices\nend_header\n"
    ).encode()
    if form == "ascii":
        return (
            header
            + "".join(f"{p['z']} 255 {p['x']} {p['y']}\n" for p in table).encode()
            + b"3 0 1 2\n"
        )
    vertices = np.zeros(
        len(table), [("z", order + "f4"), ("red", "u1"), ("x", order + "f8"), ("y", order + "f4")]
    )
    for axis in "xyz":
        vertices[axis] = table[axis]
    return header + vertices.tobytes() + struct.pack(order + "Biii", 3, 0, 1, 2)


FILES = {f"{form}.pcd": pcd(form, records()) for form in ("ascii", "binary", "binary_compressed")}


FILES |= {
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
    assert cloud.missing == 2


def test_an_organised_compressed_cloud_of_a_real_sensor_is_moved_by_its_viewpoint(shared, open3d):
    file = shared / "samples/kinect/cloud_compressed_viewpoint.pcd"
    cloud = read_cloud(file)
    assert (len(cloud.points), cloud.missing) == (249647, 57553)
    independent = np.asarray(open3d.io.read_point_cloud(str(file)).points)
    # its viewpoint is half a turn about x, which Open3D passes over
    np.testing.assert_allclose(
        cloud.points, independent[np.isfinite(independent).all(axis=1)] * [1, -1, -1], atol=1e-12
    )


def test_open3d_does_not_read_every_cloud_rightly_which_is_why_it_is_not_used(tmp_path, open3d):
    plain = np.random.default_rng(1).normal(size=(9, 3))
    for kind, same in (("4", True), ("8", False)):
        header = (
            f"VERSION .7\nFIELDS x y z\nSIZE {kind} {kind} {kind}\nTYPE F F F\nCOUNT 1 "
            "1 1\nWIDTH 9\nHEIGHT 1\nPOINTS 9\nDATA binary\n"
        )
        (tmp_path / "c.pcd").write_bytes(header.encode() + plain.astype(f"<f{kind}").tobytes())
        theirs = np.asarray(open3d.io.read_point_cloud(str(tmp_path / "c.pcd")).points)
        np.testing.assert_allclose(read_cloud(tmp_path / "c.pcd").points, plain, rtol=1e-6)
        assert np.allclose(theirs, plain, rtol=1e-6) == same


def test_the_viewpoint_turns_and_moves_the_points(tmp_path):
    w, *xyz = np.array([0.8, 0.0, 0.6, 0.0])
    (tmp_path / "c.pcd").write_bytes(
        pcd("binary", records(), width=4, viewpoint="1 -2 0.5 0.8 0 0.6 0")
    )
    expected = Rotation.from_quat([*xyz, w]).apply(positions(records())) + np.array([1, -2, 0.5])
    np.testing.assert_allclose(read_cloud(tmp_path / "c.pcd").points, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b"POINTS 12", b"POINTS 13", "rows of"),
        (b"WIDTH 12", b"WIDTH 1e3", "damaged"),
        (b"POINTS 12", b"", "damaged"),
        (b"WIDTH 12\nHEIGHT 1", b"WIDTH 99999999999\nHEIGHT 1", "rows of"),
        (b"FIELDS rgb z", b"FIELDS rgb q", "no single floating-point z"),
        (b"SIZE 4 4 1", b"SIZE 4 4", "damaged"),
        (b"COUNT 1 1 3", b"COUNT 1 2 3", "no single floating-point z"),
        (b"TYPE U F", b"TYPE U I", "no single floating-point z"),
        (b"SIZE 4 4", b"SIZE 4 5", "damaged"),
        (b"VIEWPOINT 0 0 0 1", b"VIEWPOINT 0 0 0 0", "VIEWPOINT"),
        (b"VIEWPOINT 0 0 0 1 0 0 0", b"VIEWPOINT 0 0", "damaged"),
        (b"DATA binary", b"DATA zipped", "none of ascii"),
    ],
)
def test_headers_that_do_not_fit_their_data_are_refused(tmp_path, old, new, words):
    assert old in FILES["binary.pcd"]
    (tmp_path / "c.pcd").write_bytes(FILES["binary.pcd"].replace(old, new, 1))
    assert words in refused(tmp_path / "c.pcd").message


def test_a_cloud_that_announces_more_than_any_camera_sees_is_refused(tmp_path):
    many = (
        FILES["binary.pcd"]
        .replace(b"WIDTH 12", b"WIDTH 9999999999")
        .replace(b"POINTS 12", b"POINTS 9999999999")
    )
    (tmp_path / "c.pcd").write_bytes(many)
    assert "announces" in refused(tmp_path / "c.pcd").message
    (tmp_path / "c.ply").write_bytes(FILES["ascii.ply"].replace(b"vertex 12", b"vertex 9999999999"))
    assert "announces" in refused(tmp_path / "c.ply").message


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"property double x", b"property list uchar double x"),
        (b"float32 y", b"float32 w"),
        (b"vertex", b"edge"),
    ],
)
def test_plys_without_positions_are_refused(tmp_path, old, new):
    (tmp_path / "c.ply").write_bytes(FILES["binary_little_endian.ply"].replace(old, new))
    refused(tmp_path / "c.ply")


def test_a_number_that_is_none_is_refused_with_its_line(tmp_path):
    (tmp_path / "c.pcd").write_bytes(FILES["ascii.pcd"].replace(b"nan 9", b"n/a 9"))
    assert refused(tmp_path / "c.pcd").evidence["line"] == 14
    (tmp_path / "c.pcd").write_bytes(FILES["ascii.pcd"].replace(b" 9 9 9 ", b" 9 9 ", 1))
    assert refused(tmp_path / "c.pcd").evidence["line"] == 12


@pytest.mark.parametrize(
    "content", [b"", b"ply", b"no cloud at all\n", bytes(20_000), b"VERSION 0.7\n"]
)
def test_files_that_are_no_clouds_are_refused(tmp_path, content):
    (tmp_path / "c.pcd").write_bytes(content)
    refused(tmp_path / "c.pcd")
    refused(tmp_path / "absent.pcd")


@settings(max_examples=30, deadline=None)
@given(st.data())
@pytest.mark.parametrize("name", FILES)
def test_a_cloud_cut_at_any_byte_is_refused_or_has_every_point(tmp_path_factory, name, data):
    file = tmp_path_factory.getbasetemp() / f"cut_{name}"
    file.write_bytes(FILES[name][: data.draw(st.integers(0, len(FILES[name]) - 1))])
    try:
        np.testing.assert_array_equal(read_cloud(file).points, positions(records()))
        assert name.endswith("ply")  # whose points end before the file does
    except RecordingError as error:
        assert error.evidence["file"] == file


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
