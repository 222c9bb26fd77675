from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from written_logs import write_netft

from pipeline.core.errors import RecordingError
from pipeline.formats.force.daqft import read_daqft
from pipeline.formats.force.netft import read_netft
from pipeline.formats.force.record import ForceLogOptions, ForceRecord

STARTED = "4/2/13 3:45 PM"


def record(samples: int = 50, seed: int = 1, rate: float = 500.0) -> ForceRecord:
    values = np.random.default_rng(seed).normal(size=(samples, 6)) * [10, 10, 30, 0.1, 0.1, 0.1]
    return ForceRecord(
        np.arange(samples) / rate, values[:, :3], values[:, 3:], rate, "", STARTED, {}
    )


def refusal(file, options: ForceLogOptions | None = None) -> RecordingError:
    with pytest.raises(RecordingError) as caught:
        read_netft(file, options or ForceLogOptions())
    assert caught.value.evidence["file"] == file
    return caught.value


def change(file, old: str, new: str, count: int = -1) -> None:
    text = file.read_bytes().decode()
    assert old in text
    file.write_bytes(text.replace(old, new, count).encode())


@pytest.fixture
def log(tmp_path):
    write_netft(tmp_path / "log.csv", record())
    return tmp_path / "log.csv"


def test_a_log_in_units_reads_back_to_the_bit(log):
    result = read_netft(log)
    np.testing.assert_array_equal(result.force, record().force)
    np.testing.assert_array_equal(result.torque, record().torque)
    np.testing.assert_allclose(result.time, record().time, rtol=0, atol=1e-12)
    assert (result.rate, result.started) == (500.0, STARTED)
    assert set(result.counts.values()) == {0}


def test_a_log_in_counts_is_divided_by_the_counts_per_unit_of_its_header(tmp_path):
    write_netft(tmp_path / "log.csv", record(), counts_per_unit=1_000_000)
    change(tmp_path / "log.csv", "Torque Units: N-m", "Torque Units: N-mm")
    change(tmp_path / "log.csv", "Force Units: N", "Force Units: lbf")
    result = read_netft(tmp_path / "log.csv")
    np.testing.assert_allclose(result.force, record().force * 0.45359237 * 9.80665, atol=2.3e-6)
    np.testing.assert_allclose(result.torque, record().torque * 1e-3, atol=0.51e-9)


def test_numbers_that_may_be_counts_or_not_are_settled_by_the_option(tmp_path):
    whole = ForceRecord(
        np.arange(3) / 500, np.ones((3, 3)) * 7.0, np.ones((3, 3)), 500.0, "", STARTED, {}
    )
    write_netft(tmp_path / "log.csv", whole)
    assert refusal(tmp_path / "log.csv").evidence["key"] == "dataset.force.log.counts"
    np.testing.assert_array_equal(
        read_netft(tmp_path / "log.csv", ForceLogOptions(counts=False)).force, 7
    )
    np.testing.assert_allclose(
        read_netft(tmp_path / "log.csv", ForceLogOptions(counts=True)).force, 7e-6
    )


def test_the_pcs_time_may_hold_commas_and_the_program_a_note(log):
    change(log, f'"{STARTED}"', '"Apr 2, 2013 3:45:12 PM"')
    change(log, "Force Units", '"PLEASE NOTE: The rate, as it was."\r\nForce Units')
    np.testing.assert_array_equal(read_netft(log).force, record().force)


def test_lost_packets_leave_a_gap_in_time_and_doubled_ones_are_left_out(log):
    lines = log.read_bytes().split(b"\r\n")
    first = next(i for i, line in enumerate(lines) if line.startswith(b'"0x0"'))
    kept = (
        lines[: first + 10]
        + lines[first + 14 : first + 20]
        + [lines[first + 19]]
        + lines[first + 20 :]
    )
    log.write_bytes(b"\r\n".join(kept))
    result = read_netft(log)
    assert (result.counts["lost_packets"], result.counts["doubled_rows"]) == (4, 1)
    np.testing.assert_array_equal(result.force, np.delete(record().force, range(10, 14), axis=0))
    np.testing.assert_allclose(
        result.time, np.delete(record().time, range(10, 14)), rtol=0, atol=1e-12
    )


def test_conditions_that_the_transducer_reports_are_counted(log):
    change(log, '"0x0"', '"0x80020000"', 3)
    assert read_netft(log).counts["status_rows"] == 3


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("Force Units: N\r\n", "", "fx has no known unit"),
        ("Torque Units: N-m", "Torque Units: furlong", "furlong"),
        ("RDT Sample Rate: 500", "RDT Sample Rate: fast", "no RDT Sample Rate"),
        ("RDT Sample Rate: 500", "RDT Sample Rate: 0", "RDT Sample Rate is 0"),
        ("RDT Sequence", "Sequence", "no log of a Net F/T"),
        (" Fy,", " Fx,", "two columns are labelled Fx"),
        (" Ty,", " ,", "no column is labelled ty"),
        ('"0x0","7"', '"0x0","5"', "goes from 6 to 5"),
        ('"0x0","7"', '"0x0","6"', "goes from 6 to 6"),
        ('"0x0","7"', '"0x0","7.5"', "goes from 6 to 7.5"),
        ('"0x0","7"', '"0xZ","7"', "0xZ"),
        ('"0x0","7"', '"0x0","7","7"', "12 cells|11 cells"),
        ('"0x0","7"', '"0x0"', "9 cells"),
        ('"0x0","7"', '"0x0",""', "no number"),
        ('"0x0","7"', '"0x0","1e999"', "nothing measures"),
    ],
)
def test_a_log_that_leaves_something_open_is_refused(log, old, new, words):
    change(log, old, new)
    assert any(word in str(refusal(log)) for word in words.split("|"))


def test_decimal_commas_are_no_thousands_and_no_separators(log):
    text = log.read_bytes()
    head, rows = text.split(b"Time\r\n")
    log.write_bytes(head + b"Time\r\n" + rows.replace(b".", b","))
    assert "not a finite number" in refusal(log).message


def test_units_rate_and_axes_may_come_from_the_options(log):
    change(log, "Force Units: N\r\n", "")
    change(log, "Fx, Fy, Fz", "Fx, Fx, Fz")
    options = ForceLogOptions(columns={"fx": 3, "fy": 4, "fz": 5}, force_unit="kN", rate=250.0)
    result = read_netft(log, options)
    np.testing.assert_allclose(result.force, 1e3 * record().force)
    np.testing.assert_allclose(result.time, 2 * record().time)
    assert np.isnan(result.torque).all()


def test_the_reader_of_daq_logs_names_the_format(log):
    with pytest.raises(RecordingError, match="netft") as caught:
        read_daqft(log)
    assert caught.value.evidence["key"] == "dataset.force.log.format"


@settings(derandomize=True, max_examples=80, deadline=None)
@given(data=st.data())
def test_dropped_doubled_and_swapped_rows_are_counted_or_refused(tmp_path_factory, data):
    file = tmp_path_factory.getbasetemp() / "rows.csv"
    write_netft(file, record(8))
    lines = file.read_bytes().split(b"\r\n")
    head, rows = lines[:7], lines[7:-1]
    picks = data.draw(st.lists(st.integers(0, 7), min_size=1, max_size=12))
    file.write_bytes(b"\r\n".join([*head, *(rows[i] for i in picks), b""]))
    if any(after < before for before, after in pairwise(picks)):
        assert "sequence" in refusal(file).message
        return
    result, kept = read_netft(file), sorted(set(picks))
    np.testing.assert_array_equal(result.force, record(8).force[kept])
    np.testing.assert_allclose(result.time, (np.array(kept) - kept[0]) / 500, rtol=0, atol=1e-12)
    assert result.counts["doubled_rows"] == len(picks) - len(kept)
    assert result.counts["lost_packets"] == kept[-1] - kept[0] + 1 - len(kept)
