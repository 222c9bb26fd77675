from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pipeline.errors import RecordingError
from pipeline.instruments.motive import MotiveTake, RigidBody, read_motive, write_motive

START = "2024-03-05 10.15.00.000 AM"
TOP = "Format Version,1.23,Take Name,t,Capture Frame Rate,100.0,Export Frame Rate,100.0,Rotation Type,{rotation},Length Units,{unit}"
MARKER = ",Type,Marker,Marker,Marker\n,Name,A,A,A\n,ID,1,1,1\n,,Position,Position,Position\nFrame,Time (Seconds),X,Y,Z\n"


def take(frames: int = 321, markers: int = 9, seed: int = 1, *, body: bool = True, first: int = 0) -> MotiveTake:
    generator = np.random.default_rng(seed)
    frame = np.arange(first, first + frames)
    points = {f"Link{1 + n // 3}:Marker{1 + n % 3}": generator.normal(size=(frames, 3)) for n in range(markers)}
    pose = RigidBody(generator.normal(size=(frames, 3)), Rotation.random(frames, random_state=seed).as_quat())
    return MotiveTake("Take 1", "1.23", 100.0, frame, np.arange(frames) / 100, points, {"Base": pose} if body else {}, {})


def written(folder: Path, body: str, *, rotation: str = "Quaternion", unit: str = "Meters") -> Path:
    file = folder / "take.csv"
    file.write_bytes((TOP.format(rotation=rotation, unit=unit) + "\n\n" + body).encode())
    return file


def refusal(file: Path) -> RecordingError:
    with pytest.raises(RecordingError) as caught:
        read_motive(file)
    assert caught.value.evidence["file"] == file
    return caught.value


# --- files of the instrument


def test_version_1_21_without_labels_in_column_b_has_raw_and_solved_markers_and_a_body(shared):
    found = read_motive(shared / "samples/motive/motive_v1.21_rigidbody.csv")
    assert (found.version, found.rate, len(found.frame), found.time[-1]) == ("1.21", 120.0, 250, 249 / 120)
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
    assert len(found.markers) == 18
    np.testing.assert_allclose(found.markers["Unlabeled 1036"][0], [2.659741943, -0.830793884, -2.862191650], rtol=0, atol=1e-15)
    missing = {name: int(np.isnan(points[:, 0]).sum()) for name, points in found.markers.items()}
    assert {name[-4:]: count for name, count in missing.items() if count} == {"1051": 348, "1052": 349, "1053": 1352}
    assert found.counts["missing_samples"] == 348 + 349 + 1352
    assert found.time[1] == 1 / 360  # the file prints 0.003
    assert found.time[-1] == 1352 / 360


def test_a_valid_export_without_data_columns_is_refused_as_having_no_marker(shared):
    assert "no marker" in refusal(shared / "samples/motive/motive_v1.23_empty.csv").message


def test_the_row_typed_grammar_is_refused_by_name(shared):
    assert "row-typed" in refusal(shared / "samples/motive/motive_v1.1_rigidbody.csv").message


# --- what such files do


def test_written_takes_read_back_to_a_half_micrometre_and_keep_their_gaps(tmp_path):
    original = take(first=72210)
    original.markers["Link2:Marker1"][50:60] = np.nan
    original.bodies["Base"].position[7] = original.bodies["Base"].quaternion[7] = np.nan
    write_motive(tmp_path / "t.csv", original, start=START)
    found = read_motive(tmp_path / "t.csv")
    np.testing.assert_array_equal(found.frame, original.frame)
    np.testing.assert_allclose(found.time, original.time, rtol=0, atol=1e-12)
    assert (found.name, found.rate, list(found.markers)) == (original.name, original.rate, list(original.markers))
    for name, points in original.markers.items():
        np.testing.assert_allclose(found.markers[name], points, rtol=0, atol=0.501e-6)
    np.testing.assert_allclose(found.bodies["Base"].quaternion, original.bodies["Base"].quaternion, rtol=0, atol=0.501e-6)
    np.testing.assert_allclose(found.bodies["Base"].position, original.bodies["Base"].position, rtol=0, atol=0.501e-6)
    assert (found.counts["missing_samples"], found.counts["missing_poses"], found.counts["time_mismatches"]) == (10, 1, 0)


def test_the_written_file_has_the_rows_of_the_instrument(tmp_path):
    write_motive(tmp_path / "t.csv", take(2, 1), start=START)
    content = (tmp_path / "t.csv").read_bytes()
    lines = content.split(b"\r\n")
    assert content.count(b"\n") == content.count(b"\r\n") == 9
    assert lines[0].startswith(b"Format Version,1.23,Take Name,Take 1,Take Notes,,Capture Frame Rate,100.000000,Export Frame Rate,100.")
    assert lines[0].endswith(b"Rotation Type,Quaternion,Length Units,Meters,Coordinate Space,Global")
    assert [line[:7] for line in lines[1:6]] == [b"", b",Type,R", b",Name,B", b',ID,"A1', b",,Rotat"]
    assert lines[6] == b"Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,X,Y,Z"
    assert lines[8].startswith(b"1,0.010000,")


def test_writing_twice_gives_the_same_bytes_and_rewriting_what_was_read_too(tmp_path):
    first, second, third = (tmp_path / name for name in ("1.csv", "2.csv", "3.csv"))
    write_motive(first, take(), start=START)
    write_motive(second, take(), start=START)
    write_motive(third, read_motive(first), start=START)
    assert first.read_bytes() == second.read_bytes() == third.read_bytes()


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


def with_blank_rows(content: bytes) -> bytes:
    lines = content.split(b"\r\n")
    return b"\r\n".join([*lines[:9], b"," * lines[8].count(b","), b"", *lines[9:]])


@pytest.mark.parametrize("change", [spreadsheet, with_timecode, with_parents, with_blank_rows, lambda content: content.replace(b"\r", b"")])
def test_headers_of_other_versions_and_spreadsheets_change_nothing(tmp_path, change):
    file = tmp_path / "t.csv"
    write_motive(file, take(), start=START)
    plain = read_motive(file)
    file.write_bytes(change(file.read_bytes()))
    found = read_motive(file)
    assert list(found.markers) == list(plain.markers)
    assert all((found.markers[name] == plain.markers[name]).all() for name in plain.markers)
    assert (found.bodies["Base"].quaternion == plain.bodies["Base"].quaternion).all()
    assert (found.name, found.rate, found.counts["found_frames"]) == (plain.name, plain.rate, 321)
    assert found.counts["blank_rows"] == (2 if change is with_blank_rows else 0)


def test_reordered_columns_change_nothing_because_labels_decide(tmp_path):
    body = MARKER.replace("X,Y,Z", "Z,X,Y") + "0,0.00,3,1,2\n"
    np.testing.assert_array_equal(read_motive(written(tmp_path, body)).markers["A"], [[1, 2, 3]])


def test_names_keep_colons_commas_quotes_and_letters_of_any_code_page(tmp_path):
    original = take(2, 0, body=False)
    names = ["Arm:M1", "a, b", 'say "x"', "Glied é"]
    original.markers.update({name: np.full((2, 3), number + 1.0) for number, name in enumerate(names)})
    write_motive(tmp_path / "t.csv", original, start=START)
    assert list(read_motive(tmp_path / "t.csv").markers) == names
    (tmp_path / "t.csv").write_bytes((tmp_path / "t.csv").read_bytes().decode().encode("cp1252"))
    assert list(read_motive(tmp_path / "t.csv").markers) == names


def test_frame_gaps_are_time_and_are_counted_with_headers_that_lie(tmp_path):
    file = written(tmp_path, MARKER + "72210,722.1,1,2,3\n72211,722.11,1,2,3\n83158,831.58,1,2,3\n")
    file.write_bytes(file.read_bytes().replace(b",Rotation Type", b",Total Exported Frames,17263,Rotation Type", 1))
    found = read_motive(file)
    np.testing.assert_allclose(found.time, [0, 0.01, 109.48], rtol=0, atol=1e-12)
    counts = {key: found.counts[key] for key in ("announced_frames", "found_frames", "gaps", "skipped_frames", "time_mismatches")}
    assert counts == {"announced_frames": 17263, "found_frames": 3, "gaps": 1, "skipped_frames": 10946, "time_mismatches": 0}


def test_a_time_that_is_not_its_frames_is_counted(tmp_path):
    assert read_motive(written(tmp_path, MARKER + "0,0,1,2,3\n1,0.03,1,2,3\n2,0.02,1,2,3\n")).counts["time_mismatches"] == 1


@pytest.mark.parametrize(("unit", "scale"), [("Meters", 1.0), ("Centimeters", 0.01), ("Millimeters", 0.001)])
def test_lengths_come_back_in_metres(tmp_path, unit, scale):
    found = read_motive(written(tmp_path, MARKER + "0,0,1,2,-3\n", unit=unit))
    np.testing.assert_allclose(found.markers["A"], [[scale, 2 * scale, -3 * scale]], rtol=1e-15)


@pytest.mark.parametrize(
    ("cells", "count"), [(",,", None), ("NAN,NAN,NAN", None), ("0.000000,0.000000,0.000000", "zero_samples"), ("1,,3", "partial_samples")]
)
def test_lost_samples_are_nan_in_all_coordinates_and_counted(tmp_path, cells, count):
    found = read_motive(written(tmp_path, MARKER + f"0,0,{cells}\n1,0.01,0,0,1\n"))
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
    pose = read_motive(written(tmp_path, body, rotation=order)).bodies["B"]
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
    found = read_motive(written(tmp_path, body + "0,0,1,1,1,2,2,2,9,9,9\n1,0.01,1,1,1,2,2,2,,,\n"))
    np.testing.assert_array_equal(found.markers["B:Marker1"], [[9, 9, 9], [np.nan] * 3])
    np.testing.assert_array_equal(found.markers["B:Marker2"], [[2, 2, 2]] * 2)
    assert (found.counts["solved_replaced"], found.counts["solved_only"]) == (1, 1)


def test_strays_of_one_name_and_several_ids_are_kept_apart(tmp_path):
    body = f",Type{',Marker' * 6}\n,Name{',Stray' * 6}\n,ID,1,1,1,2,2,2\n,{',Position' * 6}\nFrame,Time (Seconds){',X,Y,Z' * 2}\n"
    body += "0,0,1,1,1,2,2,2\n"
    assert list(read_motive(written(tmp_path, body)).markers) == ["Stray", "Stray [2]"]


# --- faults


@pytest.mark.parametrize(
    ("body", "line", "words"),
    [
        (MARKER, 7, "no frame"),
        (MARKER + "0,0,1,2\n", 8, "labels 5 columns"),
        (MARKER + "0,0,1,2,3\n1,0.01,1,2\n", 9, "4 cells"),
        (MARKER + "0,0,1,2,3\n1,0.01,1", 9, "cut short"),
        (MARKER + "0,0,1,2,3", 7, "no frame"),
        (MARKER + "0,0,1,2,3\n\n1,0.01,1,oops,3\n", 10, "'oops'"),
        (MARKER + "0,0,1,2,3\n1,0.01,1,inf,3\n", 9, "'inf'"),
        (MARKER + "0,0,1,2,3\n1,0.01,1,1_0,3\n", 9, "'1_0'"),
        (MARKER + "0,0,1,2,3,4\n", 8, "more cells"),
        (MARKER + "0,0,1,2,3\n0,0.01,1,2,3\n", 9, "does not increase"),
        (MARKER + ",0,1,2,3\n", 8, "frame number"),
        (MARKER + "0.5,0,1,2,3\n", 8, "frame number"),
        (MARKER.replace("X,Y,Z", "X,Y,Y") + "0,0,1,2,3\n", 7, "two columns claim Position Y"),
        (MARKER.replace("X,Y,Z", "X,Y,W") + "0,0,1,2,3\n", 7, "lacks one of its columns"),
        (MARKER.partition("Frame")[0], 6, "starts with 'Frame'"),
        ("Frame,Time (Seconds),X,Y,Z\n0,0,1,2,3\n", 3, "incomplete"),
    ],
)
def test_damaged_tables_are_refused_with_their_line(tmp_path, body, line, words):
    error = refusal(written(tmp_path, body))
    assert words in error.message
    assert error.evidence["line"] == line


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("Length Units,Meters", "Length Units,Inches"), "'Inches'"),
        ((",Length Units,Meters", ""), "Length Units"),
        (("Capture Frame Rate,100.0,Export Frame Rate,100.0,", ""), "frame rate"),
        (("Export Frame Rate,100.0", "Export Frame Rate,0"), "frame rate"),
        (("Length Units,Meters", "Length Units,Meters,Coordinate Space,Local"), "Global"),
        (("Format Version", "Version"), "no Motive export"),
    ],
)
def test_headers_that_leave_a_unit_or_rate_open_are_refused(tmp_path, change, words):
    file = written(tmp_path, MARKER + "0,0,1,2,3\n")
    assert read_motive(file).rate == 100.0
    file.write_text(file.read_text().replace(*change))
    assert words in refusal(file).message


def test_older_headers_without_an_export_rate_are_read_at_the_capture_rate(tmp_path):
    file = written(tmp_path, MARKER + "0,0,1,2,3\n")
    file.write_text(file.read_text().replace("Export Frame Rate,100.0,", "").replace("Rate,100.0", "Rate,120"))
    assert read_motive(file).rate == 120.0


@pytest.mark.parametrize(
    "content", [b"", b"\r\n\r\n", b"\x89PNG\r\n\x1a\n\0\0", b"text", b"a,b\n1,2\n", "Format Version,1.23\n".encode("utf-16"), b'"open\n']
)
def test_other_files_are_refused(tmp_path, content):
    (tmp_path / "t.csv").write_bytes(content)
    refusal(tmp_path / "t.csv")


def test_missing_files_and_folders_are_refused(tmp_path):
    refusal(tmp_path / "absent.csv")
    refusal(tmp_path)


# --- truncation


@settings(derandomize=True, max_examples=60, deadline=None)
@given(frames=st.integers(2, 5), seed=st.integers(0, 99), occluded=st.booleans(), data=st.data())
def test_a_take_cut_at_any_byte_is_refused_or_holds_only_rows_that_were_whole(tmp_path_factory, frames, seed, occluded, data):
    file = tmp_path_factory.mktemp("cut") / "t.csv"
    original = take(frames, 2, seed, body=seed % 2 == 0)
    if occluded:
        original.markers["Link1:Marker2"][-1] = np.nan
    write_motive(file, original, start=START)
    whole, content = read_motive(file), file.read_bytes()
    # half of the cuts in the last rows, where numbers can lose digits
    cut = data.draw(st.integers(0, len(content) - 1) | st.integers(len(content) - 120, len(content) - 1))
    file.write_bytes(content[:cut])
    try:
        found = read_motive(file)
    except RecordingError:
        return
    kept = content[:cut].replace(b"\r\n", b"\n").replace(b"\r", b"\n").count(b"\n") - 7
    assert 0 < len(found.frame) == kept
    for name, points in whole.markers.items():
        np.testing.assert_array_equal(found.markers[name], points[:kept])


def test_a_last_row_that_lost_only_digits_is_dropped_and_counted(tmp_path):
    file = written(tmp_path, MARKER + "0,0,1,2,0.125\n1,0.01,1,2,0.125\n")
    content = file.read_bytes()
    for lost in (1, 2, 3):
        file.write_bytes(content[:-lost])
        # the control: to a reader that takes the row, a cut number is a number
        assert float(content[:-lost].split(b",")[-1]) == [0.125, 0.12, 0.1][lost - 1]
        found = read_motive(file)
        np.testing.assert_array_equal(found.markers["A"], [[1, 2, 0.125]])
        assert found.counts["cut_rows"] == 1


def test_a_take_of_nine_markers_is_read_and_written_within_fifteen_milliseconds(tmp_path):
    file, original = tmp_path / "t.csv", take(body=False)
    spent = []
    for _ in range(5):
        start = time.perf_counter()
        write_motive(file, original, start=START)
        middle = time.perf_counter()
        read_motive(file)
        spent.append((middle - start, time.perf_counter() - middle))
    assert np.min(spent, axis=0).max() < 0.015
