from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from joint_files import log, read_joint_log, read_movement, refusal, table
from written_logs import write_joint_log

from pipeline.core.errors import RecordingError
from pipeline.formats.joints.log import LogOptions
from pipeline.formats.joints.table import joint_labels, read_joint_table, write_joint_table


@pytest.mark.parametrize(
    ("name", "samples", "cut", "last"),
    [
        ("Movement_No5_Acc_slow_no_disturbance/log_q_actual.csv", 3293, 1, 26.336),
        ("Movement_No5_Acc_slow_no_disturbance/log_qd_target.csv", 3249, 0, 25.984),
        ("Movement_No6_Acc_slow_Verify_Model/log_q_target.csv", 10264, 0, 82.104),
        ("Movement_No7_Acc_slow_Verify_Model_short/log_q_actual.csv", 3492, 0, 27.928),
    ],
)
def test_logs_of_a_real_arm_have_their_lines_less_a_cut_one(shared, name, samples, cut, last):
    result = read_joint_log(shared / "recordings/ur5" / name, joints=6)
    assert result.signals["actual"].shape == (samples, 6)
    assert (result.time[0], result.time[-1]) == (0.0, last)
    assert result.counts == {"cut_rows": cut, "blank_rows": 0, "doubled_rows": 0}


def test_values_of_a_real_log_are_those_in_the_file(shared):
    result = read_joint_log(
        shared / "recordings/ur5/Movement_No5_Acc_slow_no_disturbance/log_q_actual.csv", joints=6
    )
    np.testing.assert_array_equal(
        result.signals["actual"][0],
        [1.265641, -2.135030, -1.947016, -0.376780, -2.541832, -2.736627],
    )
    np.testing.assert_array_equal(
        result.signals["actual"][-1],
        [1.265213, -2.135398, -1.945919, -0.377209, -2.542172, -2.736708],
    )


def test_written_logs_read_back_to_half_a_microradian(tmp_path):
    write_joint_log(tmp_path / "log.csv", log())
    result = read_joint_log(tmp_path / "log.csv", joints=6)
    np.testing.assert_allclose(
        result.signals["actual"], log().signals["actual"], rtol=0, atol=0.501e-6
    )
    np.testing.assert_allclose(result.time, log().time, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("end", "rows", "cut"),
    [
        ("0.2, 3, 4\n", 2, 0),
        ("0.2, 3, 4", 1, 1),
        ("0.2, 5\n", 1, 1),
        ("0.2, -", 1, 1),
        ("0.2, 3, 4\n\n", 2, 0),
    ],
)
def test_only_a_last_line_that_is_short_or_has_no_end_is_dropped(tmp_path, end, rows, cut):
    (tmp_path / "log.csv").write_text("0.1, 1, 2\n" + end)
    result = read_joint_log(tmp_path / "log.csv", joints=2)
    assert (len(result.time), result.counts["cut_rows"]) == (rows, cut)


@pytest.mark.parametrize(
    ("content", "line", "words"),
    [
        ("0.1, 1, 2\n0.2, 1\n0.3, 1, 2\n", 2, "2 cells"),
        ("0.1, 1, 2\n\n0.2, 1, 2, 3\n0.3, 1, 2\n", 3, "4 cells"),
        ("0.1, 1, 2\n0.2, x, 2\n", 2, "'x'"),
        ("0.1, 1, 2\n0.2, nan, 2\n", 2, "no number"),
        ("0.1, 1, 2\n0.2, -inf, 2\n", 2, "'-inf'"),
        ("0.1, 1, 2\n0.2, , 2\n", 2, "no number"),
        ("0.1, 1, 2\n0.1, 1, 3\n", 2, "does not increase"),
        ("0.2, 1, 2\n0.1, 1, 2\n", 2, "does not increase"),
        ("0.1, 1, 2, 3\n0.2, 1, 2, 3\n", 1, "3 values, not 2"),
    ],
)
def test_malformed_lines_are_refused_with_their_place(tmp_path, content, line, words):
    (tmp_path / "log.csv").write_text(content)
    error = refusal(tmp_path / "log.csv")
    assert words in error.message
    assert error.evidence["line"] == line


@pytest.mark.parametrize("content", [b"", b"0.1, 1, 2", b"0.1\n", b"\x89PNG\r\n\x1a\n\0"])
def test_files_without_a_whole_line_are_refused(tmp_path, content):
    (tmp_path / "log.csv").write_bytes(content)
    refusal(tmp_path / "log.csv")


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_times_are_in_the_unit_of_the_option(tmp_path, unit, factor):
    rows = [f"{0.008 * i * factor:.0f} 0.5 0.25" for i in range(4)]
    result = read_joint_log(
        table(tmp_path, "", *rows), joints=2, options=LogOptions(time_unit=unit)
    )
    np.testing.assert_allclose(result.time, np.arange(4) * 0.008, rtol=1e-12)


def test_degrees_that_are_taken_for_radians_are_refused_with_the_option(tmp_path):
    with pytest.raises(RecordingError, match="angle_unit") as caught:
        read_joint_log(table(tmp_path, "", "0.0, 10.5, -90.0", "0.1, 10.5, -90.0"), joints=2)
    assert caught.value.evidence["key"] == "dataset.joint_log.angle_unit"
    assert "at 0 s from the start" in caught.value.message


@settings(derandomize=True, max_examples=100, deadline=None)
@given(picks=st.lists(st.integers(0, 7), min_size=3, max_size=10))
def test_dropped_doubled_and_swapped_rows_are_repaired_and_counted_or_refused(
    tmp_path_factory, picks
):
    folder = tmp_path_factory.getbasetemp()
    write_joint_log(folder / "whole.csv", log(8))
    lines = (folder / "whole.csv").read_text().splitlines(keepends=True)
    (folder / "log.csv").write_text("".join(lines[i] for i in picks))
    kept = sorted(set(picks))
    try:
        (result,), counts = read_movement(folder, ["log.csv"], joints=6, rate=125.0)
    except RecordingError:
        assert picks != sorted(picks) or kept[-1] - kept[0] + 1 != len(kept)
        return
    np.testing.assert_array_equal(
        result, read_joint_log(folder / "whole.csv", joints=6).signals["actual"][kept]
    )
    assert counts["doubled_rows"] == len(picks) - len(kept)


def test_a_written_log_reads_back_to_what_is_printed(tmp_path):
    rng, joints = np.random.default_rng(1), ["shoulder", "elbow"]
    signals = {"target": rng.normal(size=(50, 2)), "actual": rng.normal(size=(50, 2))}
    write_joint_table(tmp_path / "t.csv", np.arange(50) / 200, signals, joints)
    named = {name: joint_labels(name, joints) for name in signals}
    read = read_joint_table(tmp_path / "t.csv", LogOptions("time", joints=2, signals=named))
    np.testing.assert_allclose(read.time, np.arange(50) / 200, atol=1e-9)
    for name, values in signals.items():
        np.testing.assert_allclose(read.signals[name], values, atol=0.51e-7)
