"""Logs of one movement, and tables whose columns the options name."""

from __future__ import annotations

import numpy as np
import pytest
from joint_files import log, refusal, table
from written_logs import write_joint_log

from pipeline.core.errors import RecordingError
from pipeline.formats.joints.log import JointLog, Layout, read_joint_log, read_movement


def test_logs_of_one_movement_are_paired_row_by_row_as_far_as_the_shortest_goes(tmp_path):
    for name, samples, seed in (("a.csv", 100, 1), ("b.csv", 93, 2)):
        write_joint_log(tmp_path / name, log(samples, seed=seed))
    (a, b), counts = read_movement(tmp_path, ["a.csv", "b.csv"], joints=6, rate=125.0)
    assert counts == {"cut_rows": 0, "blank_rows": 0, "doubled_rows": 0, "rows_without_partner": 7}
    np.testing.assert_allclose(a, log(100, seed=1).values[:93], rtol=0, atol=1e-6)
    np.testing.assert_allclose(b, log(93, seed=2).values, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("time", "file", "words"),
    [
        (np.delete(np.arange(51), 20) * 0.008, "a.csv", "by 0.016 s at 0.152 s"),
        (np.arange(50) * 0.01, "a.csv", "by 0.01 s at 0 s"),
        (np.arange(50) * 0.008 + 0.004, "b.csv", "not those of a.csv"),
    ],
)
def test_clocks_that_skip_or_disagree_are_refused(tmp_path, time, file, words):
    write_joint_log(tmp_path / "a.csv", log(50))
    write_joint_log(tmp_path / "b.csv", log(50))
    write_joint_log(tmp_path / file, JointLog(time, log(50).values, {}))
    with pytest.raises(RecordingError, match=words) as caught:
        read_movement(tmp_path, ["a.csv", "b.csv"], joints=6, rate=125.0)
    assert caught.value.evidence["file"] == tmp_path / file


NAMES = ["q1", "q2", "q3"]


@pytest.mark.parametrize(
    ("header", "row", "columns", "layout"),
    [
        ("time,q1,q2,q3", "{t},0.1,0.2,0.3", NAMES, Layout("time")),
        ("q3;x;q1;stamp (s);q2", "0,3;9,9;0,1;{t};0,2", NAMES, Layout("stamp")),
        ("% t q1 q2 q3", "{t}  0.1 0.2   0.3", NAMES, Layout()),
        ("", "{t}\t0.1\t0.2\t0.3", None, Layout()),
        ("", "9 0.3 0.1 {t} 0.2", [2, 4, 1], Layout(3)),
        (
            "a note\nt,q1 [deg],q2,q3",
            "{t},5.729577951308232,11.45915590261646,17.1887338539247",
            NAMES,
            Layout("t", angle_unit="deg"),
        ),
        ("q1,q2,q3", "0.1,0.2,0.3", None, Layout(None, 125.0)),
    ],
)
def test_tables_are_read_by_labels_or_numbers_in_any_form(tmp_path, header, row, columns, layout):
    times = [f"{0.008 * i:.3f}" for i in range(4)]
    rows = [row.format(t=time.replace(".", ",") if ";" in row else time) for time in times]
    result = read_joint_log(
        table(tmp_path, header, *rows), joints=3, columns=columns, layout=layout
    )
    np.testing.assert_allclose(result.values, [[0.1, 0.2, 0.3]] * 4, rtol=1e-12)
    np.testing.assert_allclose(result.time, np.arange(4) * 0.008, atol=1e-12)


@pytest.mark.parametrize(
    ("header", "columns", "words"),
    [
        ("t,q1,q2", ["q1", "q3"], "no line above the numbers names"),
        ("t,q1,q1", ["q1", 2], "2 columns are labelled 'q1'"),
        ("t,q1", ["q1", 2], "3 cells under 2 labels"),
        ("", [1, 3], "column 3"),
        ("", ["q1", "q2"], "there is nothing"),
    ],
)
def test_columns_that_are_not_there_are_refused_with_what_is(tmp_path, header, columns, words):
    with pytest.raises(RecordingError, match=words):
        read_joint_log(
            table(tmp_path, header, "0.0,0.5,0.25", "0.1,0.5,0.25"), joints=2, columns=columns
        )


def test_one_table_of_several_signals_is_counted_once(tmp_path):
    table(tmp_path, "t,q,qd", "0.000,0.5,1", "0.008,0.6,2", "0.008,0.6,2", "", "0.016,0.7")
    (q, qd), counts = read_movement(
        tmp_path, ["log.txt"] * 2, joints=1, rate=125.0, columns=[["q"], ["qd"]]
    )
    assert (q.tolist(), qd.tolist()) == ([[0.5], [0.6]], [[1], [2]])
    assert counts == {"cut_rows": 1, "blank_rows": 1, "doubled_rows": 1, "rows_without_partner": 0}


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
        np.testing.assert_array_equal(read_joint_log(file, joints=2).values, [[0.5, 1.5]] * 2)
        return
    error = refusal(file)
    assert error.evidence["key"] == f"dataset.joint_log.{key}"
    layout = Layout(
        angle_unit="deg" if key == "angle_unit" else "rad",
        time_unit="ms" if key == "time_unit" else "s",
    )
    assert read_joint_log(file, joints=2, layout=layout).time[-1] == pytest.approx(
        0.1 if key == "angle_unit" else 1e-4
    )
