"""Forces of bags and tables: columns, units, clock, and samples that a sensor did not measure."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from ros_bags import Message, write_bag
from written_logs import refusal

from pipeline.core.errors import RecordingError
from pipeline.formats.force.daqft import read_daqft
from pipeline.formats.force.record import (
    WRENCH,
    ForceLogOptions,
    ForceRecord,
    read_force_bag,
    read_force_table,
    sound_samples,
)

START = 1_700_000_000
VALUES = default_rng(8).normal(size=(20, 6))


def bag(folder: Path, picks=range(20), topics=("/ft/wrench",)) -> Path:
    """A ROS 2 bag of the ``picks`` of samples at 500 Hz on every topic."""
    folder.mkdir(exist_ok=True)
    recorded = []
    for sent, k in enumerate(picks):
        wrench = VALUES[k].reshape(2, 3)
        message = Message(WRENCH[0], START + 0.002 * k, wrench=wrench)
        recorded.append((START + sent / 1e6, message))
    return write_bag(folder, "sqlite3", dict.fromkeys(topics, recorded))


def test_wrenches_of_a_bag_keep_their_numbers_and_the_times_of_their_headers(tmp_path):
    file = bag(tmp_path, topics=("/left", "/right"))
    assert "2 topics of WrenchStamped" in refusal(read_force_bag, file).message

    result = read_force_bag(file, ForceLogOptions(topic="/right"))
    assert_array_equal(np.hstack([result.force, result.torque]), VALUES)
    assert_allclose(result.time, np.arange(20) / 500, rtol=0, atol=0.5e-6)
    assert result.rate == pytest.approx(500, rel=1e-3) and set(
        result.counts.values(),
    ) == {0}


def test_doubled_messages_and_gaps_are_counted_and_what_is_no_clock_is_refused(
    tmp_path,
):
    result = read_force_bag(bag(tmp_path, [0, 1, 1, 2, 3, 7, 8, 9, 10]))
    assert (result.counts["doubled_rows"], result.counts["missing_samples"]) == (1, 3)

    error = refusal(read_force_bag, bag(tmp_path / "back", [0, 1, 2, 3, 4, 2, 6]))
    assert "goes back" in error.message and error.evidence["sample"] == 5


RATE = 100.0
LABELS = '"Force X (N)","Force Y (N)","Force Z (N)","Frequency = 1000","Averaging Level = 1"\n'
COLUMNS = ForceLogOptions({"fx": 0, "fy": 1, "fz": 2}, force_unit="N", rate=1000.0)
SCALE = np.full(6, 10.0)


def record(samples: int = 1000, *, torque: bool = True) -> ForceRecord:
    forces, torques = default_rng(6).normal(size=(2, samples, 3))
    if not torque:
        torques[:] = np.nan
    time = np.arange(samples) / RATE
    return ForceRecord(time, forces, torques, RATE, "", "", {})


@pytest.mark.parametrize("torque", [True, False])
def test_samples_at_or_beyond_full_scale_of_any_axis_are_saturated(torque):
    log = record(torque=torque)
    assert sound_samples(log, SCALE, 0.5, 0.0, file="log.csv")[0].all()

    log.force[[10, 11], [0, 2]] = [10.0, -12.0]
    log.torque[20] = 11.0 if torque else np.nan
    of_all_axes = [10, 11, 20] if torque else [10, 11]
    saturated_by_scale = [(SCALE, of_all_axes), (SCALE[:3], [10, 11])]
    for scale, saturated in saturated_by_scale:
        sound, counts = sound_samples(log, scale, 0.5, 0.01, file="log.csv")
        assert np.flatnonzero(~sound).tolist() == saturated
        assert counts == {"saturated_samples": len(saturated)}

    sound, counts = sound_samples(log, None, 0.5, 0.01, file="log.csv")
    assert sound.all() and counts == {}
    with pytest.raises(RecordingError, match=r"are saturated, the first at 0\.1 s"):
        sound_samples(log, SCALE, 0.5, 0.001, file="log.csv")


@pytest.mark.parametrize("torque", [True, False])
@pytest.mark.parametrize("start", [0, 300, 948])
def test_identical_samples_that_last_longer_than_the_limit_are_frozen(torque, start):
    log = record(torque=torque)
    rows = np.arange(start, start + 52)
    log.force[rows] = log.force[start]
    log.torque[rows] = log.torque[start]

    sound, _ = sound_samples(log, None, 0.515, 0.0, file="log.csv")
    assert sound.all()

    sound, counts = sound_samples(log, None, 0.5, 0.052, file="log.csv")
    assert_array_equal(np.flatnonzero(~sound), rows)
    assert counts == {"frozen_samples": 52}
    with pytest.raises(RecordingError, match="52 of 1000 samples are frozen") as caught:
        sound_samples(log, SCALE, 0.5, 0.051, file="log.csv")
    assert caught.value.evidence["key"] == "dataset.force.log.frozen_after"

    # one axis that still moves is a sensor that works
    log.force[:, 2] = default_rng(7).normal(size=len(log.force))
    sound, _ = sound_samples(log, None, 0.5, 0.0, file="log.csv")
    assert sound.all()


@pytest.mark.parametrize(
    "read",
    [read_daqft, lambda file: read_force_table(file, COLUMNS)],
)
def test_a_line_of_settings_below_a_header_is_no_record(tmp_path, read):
    file = tmp_path / "log.csv"
    file.write_text(LABELS + '"150","75","500"\n')
    with pytest.raises(RecordingError, match=r"the first is \[150. *75. *500.\] N"):
        sound_samples(read(file), None, 0.5, 0.01, file=file)

    # the control: a record
    file.write_text(LABELS + "".join(f'"1.{k}","2","3"\n' for k in range(10)))
    assert sound_samples(read(file), None, 0.5, 0.01, file=file)[0].all()


LABELLED = {
    "t": "time",
    "fx": "F1",
    "fy": "F2",
    "fz": "F3",
    "tx": "M1",
    "ty": "M2",
    "tz": "M3",
}
SI = ForceLogOptions(columns=LABELLED, force_unit="N", torque_unit="N-m", time_unit="s")
HEADER = "time,F1,F2,F3,M1,M2,M3"
POUND = 0.45359237 * 9.80665


def table(folder, *rows: str, header: str = HEADER + "\n"):
    (folder / "log.csv").write_text(header + "".join(row + "\n" for row in rows))
    return folder / "log.csv"


def test_units_stand_in_the_log_or_in_the_option_and_never_differ(tmp_path):
    options = ForceLogOptions(columns={"t": "time", "fx": "F1", "fy": "F2", "fz": "F3"})
    header = "time (ms),F1 (kN),F2 (N),F3 (lbf)\n"
    file = table(tmp_path, "500,1,2,3.5", "510,1,2,3", header=header)

    result = read_force_table(file, options)

    assert_allclose(result.force[0], [1000, 2, 3.5 * POUND], rtol=1e-12)
    assert_allclose(result.time, [0, 0.01], atol=1e-12)
    assert np.isnan(result.torque).all()

    in_newton = dataclasses.replace(options, force_unit="N")
    message = refusal(read_force_table, file, in_newton).message
    assert "'kN' in the log, 'N' by the option" in message

    columns = options.columns | {"t": "t_ms"}
    in_seconds = dataclasses.replace(options, columns=columns, time_unit="s")
    header = header.replace("time (ms)", "t_ms")
    file = table(tmp_path, "5,1,2,3", "6,1,2,3", header=header)
    message = refusal(read_force_table, file, in_seconds).message
    assert "'ms' in the log, 's' by the option" in message

    numbers = ForceLogOptions({"fx": 2, "fy": 0, "fz": 1}, force_unit="lbf", rate=100.0)
    result = read_force_table(table(tmp_path, "1.5,2,3", "4.5,5,6", header=""), numbers)
    assert_allclose(result.force, np.array([[3, 1.5, 2], [6, 4.5, 5]]) * POUND)
    assert_allclose(result.time, [0, 0.01])


FOREIGN = {"time": "{}{}", "t": "{} {} (N)", "Time Stamp": "field.wrench.{}.{}"}
FOREIGN |= {"time_stamp": "/ft/wrench/{}/{}", "timestamp": "wrench_{}_{}"}


@pytest.mark.parametrize("time", FOREIGN)
def test_labels_of_other_programs_name_their_axes_and_times(tmp_path, time):
    forces = [FOREIGN[time].format("force", axis) for axis in "xyz"]
    header = ",".join([time, *forces, "tool_tx"]) + "\n"
    rows = [f"{k / 100},1,2,{k},9" for k in range(12)]
    file = table(tmp_path, *rows, header=header)
    options = ForceLogOptions(force_unit="N", time_unit="s")

    record = read_force_table(file, options)

    assert record.force[3].tolist() == [1, 2, 3]
    assert record.rate == pytest.approx(100)
    assert np.isnan(record.torque).all()


def test_doubled_rows_jitter_and_gaps_are_counted(tmp_path):
    times = [0.0, 0.01, 0.02, 0.02, 0.03, 0.0315, 0.04, 0.05, 0.09, 0.1, 0.11, 0.11]
    rows = [f"{t:.4f},{i},0,0,0,0,0" for i, t in enumerate(times)]
    rows[3] = rows[2]
    result = read_force_table(table(tmp_path, *rows), SI)
    assert result.force[:, 0].tolist() == [0, 1, 2, 4, 5, 6, 7, 8, 9, 10, 11]

    counts = {
        "doubled_rows": 1,
        "equal_times": 1,
        "uneven_steps": 4,
        "missing_samples": 3,
    }
    assert counts.items() <= result.counts.items()


UNTIMED = {"columns": {axis: label for axis, label in LABELLED.items() if axis != "t"}}
OPEN = [
    ({f"{name}_unit": None}, f"{name}_unit") for name in ("force", "torque", "time")
]
OPEN += [({"force_unit": "stone"}, "force_unit"), (UNTIMED, "rate")]
OPEN += [({"columns": LABELLED | {"qx": 3}}, "columns")]


@pytest.mark.parametrize(("options", "key"), OPEN)
def test_what_nothing_settles_is_refused_by_the_name_of_its_option(
    tmp_path,
    options,
    key,
):
    file = table(tmp_path, "0.5,1,2,3,4,5,6", "0.6,1,2,3,4,5,7")
    read_force_table(file, SI)
    error = refusal(read_force_table, file, dataclasses.replace(SI, **options))

    assert error.evidence["key"] == f"dataset.force.log.{key}"
