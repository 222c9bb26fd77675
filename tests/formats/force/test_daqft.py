from __future__ import annotations

import numpy as np
import pytest
from force_files import log, record, refusal
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.formats.force.daqft import read_daqft, write_daqft


def test_a_log_of_a_decimal_comma_culture_has_its_values_rate_and_no_repeats(shared):
    result = read_daqft(shared / "samples/ati/daqft_dotnet_semicolon.csv")
    assert (len(result.time), result.rate, result.time[-1]) == (858, 62.5, 857 / 62.5)
    np.testing.assert_array_equal(
        result.force[0], [0.00877152755856514, 0.00518989656120539, -0.00133696524426341]
    )
    np.testing.assert_array_equal(
        result.torque[0], [0.000490232661832124, -0.000854000565595925, -8.62029555719346e-05]
    )
    np.testing.assert_array_equal(
        result.force[-1], [-0.0689550936222076, 0.0407638177275658, -0.280170291662216]
    )
    assert result.torque[-1][2] == -0.000581596628762782
    assert (result.serial, result.started) == ("FT38684", "20.12.2023 13:59:33")
    assert result.counts == {"repeated_rows": 0, "zero_rows": 0, "blank_rows": 0, "cut_rows": 0}


def test_rewriting_a_log_gives_the_instruments_own_rows(shared, tmp_path):
    source = shared / "samples/ati/daqft_dotnet_semicolon.csv"
    write_daqft(tmp_path / "log.csv", read_daqft(source), decimal=",")
    assert (tmp_path / "log.csv").read_bytes().splitlines()[1:] == source.read_bytes().splitlines()[
        1:
    ]


@pytest.mark.parametrize("decimal", [".", ","])
def test_written_records_read_back_to_fifteen_digits_in_both_cultures(tmp_path, decimal):
    original = record()
    write_daqft(tmp_path / "log.csv", original, decimal=decimal)
    result = read_daqft(tmp_path / "log.csv")
    np.testing.assert_allclose(result.force, original.force, rtol=1e-14)
    np.testing.assert_allclose(result.torque, original.torque, rtol=1e-14)
    np.testing.assert_array_equal(result.time, original.time)
    assert (result.rate, result.serial, result.started) == (
        original.rate,
        original.serial,
        original.started,
    )
    assert (b";" in (tmp_path / "log.csv").read_bytes()) == (decimal == ",")


def test_repeated_zero_and_blank_rows_are_counted_and_samples_kept(tmp_path):
    zero, one = ",".join(['"0"'] * 6), ",".join(['"1"'] * 6)
    result = read_daqft(log(tmp_path, one, one, zero, "", zero, one))
    assert result.force[:, 0].tolist() == [1, 1, 0, 0, 1]
    assert result.counts == {"repeated_rows": 2, "zero_rows": 2, "blank_rows": 1, "cut_rows": 0}


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        (" (N)", "", 1, "no known unit"),
        ("(N-m)", "(furlong)", 1, "no known unit"),
        ("Torque X", "Torque Z", 1, "two columns are labelled Torque Z"),
        ("Force Y (N)", "G1", 1, "no column is labelled fy"),
        ("Frequency = 1000", "Frequency = x", 1, "Frequency"),
        ("Averaging Level = 16", "Averaging Level = 0", 1, "Averaging Level"),
        ('"2"', '"two"', 2, "'two'"),
        ('"2"', '"nan"', 2, "no number"),
        ('"2"', '""', 2, "no number"),
        ('"2"', '"inf"', 2, "'inf'"),
        ('"2"', '"2,5"', 2, "'2,5', not a finite number"),
        ('"2",', "", 2, "5 cells under 6 labels"),
    ],
)
def test_logs_that_leave_something_open_are_refused_with_their_line(
    tmp_path, old, new, line, words
):
    file = log(tmp_path, '"1","2","3","4","5","6"')
    read_daqft(file)
    file.write_text(file.read_text().replace(old, new))
    error = refusal(file)
    assert words in error.message
    assert error.evidence["line"] == line


def test_a_decimal_point_in_a_decimal_comma_log_is_refused(tmp_path):
    write_daqft(tmp_path / "log.csv", record(3), decimal=",")
    lines = (tmp_path / "log.csv").read_bytes().split(b"\r\n")
    lines[2] = lines[2].replace(b",", b".")
    (tmp_path / "log.csv").write_bytes(b"\r\n".join(lines))
    assert refusal(tmp_path / "log.csv").evidence["line"] == 3


def test_headers_without_samples_and_other_files_are_refused(tmp_path):
    assert "no whole sample" in refusal(log(tmp_path)).message
    for content in (b"", b"0.1,0.2,0.3\n", b"Paused for 5 milliseconds\n", b"\x89PNG\r\n\x1a\n\0"):
        (tmp_path / "log.csv").write_bytes(content)
        refusal(tmp_path / "log.csv")


@settings(derandomize=True, max_examples=100, deadline=None)
@given(comma=st.lists(st.booleans(), min_size=5, max_size=5), head=st.booleans())
def test_rows_of_both_cultures_in_one_log_are_refused(tmp_path_factory, comma, head):
    folder = tmp_path_factory.getbasetemp()
    cultures = {}
    for decimal in ".,":
        write_daqft(folder / "log.csv", record(5), decimal=decimal)
        cultures[decimal == ","] = (folder / "log.csv").read_bytes().split(b"\r\n")
    rows = [cultures[culture][1 + i] for i, culture in enumerate(comma)]
    (folder / "log.csv").write_bytes(b"\r\n".join([cultures[head][0], *rows, b""]))
    if set(comma) != {head}:
        refusal(folder / "log.csv")
    else:
        np.testing.assert_allclose(
            read_daqft(folder / "log.csv").force, record(5).force, rtol=1e-14
        )
