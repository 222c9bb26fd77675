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
from case_tables import cases_beside
from numpy.random import default_rng
from numpy.testing import assert_array_equal
from pandas.testing import assert_frame_equal

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

cases = cases_beside(__file__)
FOLDER = Path(formats.__file__).parent
BLOCK = re.compile(r"^```(\w+)(?: (\S+))?\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SECTIONS = {}
for page in sorted(FOLDER.glob("*/README.md")):
    for section in page.read_text().split("\n## ")[1:]:
        title = section.splitlines()[0]
        SECTIONS[f"{page.parent.name}: {title}"] = section


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


FILE = Path("log.csv")
KEY = "dataset.here"


def sheet(folder: Path, text: str, **options: str) -> Sheet:
    (folder / "log.txt").write_bytes(text.encode())
    return read_sheet(folder / "log.txt", key=KEY, **options)


@pytest.mark.parametrize("form", ["%.6f", "%.15G", "%.17g"])
def test_numbers_are_correctly_rounded_as_by_python(form):
    generator = default_rng(1)
    powers = generator.integers(-9, 9, 5000)
    drawn = generator.normal(size=5000) * 10.0**powers
    cells = [form % value for value in drawn]

    numbers = numbers_of(cells, range(5000), [0], file=FILE)

    by_python = [float(cell) for cell in cells]
    assert_array_equal(numbers[:, 0], by_python)


@cases("no number", ["7" * 5000])
def test_a_cell_that_is_no_finite_number_or_nothing_measures_is_refused_by_its_line(
    cell,
):
    lines = ["1;2", f"3;{cell}"]
    marks = {"separator": ";", "gaps": True}
    with pytest.raises(RecordingError) as caught:
        numbers_of(lines, [4, 5], [0, 1], file=FILE, **marks)
    assert caught.value.evidence["line"] == 5 and len(str(caught.value)) < 200


@cases("one and a half")
def test_a_cell_in_any_form_is_a_number(cell):
    assert numbers_of([f"0,{cell}"], [1], [1], file=FILE).item() == 1.5


@cases("missing")
def test_a_missing_cell_is_nan_where_gaps_are_expected_and_else_refused(cell):
    number = numbers_of([f"0,{cell}"], [1], [1], file=FILE, gaps=True)
    assert np.isnan(number).all()
    with pytest.raises(RecordingError, match="column 2 has no number"):
        numbers_of([f"0,{cell}"], [1], [1], file=FILE)


def test_only_the_columns_that_are_asked_for_are_numbers_in_their_order():
    numbers = numbers_of(["1,text,2", "3,,4"], [1, 2], [2, 0], file=FILE)
    assert numbers.tolist() == [[2, 1], [4, 3]]


@cases("one reading")
def test_a_table_that_allows_one_reading_is_read_so(tmp_path, text):
    assert sheet(tmp_path, text).values([0, 1]).tolist() == [[1.5, 2], [3, 4]]
    # the control: commas separate the cells
    commas = sheet(tmp_path, "x,y\n1,5\n3,4\n").values([0, 1])
    assert commas.tolist() == [[1, 5], [3, 4]]


@cases("more readings")
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

    both_marks = {"separator": ",", "decimal": ","}
    for wrong in ({"separator": "|"}, {"decimal": "'"}, both_marks):
        with pytest.raises(ConfigError, match=KEY):
            sheet(tmp_path, "1,5\n", **wrong)


@cases("last row")
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_a_last_row_that_is_short_or_has_no_end_is_left_out_and_counted(
    tmp_path,
    last,
    rows,
    cut,
    end,
):
    text = "\ufeffx,y\n1,2\n3,4\n" + last
    result = sheet(tmp_path, text.replace("\n", end))

    assert len(result.rows) == rows and result.lines[0] == 2
    assert result.counts["cut_rows"] == cut


def test_written_trajectories_read_back_bit_for_bit_with_and_without_joints(tmp_path):
    file = tmp_path / "t.csv"
    numbers = default_rng(1).normal(0, 0.5, (321, 7))
    numbers[:, 0] = np.round(np.arange(321) / 30, 6)  # six decimals of equal steps
    families = pd.DataFrame(numbers, columns=FAMILIES)
    joints = {"q:a": np.linspace(0, 1, 321), "q:b": np.linspace(2, 3, 321)}
    both = families.assign(**joints)

    for written in (families, both, both[["t", *joints]]):
        write_trajectory(file, written.assign(other=1.0))
        assert_frame_equal(read_trajectory(file), written, check_exact=True)


def test_plain_names_of_columns_in_any_order_are_read_and_a_pose_is_whole(tmp_path):
    file = tmp_path / "t.csv"
    numbers = default_rng(1).normal(0, 0.5, (321, 7))
    numbers[:, 0] = np.arange(321) / 100
    plain = pd.DataFrame(numbers, columns=COLUMNS)
    plain[COLUMNS[::-1]].to_csv(file, index=False)
    families = pd.DataFrame(numbers, columns=FAMILIES)
    assert_frame_equal(read_trajectory(file), families, check_exact=True)

    # beside the joints a pose is whole, or there is none
    both = families.assign(**{"q:a": families["t"] / 9})
    both.drop(columns="x:z").rename(columns={"x:x": "x", "x:phi": "phi"}).to_csv(file)
    with pytest.raises(RecordingError, match="must name z"):
        read_trajectory(file)
