from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.errors import RecordingError
from pipeline.instruments.joint_log import JointLog, Layout, read_joint_log, read_movement, write_joint_log


def log(samples: int = 100, joints: int = 6, seed: int = 1) -> JointLog:
    return JointLog(np.arange(samples) * 0.008, np.random.default_rng(seed).uniform(-3, 3, (samples, joints)), {})


def refusal(file, joints: int = 2) -> RecordingError:
    with pytest.raises(RecordingError) as caught:
        read_joint_log(file, joints=joints)
    assert caught.value.evidence["file"] == file
    return caught.value


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
    found = read_joint_log(shared / "recordings/ur5" / name, joints=6)
    assert found.values.shape == (samples, 6)
    assert (found.time[0], found.time[-1]) == (0.0, last)
    assert found.counts == {"cut_rows": cut, "blank_rows": 0, "doubled_rows": 0}


def test_values_of_a_real_log_are_those_in_the_file(shared):
    found = read_joint_log(shared / "recordings/ur5/Movement_No5_Acc_slow_no_disturbance/log_q_actual.csv", joints=6)
    np.testing.assert_array_equal(found.values[0], [1.265641, -2.135030, -1.947016, -0.376780, -2.541832, -2.736627])
    np.testing.assert_array_equal(found.values[-1], [1.265213, -2.135398, -1.945919, -0.377209, -2.542172, -2.736708])


def test_written_logs_read_back_to_half_a_microradian(tmp_path):
    write_joint_log(tmp_path / "log.csv", log())
    found = read_joint_log(tmp_path / "log.csv", joints=6)
    np.testing.assert_allclose(found.values, log().values, rtol=0, atol=0.501e-6)
    np.testing.assert_allclose(found.time, log().time, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("end", "rows", "cut"),
    [("0.2, 5, 6\n", 2, 0), ("0.2, 5, 6", 1, 1), ("0.2, 5\n", 1, 1), ("0.2, -", 1, 1), ("0.2, 5, 6\n\n", 2, 0)],
)
def test_only_a_last_line_that_is_short_or_has_no_end_is_dropped(tmp_path, end, rows, cut):
    (tmp_path / "log.csv").write_text("0.1, 1, 2\n" + end)
    found = read_joint_log(tmp_path / "log.csv", joints=2)
    assert (len(found.time), found.counts["cut_rows"]) == (rows, cut)


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


@settings(derandomize=True, max_examples=60, deadline=None)
@given(samples=st.integers(1, 6), seed=st.integers(0, 99), data=st.data())
def test_a_log_cut_at_any_byte_is_refused_or_holds_only_rows_that_were_whole(tmp_path_factory, samples, seed, data):
    file = tmp_path_factory.mktemp("cut") / "log.csv"
    write_joint_log(file, log(samples, seed=seed))
    whole, content = read_joint_log(file, joints=6), file.read_bytes()
    cut = data.draw(st.integers(0, len(content) - 1))
    file.write_bytes(content[:cut])
    try:
        found = read_joint_log(file, joints=6)
    except RecordingError:
        return
    kept = content[:cut].count(b"\n")
    assert 0 < len(found.time) == kept
    np.testing.assert_array_equal(found.values, whole.values[:kept])


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


def table(folder, header: str, *rows: str):
    (folder / "log.txt").write_text("".join(line + "\n" for line in ([header] if header else []) + list(rows)))
    return folder / "log.txt"


@pytest.mark.parametrize(
    ("header", "row", "columns", "layout"),
    [
        ("time,q1,q2,q3", "{t},0.1,0.2,0.3", NAMES, Layout("time")),
        ("q3;x;q1;stamp (s);q2", "0,3;9,9;0,1;{t};0,2", NAMES, Layout("stamp")),
        ("% t q1 q2 q3", "{t}  0.1 0.2   0.3", NAMES, Layout()),
        ("", "{t}\t0.1\t0.2\t0.3", None, Layout()),
        ("", "9 0.3 0.1 {t} 0.2", [2, 4, 1], Layout(3)),
        ("a note\nt,q1 [deg],q2,q3", "{t},5.729577951308232,11.45915590261646,17.1887338539247", NAMES, Layout("t", angle_unit="deg")),
        ("q1,q2,q3", "0.1,0.2,0.3", None, Layout(None, 125.0)),
    ],
)  # fmt: skip
def test_tables_are_read_by_labels_or_numbers_in_any_form(tmp_path, header, row, columns, layout):
    times = [f"{0.008 * i:.3f}" for i in range(4)]
    rows = [row.format(t=time.replace(".", ",") if ";" in row else time) for time in times]
    found = read_joint_log(table(tmp_path, header, *rows), joints=3, columns=columns, layout=layout)
    np.testing.assert_allclose(found.values, [[0.1, 0.2, 0.3]] * 4, rtol=1e-12)
    np.testing.assert_allclose(found.time, np.arange(4) * 0.008, atol=1e-12)


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_times_are_in_the_unit_of_the_option(tmp_path, unit, factor):
    rows = [f"{0.008 * i * factor:.0f} 0.5 0.25" for i in range(4)]
    found = read_joint_log(table(tmp_path, "", *rows), joints=2, layout=Layout(time_unit=unit))
    np.testing.assert_allclose(found.time, np.arange(4) * 0.008, rtol=1e-12)


def test_degrees_that_are_taken_for_radians_are_refused_with_the_option(tmp_path):
    with pytest.raises(RecordingError, match="angle_unit") as caught:
        read_joint_log(table(tmp_path, "", "0.0, 10.5, -90.0", "0.1, 10.5, -90.0"), joints=2)
    assert (caught.value.evidence["key"], caught.value.evidence["line"]) == ("dataset.joint_log.angle_unit", 1)


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
        read_joint_log(table(tmp_path, header, "0.0,0.5,0.25", "0.1,0.5,0.25"), joints=2, columns=columns)


def test_one_table_of_several_signals_is_counted_once(tmp_path):
    table(tmp_path, "t,q,qd", "0.000,0.5,1", "0.008,0.6,2", "0.008,0.6,2", "", "0.016,0.7")
    (q, qd), counts = read_movement(tmp_path, ["log.txt"] * 2, joints=1, rate=125.0, columns=[["q"], ["qd"]])
    assert (q.tolist(), qd.tolist()) == ([[0.5], [0.6]], [[1], [2]])
    assert counts == {"cut_rows": 1, "blank_rows": 1, "doubled_rows": 1, "rows_without_partner": 0}


@settings(derandomize=True, max_examples=100, deadline=None)
@given(picks=st.lists(st.integers(0, 7), min_size=3, max_size=10))
def test_dropped_doubled_and_swapped_rows_are_repaired_and_counted_or_refused(tmp_path_factory, picks):
    folder = tmp_path_factory.getbasetemp()
    write_joint_log(folder / "whole.csv", log(8))
    lines = (folder / "whole.csv").read_text().splitlines(keepends=True)
    (folder / "log.csv").write_text("".join(lines[i] for i in picks))
    kept = sorted(set(picks))
    try:
        (found,), counts = read_movement(folder, ["log.csv"], joints=6, rate=125.0)
    except RecordingError:
        assert picks != sorted(picks) or kept[-1] - kept[0] + 1 != len(kept)
        return
    np.testing.assert_array_equal(found, read_joint_log(folder / "whole.csv", joints=6).values[kept])
    assert counts["doubled_rows"] == len(picks) - len(kept)


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
    layout = Layout(angle_unit="deg" if key == "angle_unit" else "rad", time_unit="ms" if key == "time_unit" else "s")
    assert read_joint_log(file, joints=2, layout=layout).time[-1] == pytest.approx(0.1 if key == "angle_unit" else 1e-4)
