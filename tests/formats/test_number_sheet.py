from __future__ import annotations

import pytest

from pipeline.core.errors import ConfigError, RecordingError
from pipeline.formats.force.record import ForceLogOptions
from pipeline.formats.force.table import read_force_table
from pipeline.formats.joints.log import LogOptions
from pipeline.formats.joints.table import read_joint_table
from pipeline.formats.number_sheet import read_sheet
from pipeline.tools.inspect.command import inspect

KEY = "dataset.here"


def sheet(folder, text: str, **options: str):
    (folder / "log.txt").write_text(text)
    return read_sheet(folder / "log.txt", key=KEY, **options)


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("1.5,2\n3,4\n", [[1.5, 2], [3, 4]]),
        ("1.5, 2\n3, 4\n", [[1.5, 2], [3, 4]]),
        ("1,5;2\n3;4\n", [[1.5, 2], [3, 4]]),
        ("1.5;2\n3;4\n", [[1.5, 2], [3, 4]]),
        ("1,5\t2\n3\t4\n", [[1.5, 2], [3, 4]]),
        ("  1,5   2\n\n 3 4\n", [[1.5, 2], [3, 4]]),
        ("a note\nx,y\n1,5\n3,4\n", [[1, 5], [3, 4]]),
        ('"x";"y"\n"1,5";"2"\n"3";"4"\n', [[1.5, 2], [3, 4]]),
    ],
)
def test_a_table_that_allows_one_reading_is_read_so(tmp_path, text, values):
    assert sheet(tmp_path, text).values([0, 1]).tolist() == values


@pytest.mark.parametrize(
    "text",
    [
        "1,5,2\n3,5,4\n",
        "1;2.5\n3,5;4\n",
        "1,5\n3,4\n",
        "1.5;2\n1.234,5;3\n",
        "1,5;2\n1;5,2;3\n1,5,2\n",
    ],
)
def test_a_table_that_allows_more_is_refused_with_its_option_or_its_line(tmp_path, text):
    with pytest.raises(RecordingError) as caught:
        sheet(tmp_path, text).values([0, 1])
    assert caught.value.evidence.get("key") == KEY or caught.value.evidence["line"] == 2


@pytest.mark.parametrize(
    ("options", "values"),
    [({"separator": ","}, [[1, 5], [3, 4]]), ({"separator": ";", "decimal": ","}, [[1.5], [3.4]])],
)
def test_options_settle_it(tmp_path, options, values):
    result = sheet(tmp_path, "1,5\n3,4\n", **options)
    assert result.values(list(range(result.width))).tolist() == values


@pytest.mark.parametrize(
    ("end", "rows", "cut"), [("5,6\n", 3, 0), ("5,6", 2, 1), ("5\n", 2, 1), ("5\n6", 2, 2)]
)
def test_a_last_row_that_is_short_or_has_no_end_is_left_out_and_counted(tmp_path, end, rows, cut):
    result = sheet(tmp_path, "x,y\n1,2\n3,4\n" + end)
    assert (len(result.rows), result.counts["cut_rows"], result.lines[0]) == (rows, cut, 2)


@pytest.mark.parametrize(
    "options", [{"separator": "|"}, {"decimal": "'"}, {"separator": ",", "decimal": ","}]
)
def test_options_that_are_no_marks_are_refused(tmp_path, options):
    with pytest.raises(ConfigError, match=KEY):
        sheet(tmp_path, "1,5\n", **options)


def test_lines_of_blanks_that_are_no_blanks_are_no_numbers(tmp_path):
    assert sheet(tmp_path, "\xa0\nx,y\n1,2\n").values([0, 1]).tolist() == [[1, 2]]


def test_rows_that_lack_a_column_of_their_labels_are_refused_also_by_columns_numbers(tmp_path):
    file = tmp_path / "log.csv"
    rows = "".join(f"{k}.5,1.5,2.5\n" for k in range(12))
    file.write_text("time,q1,q2,q3\n" + rows)
    joints = LogOptions(joints=2, signals={"actual": [1, 2]})
    forces = ForceLogOptions({"t": 0, "fx": 0, "fy": 1, "fz": 2}, force_unit="N", time_unit="s")
    for read, options in ((read_joint_table, joints), (read_force_table, forces)):
        with pytest.raises(RecordingError, match=r"3 cells under 4 labels.*'q3'") as refused:
            read(file, options)
        assert refused.value.evidence["line"] == 2
    assert "3 cells under 4 labels" in inspect(file)[0].stops[0]
    # the control: as many labels, and cells that a spreadsheet has padded
    file.write_text("time;q1;q2;;\n" + rows.replace(",", ";").replace("\n", ";;\n"))
    assert read_joint_table(file, joints).signals["actual"].shape == (12, 2)
    assert inspect(file)[0].facts["columns"] == 3 and not inspect(file)[0].stops
