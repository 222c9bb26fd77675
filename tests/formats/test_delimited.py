from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import NUMBER, numbers_of, read_text

FILE = Path("log.csv")


@pytest.mark.parametrize("form", ["%.6f", "%.15G", "%.17g", "%.3f"])
def test_numbers_are_correctly_rounded_as_by_python(form):
    generator = np.random.default_rng(1)
    rows = [
        form % value
        for value in generator.normal(size=5000) * 10.0 ** generator.integers(-9, 9, 5000)
    ]
    result = numbers_of(rows, list(range(5000)), [0], file=FILE)
    np.testing.assert_array_equal(result[:, 0], [float(row) for row in rows])


@pytest.mark.parametrize(
    "cell",
    [
        "x",
        "1_0",
        "1 2",
        "0x1A",
        "True",
        "None",
        "NA",
        "-Infinity",
        "1e999",
        "1,5",
        "1.2.3",
        "--1",
        '"1',
    ],
)
def test_cells_that_are_no_finite_number_are_refused(cell):
    with pytest.raises(RecordingError):
        numbers_of(["1;2", f"3;{cell}"], [1, 2], [0, 1], file=FILE, separator=";", gaps=True)


@pytest.mark.parametrize("cell", ["1.5", " 1.5", "1.5 ", "+1.5", '"1.5"', "15e-1", "0.15E+1"])
def test_cells_that_are_a_number_are_read(cell):
    assert numbers_of([f"0,{cell}"], [1], [1], file=FILE).item() == 1.5


@pytest.mark.parametrize("cell", ["", " ", "NAN", "nan", "-nan(ind)", "1.#QNAN", '""'])
def test_missing_cells_are_nan_where_gaps_are_expected_and_refused_elsewhere(cell):
    assert np.isnan(numbers_of([f"0,{cell}"], [1], [1], file=FILE, gaps=True)).all()
    with pytest.raises(RecordingError, match="column 2 has no number"):
        numbers_of([f"0,{cell}"], [1], [1], file=FILE)


def test_columns_come_in_the_order_asked_for_and_others_may_hold_anything():
    assert numbers_of(["1,text,2", "3,,4"], [1, 2], [2, 0], file=FILE).tolist() == [[2, 1], [4, 3]]


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_what_follows_the_last_line_end_is_kept_apart(tmp_path, end):
    (tmp_path / "t.txt").write_bytes(f"\ufeffone{end}two{end}thr".encode())
    text = read_text(tmp_path / "t.txt")
    assert (text.lines, text.cut) == (["one", "two"], "thr")
    (tmp_path / "t.txt").write_bytes(f"one{end}".encode())
    assert read_text(tmp_path / "t.txt").cut is None


@pytest.mark.parametrize("cell", ["1e300", "-2E20", "7" * 5000, "1e400"])
def test_a_number_that_nothing_measures_is_refused_by_its_line(cell):
    with pytest.raises(RecordingError, match=r"nothing measures") as caught:
        numbers_of(["1,2", f"3,{cell}"], [4, 5], [0, 1], file=Path("a.csv"))
    assert caught.value.evidence["line"] == 5
    assert len(str(caught.value)) < 200


def test_a_text_is_told_from_a_number_in_a_time_that_grows_with_its_length():
    began = time.perf_counter()
    assert not NUMBER.fullmatch("1" * 10**6 + "x") and not NUMBER.fullmatch(" " * 10**6 + "x")
    assert NUMBER.fullmatch("1" * 10**6 + "." + "1" * 10**6)
    assert time.perf_counter() - began < 2
