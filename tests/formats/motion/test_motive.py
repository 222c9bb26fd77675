"""Takes of Motive in both grammars: written, read whatever their version, refused by their line."""

import numpy as np
import pytest
from motive_files import MARKER, POSE, START, TRACKED, columns, columns_file, random_take, rows_file
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
    np.testing.assert_array_equal(result.frame, original.frame)
    np.testing.assert_allclose(result.time, original.time, rtol=0, atol=1e-12)
    assert (result.name, result.rate) == (original.name, original.rate)
    assert list(result.markers) == list(original.markers)
    for name, points in original.markers.items():
        np.testing.assert_allclose(result.markers[name], points, rtol=0, atol=0.501e-6)
    for part in ("position", "quaternion"):
        found, put = (getattr(take.bodies["Base"], part) for take in (result, original))
        np.testing.assert_allclose(found, put, rtol=0, atol=0.501e-6)
    names = ("missing_samples", "missing_poses", "time_mismatches")
    assert [result.counts[name] for name in names] == [10, 1, 0]


def test_names_keep_colons_commas_quotes_and_letters_of_any_code_page(tmp_path):
    original = random_take(2, 0, body=False)
    names = ["Arm:M1", "a, b", 'say "x"', "Glied é"]
    original.markers.update({name: np.full((2, 3), k + 1.0) for k, name in enumerate(names)})
    write_motive(tmp_path / "t.csv", original, start=START)
    assert list(read_motive(tmp_path / "t.csv").markers) == names
    (tmp_path / "t.csv").write_bytes((tmp_path / "t.csv").read_bytes().decode().encode("cp1252"))
    assert list(read_motive(tmp_path / "t.csv").markers) == names


def test_takes_of_versions_1_21_and_1_23_have_the_values_that_are_printed(shared):
    samples = shared / "samples/motive"
    result = read_motive(samples / "motive_v1.21_rigidbody.csv")
    assert (result.version, result.rate, result.unit) == ("1.21", 120.0, "m")
    assert (result.name, len(result.frame)) == ("Take 2016-01-05 03.49.50 PM", 250)
    body = result.bodies["Rigid Body 1"]
    for found, printed in (
        (result.markers["Rigid Body 1:Marker1"][0], [0.009933, 0.019160, 0.009812]),
        (result.markers["Rigid Body 1:Marker3"][-1], [0.160351, 0.019160, 0.009576]),
        (result.markers["Rigid Body 1_1"][0], [0.009986, 0.019136, 0.009807]),
        (body.quaternion[0], [0.000035, 0.000016, -0.000030, -1.0]),
        (body.position[1], [0.060004, 0.019161, 0.076594]),
        (result.time[-1], 249 / 120),
    ):
        np.testing.assert_array_equal(found, printed)
    assert np.isnan(result.markers["Unlabeled:105"]).all()
    counts = [result.counts[n] for n in ("missing_samples", "solved_only", "unused_columns")]
    assert counts == [3 * 250, 3, 4]
    result = read_motive(samples / "motive_v1.23_rigidbody.csv")
    body = result.bodies["RigidBody"]
    assert (result.rate, len(result.frame), result.time[-1]) == (240.0, 10460, 10459 / 240)
    np.testing.assert_array_equal(body.position[-1], [-0.065706, 0.730724, 0.312436])
    np.testing.assert_array_equal(body.quaternion[1], [-0.715889, -0.252145, 0.630100, 0.164013])
    assert np.abs(np.linalg.norm(body.quaternion, axis=1) - 1).max() < 2e-6
    assert body.quaternion[0] @ body.quaternion[1] < -0.99  # the sign flips, the rotation does not
    result = read_motive(samples / "motive_v1.23_markers_millimetres.csv")
    assert (len(result.markers), result.unit, result.time[1]) == (18, "mm", 1 / 360)
    place = [2.659741943, -0.830793884, -2.862191650]
    np.testing.assert_allclose(result.markers["Unlabeled 1036"][0], place, rtol=0, atol=1e-15)
    assert result.counts["missing_samples"] == 348 + 349 + 1352
    empty = refusal(read_motive, samples / "motive_v1.23_empty.csv")
    assert "no marker" in empty.message


def test_frame_gaps_are_time_and_are_counted_with_headers_and_times_that_lie(tmp_path):
    rows = "72210,722.1,1,2,3\n72211,722.13,1,2,3\n83158,831.58,1,2,3\n"
    file = columns_file(tmp_path, MARKER + rows)
    lie = b",Total Exported Frames,17263,Rotation Type"
    file.write_bytes(file.read_bytes().replace(b",Rotation Type", lie, 1))
    result = read_motive(file)
    np.testing.assert_allclose(result.time, [0, 0.01, 109.48], rtol=0, atol=1e-12)
    names = ("announced_frames", "found_frames", "gaps", "skipped_frames", "time_mismatches")
    assert [result.counts[name] for name in names] == [17263, 3, 1, 10946, 1]


@pytest.mark.parametrize(("unit", "scale"), [("Meters", 1.0), ("Millimeters", 0.001)])
def test_labels_decide_which_column_is_which_in_which_unit(tmp_path, unit, scale):
    body = MARKER.replace("X,Y,Z", "Z,X,Y") + "0,0,-3,1,2\n"
    result = read_motive(columns_file(tmp_path, body, unit=unit))
    np.testing.assert_allclose(result.markers["A"], [[scale, 2 * scale, -3 * scale]], rtol=1e-15)


LOST = {",,": "", "NAN,NAN,NAN": "", "0.00,0,0": "zero_samples", "1,,3": "partial_samples"}


@pytest.mark.parametrize("cells", LOST)
def test_lost_samples_are_nan_in_all_coordinates_and_counted(tmp_path, cells):
    result = read_motive(columns_file(tmp_path, MARKER + f"0,0,{cells}\n1,0.01,0,0,1\n"))
    np.testing.assert_array_equal(result.markers["A"], [[np.nan] * 3, [0, 0, 1]])
    assert result.counts["missing_samples"] == 1
    for name in ("zero_samples", "partial_samples"):
        assert result.counts[name] == (name == LOST[cells])


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
    "without rates": lambda content: content.replace(RATES, b"", 1),
}


@pytest.mark.parametrize("name", CHANGES)
def test_headers_of_other_versions_and_spreadsheets_change_nothing(tmp_path, name):
    file = tmp_path / "t.csv"
    write_motive(file, random_take(), start=START)
    plain, content = read_motive(file), file.read_bytes()
    file.write_bytes(CHANGES[name](content))
    assert file.read_bytes() != content
    result = read_motive(file)
    assert list(result.markers) == list(plain.markers)
    assert all((result.markers[name] == plain.markers[name]).all() for name in plain.markers)
    assert (result.bodies["Base"].quaternion == plain.bodies["Base"].quaternion).all()
    assert (result.name, result.rate, len(result.frame)) == (plain.name, plain.rate, 321)


@pytest.mark.parametrize("order", ["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"])
def test_euler_angles_are_products_of_axis_rotations_in_the_order_of_the_header(tmp_path, order):
    degrees = {"X": 20.0, "Y": -35.0, "Z": 50.0}
    body = f",Type{',Rigid Body' * 6}\n,Name{',B' * 6}\n,ID{',1' * 6}\n"
    body += f",{',Rotation' * 3}{',Position' * 3}\n"
    body += "Frame,Time (Seconds),X,Y,Z,X,Y,Z\n0,0,20,-35,50,1,2,3\n1,0.01,,,,,,\n"
    pose = read_motive(columns_file(tmp_path, body, rotation=order)).bodies["B"]
    wanted = np.eye(3)
    for axis in order:
        a = "XYZ".index(axis)
        c, s = np.cos(np.radians(degrees[axis])), np.sin(np.radians(degrees[axis]))
        turn, i, j = np.eye(3), (a + 1) % 3, (a + 2) % 3
        turn[[i, j, i, j], [i, j, j, i]] = c, c, -s, s
        wanted = wanted @ turn
    found = Rotation.from_quat(pose.quaternion[0]).as_matrix()
    np.testing.assert_allclose(found, wanted, atol=1e-14)
    assert np.isnan(pose.quaternion[1]).all() and np.isnan(pose.position[1]).all()


def test_raw_markers_are_preferred_shared_names_keep_their_ids_and_bones_are_skipped(tmp_path):
    def read(body: str, *rows: str) -> MotionTake:
        return read_motive(columns_file(tmp_path, body + "".join(row + "\n" for row in rows)))

    solved, bone = "Rigid Body Marker", ("Bone Marker", "Hip_1", "1")
    body = columns((solved, "B:1", "1"), (solved, "B:2", "1"), ("Marker", "B:1", "1"))
    result = read(body, "0,0,1,1,1,2,2,2,9,9,9", "1,0.01,1,1,1,2,2,2,,,")
    np.testing.assert_array_equal(result.markers["B:1"], [[9, 9, 9], [np.nan] * 3])
    np.testing.assert_array_equal(result.markers["B:2"], [[2, 2, 2]] * 2)
    assert (result.counts["solved_replaced"], result.counts["solved_only"]) == (1, 1)
    body = columns(("Marker", "S", "1"), ("Marker", "S", "2"), (solved, "S", "3"))
    assert list(read(body, f"0,0{',1,2,3' * 3}").markers) == ["S [1]", "S [2]", "S [3]"]
    body = columns(*(("Rigid Body", "B", k) for k in "12"), quantities=POSE)
    assert list(read(body, "0,0,0,0,0,1,1,2,3,0,0,0,1,4,5,6").bodies) == ["B [1]", "B [2]"]
    result = read(columns(("Marker", "A", "1"), bone), "0,0,1,2,3,4,5,6")
    assert list(result.markers) == ["A"] and result.counts["skipped_bones"] == 1
    with pytest.raises(RecordingError, match="only bones"):
        read(columns(bone), "0,0,4,5,6")


def test_a_rate_that_the_printed_times_contradict_is_refused(tmp_path):
    def take(rate: float, jump: float):
        rows = "".join(f"{k},{k / rate + jump * (k >= 30):.3f},1,2,3\n" for k in range(60))
        return columns_file(tmp_path, MARKER + rows)

    error = refusal(read_motive, take(120.0, 0.0))
    assert "100.0' in the header and 120 by the printed times" in error.message
    # the control: a jump is no other rate
    assert read_motive(take(100.0, 109.0)).counts["time_mismatches"] == 30


@pytest.mark.parametrize(("w", "sound"), [("1.0002", True), ("0.1", False), ("1e19", False)])
def test_a_rotation_of_another_length_than_one_is_refused_by_its_row(tmp_path, w, sound):
    rows = "".join(f"{k},{k / 100},0,0,0,{w if k == 2 else 1},1,2,3\n" for k in range(3))
    file = columns_file(tmp_path, columns(("Rigid Body", "A", "1"), quantities=POSE) + rows)
    if sound:
        assert read_motive(file).bodies["A"].quaternion[2, 3] == float(w)
        return
    error = refusal(read_motive, file)
    assert "the quaternion of A has the length" in error.message and error.evidence["line"] == 10


def test_version_1_1_gives_measured_markers_poses_and_strays_in_the_unit_that_is_asked_for(shared):
    file = shared / "samples/motive/motive_v1.1_rigidbody.csv"
    assert refusal(read_motive, file).evidence["key"] == "dataset.mocap.unit"  # it states none
    result = read_motive(file, "m")
    assert (result.version, result.rate, result.unit, len(result.frame)) == ("1.1", 120.0, "m", 548)
    names = [f"Rigid Body 1-Marker {i}" for i in range(1, 6)]
    assert [name for name in result.markers if not name.startswith("Unl")] == names
    body = result.bodies["Rigid Body 1"]
    for found, printed in (
        (result.markers[names[0]][0], [0.02566679, 0.90468109, 0.67789614]),
        (result.markers[names[3]][0], [np.nan] * 3),
        (body.position[0], [-0.01044001, 0.90504020, 0.70895135]),
        (body.quaternion[0], [0.43526953, -0.81957161, 0.15150657, 0.34042403]),
        (result.markers["Unlabeled 2"][266], [-0.08343393, 0.72060782, 0.66178828]),
        (body.position[266], [np.nan] * 3),
        # though its solved place still stands in the file
        (result.markers[names[1]][266], [np.nan] * 3),
        (result.time[-1], 547 / 120),
    ):
        np.testing.assert_array_equal(found, printed)
    counts = [result.counts[name] for name in ("stray_ids", "stray_samples", "missing_poses")]
    assert counts == [6, 55, 20]
    smaller = read_motive(file, "mm").markers[names[0]]
    np.testing.assert_allclose(smaller, result.markers[names[0]] / 1000)


def test_version_1_0_calls_bodies_trackables_and_has_markers_without_names(tmp_path):
    rows = ['trackable,"Arm",7,2,0.1,0,0,-0.1,0,0']
    for k, t in enumerate((0.0211, 0.0252, 0.0291)):
        rows += [
            f"frame,{k},{t},1,{TRACKED.format(k)},2,{k},0,1,0,5,5,5,0",
            f'trackable,{k},{t},"Arm",7,0,2,9,9,9,9,9,9,{k},0,1,NAN,NAN,NAN,1,0,0.9,0.0,0.002',
        ]
    result = read_motive(rows_file(tmp_path, *rows, head="righthanded\n"), "m")
    assert (result.version, result.rate) == ("1.0", 250.0)  # the cameras' own times are irregular
    np.testing.assert_array_equal(result.markers["Arm-Marker 1"], [[0, 0, 1], [1, 0, 1], [2, 0, 1]])
    assert np.isnan(result.markers["Arm-Marker 2"]).all()
    np.testing.assert_array_equal(result.markers["Unlabeled 1"], [[5, 5, 5]] * 3)
