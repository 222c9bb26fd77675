from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.errors import RecordingError
from pipeline.instruments.ati import read_daqft, write_daqft
from pipeline.instruments.force_record import ForceRecord, LogOptions
from pipeline.instruments.force_table import read_force_table

SETTINGS = '"Frequency = 1000","Averaging Level = 16","F/T Serial Number = FT1","Time Started = 1/2/2024 3:04:05 PM"'


def record(samples: int = 200, seed: int = 1) -> ForceRecord:
    values = np.random.default_rng(seed).normal(size=(samples, 6)) * 10.0 ** np.arange(-7, 5, 2)
    return ForceRecord(np.arange(samples) / 62.5, values[:, :3], values[:, 3:], 62.5, "FT38684", "20.12.2023 13:59:33", {})


def log(folder, *rows: str, force: str = "N", torque: str = "N-m", top: str = ""):
    labels = [f'"Force {axis} ({force})"' for axis in "XYZ"] + [f'"Torque {axis} ({torque})"' for axis in "XYZ"]
    file = folder / "log.csv"
    file.write_bytes((top + ",".join([*labels, SETTINGS]) + "\r\n" + "".join(row + "\r\n" for row in rows)).encode())
    return file


def refusal(file) -> RecordingError:
    with pytest.raises(RecordingError) as caught:
        read_daqft(file)
    assert caught.value.evidence["file"] == file
    return caught.value


def test_a_log_of_a_decimal_comma_culture_has_its_values_rate_and_no_repeats(shared):
    found = read_daqft(shared / "samples/ati/daqft_dotnet_semicolon.csv")
    assert (len(found.time), found.rate, found.time[-1]) == (858, 62.5, 857 / 62.5)
    np.testing.assert_array_equal(found.force[0], [0.00877152755856514, 0.00518989656120539, -0.00133696524426341])
    np.testing.assert_array_equal(found.torque[0], [0.000490232661832124, -0.000854000565595925, -8.62029555719346e-05])
    np.testing.assert_array_equal(found.force[-1], [-0.0689550936222076, 0.0407638177275658, -0.280170291662216])
    assert found.torque[-1][2] == -0.000581596628762782
    assert (found.serial, found.started) == ("FT38684", "20.12.2023 13:59:33")
    assert found.counts == {"repeated_rows": 0, "zero_rows": 0, "blank_rows": 0, "cut_rows": 0}


def test_rewriting_a_log_gives_the_instruments_own_rows(shared, tmp_path):
    source = shared / "samples/ati/daqft_dotnet_semicolon.csv"
    write_daqft(tmp_path / "log.csv", read_daqft(source), decimal=",")
    assert (tmp_path / "log.csv").read_bytes().splitlines()[1:] == source.read_bytes().splitlines()[1:]


@pytest.mark.parametrize("decimal", [".", ","])
def test_written_records_read_back_to_fifteen_digits_in_both_cultures(tmp_path, decimal):
    original = record()
    write_daqft(tmp_path / "log.csv", original, decimal=decimal)
    found = read_daqft(tmp_path / "log.csv")
    np.testing.assert_allclose(found.force, original.force, rtol=1e-14)
    np.testing.assert_allclose(found.torque, original.torque, rtol=1e-14)
    np.testing.assert_array_equal(found.time, original.time)
    assert (found.rate, found.serial, found.started) == (original.rate, original.serial, original.started)
    assert (b";" in (tmp_path / "log.csv").read_bytes()) == (decimal == ",")


@pytest.mark.parametrize(
    ("force", "torque", "newton", "newton_metre"),
    [
        ("N", "N-m", 1, 1),
        ("N", "N-mm", 1, 1e-3),
        ("kN", "kN-m", 1e3, 1e3),
        ("lbf", "lbf-in", 0.45359237 * 9.80665, 0.45359237 * 9.80665 * 0.0254),
        ("lbf", "lbf-ft", 0.45359237 * 9.80665, 0.45359237 * 9.80665 * 0.3048),
        ("N", "N·m", 1, 1),
    ],
)
def test_units_become_newton_and_newton_metre(tmp_path, force, torque, newton, newton_metre):
    found = read_daqft(log(tmp_path, '"1","2","3","4","5","6"', force=force, torque=torque))
    np.testing.assert_allclose(found.force, [np.array([1, 2, 3]) * newton], rtol=1e-14)
    np.testing.assert_allclose(found.torque, [np.array([4, 5, 6]) * newton_metre], rtol=1e-14)


def test_labels_decide_the_order_of_the_axes(tmp_path):
    file = log(tmp_path, '"1","2","3","4","5","6"')
    file.write_text(file.read_text().replace("Force X", "Force ?").replace("Force Z", "Force X").replace("Force ?", "Force Z"))
    np.testing.assert_array_equal(read_daqft(file).force, [[3, 2, 1]])


def test_repeated_zero_and_blank_rows_are_counted_and_samples_kept(tmp_path):
    zero, one = ",".join(['"0"'] * 6), ",".join(['"1"'] * 6)
    found = read_daqft(log(tmp_path, one, one, zero, "", zero, one))
    assert found.force[:, 0].tolist() == [1, 1, 0, 0, 1]
    assert found.counts == {"repeated_rows": 2, "zero_rows": 2, "blank_rows": 1, "cut_rows": 0}


@pytest.mark.parametrize(
    ("top", "count"), [("Paused for 500 milliseconds", {"paused_ms": 500}), ("Skipped 20 samples", {"skipped_samples": 20})]
)
def test_a_first_line_about_a_delay_is_understood(tmp_path, top, count):
    file = log(tmp_path, ",".join(['"1"'] * 6), top=f'{top} before saving data - it is after what is reported as "Time Started".\r\n')
    found = read_daqft(file)
    assert found.counts.items() >= count.items()
    assert (found.rate, len(found.time)) == (62.5, 1)


def test_a_log_of_forces_alone_has_no_torque(tmp_path):
    (tmp_path / "log.csv").write_text("Force X (N),Force Y (N),Force Z (N),Frequency = 250,Averaging Level = 1\n1,2,3\n")
    found = read_daqft(tmp_path / "log.csv")
    np.testing.assert_array_equal(found.force, [[1, 2, 3]])
    assert np.isnan(found.torque).all()


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        (" (N)", "", 1, "no known unit"),
        ("(N-m)", "(furlong)", 1, "no known unit"),
        ("Torque X", "Torque Z", 1, "two columns are labelled Torque Z"),
        ("Force Y (N)", "G1", 1, "no column is labelled Force Y"),
        ("Frequency = 1000", "Frequency = x", 1, "Frequency"),
        ("Averaging Level = 16", "Averaging Level = 0", 1, "Averaging Level"),
        ('"2"', '"two"', 2, "'two'"),
        ('"2"', '"nan"', 2, "no number"),
        ('"2"', '""', 2, "no number"),
        ('"2"', '"inf"', 2, "'inf'"),
        ('"2"', '"2,5"', 2, "7 cells under 6 labels"),
        ('"2",', "", 2, "5 cells under 6 labels"),
    ],
)
def test_logs_that_leave_something_open_are_refused_with_their_line(tmp_path, old, new, line, words):
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


@settings(derandomize=True, max_examples=60, deadline=None)
@given(samples=st.integers(2, 6), seed=st.integers(0, 99), decimal=st.sampled_from(".,"), data=st.data())
def test_a_log_cut_at_any_byte_is_refused_or_holds_only_rows_that_were_whole(tmp_path_factory, samples, seed, decimal, data):
    file = tmp_path_factory.mktemp("cut") / "log.csv"
    write_daqft(file, record(samples, seed), decimal=decimal)
    whole, content = read_daqft(file), file.read_bytes()
    cut = data.draw(st.integers(0, len(content) - 1) | st.integers(len(content) - 150, len(content) - 1))
    file.write_bytes(content[:cut])
    try:
        found = read_daqft(file)
    except RecordingError:
        return
    kept = content[:cut].replace(b"\r\n", b"\n").replace(b"\r", b"\n").count(b"\n") - 1
    assert 0 < len(found.time) == kept
    np.testing.assert_array_equal(found.force, whole.force[:kept])
    np.testing.assert_array_equal(found.torque, whole.torque[:kept])


ROW = "1.5,2,3,4,5,6"
NUMBERED = {"fx": 0, "fy": 1, "fz": 2, "tx": 3, "ty": 4, "tz": 5}


@pytest.mark.parametrize(
    "header",
    [
        "Frequency = 1000,Averaging Level = 16,F/T Serial Number = FT1\nFx,Fy,Fz,Tx,Ty,Tz\nN,N,N,N-mm,N-mm,N-mm",
        'Paused for 500 milliseconds before saving data.\n"Force X","Force Y","Force Z","Torque X","Torque Y","Torque Z"\n'
        '"(N)","(N)","(N)","(N-mm)","(N-mm)","(N-mm)","Frequency = 1000","Averaging Level = 16","F/T Serial Number = FT1"',
        "Fx [N],Fy [N],Fz [N],Mx [N-mm],My [N-mm],Mz [N-mm],Frequency = 1000,Averaging Level = 16,F/T Serial Number = FT1",
    ],
)
def test_labels_units_and_settings_may_stand_in_rows_of_their_own(tmp_path, header):
    (tmp_path / "log.csv").write_text(f"{header}\n{ROW}\n{ROW}\n")
    found = read_daqft(tmp_path / "log.csv")
    np.testing.assert_array_equal(found.force, [[1.5, 2, 3]] * 2)
    np.testing.assert_allclose(found.torque, [[0.004, 0.005, 0.006]] * 2)
    assert (found.rate, found.serial) == (62.5, "FT1")


def test_axes_that_are_labelled_twice_are_settled_by_their_numbers(tmp_path):
    file = log(tmp_path, ROW)
    file.write_text(file.read_text().replace("Torque X", "Torque Z"))
    assert refusal(file).evidence["key"] == "dataset.force.log.columns"
    options = LogOptions(columns=NUMBERED)
    np.testing.assert_array_equal(read_daqft(file, options).torque, [[4, 5, 6]])
    # only what is named is read
    forces = LogOptions(columns={axis: column for axis, column in NUMBERED.items() if axis.startswith("f")})
    assert np.isnan(read_daqft(file, forces).torque).all()


def test_a_rate_that_the_labels_do_not_state_is_the_options_and_never_another(tmp_path):
    file = log(tmp_path, ROW, ROW)
    with pytest.raises(RecordingError, match=r"62\.5 samples a second, the option 64"):
        read_daqft(file, LogOptions(rate=64.0))
    file.write_text(file.read_text().replace('"Frequency = 1000","Averaging Level = 16",', ""))
    assert refusal(file).evidence["key"] == "dataset.force.log.rate"
    assert read_daqft(file, LogOptions(rate=250.0)).time.tolist() == [0, 0.004]


def test_a_log_without_labels_is_a_table_whose_columns_have_numbers(tmp_path):
    file = tmp_path / "log.csv"
    file.write_text(f"{ROW}\n{ROW}\n")
    assert refusal(file).evidence["key"] == "dataset.force.log.format"
    found = read_force_table(file, LogOptions(columns=NUMBERED, rate=62.5, force_unit="N", torque_unit="N-m"))
    np.testing.assert_array_equal(np.hstack([found.force, found.torque]), [[1.5, 2, 3, 4, 5, 6]] * 2)


@settings(derandomize=True, max_examples=60, deadline=None)
@given(picks=st.lists(st.integers(0, 5), min_size=1, max_size=10), decimal=st.sampled_from(".,"))
def test_without_a_time_doubled_rows_can_only_be_counted(tmp_path_factory, picks, decimal):
    file = tmp_path_factory.getbasetemp() / "rows.csv"
    write_daqft(file, record(6), decimal=decimal)
    head, *rows, _ = file.read_bytes().split(b"\r\n")
    file.write_bytes(b"\r\n".join([head, *(rows[i] for i in picks), b""]))
    found = read_daqft(file)
    np.testing.assert_allclose(found.force, record(6).force[picks], rtol=1e-14)
    assert found.counts["repeated_rows"] == sum(before == after for before, after in pairwise(picks))


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
        np.testing.assert_allclose(read_daqft(folder / "log.csv").force, record(5).force, rtol=1e-14)


@pytest.mark.parametrize(
    ("label", "tick", "options"),
    [
        ("Time (s)", 0.016, LogOptions()),
        ("Time Stamp [ms]", 16, LogOptions()),
        ("Time", 0.016, LogOptions(time_unit="s")),
        ("Sample Number", 1, LogOptions()),
        ("Clock (ms)", 16, LogOptions(columns={"t": 0, "fx": 1, "fy": 2, "fz": 3})),
    ],
)
def test_rows_that_were_lost_leave_a_gap_where_the_log_has_times_or_numbers(tmp_path, label, tick, options):
    rows = [f'"{k * tick:g}","{k}.5","2","3","4","5","6"' for k in range(20) if k not in (7, 8)]
    file = log(tmp_path, *rows)
    file.write_text(f'"{label}",' + file.read_text())
    found = read_daqft(file, options)
    assert found.counts["missing_samples"] == 2
    assert found.rate == pytest.approx(62.5)
    np.testing.assert_allclose(found.time, [k * 0.016 for k in range(20) if k not in (7, 8)], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(found.force[:, 0], [k + 0.5 for k in range(20) if k not in (7, 8)])


def test_a_clock_without_a_unit_is_refused_with_the_option(tmp_path):
    file = log(tmp_path, '"0","1","2","3","4","5","6"', '"16","1","2","3","4","5","7"')
    file.write_text('"Time",' + file.read_text())
    assert refusal(file).evidence["key"] == "dataset.force.log.time_unit"


@pytest.mark.parametrize(("columns", "words"), [({"fx": 0, "fy": 1}, "fz"), ({"fx": 0, "fy": 1, "fz": 2, "tx": 3}, "all or none")])
def test_columns_that_name_some_of_the_axes_are_refused(tmp_path, columns, words):
    file = log(tmp_path, '"1","2","3","4","5","6"')
    with pytest.raises(RecordingError, match=words) as caught:
        read_daqft(file, LogOptions(columns=columns))
    assert caught.value.evidence["key"] == "dataset.force.log.columns"


def test_a_frequency_of_thousands_is_not_read_as_a_fraction(tmp_path):
    write_daqft(tmp_path / "log.csv", record(5), decimal=",")
    text = (tmp_path / "log.csv").read_text()
    (tmp_path / "log.csv").write_text(text.replace("Frequency = 62,5", "Frequency = 1.000"))
    error = refusal(tmp_path / "log.csv")
    assert error.evidence["key"] == "dataset.force.log.rate"
    assert read_daqft(tmp_path / "log.csv", LogOptions(rate=1000.0)).rate == 1000.0
