"""From the log of any transducer to forces without its bias: the same whatever the format, with
faults named.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from written_logs import write_netft

from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.instruments import Force
from pipeline.core.validation import validated
from pipeline.formats.force.daqft import write_daqft
from pipeline.formats.force.record import ForceRecord
from pipeline.recordings.force import force_rows, remove_bias

RATE, TARE = 250.0, 2.0


BIAS, LOAD = np.array([0.4, -1.1, 7.0]), np.array([3.0, 5.0, 0.0])


def record(seconds: float = 10.0, seed: int = 2, noise: float = 0.01) -> ForceRecord:
    """A record whose first seconds are unloaded; noise 10 mN."""
    rng, time = np.random.default_rng(seed), np.arange(round(seconds * RATE)) / RATE
    force = BIAS + np.where(time[:, None] < TARE, 0, LOAD) + rng.normal(0, noise, (len(time), 3))
    return ForceRecord(
        time, force, rng.normal(0, 0.001, (len(time), 3)), RATE, "FT1", "1/2/2024 3:04:05 PM", {}
    )


def forces(seed: int, noise: float = 0.01) -> tuple[np.ndarray, np.ndarray]:
    """(N,) s and (N, 3) N of a record of other noise."""
    log = record(20.0, seed, noise)
    return log.time, log.force


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
    log.force[1500:], log.torque[1500:] = log.force[1500], log.torque[1500]
    write_daqft(tmp_path / "log.csv", log)
    with pytest.raises(RecordingError, match="frozen, the first at 6 s"):
        force_rows(tmp_path, "C1", options())


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


def test_the_loaded_force_comes_back_without_the_bias():
    time, force = forces(20)
    tared = remove_bias(time, force, TARE)
    samples = int(np.ceil(TARE * RATE))
    assert (
        tared.tare_samples == samples
        and len(tared.wrench) == len(time) - samples
        and tared.time[0] >= TARE
    )
    np.testing.assert_allclose(tared.bias, BIAS, atol=4.5 * 0.01 / np.sqrt(samples))
    np.testing.assert_allclose(tared.noise, 0.01, rtol=4.5 / np.sqrt(2 * samples))
    np.testing.assert_allclose(
        tared.wrench.mean(axis=0), [3.0, 5.0, 0.0], atol=6 * 0.01 / np.sqrt(samples)
    )
    np.testing.assert_array_equal(
        tared.wrench + tared.bias, (force[samples:] - tared.bias) + tared.bias
    )


def test_a_record_tared_by_its_instrument_is_left_as_it_is():
    time, force = forces(22)
    tared = remove_bias(time, force, 0.0)
    assert tared.wrench is force and tared.tare_samples == 0 and not tared.bias.any()


@pytest.mark.parametrize("tare_seconds", [0.02, 20.0, -1.0])
def test_an_interval_without_a_mean_or_a_record_without_a_rest_is_refused(tare_seconds):
    time, force = forces(23)
    with pytest.raises(RecordingError, match="tare interval"):
        remove_bias(time, force, tare_seconds)


def test_a_force_that_is_not_finite_is_refused_with_its_sample():
    time, force = forces(24)
    force[77, 1] = np.nan
    with pytest.raises(RecordingError, match="step 77"):
        remove_bias(time, force, TARE)


def test_a_clock_that_rounds_leaves_the_first_loaded_sample_out_of_the_mean():
    time, force = forces(39, noise=0.0)
    first = int(np.searchsorted(time, TARE))
    tare_seconds = time[first]
    time[first] -= 5e-7
    tared = remove_bias(time, force, tare_seconds)
    np.testing.assert_allclose(tared.bias, BIAS, rtol=1e-12)


@pytest.mark.parametrize(
    ("log", "words"),
    [
        ({"format": "lvm"}, "'lvm'; there are bag, daqft, netft, table"),
        ({"separator": "tab"}, "separator"),
        ({"decimal": ";"}, "decimal"),
        ({"separator": ",", "decimal": ","}, "decimal"),
    ],
)
def test_a_format_or_a_separator_that_there_is_not_is_refused(tmp_path, log, words):
    write_daqft(tmp_path / "log.csv", record())
    with pytest.raises(ConfigError, match=words) as refused:
        force_rows(tmp_path, "C1", options(**log))
    assert "dataset.force.log" in str(refused.value)
