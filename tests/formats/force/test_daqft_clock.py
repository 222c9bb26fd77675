"""Times of an ATI DAQ F/T log."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from force_files import ROW, log, record, refusal
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.core.errors import RecordingError
from pipeline.formats.force.daqft import read_daqft, write_daqft
from pipeline.formats.force.record import ForceLogOptions


@pytest.mark.parametrize(
    ("top", "count"),
    [
        ("Paused for 500 milliseconds", {"paused_ms": 500}),
        ("Skipped 20 samples", {"skipped_samples": 20}),
    ],
)
def test_a_first_line_about_a_delay_is_understood(tmp_path, top, count):
    file = log(
        tmp_path,
        ",".join(['"1"'] * 6),
        top=f'{top} before saving data - it is after what is reported as "Time Started".\r\n',
    )
    result = read_daqft(file)
    assert result.counts.items() >= count.items()
    assert (result.rate, len(result.time)) == (62.5, 1)


def test_a_rate_that_the_labels_do_not_state_is_the_options_and_never_another(tmp_path):
    file = log(tmp_path, ROW, ROW)
    with pytest.raises(RecordingError, match=r"62\.5 samples a second, the option 64"):
        read_daqft(file, ForceLogOptions(rate=64.0))
    file.write_text(file.read_text().replace('"Frequency = 1000","Averaging Level = 16",', ""))
    assert refusal(file).evidence["key"] == "dataset.force.log.rate"
    assert read_daqft(file, ForceLogOptions(rate=250.0)).time.tolist() == [0, 0.004]


@settings(derandomize=True, max_examples=60, deadline=None)
@given(picks=st.lists(st.integers(0, 5), min_size=1, max_size=10), decimal=st.sampled_from(".,"))
def test_without_a_time_doubled_rows_can_only_be_counted(tmp_path_factory, picks, decimal):
    file = tmp_path_factory.getbasetemp() / "rows.csv"
    write_daqft(file, record(6), decimal=decimal)
    head, *rows, _ = file.read_bytes().split(b"\r\n")
    file.write_bytes(b"\r\n".join([head, *(rows[i] for i in picks), b""]))
    result = read_daqft(file)
    np.testing.assert_allclose(result.force, record(6).force[picks], rtol=1e-14)
    assert result.counts["repeated_rows"] == sum(
        before == after for before, after in pairwise(picks)
    )


@pytest.mark.parametrize(
    ("label", "tick", "options"),
    [
        ("Time (s)", 0.016, ForceLogOptions()),
        ("Time Stamp [ms]", 16, ForceLogOptions()),
        ("Time", 0.016, ForceLogOptions(time_unit="s")),
        ("Sample Number", 1, ForceLogOptions()),
        ("Clock (ms)", 16, ForceLogOptions(columns={"t": 0, "fx": 1, "fy": 2, "fz": 3})),
    ],
)
def test_rows_that_were_lost_leave_a_gap_where_the_log_has_times_or_numbers(
    tmp_path, label, tick, options
):
    rows = [f'"{k * tick:g}","{k}.5","2","3","4","5","6"' for k in range(20) if k not in (7, 8)]
    file = log(tmp_path, *rows)
    file.write_text(f'"{label}",' + file.read_text())
    result = read_daqft(file, options)
    assert result.counts["missing_samples"] == 2
    assert result.rate == pytest.approx(62.5)
    np.testing.assert_allclose(
        result.time, [k * 0.016 for k in range(20) if k not in (7, 8)], rtol=0, atol=1e-12
    )
    np.testing.assert_array_equal(
        result.force[:, 0], [k + 0.5 for k in range(20) if k not in (7, 8)]
    )


def test_a_clock_without_a_unit_is_refused_with_the_option(tmp_path):
    file = log(tmp_path, '"0","1","2","3","4","5","6"', '"16","1","2","3","4","5","7"')
    file.write_text('"Time",' + file.read_text())
    assert refusal(file).evidence["key"] == "dataset.force.log.time_unit"


def test_a_frequency_of_thousands_is_not_read_as_a_fraction(tmp_path):
    write_daqft(tmp_path / "log.csv", record(5), decimal=",")
    text = (tmp_path / "log.csv").read_text()
    (tmp_path / "log.csv").write_text(text.replace("Frequency = 62,5", "Frequency = 1.000"))
    error = refusal(tmp_path / "log.csv")
    assert error.evidence["key"] == "dataset.force.log.rate"
    assert read_daqft(tmp_path / "log.csv", ForceLogOptions(rate=1000.0)).rate == 1000.0
