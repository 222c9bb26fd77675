"""From the log of any transducer to forces without its bias, with faults named."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from written_logs import write_netft

from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.dataset import Force
from pipeline.core.validation import validated
from pipeline.formats.force.daqft import write_daqft
from pipeline.formats.force.record import ForceRecord
from pipeline.recordings.force import force_rows, remove_bias

# 1/s, s, N
RATE = 250.0
TARE = 2.0
NOISE = 0.01
BIAS = np.array([0.4, -1.1, 7.0])
LOAD = np.array([3.0, 5.0, 0.0])
ARRANGED = {
    "file": "log.csv",
    "direction": [0.0],
    "tension": [1.0],
    "direction_bounds": [0, 1],
}
BOUNDS = {
    name: [1.0, 2.0]
    for name in ("kappa_bounds", "tension_std_bounds", "tension_bounds")
}


def record(seconds: float = 10.0, seed: int = 2, noise: float = NOISE) -> ForceRecord:
    """A record whose first seconds are unloaded."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * RATE)) / RATE
    size = len(time), 3
    force = BIAS + rng.normal(0, noise, size)
    force[time >= TARE] += LOAD
    torque = rng.normal(0, 0.001, size)
    return ForceRecord(time, force, torque, RATE, "FT1", "1/2/2024 3:04:05 PM", {})


def options(**log: object) -> Force:
    """The section force of a dataset, checked as the configuration checks it."""
    values = {
        "tare": TARE,
        "configurations": {"C1": ARRANGED},
        "tension_std": [1.0],
        "log": log,
    }
    return validated(Force, values | BOUNDS, "dataset.force")


@pytest.mark.parametrize("netft", [False, True])
def test_a_record_gives_the_loaded_samples_without_their_bias(tmp_path, netft):
    log = record()
    write = write_netft if netft else write_daqft
    write(tmp_path / "log.csv", log)
    section = options(format="netft" if netft else "daqft")

    rows, quality = force_rows(tmp_path, "C1", section)

    loaded = log.time >= TARE
    logged = np.hstack([log.force, log.torque])
    assert_allclose(rows["t"], log.time[loaded], rtol=0, atol=1e-9)
    axes = ["fx", "fy", "fz", "mx", "my", "mz"]
    assert list(rows) == ["configuration", "t", *axes]

    expected = logged[loaded] - logged[~loaded].mean(axis=0)
    assert_allclose(rows[axes], expected, atol=1e-12)
    assert_allclose(rows[axes[:3]].mean(), LOAD, atol=5e-3)

    counts = pd.DataFrame(quality).set_index("quantity")["value"]
    bias = counts[counts.index.str.startswith("bias")]
    assert_allclose(bias, [*BIAS, 0, 0, 0], atol=5e-3)
    # of the sensor's faults only those that there are
    assert not counts.index.str.contains("frozen|saturated").any()


def test_a_record_that_its_instrument_tared_stays_as_it_is():
    log = record()
    _, untouched, bias = remove_bias(log.time, log.force, 0.0)
    assert untouched is log.force and not bias.any()


def test_moments_are_about_the_stated_point_whatever_the_bias(tmp_path):
    """A force at the point makes no moment about it, whatever it makes about the origin."""
    point = np.array([0.02, -0.03, 0.05])
    log = record()
    offset = np.array([0.2, -0.1, 0.3])  # N·m, of the sensor
    log.torque[:] = np.cross(point, log.force - BIAS) + offset
    write_daqft(tmp_path / "log.csv", log)
    moments = []
    for about in (point.tolist(), [0.0, 0.0, 0.0]):
        rows, _ = force_rows(tmp_path, "C1", replace(options(), point=about))
        moments.append(rows[["mx", "my", "mz"]].to_numpy())

    assert_allclose(moments[0], 0, atol=1e-12)
    # the control: about the origin
    about_origin = moments[1].mean(axis=0)
    assert_allclose(about_origin, np.cross(point, LOAD), atol=1e-3)


@pytest.mark.parametrize("tare_seconds", [0.02, 20.0, -1.0])
def test_an_interval_without_a_mean_or_a_record_without_a_rest_is_refused(tare_seconds):
    log = record(20.0, 23)
    with pytest.raises(RecordingError, match="tare interval"):
        remove_bias(log.time, log.force, tare_seconds)


@pytest.mark.parametrize(
    ("log", "words"),
    [
        ({"format": "lvm"}, "'lvm'; set one of bag, daqft, netft, table"),
        ({"separator": "tab"}, "separator"),
        ({"separator": ",", "decimal": ","}, "decimal"),
    ],
)
def test_a_format_or_a_separator_that_there_is_not_is_refused(tmp_path, log, words):
    write_daqft(tmp_path / "log.csv", record())
    with pytest.raises(ConfigError, match=words) as refused:
        force_rows(tmp_path, "C1", options(**log))
    assert "dataset.force.log" in str(refused.value)
