"""Takes of Motive in both grammars: written, read whatever their version, refused by their line."""

import re
from pathlib import Path

import numpy as np
import pytest
from case_tables import cases_beside
from motive_files import (
    MARKER,
    POSE,
    START,
    TRACKED,
    columns,
    columns_file,
    random_take,
    rows_file,
)
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation
from written_logs import refusal

from pipeline.core.errors import RecordingError
from pipeline.formats.motion.motive import read_motive, write_motive
from pipeline.formats.motion.take import MotionTake

cases = cases_beside(__file__)


def test_written_takes_read_back_to_a_half_micrometre_and_keep_their_gaps(tmp_path):
    original = random_take(first=72210)
    original.markers["Link2:Marker1"][50:60] = np.nan
    original.bodies["Base"].position[7] = original.bodies["Base"].quaternion[7] = np.nan
    write_motive(tmp_path / "t.csv", original, start=START)

    result = read_motive(tmp_path / "t.csv")

    assert_array_equal(result.frame, original.frame)
    assert_allclose(result.time, original.time, rtol=0, atol=1e-12)
    assert (result.name, result.rate) == (original.name, original.rate)
    assert list(result.markers) == list(original.markers)
    for name, points in original.markers.items():
        assert_allclose(result.markers[name], points, rtol=0, atol=0.501e-6)

    read = result.bodies["Base"]
    written = original.bodies["Base"]
    half_micrometre = {"rtol": 0, "atol": 0.501e-6}
    assert_allclose(read.position, written.position, **half_micrometre)
    assert_allclose(read.quaternion, written.quaternion, **half_micrometre)
    names = ("missing_samples", "missing_poses", "time_mismatches")
    assert [result.counts[name] for name in names] == [10, 1, 0]


def test_names_keep_colons_commas_quotes_and_letters_of_any_code_page(tmp_path):
    file = tmp_path / "t.csv"
    original = random_take(2, 0, body=False)
    names = ["Arm:M1", "a, b", 'say "x"', "Glied é"]
    for name in names:
        original.markers[name] = np.ones((2, 3))
    write_motive(file, original, start=START)
    assert list(read_motive(file).markers) == names

    file.write_bytes(file.read_bytes().decode().encode("cp1252"))
    assert list(read_motive(file).markers) == names


def test_frame_gaps_are_time_and_are_counted_with_headers_and_times_that_lie(tmp_path):
    rows = "72210,722.1,1,2,3\n72211,722.13,1,2,3\n83158,831.58,1,2,3\n"
    file = columns_file(tmp_path, MARKER + rows)
    lie = b",Total Exported Frames,17263,Rotation Type"
    file.write_bytes(file.read_bytes().replace(b",Rotation Type", lie, 1))

    take = read_motive(file)

    assert_allclose(take.time, [0, 0.01, 109.48], rtol=0, atol=1e-12)
    counts = {"announced_frames": 17263, "found_frames": 3, "gaps": 1}
    counts |= {"skipped_frames": 10946, "time_mismatches": 1}
    assert counts.items() <= take.counts.items()


@pytest.mark.parametrize(("unit", "scale"), [("Meters", 1.0), ("Millimeters", 0.001)])
def test_labels_decide_which_column_is_which_in_which_unit(tmp_path, unit, scale):
    body = MARKER.replace("X,Y,Z", "Z,X,Y") + "0,0,-3,1,2\n"
    result = read_motive(columns_file(tmp_path, body, unit=unit))
    assert_allclose(result.markers["A"], [[scale, 2 * scale, -3 * scale]], rtol=1e-15)


@cases("lost samples")
def test_lost_samples_are_nan_in_all_coordinates_and_counted(tmp_path, cells, count):
    file = columns_file(tmp_path, MARKER + f"0,0,{cells}\n1,0.01,0,0,1\n")
    take = read_motive(file)

    assert_array_equal(take.markers["A"], [[np.nan] * 3, [0, 0, 1]])
    assert take.counts["missing_samples"] == 1
    for name in ("zero_samples", "partial_samples", "filler_samples"):
        assert take.counts.get(name, 0) == (name == count)


def spreadsheet(content: bytes) -> bytes:
    """With a byte-order mark, and every row padded with commas beyond the widest."""
    lines = content.decode().splitlines()
    width = max(line.count(",") for line in lines) + 3
    padded = (line + "," * (width - line.count(",")) for line in lines)
    return ("\ufeff" + "\n".join(padded) + "\n").encode()


RATES = b"Capture Frame Rate,100.000000,Export Frame Rate,100.000000,"
LATER = b",Fresh Key,1.0,Coordinate Space,Global,Newer,x"
CHANGES = {
    "saved by a spreadsheet": spreadsheet,
    "with line feeds and blank rows": lambda content: content.replace(b"\r\n", b"\n\n"),
    "of a later version": lambda content: content.replace(b",Coordinate Space,Global", LATER, 1),
    "of version 1.21, whose label rows have no names": lambda content: re.sub(
        rb"(?m)^,(Type|Name|ID),", b",,", content.replace(b"Time (Seconds)", b"Time")),
    "without rates": lambda content: content.replace(RATES, b"", 1),
}  # fmt: skip


@pytest.mark.parametrize("name", CHANGES)
def test_headers_of_other_versions_and_spreadsheets_change_nothing(tmp_path, name):
    file = tmp_path / "t.csv"
    write_motive(file, random_take(), start=START)
    plain = read_motive(file)
    content = file.read_bytes()
    file.write_bytes(CHANGES[name](content))
    assert file.read_bytes() != content
    take = read_motive(file)

    assert list(take.markers) == list(plain.markers)
    for name, points in plain.markers.items():
        assert_array_equal(take.markers[name], points)
    body = take.bodies["Base"]
    plain_body = plain.bodies["Base"]
    assert_array_equal(body.quaternion, plain_body.quaternion)
    assert (take.name, take.rate) == (plain.name, plain.rate)
    assert len(take.frame) == 321


@pytest.mark.parametrize("order", ["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"])
def test_euler_angles_are_products_of_axis_rotations_in_the_order_of_the_header(
    tmp_path,
    order,
):
    body = f",Type{',Rigid Body' * 6}\n,Name{',B' * 6}\n,ID{',1' * 6}\n"
    body += f",{',Rotation' * 3}{',Position' * 3}\n"
    body += "Frame,Time (Seconds),X,Y,Z,X,Y,Z\n0,0,20,-35,50,1,2,3\n1,0.01,,,,,,\n"
    file = columns_file(tmp_path, body, rotation=order)

    pose = read_motive(file).bodies["B"]

    expected = np.eye(3)
    for axis in order:
        expected = expected @ axis_rotation(axis)
    rotation = Rotation.from_quat(pose.quaternion[0]).as_matrix()

    assert_allclose(rotation, expected, atol=1e-14)
    assert np.isnan(pose.quaternion[1]).all() and np.isnan(pose.position[1]).all()


def axis_rotation(axis: str) -> np.ndarray:
    """Rotation matrix about an axis by 20° (X), -35° (Y) or 50° (Z)."""
    degrees = {"X": 20.0, "Y": -35.0, "Z": 50.0}[axis]
    cosine = np.cos(np.radians(degrees))
    sine = np.sin(np.radians(degrees))
    match axis:
        case "X":
            return np.array([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]])
        case "Y":
            return np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]])
    return np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])


SOLVED = "Rigid Body Marker"
BONE = ("Bone Marker", "Hip_1", "1")


def read_columns(folder: Path, body: str, *rows: str) -> MotionTake:
    """The take of ``rows`` below the labels ``body``."""
    lines = "".join(row + "\n" for row in rows)
    return read_motive(columns_file(folder, body + lines))


def test_raw_markers_are_preferred_to_solved_ones(tmp_path):
    body = columns((SOLVED, "B:1", "1"), (SOLVED, "B:2", "1"), ("Marker", "B:1", "1"))
    rows = "0,0,1,1,1,2,2,2,9,9,9", "1,0.01,1,1,1,2,2,2,,,"
    take = read_columns(tmp_path, body, *rows)

    assert_array_equal(take.markers["B:1"], [[9, 9, 9], [np.nan] * 3])
    assert_array_equal(take.markers["B:2"], [[2, 2, 2]] * 2)
    assert (take.counts["solved_replaced"], take.counts["solved_only"]) == (1, 1)


def test_shared_names_keep_their_ids(tmp_path):
    body = columns(("Marker", "S", "1"), ("Marker", "S", "2"), (SOLVED, "S", "3"))
    take = read_columns(tmp_path, body, "0,0,1,2,3,1,2,3,1,2,3")
    assert list(take.markers) == ["S [1]", "S [2]", "S [3]"]

    bodies = ("Rigid Body", "B", "1"), ("Rigid Body", "B", "2")
    row = "0,0,0,0,0,1,1,2,3,0,0,0,1,4,5,6"
    take = read_columns(tmp_path, columns(*bodies, quantities=POSE), row)
    assert list(take.bodies) == ["B [1]", "B [2]"]


def test_bones_are_skipped_and_a_take_of_bones_is_refused(tmp_path):
    body = columns(("Marker", "A", "1"), BONE)
    take = read_columns(tmp_path, body, "0,0,1,2,3,4,5,6")

    assert list(take.markers) == ["A"] and take.counts["skipped_bones"] == 1
    with pytest.raises(RecordingError, match="only bones"):
        read_columns(tmp_path, columns(BONE), "0,0,4,5,6")


def test_a_rate_that_the_printed_times_contradict_is_refused(tmp_path):
    def take(rate: float, jump: float) -> Path:
        rows = []
        for k in range(60):
            time = k / rate + (jump if k >= 30 else 0.0)
            rows.append(f"{k},{time:.3f},1,2,3\n")
        return columns_file(tmp_path, MARKER + "".join(rows))

    error = refusal(read_motive, take(120.0, 0.0))
    assert "100.0' in the header and 120 by the printed times" in error.message
    # the control: a jump is no other rate
    assert read_motive(take(100.0, 109.0)).counts["time_mismatches"] == 30


@pytest.mark.parametrize(
    ("w", "sound"),
    [("1.0002", True), ("0.1", False), ("1e19", False)],
)
def test_a_rotation_of_another_length_than_one_is_refused_by_its_row(
    tmp_path,
    w,
    sound,
):
    labels = columns(("Rigid Body", "A", "1"), quantities=POSE)
    rows = "0,0.0,0,0,0,1,1,2,3\n1,0.01,0,0,0,1,1,2,3\n"
    file = columns_file(tmp_path, f"{labels}{rows}2,0.02,0,0,0,{w},1,2,3\n")
    if sound:
        assert read_motive(file).bodies["A"].quaternion[2, 3] == float(w)
        return
    error = refusal(read_motive, file)

    assert "the quaternion of A has the length" in error.message
    assert error.evidence["line"] == 10


SEEN = {  # version: beginning, name of body rows, solved places of two markers, a visible marker
    "1.0": ("righthanded\n", "trackable", "9,9,9,9,9,9", "{},0,1,0"),
    "1.1": (
        "righthanded\ninfo,version,1.1\n", "rigidbody", "9,9,9,1,9,9,9,2", "{},0,1,3,Arm-Marker 1"),
}  # fmt: skip


@pytest.mark.parametrize("version", SEEN)
def test_row_typed_takes_give_measured_markers_poses_and_strays(tmp_path, version):
    head, kind, solved, marker = SEEN[version]
    rows = [f'{kind},"Arm",7,2,0.1,0,0,-0.1,0,0']
    for k, t in enumerate((0.0211, 0.0252, 0.0291)):
        pose = f"1,{TRACKED.format(k)}" if k else "0"
        stray = f"5,5,5,{k + 9}" + (f",Marker-{k}" if version == "1.1" else "")
        rows += [
            f"frame,{k},{t},{pose},2,{marker.format(k)},{stray}",
            f'{kind},{k},{t},"Arm",7,0,2,{solved},{k},0,1,NAN,NAN,NAN,1,0,0.9,0.0,0.002',
        ]
    file = rows_file(tmp_path, *rows, head=head)
    # it states none
    assert refusal(read_motive, file).evidence["key"] == "dataset.mocap.unit"
    result = read_motive(file, "m")
    # the printed times are irregular
    assert (result.version, result.rate) == (
        version,
        250.0,
    )

    wanted = {"Unlabeled 1": [[5, 5, 5]] * 3}
    seen = [[0, 0, 1], [1, 0, 1], [2, 0, 1]]
    # a solved place is no measured one; version 1.0 has no names of markers
    wanted |= {"Arm-Marker 1": seen, "Arm-Marker 2": [[np.nan] * 3] * 3}
    if version == "1.0":
        wanted = {"Unlabeled 1": seen, "Unlabeled 2": wanted["Unlabeled 1"]}
    assert {*result.markers} == {*wanted}
    for name, places in wanted.items():
        assert_array_equal(result.markers[name], places)
    position = result.bodies["Arm"].position
    assert_array_equal(position, [[np.nan] * 3, [1.5, 2, 3], [2.5, 2, 3]])

    counts = [
        result.counts[name] for name in ("stray_ids", "stray_samples", "missing_poses")
    ]
    assert counts == [3 if version == "1.1" else 4, 3 if version == "1.1" else 6, 1]
    assert_allclose(read_motive(file, "mm").bodies["Arm"].position, position / 1000)
