"""Row-typed takes of Motive 1.0 and 1.1: read, repaired with a count, and refused by their line."""

from __future__ import annotations

import time

import numpy as np
from motive_files import DEFINITION, TRACKED, body_row, frame_row, in_metres, rows_file, seen_row
from scipy.spatial.transform import Rotation
from written_logs import refusal

from pipeline.formats.motion.motive import read_motive


def lines_of_take(frames: int) -> list[str]:
    rows = [[seen_row(k), body_row(k, f"{k},0,1", "NAN,NAN,NAN")] for k in range(frames)]
    return [DEFINITION, *(row for pair in rows for row in pair)]


def test_version_1_1_gives_measured_markers_poses_and_strays_in_the_unit_that_is_asked_for(shared):
    file = shared / "samples/motive/motive_v1.1_rigidbody.csv"
    assert refusal(read_motive, file).evidence["key"] == "dataset.mocap.unit"  # it states none
    result = in_metres(file)
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


def test_the_solved_pose_carries_the_defined_markers_to_where_they_were_measured(shared):
    file = shared / "samples/motive/motive_v1.1_rigidbody.csv"
    line = next(line for line in file.read_text().splitlines() if line.startswith("rigidbody"))
    places = np.array(line.split(",")[4:], dtype=float).reshape(5, 3)
    result = in_metres(file)
    body = result.bodies["Rigid Body 1"]
    tracked = np.isfinite(body.position[:, 0])
    turn = Rotation.from_quat(body.quaternion[tracked])
    # the fifth marker moved 22 mm after its body was defined
    for i, place in enumerate(places[:4], 1):
        lever = result.markers[f"Rigid Body 1-Marker {i}"][tracked] - body.position[tracked]
        assert np.nanmedian(np.linalg.norm(lever - turn.apply(place), axis=1)) < 2e-3
        # the control
        assert np.nanmedian(np.linalg.norm(lever - turn.inv().apply(place), axis=1)) > 2e-2


def test_version_1_0_calls_bodies_trackables_and_has_markers_without_names(tmp_path):
    head = "righthanded\ninfo,framecount,3\ninfo,trackablecount,1\n"
    rows = ['trackable,"Arm",7,2,0.1,0,0,-0.1,0,0']
    for k, t in enumerate((0.0211, 0.0252, 0.0291)):
        rows += [
            f"frame,{k},{t},1,{TRACKED.format(k)},2,{k},0,1,0,5,5,5,0",
            f'trackable,{k},{t},"Arm",7,0,2,9,9,9,9,9,9,{k},0,1,NAN,NAN,NAN,1,0,0.9,0.0,0.002',
        ]
    result = in_metres(rows_file(tmp_path, *rows, head=head))
    assert (result.version, result.rate) == ("1.0", 250.0)  # the cameras' own times are irregular
    np.testing.assert_allclose(result.time, [0, 0.004, 0.008], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(result.markers["Arm-Marker 1"], [[0, 0, 1], [1, 0, 1], [2, 0, 1]])
    assert np.isnan(result.markers["Arm-Marker 2"]).all()
    np.testing.assert_array_equal(result.markers["Unlabeled 1"], [[5, 5, 5]] * 3)
    names = ("announced_frames", "found_frames", "stray_samples")
    assert [result.counts[name] for name in names] == [3, 3, 3]


def test_a_stray_that_gets_a_new_id_at_every_occlusion_takes_no_more_memory_than_one(tmp_path):
    rows = [frame_row(k, f"1,{k / 100},5,5,{k},Marker-{k}", tracked=False) for k in range(5000)]
    start = time.perf_counter()
    result = in_metres(rows_file(tmp_path, *rows))
    assert time.perf_counter() - start < 2.0
    assert list(result.markers) == ["Unlabeled 1"]
    names = ("stray_ids", "stray_samples", "missing_samples")
    assert [result.counts[name] for name in names] == [5000, 5000, 0]


def test_trailing_and_blank_cells_and_repeated_rows_change_nothing_and_are_counted(tmp_path):
    lines = lines_of_take(3)
    plain = in_metres(rows_file(tmp_path, *lines))
    padded = [lines[0] + ",,", "", *lines[1:3], ",,,,", lines[3], lines[3]]
    padded += [line + ",,," for line in lines[4:]]
    head = '\ufeffcomment,"== \'"\nrighthanded\ninfo,version,1.1\n'
    result = in_metres(rows_file(tmp_path, *padded, head=head))
    for name in plain.markers:
        np.testing.assert_array_equal(result.markers[name], plain.markers[name])
    assert (result.counts["blank_rows"], result.counts["repeated_rows"]) == (2, 1)
