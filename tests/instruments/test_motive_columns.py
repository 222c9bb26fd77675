from __future__ import annotations

import numpy as np
import pytest
from motive_files import MARKER, START, columns_file, random_take, refusal
from scipy.spatial.transform import Rotation

from pipeline.instruments.motive import read_motive, write_motive

# --- files of the instrument


def test_version_1_21_without_labels_in_column_b_has_raw_and_solved_markers_and_a_body(shared):
    found = read_motive(shared / "samples/motive/motive_v1.21_rigidbody.csv")
    assert (found.version, found.rate, found.unit, len(found.frame), found.time[-1]) == ("1.21", 120.0, "m", 250, 249 / 120)
    assert found.name == "Take 2016-01-05 03.49.50 PM"
    np.testing.assert_array_equal(found.markers["Rigid Body 1:Marker1"][0], [0.009933, 0.019160, 0.009812])
    np.testing.assert_array_equal(found.markers["Rigid Body 1:Marker3"][-1], [0.160351, 0.019160, 0.009576])
    np.testing.assert_array_equal(found.markers["Rigid Body 1_1"][0], [0.009986, 0.019136, 0.009807])
    np.testing.assert_array_equal(found.bodies["Rigid Body 1"].quaternion[0], [0.000035, 0.000016, -0.000030, -1.0])
    np.testing.assert_array_equal(found.bodies["Rigid Body 1"].position[1], [0.060004, 0.019161, 0.076594])
    assert np.isnan(found.markers["Unlabeled:105"]).all()
    assert found.counts["missing_samples"] == 3 * 250
    assert (found.counts["solved_only"], found.counts["unused_columns"]) == (3, 4)


def test_version_1_23_rigid_body_has_unit_quaternions_scalar_last(shared):
    found = read_motive(shared / "samples/motive/motive_v1.23_rigidbody.csv")
    body = found.bodies["RigidBody"]
    assert (found.rate, len(found.frame), found.time[-1]) == (240.0, 10460, 10459 / 240)
    np.testing.assert_array_equal(body.position[0], [0.047597, 0.607298, 0.329784])
    np.testing.assert_array_equal(body.position[-1], [-0.065706, 0.730724, 0.312436])
    np.testing.assert_array_equal(body.quaternion[1], [-0.715889, -0.252145, 0.630100, 0.164013])
    assert np.abs(np.linalg.norm(body.quaternion, axis=1) - 1).max() < 2e-6
    assert body.quaternion[0] @ body.quaternion[1] < -0.99  # the sign flips, the rotation does not
    assert found.counts["time_mismatches"] == 0


def test_version_1_23_markers_come_from_millimetres_with_time_from_frames(shared):
    found = read_motive(shared / "samples/motive/motive_v1.23_markers_millimetres.csv")
    assert (len(found.markers), found.unit) == (18, "mm")
    np.testing.assert_allclose(found.markers["Unlabeled 1036"][0], [2.659741943, -0.830793884, -2.862191650], rtol=0, atol=1e-15)
    missing = {name: int(np.isnan(points[:, 0]).sum()) for name, points in found.markers.items()}
    assert {name[-4:]: count for name, count in missing.items() if count} == {"1051": 348, "1052": 349, "1053": 1352}
    assert found.counts["missing_samples"] == 348 + 349 + 1352
    assert found.time[1] == 1 / 360  # the file prints 0.003
    assert found.time[-1] == 1352 / 360


def test_a_valid_export_without_data_columns_is_refused_as_having_no_marker(shared):
    assert "no marker" in refusal(read_motive, shared / "samples/motive/motive_v1.23_empty.csv").message


# --- what such files do


def spreadsheet(content: bytes) -> bytes:
    # a byte-order mark, LF, every row padded with commas to the widest
    lines = content.decode().splitlines()
    width = max(line.count(",") for line in lines) + 3
    return ("\ufeff" + "\n".join(line + "," * (width - line.count(",")) for line in lines) + "\n").encode()


def with_timecode(content: bytes) -> bytes:
    # a column that is no number, between the time and the markers
    kinds = [b"", b"", b"", b"", b"", b"", b"TimeCode"]
    rows = [line.split(b",", 2) for line in content.split(b"\r\n")[:-1]]
    cell = [kinds[n] if n < len(kinds) else b"15:26:46:12.02" for n in range(len(rows))]
    return b"".join(b",".join(row if n < 2 else [*row[:2], cell[n], *row[2:]]) + b"\r\n" for n, row in enumerate(rows))


def with_parents(content: bytes) -> bytes:
    lines = content.split(b"\r\n")
    return b"\r\n".join([*lines[:5], b",Parent" + b"," * (lines[4].count(b",") - 1), *lines[5:]])


def with_unknown_keys(content: bytes) -> bytes:
    return content.replace(b",Coordinate Space", b",Fresh Key,1.0,Coordinate Space", 1).replace(b"Space,Global", b"Space,Global,Newer,x", 1)


def without_rates(content: bytes) -> bytes:
    return content.replace(b"Capture Frame Rate,100.000000,Export Frame Rate,100.000000,", b"", 1)


def with_blank_rows(content: bytes) -> bytes:
    lines = content.split(b"\r\n")
    return b"\r\n".join([*lines[:9], b"," * lines[8].count(b","), b"", *lines[9:]])


def with_line_feeds(content: bytes) -> bytes:
    return content.replace(b"\r", b"")


@pytest.mark.parametrize(
    "change", [spreadsheet, with_timecode, with_parents, with_unknown_keys, without_rates, with_blank_rows, with_line_feeds]
)
def test_headers_of_other_versions_and_spreadsheets_change_nothing(tmp_path, change):
    file = tmp_path / "t.csv"
    write_motive(file, random_take(), start=START)
    plain, content = read_motive(file), file.read_bytes()
    file.write_bytes(change(content))
    assert file.read_bytes() != content
    found = read_motive(file)
    assert list(found.markers) == list(plain.markers)
    assert all((found.markers[name] == plain.markers[name]).all() for name in plain.markers)
    assert (found.bodies["Base"].quaternion == plain.bodies["Base"].quaternion).all()
    assert (found.name, found.rate, found.counts["found_frames"]) == (plain.name, plain.rate, 321)
    assert found.counts["blank_rows"] == (2 if change is with_blank_rows else 0)


def test_reordered_columns_change_nothing_because_labels_decide(tmp_path):
    body = MARKER.replace("X,Y,Z", "Z,X,Y") + "0,0.00,3,1,2\n"
    np.testing.assert_array_equal(read_motive(columns_file(tmp_path, body)).markers["A"], [[1, 2, 3]])


def test_frame_gaps_are_time_and_are_counted_with_headers_that_lie(tmp_path):
    file = columns_file(tmp_path, MARKER + "72210,722.1,1,2,3\n72211,722.11,1,2,3\n83158,831.58,1,2,3\n")
    file.write_bytes(file.read_bytes().replace(b",Rotation Type", b",Total Exported Frames,17263,Rotation Type", 1))
    found = read_motive(file)
    np.testing.assert_allclose(found.time, [0, 0.01, 109.48], rtol=0, atol=1e-12)
    counts = {key: found.counts[key] for key in ("announced_frames", "found_frames", "gaps", "skipped_frames", "time_mismatches")}
    assert counts == {"announced_frames": 17263, "found_frames": 3, "gaps": 1, "skipped_frames": 10946, "time_mismatches": 0}


def test_a_time_that_is_not_its_frames_is_counted(tmp_path):
    rows = "0,0,1,2,3\n1,0.03,1,2,3\n2,0.02,1,2,3\n"
    assert read_motive(columns_file(tmp_path, MARKER + rows)).counts["time_mismatches"] == 1


@pytest.mark.parametrize(("unit", "scale"), [("Meters", 1.0), ("Centimeters", 0.01), ("Millimeters", 0.001)])
def test_lengths_come_back_in_metres(tmp_path, unit, scale):
    found = read_motive(columns_file(tmp_path, MARKER + "0,0,1,2,-3\n", unit=unit))
    np.testing.assert_allclose(found.markers["A"], [[scale, 2 * scale, -3 * scale]], rtol=1e-15)


@pytest.mark.parametrize(
    ("cells", "count"), [(",,", None), ("NAN,NAN,NAN", None), ("0.000000,0.000000,0.000000", "zero_samples"), ("1,,3", "partial_samples")]
)
def test_lost_samples_are_nan_in_all_coordinates_and_counted(tmp_path, cells, count):
    found = read_motive(columns_file(tmp_path, MARKER + f"0,0,{cells}\n1,0.01,0,0,1\n"))
    np.testing.assert_array_equal(found.markers["A"], [[np.nan] * 3, [0, 0, 1]])
    assert found.counts["missing_samples"] == 1
    assert {key: found.counts[key] for key in ("zero_samples", "partial_samples")} == {"zero_samples": 0, "partial_samples": 0} | (
        {count: 1} if count else {}
    )


@pytest.mark.parametrize("order", ["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"])
def test_euler_angles_are_products_of_axis_rotations_in_the_order_of_the_header(tmp_path, order):
    degrees = {"X": 20.0, "Y": -35.0, "Z": 50.0}
    body = f",Type{',Rigid Body' * 6}\n,Name{',B' * 6}\n,ID{',1' * 6}\n,{',Rotation' * 3}{',Position' * 3}\n"
    body += "Frame,Time (Seconds),X,Y,Z,X,Y,Z\n0,0,20,-35,50,1,2,3\n1,0.01,,,,,,\n"
    pose = read_motive(columns_file(tmp_path, body, rotation=order)).bodies["B"]
    wanted = np.eye(3)
    for axis in order:
        a, c, s = "XYZ".index(axis), np.cos(np.radians(degrees[axis])), np.sin(np.radians(degrees[axis]))
        turn = np.eye(3)
        i, j = (a + 1) % 3, (a + 2) % 3
        turn[[i, j, i, j], [i, j, j, i]] = c, c, -s, s
        wanted = wanted @ turn
    np.testing.assert_allclose(Rotation.from_quat(pose.quaternion[0]).as_matrix(), wanted, atol=1e-14)
    assert np.isnan(pose.quaternion[1]).all() and np.isnan(pose.position[1]).all()


def test_a_raw_marker_is_preferred_to_the_solved_one_of_its_name(tmp_path):
    kinds = ["Rigid Body Marker"] * 6 + ["Marker"] * 3
    names = ["B:Marker1"] * 3 + ["B:Marker2"] * 3 + ["B:Marker1"] * 3
    body = f",Type,{','.join(kinds)}\n,Name,{','.join(names)}\n,ID{',1' * 9}\n,{',Position' * 9}\nFrame,Time (Seconds){',X,Y,Z' * 3}\n"
    found = read_motive(columns_file(tmp_path, body + "0,0,1,1,1,2,2,2,9,9,9\n1,0.01,1,1,1,2,2,2,,,\n"))
    np.testing.assert_array_equal(found.markers["B:Marker1"], [[9, 9, 9], [np.nan] * 3])
    np.testing.assert_array_equal(found.markers["B:Marker2"], [[2, 2, 2]] * 2)
    assert (found.counts["solved_replaced"], found.counts["solved_only"]) == (1, 1)


def test_a_name_of_several_ids_names_none_of_them(tmp_path):
    body = f",Type{',Marker' * 6}{',Rigid Body Marker' * 3}\n,Name{',Stray' * 9}\n,ID,1,1,1,2,2,2,3,3,3\n"
    body += f",{',Position' * 9}\nFrame,Time (Seconds){',X,Y,Z' * 3}\n0,0,1,1,1,2,2,2,3,3,3\n"
    found = read_motive(columns_file(tmp_path, body))
    assert list(found.markers) == ["Stray [1]", "Stray [2]", "Stray [3]"]
    pose = [("Rotation", axis) for axis in "XYZW"] + [("Position", axis) for axis in "XYZ"]
    quantities, axes = (",".join(labels) for labels in zip(*(2 * pose), strict=True))
    body = f",Type{',Rigid Body' * 14}\n,Name{',B' * 14}\n,ID{',1' * 7}{',2' * 7}\n,,{quantities}\nFrame,Time (Seconds),{axes}\n"
    assert list(read_motive(columns_file(tmp_path, body + "0,0,0,0,0,1,1,2,3,0,0,0,1,4,5,6\n")).bodies) == ["B [1]", "B [2]"]


def test_bones_are_skipped_and_counted(tmp_path):
    kinds = "Marker,Marker,Marker,Bone,Bone,Bone,Bone Marker,Bone Marker,Bone Marker"
    names = "A,A,A,Hip,Hip,Hip,Hip_1,Hip_1,Hip_1"
    body = f",Type,{kinds}\n,Name,{names}\n,ID{',1' * 9}\n,{',Position' * 9}\nFrame,Time (Seconds){',X,Y,Z' * 3}\n"
    found = read_motive(columns_file(tmp_path, body + "0,0,1,2,3,4,5,6,7,8,9\n"))
    assert list(found.markers) == ["A"]
    assert (found.counts["skipped_bones"], found.counts["unused_columns"]) == (2, 6)
    alone = refusal(read_motive, columns_file(tmp_path, body.replace("Marker,Marker,Marker,Bone,", ",,,Bone,") + "0,0,,,,4,5,6,7,8,9\n"))
    assert "bones alone" in alone.message
