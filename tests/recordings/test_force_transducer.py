"""From the log of any transducer to the table of forces: the same forces whatever the format, and
faults named.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from written_logs import write_netft

from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.force import Force
from pipeline.core.validation import validated
from pipeline.formats.force.daqft import write_daqft
from pipeline.formats.force.record import ForceRecord
from pipeline.recordings.force_transducer import force_rows

RATE, TARE = 250.0, 2.0
BIAS, LOAD = np.array([0.4, -1.1, 7.0]), np.array([3.0, 5.0, 0.0])


def record(seconds: float = 10.0) -> ForceRecord:
    """A record whose first seconds are unloaded; noise 10 mN."""
    rng, time = np.random.default_rng(2), np.arange(round(seconds * RATE)) / RATE
    force = BIAS + np.where(time[:, None] < TARE, 0, LOAD) + rng.normal(0, 0.01, (len(time), 3))
    return ForceRecord(
        time, force, rng.normal(0, 0.001, (len(time), 3)), RATE, "FT1", "1/2/2024 3:04:05 PM", {}
    )


def options(file: str = "log.csv", **log: object) -> Force:
    """The section force of a dataset, checked as the configuration checks it."""
    configuration = {
        "file": file,
        "direction": [0.0],
        "tension": [1.0],
        "direction_bounds": [0.0, 1.0],
    }
    bounds = {
        "tension_std": [1.0],
        "kappa_bounds": [1.0, 2.0],
        "tension_std_bounds": [1.0, 2.0],
        "tension_bounds": [1.0, 2.0],
    }
    values = {"tare": TARE, "configurations": {"C1": configuration}, "log": log, **bounds}
    return validated(Force, values, "dataset.force")


def as_table(file, log: ForceRecord, *, milliseconds: bool = False) -> None:
    lines = ["t;Kraft x;Kraft y;Kraft z"]
    for time, row in zip(log.time.tolist(), log.force.tolist(), strict=True):
        lines.append(
            ";".join(
                repr(cell) for cell in [round(time * (1000 if milliseconds else 1), 6), *row]
            ).replace(".", ",")
        )
    file.write_text("\n".join([*lines, ""]))


TABLE = {
    "format": "table",
    "columns": {"t": "t", "fx": "Kraft x", "fy": "Kraft y", "fz": "Kraft z"},
    "force_unit": "N",
    "time_unit": "s",
}


@pytest.mark.parametrize("kind", ["daqft", "daqft comma", "netft", "table", "table in ms"])
def test_the_same_record_in_every_format_gives_the_same_table(tmp_path, kind):
    log, file = record(), tmp_path / "log.csv"
    force = options(format=kind.split()[0])
    if kind.startswith("daqft"):
        write_daqft(file, log, decimal="," if "comma" in kind else ".")
    elif kind == "netft":
        write_netft(file, log)
    else:
        as_table(file, log, milliseconds="ms" in kind)
        force = options(**TABLE | {"time_unit": kind.rpartition(" ")[2] if "ms" in kind else "s"})
    rows, quality = force_rows(tmp_path, "C1", force)
    loaded = log.time >= TARE
    np.testing.assert_allclose(rows["t"], log.time[loaded], rtol=0, atol=1e-9)
    alone = kind.startswith("table")  # of forces
    logged = log.force if alone else np.hstack([log.force, log.torque])
    axes = ["fx", "fy", "fz", "mx", "my", "mz"][: logged.shape[1]]
    assert list(rows) == ["configuration", "t", *axes]
    np.testing.assert_allclose(
        rows[axes], logged[loaded] - logged[~loaded].mean(axis=0), atol=1e-12
    )
    np.testing.assert_allclose(rows[axes[:3]].mean(), LOAD, atol=5e-3)
    bias = [row["value"] for row in quality if row["quantity"].startswith("bias")]
    np.testing.assert_allclose(bias, [*BIAS, 0, 0, 0][: len(axes)], atol=5e-3)
    # of the sensor's faults only those that there are
    assert not [
        row for row in quality if "frozen" in row["quantity"] or "saturated" in row["quantity"]
    ]


def test_a_load_beyond_the_full_scale_is_counted_or_refused_before_the_bias_is_taken_out(tmp_path):
    log = record()
    log.force[1000:1010, 2] = 9.0  # 2 N beside the bias, but all of the sensor's range
    write_daqft(tmp_path / "log.csv", log)
    _, quality = force_rows(tmp_path, "C1", options(full_scale=[9.0, 9.0, 9.0]))
    assert [row["value"] for row in quality if row["quantity"] == "saturated_samples"] == [10]
    with pytest.raises(RecordingError, match="10 of 2500 samples are saturated") as caught:
        force_rows(tmp_path, "C1", options(full_scale=[9.0, 9.0, 9.0], max_faulty=0.003))
    assert caught.value.evidence["file"] == tmp_path / "log.csv"


def test_moments_are_about_the_stated_point_whatever_the_bias(tmp_path):
    """A force at the point makes no moment about it, whatever it makes about the origin."""
    point, log = np.array([0.02, -0.03, 0.05]), record()
    offset = np.array([0.2, -0.1, 0.3])  # N·m, of the sensor
    log.torque[:] = np.cross(point, log.force - BIAS) + offset
    write_daqft(tmp_path / "log.csv", log)
    moments = {}
    for name, about in (("point", point.tolist()), ("origin", [0.0, 0.0, 0.0])):
        rows, _ = force_rows(tmp_path, "C1", replace(options(), point=about))
        moments[name] = rows[["mx", "my", "mz"]].to_numpy()
    np.testing.assert_allclose(moments["point"], 0, atol=1e-12)
    # the control
    np.testing.assert_allclose(moments["origin"].mean(axis=0), np.cross(point, LOAD), atol=1e-3)


def test_a_sensor_that_froze_is_refused_with_the_time_it_did(tmp_path):
    log = record()
    log.force[1500:], log.torque[1500:] = log.force[1500], log.torque[1500]
    write_daqft(tmp_path / "log.csv", log)
    with pytest.raises(RecordingError, match="frozen, the first at 6 s"):
        force_rows(tmp_path, "C1", options())


@pytest.mark.parametrize(
    "log",
    [
        {"full_scale": [1.0, 2.0]},
        {"full_scale": [1.0, 2.0, -3.0]},
        {"rate": 0.0},
        {"max_faulty": 1.0},
        {"frozen_after": 0.0},
        {"columns": {"force": 1}},
        {"columns": {"fx": [1]}},
    ],
)
def test_options_that_mean_nothing_are_refused(log):
    with pytest.raises(ConfigError, match=r"dataset\.force\.log"):
        options(**log)


def test_a_format_that_there_is_not_is_refused_with_those_that_there_are(tmp_path):
    with pytest.raises(ConfigError, match="'lvm'; there are bag, daqft, netft, table") as refused:
        force_rows(tmp_path, "C1", options(format="lvm"))
    assert refused.value.evidence["key"] == "dataset.force.log.format"


@pytest.mark.parametrize(
    "log", [{"separator": "tab"}, {"decimal": ";"}, {"separator": ",", "decimal": ","}]
)
def test_separators_that_are_none_are_refused(tmp_path, log):
    write_daqft(tmp_path / "log.csv", record())
    with pytest.raises(ConfigError, match=r"dataset\.force\.log"):
        force_rows(tmp_path, "C1", options(**log))
