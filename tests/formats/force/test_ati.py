"""ATI's logs and calibrations: DAQ F/T in both cultures, Net F/T, gauge voltages; values, units,
axes, times, and what is refused by the line or the option that settles it.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from written_logs import refusal, write_netft

from pipeline.formats.force.calibration import AXES, read_calibration
from pipeline.formats.force.daqft import read_daqft, read_netft, write_daqft
from pipeline.formats.force.record import ForceLogOptions, ForceRecord

KEY = "dataset.force.log"
STARTED = "4/2/13 3:45 PM"
PLAIN = ForceLogOptions()
SETTINGS = "Frequency = 1000,Averaging Level = 16,F/T Serial Number = FT1"
ROW = '"1.5","2","3","4","5","6"'
POUND = 0.45359237 * 9.80665


def record(samples: int = 50, rate: float = 500.0) -> ForceRecord:
    scales = [10, 10, 30, 0.1, 0.1, 0.1]
    values = default_rng(1).normal(size=(samples, 6)) * scales
    time = np.arange(samples) / rate
    return ForceRecord(time, values[:, :3], values[:, 3:], rate, "FT7", STARTED, {})


def log(folder: Path, *rows: str, force: str = "N", torque: str = "N-m") -> Path:
    labels = [f'"Force {axis} ({force})"' for axis in "XYZ"]
    labels += [f'"Torque {axis} ({torque})"' for axis in "XYZ"]
    (folder / "log.csv").write_text(
        "\n".join([",".join([*labels, SETTINGS]), *rows, ""]),
    )
    return folder / "log.csv"


def change(file: Path, old: str, new: str, count: int = -1) -> None:
    text = file.read_bytes().decode()
    assert old in text
    file.write_bytes(text.replace(old, new, count).encode())


@pytest.mark.parametrize("decimal", [".", ","])
def test_a_log_of_either_culture_is_read_and_rewritten_to_its_own_bytes(
    tmp_path,
    decimal,
):
    first = tmp_path / "1.csv"
    again = tmp_path / "2.csv"
    write_daqft(first, record(rate=62.5), decimal=decimal)
    result = read_daqft(first)
    assert (result.rate, result.serial, result.started) == (62.5, "FT7", STARTED)
    assert_allclose(result.force, record().force, rtol=1e-14)
    assert not any(result.counts.values())
    write_daqft(again, result, decimal=decimal)
    assert first.read_bytes() == again.read_bytes()
    # the columns need no name of a time, and a cell that is left empty at the end of each row
    first.write_bytes(
        first.read_bytes().replace(b"\r\n", b";\r\n" if decimal == "," else b",\r\n"),
    )
    assert_array_equal(read_daqft(first).torque, result.torque)


HEADERS = [
    f"{SETTINGS}\nFx,Fy,Fz,Tx,Ty,Tz\nN,N,N,N-mm,N-mm,N-mm",
    "Paused for 500 milliseconds before saving data.\nForce X,Force Y,Force Z,Torque X,"
    f"Torque Y,Torque Z\n(N),(N),(N),(N-mm),(N-mm),(N-mm),{SETTINGS}",
    f"Fx [N],Fy [N],Fz [N],Mx [N-mm],My [N-mm],Mz [N-mm],{SETTINGS}",
]


@pytest.mark.parametrize("header", HEADERS)
def test_labels_units_and_settings_may_have_rows_of_their_own(tmp_path, header):
    file = tmp_path / "log.csv"
    file.write_text(f"{header}\n{ROW}\n{ROW}\n")

    result = read_daqft(file)

    assert_array_equal(result.force, [[1.5, 2, 3]] * 2)
    assert_allclose(result.torque, [[0.004, 0.005, 0.006]] * 2)
    assert (result.rate, result.serial) == (62.5, "FT1")
    assert result.counts.get("paused_ms") == (500 if "Paused" in header else None)


def test_labels_or_numbers_say_which_column_is_which_axis(tmp_path):
    file = log(tmp_path, ROW)
    for old, new in (("Force X", "?"), ("Force Z", "Force X"), ("?", "Force Z")):
        change(file, old, new)
    assert_array_equal(read_daqft(file).force, [[3, 2, 1.5]])

    forces = read_daqft(file, ForceLogOptions(columns={"fx": 0, "fy": 1, "fz": 2}))
    assert_array_equal(forces.force, [[1.5, 2, 3]])
    assert np.isnan(forces.torque).all()  # only what is named is read


def test_a_rate_is_the_labels_or_the_options(tmp_path):
    file = log(tmp_path, ROW, ROW)
    at_another_rate = refusal(read_daqft, file, ForceLogOptions(rate=64.0))
    assert "in Hz is 62.5 in the log" in at_another_rate.message

    change(file, "Frequency = 1000,Averaging Level = 16,", "")
    assert refusal(read_daqft, file).evidence["key"] == f"{KEY}.rate"
    assert read_daqft(file, ForceLogOptions(rate=250.0)).time.tolist() == [0, 0.004]


BY_CLOCK = ForceLogOptions(columns={"t": 0, "fx": 1, "fy": 2, "fz": 3})
CLOCKS = [("Time (s)", 0.016, PLAIN), ("Time", 0.016, ForceLogOptions(time_unit="s"))]
CLOCKS += [("Sample Number", 1, PLAIN), ("Clock (ms)", 16, BY_CLOCK)]


@pytest.mark.parametrize(("label", "tick", "options"), CLOCKS)
def test_rows_that_were_lost_leave_a_gap_where_the_log_has_times_or_numbers(
    tmp_path,
    label,
    tick,
    options,
):
    numbers = np.array([k for k in range(20) if k not in (7, 8)])
    rows = [f'"{k * tick:g}","{k}.5","2","3","4","5","6"' for k in numbers]
    file = log(tmp_path, *rows)
    file.write_text(f'"{label}",' + file.read_text())

    result = read_daqft(file, options)

    assert result.counts["missing_samples"] == 2 and result.rate == pytest.approx(62.5)
    assert_allclose(result.time, numbers * 0.016, rtol=0, atol=1e-12)
    assert_array_equal(result.force[:, 0], numbers + 0.5)
    if label == "Time":
        assert refusal(read_daqft, file).evidence["key"] == f"{KEY}.time_unit"


@pytest.fixture
def netft(tmp_path) -> Path:
    write_netft(tmp_path / "log.csv", record())
    return tmp_path / "log.csv"


def test_a_netft_log_reads_back_to_the_bit_whatever_is_beside_its_numbers(netft):
    change(netft, f'"{STARTED}"', '"Apr 2, 2013 3:45:12 PM"')
    change(netft, "Force Units", '"PLEASE NOTE: The rate, as it was."\r\nForce Units')
    change(netft, '"0x0"', '"0x80020000"', 3)

    result = read_netft(netft)

    assert_array_equal(result.force, record().force)
    assert_array_equal(result.torque, record().torque)
    assert_allclose(result.time, record().time, rtol=0, atol=1e-12)
    assert (result.rate, result.started) == (500.0, STARTED)
    assert {n: count for n, count in result.counts.items() if count} == {
        "status_rows": 3,
    }


def test_repeated_zero_and_blank_rows_are_counted_and_lost_packets_leave_a_gap(
    tmp_path,
    netft,
):
    zeros = ",".join(['"0"'] * 6)
    ones = ",".join(['"1"'] * 6)
    result = read_daqft(log(tmp_path, ones, ones, zeros, "", zeros, ones))
    assert result.force[:, 0].tolist() == [1, 1, 0, 0, 1]
    assert result.counts == {
        "repeated_rows": 2,
        "zero_rows": 2,
        "blank_rows": 1,
        "cut_rows": 0,
    }

    write_netft(netft, record())
    lines = netft.read_bytes().split(b"\r\n")
    netft.write_bytes(b"\r\n".join([*lines[:17], *lines[21:28], *lines[27:]]))
    result = read_netft(netft)
    received = np.delete(np.arange(50), range(10, 14))

    assert (result.counts["lost_packets"], result.counts["doubled_rows"]) == (4, 1)
    assert_array_equal(result.force, record().force[received])
    assert_allclose(result.time, received / 500, rtol=0, atol=1e-12)


@pytest.mark.parametrize("torque_counts", [1_000_000, 250_000, 4_000_000])
def test_counts_of_forces_and_of_torques_are_divided_each_by_its_own(
    tmp_path,
    torque_counts,
):
    """Transducers have more counts a N·m than a N, or fewer."""
    file = tmp_path / "log.csv"
    share = 1_000_000 / torque_counts
    write_netft(file, record(), counts_per_unit=1_000_000)
    stated = "Counts per Unit Torque: "
    change(file, f"{stated}1000000.0", f"{stated}{torque_counts}.0")
    change(file, "Torque Units: N-m", "Torque Units: N-mm")
    result = read_netft(file)
    torque = record().torque * 1e-3 * share

    assert_allclose(result.force, record().force, atol=0.51e-6)
    assert_allclose(result.torque, torque, atol=0.51e-9 * share)


def test_what_may_be_counts_is_asked(tmp_path):
    file = tmp_path / "log.csv"
    sevens = np.full((3, 3), 7.0)
    time = np.arange(3) / 500
    write_netft(file, ForceRecord(time, sevens, sevens, 500, "", "", {}))

    assert refusal(read_netft, file).evidence["key"] == f"{KEY}.counts"
    for counts, value in ((False, 7), (True, 7e-6)):
        force = read_netft(file, ForceLogOptions(counts=counts)).force
        assert_allclose(force, value)

    file.write_bytes(b"7,0".join(file.read_bytes().rsplit(b"7.0", 1)))
    assert "'7,0', not a finite number" in refusal(read_netft, file).message


MATRIX = default_rng(3).normal(size=(6, 6)).round(5)
RATINGS = [25.0, 25.0, 35.0, 250.0, 250.0, 250.0]
NEWTON = 'ForceUnits="N" TorqueUnits="N-mm"'


def rows(kind: str, matrix: np.ndarray) -> str:
    """The six elements of a matrix as calibrations write them."""
    return "\n".join(
        f'<{kind} Name="{axis}" values="{" ".join(map(repr, row))}" max="{rating}"/>'
        for axis, row, rating in zip(AXES, matrix.tolist(), RATINGS, strict=True)
    )


def calibration(folder: Path, body: str = "", *, units: str = NEWTON) -> Path:
    head = '<?xml version="1.0" encoding="utf-8"?>\n<!-- made up -->\n<FTSensor Serial="FT1">\n'
    body = f"<Calibration {units}>\n{body or rows('UserAxis', MATRIX)}\n</Calibration>"
    (folder / "FT1.cal").write_text(f"{head}{body}</FTSensor>\n")
    return folder / "FT1.cal"


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "latin-1"])
def test_units_matrix_and_ratings_are_those_of_the_user_axes_in_any_encoding(
    tmp_path,
    encoding,
):
    axes = rows("Axis", 7 * MATRIX) + '<BasicTransform Dx="0" Dy="0" Dz="9"/>'
    for body in (rows("UserAxis", MATRIX), axes + rows("UserAxis", MATRIX)):
        file = calibration(tmp_path, body)
        text = file.read_text().replace("made up", "Meßgerät")
        file.write_bytes(text.encode(encoding))

        result = read_calibration(file)

        units = result.force_unit, result.torque_unit
        assert result.serial == "FT1" and units == ("N", "N-mm")
        newton = MATRIX * np.repeat([1, 1e-3], 3)[:, None]
        assert_array_equal(result.matrix, newton)
        assert_allclose(result.full_scale, [25, 25, 35, 0.25, 0.25, 0.25])

    error = refusal(read_calibration, calibration(tmp_path, axes))
    assert "get a calibration of version 1.1" in error.message


@pytest.mark.parametrize("thermistor", [[], ["Therm"]])
def test_gauge_voltages_become_forces_by_the_matrix_of_their_transducer(
    tmp_path,
    thermistor,
):
    volts = default_rng(5).normal(size=(4, 6)).round(6)
    options = ForceLogOptions(calibration=read_calibration(calibration(tmp_path)))
    file = tmp_path / "log.csv"
    gauges = [f"G{gauge}" for gauge in range(6)]
    table = pd.DataFrame(volts, columns=gauges).assign(**dict.fromkeys(thermistor, 2.5))
    table.to_csv(file, index=False, header=[*gauges, *thermistor])
    change(file, "\n", f",{SETTINGS}\n", 1)

    result = read_daqft(file, options)

    assert_allclose(result.force, volts @ MATRIX[:3].T, rtol=1e-11)
    assert_allclose(result.torque, volts @ MATRIX[3:].T * 1e-3, rtol=1e-11)
    assert refusal(read_daqft, file).evidence["key"] == f"{KEY}.calibration"

    change(file, "FT1", "FT2")
    assert "FT2" in refusal(read_daqft, file, options).message


def test_units_that_the_log_does_not_state_are_the_options_or_the_calibrations(
    tmp_path,
):
    file = tmp_path / "log.csv"
    file.write_text(f"Fx,Fy,Fz,Mx,My,Mz,{SETTINGS}\n1.5,2,3,4,5,6\n")
    assert refusal(read_daqft, file).evidence["key"] == f"{KEY}.force_unit"

    pounds = read_calibration(
        calibration(tmp_path, units='ForceUnits="lb" TorqueUnits="in-lb"'),
    )
    for unit, newton in ((None, POUND), ("kN", 1e3)):
        result = read_daqft(file, ForceLogOptions(calibration=pounds, force_unit=unit))
        assert_allclose(result.force, [np.array([1.5, 2, 3]) * newton], rtol=1e-12)
        torque = np.array([4, 5, 6]) * POUND * 0.0254
        assert_allclose(result.torque, [torque], rtol=1e-12)
