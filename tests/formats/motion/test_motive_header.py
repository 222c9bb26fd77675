"""Headers of columnar takes: whatever their version, order and names, labels decide."""

from __future__ import annotations

import numpy as np
import pytest
from motive_files import MARKER, START, columns_file, random_take, refusal
from scipy.spatial.transform import Rotation

from pipeline.formats.motion.motive import read_motive, write_motive


def spreadsheet(content: bytes) -> bytes:
    # a byte-order mark, LF, every row padded with commas to the widest
    lines = content.decode().splitlines()
    width = max(line.count(",") for line in lines) + 3
    return (
        "\ufeff" + "\n".join(line + "," * (width - line.count(",")) for line in lines) + "\n"
    ).encode()


def with_timecode(content: bytes) -> bytes:
    # a column that is no number, between the time and the markers
    kinds = [b"", b"", b"", b"", b"", b"", b"TimeCode"]
    rows = [line.split(b",", 2) for line in content.split(b"\r\n")[:-1]]
    cell = [kinds[n] if n < len(kinds) else b"15:26:46:12.02" for n in range(len(rows))]
    return b"".join(
        b",".join(row if n < 2 else [*row[:2], cell[n], *row[2:]]) + b"\r\n"
        for n, row in enumerate(rows)
    )


def with_parents(content: bytes) -> bytes:
    lines = content.split(b"\r\n")
    return b"\r\n".join([*lines[:5], b",Parent" + b"," * (lines[4].count(b",") - 1), *lines[5:]])


def with_unknown_keys(content: bytes) -> bytes:
    return content.replace(b",Coordinate Space", b",Fresh Key,1.0,Coordinate Space", 1).replace(
        b"Space,Global", b"Space,Global,Newer,x", 1
    )


def without_rates(content: bytes) -> bytes:
    return content.replace(b"Capture Frame Rate,100.000000,Export Frame Rate,100.000000,", b"", 1)


def with_blank_rows(content: bytes) -> bytes:
    lines = content.split(b"\r\n")
    return b"\r\n".join([*lines[:9], b"," * lines[8].count(b","), b"", *lines[9:]])


def with_line_feeds(content: bytes) -> bytes:
    return content.replace(b"\r", b"")


@pytest.mark.parametrize(
    "change",
    [
        spreadsheet,
        with_timecode,
        with_parents,
        with_unknown_keys,
        without_rates,
        with_blank_rows,
        with_line_feeds,
    ],
)
def test_headers_of_other_versions_and_spreadsheets_change_nothing(tmp_path, change):
    file = tmp_path / "t.csv"
    write_motive(file, random_take(), start=START)
    plain, content = read_motive(file), file.read_bytes()
    file.write_bytes(change(content))
    assert file.read_bytes() != content
    result = read_motive(file)
    assert list(result.markers) == list(plain.markers)
    assert all((result.markers[name] == plain.markers[name]).all() for name in plain.markers)
    assert (result.bodies["Base"].quaternion == plain.bodies["Base"].quaternion).all()
    assert (result.name, result.rate, result.counts["found_frames"]) == (
        plain.name,
        plain.rate,
        321,
    )
    assert result.counts["blank_rows"] == (2 if change is with_blank_rows else 0)


def test_reordered_columns_change_nothing_because_labels_decide(tmp_path):
    body = MARKER.replace("X,Y,Z", "Z,X,Y") + "0,0.00,3,1,2\n"
    np.testing.assert_array_equal(
        read_motive(columns_file(tmp_path, body)).markers["A"], [[1, 2, 3]]
    )


@pytest.mark.parametrize("order", ["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"])
def test_euler_angles_are_products_of_axis_rotations_in_the_order_of_the_header(tmp_path, order):
    degrees = {"X": 20.0, "Y": -35.0, "Z": 50.0}
    body = f",Type{',Rigid Body' * 6}\n,Name{',B' * 6}\n,ID{',1' * 6}\n"
    body += f",{',Rotation' * 3}{',Position' * 3}\n"
    body += "Frame,Time (Seconds),X,Y,Z,X,Y,Z\n0,0,20,-35,50,1,2,3\n1,0.01,,,,,,\n"
    pose = read_motive(columns_file(tmp_path, body, rotation=order)).bodies["B"]
    wanted = np.eye(3)
    for axis in order:
        a, c, s = (
            "XYZ".index(axis),
            np.cos(np.radians(degrees[axis])),
            np.sin(np.radians(degrees[axis])),
        )
        turn = np.eye(3)
        i, j = (a + 1) % 3, (a + 2) % 3
        turn[[i, j, i, j], [i, j, j, i]] = c, c, -s, s
        wanted = wanted @ turn
    np.testing.assert_allclose(
        Rotation.from_quat(pose.quaternion[0]).as_matrix(), wanted, atol=1e-14
    )
    assert np.isnan(pose.quaternion[1]).all() and np.isnan(pose.position[1]).all()


def test_a_raw_marker_is_preferred_to_the_solved_one_of_its_name(tmp_path):
    kinds = ["Rigid Body Marker"] * 6 + ["Marker"] * 3
    names = ["B:Marker1"] * 3 + ["B:Marker2"] * 3 + ["B:Marker1"] * 3
    body = f",Type,{','.join(kinds)}\n,Name,{','.join(names)}\n,ID{',1' * 9}\n"
    body += f",{',Position' * 9}\nFrame,Time (Seconds){',X,Y,Z' * 3}\n"
    result = read_motive(
        columns_file(tmp_path, body + "0,0,1,1,1,2,2,2,9,9,9\n1,0.01,1,1,1,2,2,2,,,\n")
    )
    np.testing.assert_array_equal(result.markers["B:Marker1"], [[9, 9, 9], [np.nan] * 3])
    np.testing.assert_array_equal(result.markers["B:Marker2"], [[2, 2, 2]] * 2)
    assert (result.counts["solved_replaced"], result.counts["solved_only"]) == (1, 1)


def test_a_name_of_several_ids_names_none_of_them(tmp_path):
    body = f",Type{',Marker' * 6}{',Rigid Body Marker' * 3}\n,Name{',Stray' * 9}\n"
    body += ",ID,1,1,1,2,2,2,3,3,3\n"
    body += f",{',Position' * 9}\nFrame,Time (Seconds){',X,Y,Z' * 3}\n0,0,1,1,1,2,2,2,3,3,3\n"
    result = read_motive(columns_file(tmp_path, body))
    assert list(result.markers) == ["Stray [1]", "Stray [2]", "Stray [3]"]
    pose = [("Rotation", axis) for axis in "XYZW"] + [("Position", axis) for axis in "XYZ"]
    quantities, axes = (",".join(labels) for labels in zip(*(2 * pose), strict=True))
    body = f",Type{',Rigid Body' * 14}\n,Name{',B' * 14}\n,ID{',1' * 7}{',2' * 7}\n"
    body += f",,{quantities}\nFrame,Time (Seconds),{axes}\n"
    assert list(
        read_motive(columns_file(tmp_path, body + "0,0,0,0,0,1,1,2,3,0,0,0,1,4,5,6\n")).bodies
    ) == ["B [1]", "B [2]"]


def test_bones_are_skipped_and_counted(tmp_path):
    kinds = "Marker,Marker,Marker,Bone,Bone,Bone,Bone Marker,Bone Marker,Bone Marker"
    names = "A,A,A,Hip,Hip,Hip,Hip_1,Hip_1,Hip_1"
    body = (
        f",Type,{kinds}\n,Name,{names}\n,ID{',1' * 9}\n,{',Position' * 9}\nFrame,Time "
        f"(Seconds){',X,Y,Z' * 3}\n"
    )
    result = read_motive(columns_file(tmp_path, body + "0,0,1,2,3,4,5,6,7,8,9\n"))
    assert list(result.markers) == ["A"]
    assert (result.counts["skipped_bones"], result.counts["unused_columns"]) == (2, 6)
    alone = refusal(
        read_motive,
        columns_file(
            tmp_path,
            body.replace("Marker,Marker,Marker,Bone,", ",,,Bone,") + "0,0,,,,4,5,6,7,8,9\n",
        ),
    )
    assert "bones alone" in alone.message
