"""Samples that a force sensor did not measure: saturated, frozen, or a line of settings."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.errors import RecordingError
from pipeline.formats.force.daqft import read_daqft
from pipeline.formats.force.record import (
    ForceLogOptions,
    ForceRecord,
    frozen,
    read_force_table,
    saturated,
    sound_samples,
)

RATE = 100.0
LABELS = '"Force X (N)","Force Y (N)","Force Z (N)","Frequency = 1000","Averaging Level = 1"\n'
COLUMNS = ForceLogOptions({"fx": 0, "fy": 1, "fz": 2}, force_unit="N", rate=1000.0)


def record(samples: int = 1000, *, torque: bool = True) -> ForceRecord:
    values = np.random.default_rng(6).normal(size=(samples, 6))
    torques = values[:, 3:] if torque else np.full((samples, 3), np.nan)
    return ForceRecord(np.arange(samples) / RATE, values[:, :3], torques, RATE, "", "", {})


@pytest.mark.parametrize("torque", [True, False])
def test_samples_at_or_beyond_full_scale_of_any_axis_are_saturated(torque):
    log = record(torque=torque)
    assert not saturated(log, np.full(6, 10.0)).any()
    log.force[[10, 11], [0, 2]] = [10.0, -12.0]
    log.torque[20] = 11.0
    assert np.flatnonzero(saturated(log, np.full(6, 10.0))).tolist() == [10, 11, 20]
    assert np.flatnonzero(saturated(log, np.full(3, 10.0))).tolist() == [10, 11]


@pytest.mark.parametrize("torque", [True, False])
@pytest.mark.parametrize(("start", "length"), [(0, 52), (300, 52), (948, 52), (300, 51)])
def test_identical_samples_that_last_longer_than_the_limit_are_frozen(torque, start, length):
    log = record(torque=torque)
    log.force[start : start + length] = log.force[start]
    log.torque[start : start + length] = log.torque[start]
    expected = range(start, start + length) if length > 51 else []
    assert np.flatnonzero(frozen(log, 0.5)).tolist() == [*expected]
    # one axis that still moves is a sensor that works
    log.force[:, 2] = np.random.default_rng(7).normal(size=len(log.force))
    assert not frozen(log, 0.5).any()


def test_faults_are_counted_up_to_the_stated_share_and_refused_beyond_it():
    log, scale = record(), np.full(6, 10.0)
    sound, result = sound_samples(log, scale, 0.5, 0.0, file="log.csv")
    assert sound.all() and result == {}
    log.force[100:160], log.torque[100:160] = log.force[100], log.torque[100]
    log.force[5, 1] = 40.0
    sound, result = sound_samples(log, scale, 0.5, 0.06, file="log.csv")
    assert result == {"frozen_samples": 60, "saturated_samples": 1} and (~sound).sum() == 61
    assert sound_samples(log, None, 0.5, 0.06, file="log.csv")[1] == {"frozen_samples": 60}
    words = "60 of 1000 samples are frozen, the first at 1 s"
    with pytest.raises(RecordingError, match=words) as caught:
        sound_samples(log, scale, 0.5, 0.059, file="log.csv")
    assert caught.value.evidence == {"file": "log.csv", "key": "dataset.force.log.frozen_after"}
    log.force[:100, 1] = 40.0
    with pytest.raises(RecordingError, match="saturated"):
        sound_samples(log, scale, 0.5, 0.06, file="log.csv")


@pytest.mark.parametrize("read", [read_daqft, lambda file: read_force_table(file, COLUMNS)])
def test_a_line_of_settings_below_a_header_is_no_record(tmp_path, read):
    file = tmp_path / "log.csv"
    file.write_text(LABELS + '"150","75","500"\n')
    with pytest.raises(RecordingError, match="the first is 150, 75, 500 N"):
        sound_samples(read(file), None, 0.5, 0.01, file=file)
    # the control: a record
    file.write_text(LABELS + "".join(f'"1.{k}","2","3"\n' for k in range(10)))
    assert sound_samples(read(file), None, 0.5, 0.01, file=file)[0].all()
