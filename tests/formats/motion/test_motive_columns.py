from __future__ import annotations

import numpy as np
import pytest
from motive_files import MARKER, columns_file, refusal

from pipeline.formats.motion.motive import read_motive


def test_version_1_21_without_labels_in_column_b_has_raw_and_solved_markers_and_a_body(shared):
    result = read_motive(shared / "samples/motive/motive_v1.21_rigidbody.csv")
    assert (result.version, result.rate, result.unit, len(result.frame), result.time[-1]) == (
        "1.21",
        120.0,
        "m",
        250,
        249 / 120,
    )
    assert result.name == "Take 2016-01-05 03.49.50 PM"
    np.testing.assert_array_equal(
        result.markers["Rigid Body 1:Marker1"][0], [0.009933, 0.019160, 0.009812]
    )
    np.testing.assert_array_equal(
        result.markers["Rigid Body 1:Marker3"][-1], [0.160351, 0.019160, 0.009576]
    )
    np.testing.assert_array_equal(
        result.markers["Rigid Body 1_1"][0], [0.009986, 0.019136, 0.009807]
    )
    np.testing.assert_array_equal(
        result.bodies["Rigid Body 1"].quaternion[0], [0.000035, 0.000016, -0.000030, -1.0]
    )
    np.testing.assert_array_equal(
        result.bodies["Rigid Body 1"].position[1], [0.060004, 0.019161, 0.076594]
    )
    assert np.isnan(result.markers["Unlabeled:105"]).all()
    assert result.counts["missing_samples"] == 3 * 250
    assert (result.counts["solved_only"], result.counts["unused_columns"]) == (3, 4)


def test_version_1_23_rigid_body_has_unit_quaternions_scalar_last(shared):
    result = read_motive(shared / "samples/motive/motive_v1.23_rigidbody.csv")
    body = result.bodies["RigidBody"]
    assert (result.rate, len(result.frame), result.time[-1]) == (240.0, 10460, 10459 / 240)
    np.testing.assert_array_equal(body.position[0], [0.047597, 0.607298, 0.329784])
    np.testing.assert_array_equal(body.position[-1], [-0.065706, 0.730724, 0.312436])
    np.testing.assert_array_equal(body.quaternion[1], [-0.715889, -0.252145, 0.630100, 0.164013])
    assert np.abs(np.linalg.norm(body.quaternion, axis=1) - 1).max() < 2e-6
    assert body.quaternion[0] @ body.quaternion[1] < -0.99  # the sign flips, the rotation does not
    assert result.counts["time_mismatches"] == 0


def test_version_1_23_markers_come_from_millimetres_with_time_from_frames(shared):
    result = read_motive(shared / "samples/motive/motive_v1.23_markers_millimetres.csv")
    assert (len(result.markers), result.unit) == (18, "mm")
    np.testing.assert_allclose(
        result.markers["Unlabeled 1036"][0],
        [2.659741943, -0.830793884, -2.862191650],
        rtol=0,
        atol=1e-15,
    )
    missing = {name: int(np.isnan(points[:, 0]).sum()) for name, points in result.markers.items()}
    assert {name[-4:]: count for name, count in missing.items() if count} == {
        "1051": 348,
        "1052": 349,
        "1053": 1352,
    }
    assert result.counts["missing_samples"] == 348 + 349 + 1352
    assert result.time[1] == 1 / 360  # the file prints 0.003
    assert result.time[-1] == 1352 / 360


def test_a_valid_export_without_data_columns_is_refused_as_having_no_marker(shared):
    assert (
        "no marker"
        in refusal(read_motive, shared / "samples/motive/motive_v1.23_empty.csv").message
    )


def test_frame_gaps_are_time_and_are_counted_with_headers_that_lie(tmp_path):
    file = columns_file(
        tmp_path, MARKER + "72210,722.1,1,2,3\n72211,722.11,1,2,3\n83158,831.58,1,2,3\n"
    )
    file.write_bytes(
        file.read_bytes().replace(
            b",Rotation Type", b",Total Exported Frames,17263,Rotation Type", 1
        )
    )
    result = read_motive(file)
    np.testing.assert_allclose(result.time, [0, 0.01, 109.48], rtol=0, atol=1e-12)
    counts = {
        key: result.counts[key]
        for key in ("announced_frames", "found_frames", "gaps", "skipped_frames", "time_mismatches")
    }
    assert counts == {
        "announced_frames": 17263,
        "found_frames": 3,
        "gaps": 1,
        "skipped_frames": 10946,
        "time_mismatches": 0,
    }


def test_a_time_that_is_not_its_frames_is_counted(tmp_path):
    rows = "0,0,1,2,3\n1,0.03,1,2,3\n2,0.02,1,2,3\n"
    assert read_motive(columns_file(tmp_path, MARKER + rows)).counts["time_mismatches"] == 1


@pytest.mark.parametrize(
    ("unit", "scale"), [("Meters", 1.0), ("Centimeters", 0.01), ("Millimeters", 0.001)]
)
def test_lengths_come_back_in_metres(tmp_path, unit, scale):
    result = read_motive(columns_file(tmp_path, MARKER + "0,0,1,2,-3\n", unit=unit))
    np.testing.assert_allclose(result.markers["A"], [[scale, 2 * scale, -3 * scale]], rtol=1e-15)


@pytest.mark.parametrize(
    ("cells", "count"),
    [
        (",,", None),
        ("NAN,NAN,NAN", None),
        ("0.000000,0.000000,0.000000", "zero_samples"),
        ("1,,3", "partial_samples"),
    ],
)
def test_lost_samples_are_nan_in_all_coordinates_and_counted(tmp_path, cells, count):
    result = read_motive(columns_file(tmp_path, MARKER + f"0,0,{cells}\n1,0.01,0,0,1\n"))
    np.testing.assert_array_equal(result.markers["A"], [[np.nan] * 3, [0, 0, 1]])
    assert result.counts["missing_samples"] == 1
    assert {key: result.counts[key] for key in ("zero_samples", "partial_samples")} == {
        "zero_samples": 0,
        "partial_samples": 0,
    } | ({count: 1} if count else {})
