"""The examples of the READMEs of the formats; numbers in delimited text, tables
of any program, commanded trajectories: one reading, or a refusal.
"""

import contextlib
import io
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_array_equal

from pipeline import formats
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.formats.delimited import numbers_of
from pipeline.formats.number_sheet import Sheet, read_sheet
from pipeline.formats.trajectory import (
    COLUMNS,
    FAMILIES,
    read_trajectory,
    write_trajectory,
)

FOLDER = Path(formats.__file__).parent
BLOCK = re.compile(r"^```(\w+)(?: (\S+))?\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SECTIONS = {
    f"{folder}: {section.splitlines()[0]}": section
    for folder in ("joints", "motion", "force", "depth")
    for section in (FOLDER / folder / "README.md").read_text().split("\n## ")[1:]
}


@pytest.mark.parametrize("title", SECTIONS)
def test_an_example_prints_what_its_page_says(title, tmp_path, monkeypatch):
    *files, (language, place, code), (_, _, printed) = BLOCK.findall(SECTIONS[title])
    assert (language, place) == ("python", "") and printed
    monkeypatch.chdir(tmp_path)
    for _, name, text in files:
        Path(name).write_text(text)
    with contextlib.redirect_stdout(io.StringIO()) as said:
        exec(compile(code, title, "exec"), {})
    assert said.getvalue().split() == printed.split()


FILE, KEY = Path("log.csv"), "dataset.here"


def sheet(folder: Path, text: str, **options: str) -> Sheet:
    (folder / "log.txt").write_bytes(text.encode())
    return read_sheet(folder / "log.txt", key=KEY, **options)


@pytest.mark.parametrize("form", ["%.6f", "%.15G", "%.17g"])
def test_numbers_are_correctly_rounded_as_by_python(form):
    generator = np.random.default_rng(1)
    powers = generator.integers(-9, 9, 5000)
    drawn = generator.normal(size=5000) * 10.0**powers
    rows = [form % value for value in drawn]
    result = numbers_of(rows, list(range(5000)), [0], file=FILE)
    assert_array_equal(result[:, 0], [float(row) for row in rows])


WRONG = ["1 2", "7" * 5000, *'x 1_0 0x1A True NAN1 1e999 1,5 --1 "1 1e300'.split()]


@pytest.mark.parametrize("cell", WRONG)
def test_a_cell_that_is_no_finite_number_or_nothing_measures_is_refused_by_its_line(
    cell,
):
    with pytest.raises(RecordingError) as caught:
        numbers_of(
            ["1;2", f"3;{cell}"],
            [4, 5],
            [0, 1],
            file=FILE,
            separator=";",
            gaps=True,
        )
    assert caught.value.evidence["line"] == 5 and len(str(caught.value)) < 200


def test_cells_in_many_forms_are_numbers_and_missing_ones_are_nan_where_gaps_are_expected():
    for cell in ("1.5", " 1.5", "1.5 ", "+1.5", '"1.5"', "15e-1", "0.15E+1"):
        assert numbers_of([f"0,{cell}"], [1], [1], file=FILE).item() == 1.5
    for cell in ("", " ", "NAN", "nan", "-nan(ind)", "1.#QNAN", "None", "N/A", '""'):
        assert np.isnan(numbers_of([f"0,{cell}"], [1], [1], file=FILE, gaps=True)).all()
        with pytest.raises(RecordingError, match="column 2 has no number"):
            numbers_of([f"0,{cell}"], [1], [1], file=FILE)
    assert numbers_of(["1,text,2", "3,,4"], [1, 2], [2, 0], file=FILE).tolist() == [
        [2, 1],
        [4, 3],
    ]


ONE = [
    "1.5,2\n3,4\n",
    "1.5, 2\n3, 4\n",
    "1,5;2\n3;4\n",
    "1.5;2\n3;4\n",
    "1,5\t2\n3\t4\n",
]
ONE += ["  1,5   2\n\n 3 4\n", "# x y\n1.5 2\n3e0 4\n", '"x";"y"\n"1,5";"2"\n"3";"4"\n']
ONE += [
    "a note\nx,y\n1.5,2\n3,4\n",
    "x;y;;\n1,5;2;;\n3;4;;\n",
    "\xa0\nx,y\n1.5,2\n3,4\n",
]


@pytest.mark.parametrize("text", ONE)
def test_a_table_that_allows_one_reading_is_read_so(tmp_path, text):
    assert sheet(tmp_path, text).values([0, 1]).tolist() == [[1.5, 2], [3, 4]]
    assert sheet(tmp_path, "x,y\n1,5\n3,4\n").values([0, 1]).tolist() == [
        [1, 5],
        [3, 4],
    ]


MORE = ["1,5,2\n3,5,4\n", "1;2.5\n3,5;4\n", "1,5\n3,4\n", "1.5;2\n1.234,5;3\n"]
MORE += ["1,5;2\n1;5,2;3\n1,5,2\n"]


@pytest.mark.parametrize("text", MORE)
def test_a_table_that_allows_more_is_refused_with_its_option_or_its_line(
    tmp_path,
    text,
):
    with pytest.raises(RecordingError) as caught:
        sheet(tmp_path, text).values([0, 1])
    assert caught.value.evidence.get("key") == KEY or caught.value.evidence["line"] == 2


def test_options_settle_it_and_what_is_no_mark_is_refused(tmp_path):
    result = sheet(tmp_path, "1,5\n3,4\n", separator=";", decimal=",")
    assert (result.width, result.values([0]).tolist()) == (1, [[1.5], [3.4]])
    for wrong in (
        {"separator": "|"},
        {"decimal": "'"},
        {"separator": ",", "decimal": ","},
    ):
        with pytest.raises(ConfigError, match=KEY):
            sheet(tmp_path, "1,5\n", **wrong)


LAST = [("5,6\n", 3, 0), ("5,6", 2, 1), ("5\n", 2, 1), ("5\n6", 2, 2)]


@pytest.mark.parametrize(("last", "rows", "cut"), LAST)
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_a_last_row_that_is_short_or_has_no_end_is_left_out_and_counted(
    tmp_path,
    last,
    rows,
    cut,
    end,
):
    result = sheet(tmp_path, ("\ufeffx,y\n1,2\n3,4\n" + last).replace("\n", end))
    assert (len(result.rows), result.counts["cut_rows"], result.lines[0]) == (
        rows,
        cut,
        2,
    )


def test_written_trajectories_read_back_bit_for_bit_with_and_without_joints(tmp_path):
    table, file = np.random.default_rng(1).normal(0, 0.5, (321, 7)), tmp_path / "t.csv"
    table[:, 0] = np.round(np.arange(321) / 30, 6)  # as six decimals print equal steps
    families = pd.DataFrame(table, columns=FAMILIES)
    both = families.assign(
        **{"q:a": np.linspace(0, 1, 321), "q:b": np.linspace(2, 3, 321)},
    )
    for written in (families, both, both[["t", "q:a", "q:b"]]):
        write_trajectory(file, written.assign(other=1.0))
        pd.testing.assert_frame_equal(read_trajectory(file), written, check_exact=True)
    pd.DataFrame(table, columns=COLUMNS)[COLUMNS[::-1]].to_csv(file, index=False)
    pd.testing.assert_frame_equal(read_trajectory(file), families, check_exact=True)
    # beside the joints a pose is whole, or there is none
    both.drop(columns="x:z").rename(columns={"x:x": "x", "x:phi": "phi"}).to_csv(file)
    with pytest.raises(RecordingError, match="must name z"):
        read_trajectory(file)
