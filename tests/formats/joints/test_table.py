"""Joint logs as tables: logs of a real arm, columns by label or number, units, refusals."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from joint_files import read_joint_log, table
from written_logs import refusal

from pipeline.formats.joints.log import LogOptions
from pipeline.formats.joints.table import joint_labels, read_joint_table, write_joint_table

NAMES = ["q1", "q2", "q3"]


REAL = [
    ("5_Acc_slow_no_disturbance/log_q_actual.csv", 3293, 1, 26.336, 1.265641),
    ("5_Acc_slow_no_disturbance/log_qd_target.csv", 3249, 0, 25.984, None),
    ("6_Acc_slow_Verify_Model/log_q_target.csv", 10264, 0, 82.104, None),
]


@pytest.mark.parametrize(("name", "samples", "cut", "last", "first"), REAL)
def test_logs_of_a_real_arm_have_their_lines_less_a_cut_one(
    shared, name, samples, cut, last, first
):
    result = read_joint_log(shared / "recordings/ur5" / f"Movement_No{name}", joints=6)
    assert result.signals["actual"].shape == (samples, 6)
    assert (result.time[0], result.time[-1]) == (0.0, last)
    assert result.counts == {"cut_rows": cut, "blank_rows": 0, "doubled_rows": 0}
    assert first in (None, result.signals["actual"][0, 0])


def test_a_written_log_reads_back_to_what_is_printed(tmp_path):
    rng, joints = np.random.default_rng(1), ["shoulder", "elbow"]
    signals = {"target": rng.normal(size=(50, 2)), "actual": rng.normal(size=(50, 2))}
    write_joint_table(tmp_path / "t.csv", np.arange(50) / 200, signals, joints)
    named = {name: joint_labels(name, joints) for name in signals}
    read = read_joint_table(tmp_path / "t.csv", LogOptions("time", joints=2, signals=named))
    np.testing.assert_allclose(read.time, np.arange(50) / 200, atol=1e-9)
    for name, values in signals.items():
        np.testing.assert_allclose(read.signals[name], values, atol=0.51e-7)


DEGREES = "{t},5.729577951308232,11.45915590261646,17.1887338539247"
FORMS = [
    ("time,q1,q2,q3", "{t},0.1,0.2,0.3", NAMES, LogOptions("time")),
    ("q3;x;q1;stamp (s);q2", "0,3;9,9;0,1;{t};0,2", NAMES, LogOptions("stamp")),
    ("% t q1 q2 q3", "{t}  0.1 0.2   0.3", NAMES, LogOptions()),
    ("", "{t}\t0.1\t0.2\t0.3", None, LogOptions()),
    ("", "9 0.3 0.1 {t} 0.2", [2, 4, 1], LogOptions(3)),
    ("a note\nt,q1 [deg],q2,q3", DEGREES, NAMES, LogOptions("t", angle_unit="deg")),
    ("q1,q2,q3", "0.1,0.2,0.3", None, LogOptions(None, 125.0)),
]


@pytest.mark.parametrize(("header", "row", "columns", "options"), FORMS)
def test_tables_are_read_by_labels_or_numbers_in_any_form(tmp_path, header, row, columns, options):
    times = [f"{0.008 * i:.3f}" for i in range(4)]
    rows = [row.format(t=time.replace(".", ",") if ";" in row else time) for time in times]
    file = table(tmp_path, header, *rows)
    result = read_joint_log(file, joints=3, columns=columns, options=options)
    np.testing.assert_allclose(result.signals["actual"], [[0.1, 0.2, 0.3]] * 4, rtol=1e-12)
    np.testing.assert_allclose(result.time, np.arange(4) * 0.008, atol=1e-12)


@pytest.mark.parametrize(
    ("header", "key", "unit", "last"),
    [
        ("t (s),q1 (deg),q2 (deg)", "angle_unit", "deg", 0.1),
        ("t,q1 [degrees],q2", "angle_unit", "deg", 0.1),
        ("t,q1,q2\ns,deg,deg", "angle_unit", "deg", 0.1),
        ("t,w1 [deg/s],w2", "angle_unit", "deg", 0.1),
        ("t [ms],q1,q2", "time_unit", "ms", 1e-4),
        ("t [ns],q1,q2", "time_unit", "ns", 1e-10),
        ("t [s],q1 [rad],q2 [rad/s]", None, None, 0.1),
        ("t,q[0],q[1]", None, None, 0.1),
    ],
)
def test_a_unit_in_the_header_is_never_read_as_another(tmp_path, header, key, unit, last):
    (tmp_path / "log.csv").write_text(f"{header}\n0.0,0.5,1.5\n0.1,0.5,1.5\n")
    if key:
        read = partial(read_joint_log, joints=2)
        assert refusal(read, tmp_path / "log.csv").evidence["key"] == f"dataset.joint_log.{key}"
    options = LogOptions(**({key: unit} if key else {}))
    result = read_joint_log(tmp_path / "log.csv", joints=2, options=options)
    assert result.time[-1] == pytest.approx(last)
    angles = np.deg2rad([0.5, 1.5]) if unit == "deg" else [0.5, 1.5]
    np.testing.assert_allclose(result.signals["actual"], [angles] * 2)


def test_degrees_that_are_taken_for_radians_are_refused_with_the_option_and_the_time(tmp_path):
    file = table(tmp_path, "", "0.0, 10.5, -90.0", "0.1, 10.5, -90.0")
    error = refusal(partial(read_joint_log, joints=2), file)
    assert error.evidence["key"] == "dataset.joint_log.angle_unit"
    assert "at 0 s from the start" in error.message
