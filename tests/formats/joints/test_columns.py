"""Joint logs as tables whose columns the options name."""

from __future__ import annotations

import numpy as np
import pytest
from joint_files import read_joint_log, refusal, table

from pipeline.core.errors import RecordingError
from pipeline.formats.joints.log import LogOptions

NAMES = ["q1", "q2", "q3"]


@pytest.mark.parametrize(
    ("header", "row", "columns", "options"),
    [
        ("time,q1,q2,q3", "{t},0.1,0.2,0.3", NAMES, LogOptions("time")),
        ("q3;x;q1;stamp (s);q2", "0,3;9,9;0,1;{t};0,2", NAMES, LogOptions("stamp")),
        ("% t q1 q2 q3", "{t}  0.1 0.2   0.3", NAMES, LogOptions()),
        ("", "{t}\t0.1\t0.2\t0.3", None, LogOptions()),
        ("", "9 0.3 0.1 {t} 0.2", [2, 4, 1], LogOptions(3)),
        (
            "a note\nt,q1 [deg],q2,q3",
            "{t},5.729577951308232,11.45915590261646,17.1887338539247",
            NAMES,
            LogOptions("t", angle_unit="deg"),
        ),
        ("q1,q2,q3", "0.1,0.2,0.3", None, LogOptions(None, 125.0)),
    ],
)
def test_tables_are_read_by_labels_or_numbers_in_any_form(tmp_path, header, row, columns, options):
    times = [f"{0.008 * i:.3f}" for i in range(4)]
    rows = [row.format(t=time.replace(".", ",") if ";" in row else time) for time in times]
    result = read_joint_log(
        table(tmp_path, header, *rows), joints=3, columns=columns, options=options
    )
    np.testing.assert_allclose(result.signals["actual"], [[0.1, 0.2, 0.3]] * 4, rtol=1e-12)
    np.testing.assert_allclose(result.time, np.arange(4) * 0.008, atol=1e-12)


@pytest.mark.parametrize(
    ("header", "columns", "words"),
    [
        ("t,q1,q2", ["q1", "q3"], "0 columns are labelled 'q3'"),
        ("t,q1,q1", ["q1", 2], "2 columns are labelled 'q1'"),
        ("t,q1", ["q1", 2], "3 cells under 2 labels"),
        ("", [1, 3], "column 3"),
        ("", ["q1", "q2"], "labels above the numbers are nothing"),
    ],
)
def test_columns_that_are_not_there_are_refused_with_what_is(tmp_path, header, columns, words):
    with pytest.raises(RecordingError, match=words):
        read_joint_log(
            table(tmp_path, header, "0.0,0.5,0.25", "0.1,0.5,0.25"), joints=2, columns=columns
        )


@pytest.mark.parametrize(
    ("header", "key"),
    [
        ("t (s),q1 (deg),q2 (deg)", "angle_unit"),
        ("t,q1 [degrees],q2", "angle_unit"),
        ("t,q1,q2\ns,deg,deg", "angle_unit"),
        ("t,w1 [deg/s],w2", "angle_unit"),
        ("t [ms],q1,q2", "time_unit"),
        ("t [s],q1 [rad],q2 [rad/s]", None),
        ("t,q[0],q[1]", None),
    ],
)
def test_a_unit_in_the_header_is_never_read_as_another(tmp_path, header, key):
    file = tmp_path / "log.csv"
    file.write_text(f"{header}\n0.0,0.5,1.5\n0.1,0.5,1.5\n")
    if key is None:
        np.testing.assert_array_equal(
            read_joint_log(file, joints=2).signals["actual"], [[0.5, 1.5]] * 2
        )
        return
    error = refusal(file)
    assert error.evidence["key"] == f"dataset.joint_log.{key}"
    options = LogOptions(
        angle_unit="deg" if key == "angle_unit" else "rad",
        time_unit="ms" if key == "time_unit" else "s",
    )
    assert read_joint_log(file, joints=2, options=options).time[-1] == pytest.approx(
        0.1 if key == "angle_unit" else 1e-4
    )
