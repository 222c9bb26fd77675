"""Takes of Motive in both grammars: written, read whatever their version, refused by their line."""

import re

import numpy as np
import pytest
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
    read, written = result.bodies["Base"], original.bodies["Base"]
    half_micrometre = {"rtol": 0, "atol": 0.501e-6}
    assert_allclose(read.position, written.position, **half_micrometre)
    assert_allclose(read.quaternion, written.quaternion, **half_micrometre)
    names = ("missing_samples", "missing_poses", "time_mismatches")
    assert [result.counts[name] for name in names] == [10, 1, 0]


def test_names_keep_colons_commas_quotes_and_letters_of_any_code_page(tmp_path):
    original = random_take(2, 0, body=False)
    names = ["Arm:M1", "a, b", 'say "x"', "Glied é"]
    original.markers.update(
        {name: np.full((2, 3), k + 1.0) for k, name in enumerate(names)},
    )
    write_motive(tmp_path / "t.csv", original, start=START)
    assert list(read_motive(tmp_path / "t.csv").markers) == names
    (tmp_path / "t.csv").write_bytes(
        (tmp_path / "t.csv").read_bytes().decode().encode("cp1252"),
    )
    assert list(read_motive(tmp_path / "t.csv").markers) == names


def test_frame_gaps_are_time_and_are_counted_with_headers_and_times_that_lie(tmp_path):
    rows = "72210,722.1,1,2,3\n72211,722.13,1,2,3\n83158,831.58,1,2,3\n"
    file = columns_file(tmp_path, MARKER + rows)
    lie = b",Total Exported Frames,17263,Rotation Type"
    file.write_bytes(file.read_bytes().replace(b",Rotation Type", lie, 1))
    result = read_motive(file)
    assert_allclose(result.time, [0, 0.01, 109.48], rtol=0, atol=1e-12)
    names = (
        "announced_frames",
        "found_frames",
        "gaps",
        "skipped_frames",
        "time_mismatches",
    )
    assert [result.counts[name] for name in names] == [17263, 3, 1, 10946, 1]


@pytest.mark.parametrize(("unit", "scale"), [("Meters", 1.0), ("Millimeters", 0.001)])
def test_labels_decide_which_column_is_which_in_which_unit(tmp_path, unit, scale):
    body = MARKER.replace("X,Y,Z", "Z,X,Y") + "0,0,-3,1,2\n"
    result = read_motive(columns_file(tmp_path, body, unit=unit))
    assert_allclose(result.markers["A"], [[scale, 2 * scale, -3 * scale]], rtol=1e-15)


LOST = {
    ",,": "",
    "NAN,NAN,NAN": "",
    "0.00,0,0": "zero_samples",
    "1,,3": "partial_samples",
}
LOST |= dict.fromkeys(("9999,9999,9999", "-99999.0,-99999,-99999"), "filler_samples")


@pytest.mark.parametrize("cells", LOST)
def test_lost_samples_are_nan_in_all_coordinates_and_counted(tmp_path, cells):
    result = read_motive(
        columns_file(tmp_path, MARKER + f"0,0,{cells}\n1,0.01,0,0,1\n"),
    )
    assert_array_equal(result.markers["A"], [[np.nan] * 3, [0, 0, 1]])
    assert result.counts["missing_samples"] == 1
    for name in ("zero_samples", "partial_samples", "filler_samples"):
        assert result.counts.get(name, 0) == (name == LOST[cells])


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
    plain, content = read_motive(file), file.read_bytes()
    file.write_bytes(CHANGES[name](content))
    assert file.read_bytes() != content
    result = read_motive(file)
    assert list(result.markers) == list(plain.markers)
    assert all(
        (result.markers[name] == plain.markers[name]).all() for name in plain.markers
    )
    assert (result.bodies["Base"].quaternion == plain.bodies["Base"].quaternion).all()
    assert (result.name, result.rate, len(result.frame)) == (
        plain.name,
        plain.rate,
        321,
    )


@pytest.mark.parametrize("order", ["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"])
def test_euler_angles_are_products_of_axis_rotations_in_the_order_of_the_header(
    tmp_path,
    order,
):
    degrees = {"X": 20.0, "Y": -35.0, "Z": 50.0}
    body = f",Type{',Rigid Body' * 6}\n,Name{',B' * 6}\n,ID{',1' * 6}\n"
    body += f",{',Rotation' * 3}{',Position' * 3}\n"
    body += "Frame,Time (Seconds),X,Y,Z,X,Y,Z\n0,0,20,-35,50,1,2,3\n1,0.01,,,,,,\n"
    pose = read_motive(columns_file(tmp_path, body, rotation=order)).bodies["B"]
    expected = np.eye(3)
    for axis in order:
        number = "XYZ".index(axis)
        i, j = (number + 1) % 3, (number + 2) % 3
        angle = np.radians(degrees[axis])
        turn = np.eye(3)
        turn[i, i] = turn[j, j] = np.cos(angle)
        turn[i, j], turn[j, i] = -np.sin(angle), np.sin(angle)
        expected = expected @ turn
    rotation = Rotation.from_quat(pose.quaternion[0]).as_matrix()
    assert_allclose(rotation, expected, atol=1e-14)
    assert np.isnan(pose.quaternion[1]).all() and np.isnan(pose.position[1]).all()


def test_raw_markers_are_preferred_shared_names_keep_their_ids_and_bones_are_skipped(
    tmp_path,
):
    def read(body: str, *rows: str) -> MotionTake:
        return read_motive(
            columns_file(tmp_path, body + "".join(row + "\n" for row in rows)),
        )

    solved, bone = "Rigid Body Marker", ("Bone Marker", "Hip_1", "1")
    body = columns((solved, "B:1", "1"), (solved, "B:2", "1"), ("Marker", "B:1", "1"))
    result = read(body, "0,0,1,1,1,2,2,2,9,9,9", "1,0.01,1,1,1,2,2,2,,,")
    assert_array_equal(result.markers["B:1"], [[9, 9, 9], [np.nan] * 3])
    assert_array_equal(result.markers["B:2"], [[2, 2, 2]] * 2)
    assert (result.counts["solved_replaced"], result.counts["solved_only"]) == (1, 1)
    body = columns(("Marker", "S", "1"), ("Marker", "S", "2"), (solved, "S", "3"))
    assert list(read(body, f"0,0{',1,2,3' * 3}").markers) == ["S [1]", "S [2]", "S [3]"]
    body = columns(*(("Rigid Body", "B", k) for k in "12"), quantities=POSE)
    assert list(read(body, "0,0,0,0,0,1,1,2,3,0,0,0,1,4,5,6").bodies) == [
        "B [1]",
        "B [2]",
    ]
    result = read(columns(("Marker", "A", "1"), bone), "0,0,1,2,3,4,5,6")
    assert list(result.markers) == ["A"] and result.counts["skipped_bones"] == 1
    with pytest.raises(RecordingError, match="only bones"):
        read(columns(bone), "0,0,4,5,6")


def test_a_rate_that_the_printed_times_contradict_is_refused(tmp_path):
    def take(rate: float, jump: float):
        rows = "".join(
            f"{k},{k / rate + jump * (k >= 30):.3f},1,2,3\n" for k in range(60)
        )
        return columns_file(tmp_path, MARKER + rows)

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
    rows = "".join(
        f"{k},{k / 100},0,0,0,{w if k == 2 else 1},1,2,3\n" for k in range(3)
    )
    file = columns_file(
        tmp_path,
        columns(("Rigid Body", "A", "1"), quantities=POSE) + rows,
    )
    if sound:
        assert read_motive(file).bodies["A"].quaternion[2, 3] == float(w)
        return
    error = refusal(read_motive, file)
    assert (
        "the quaternion of A has the length" in error.message
        and error.evidence["line"] == 10
    )


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
