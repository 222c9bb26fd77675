"""Forces in ROS bags, and samples that a sensor did not measure: saturated, frozen, or a line of
settings.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from ros_bags import Message, write_bag
from written_logs import refusal

from pipeline.core.errors import RecordingError
from pipeline.formats.force.bag import WRENCH, read_force_bag
from pipeline.formats.force.daqft import read_daqft
from pipeline.formats.force.record import (
    ForceLogOptions,
    ForceRecord,
    frozen,
    read_force_table,
    saturated,
    sound_samples,
)

START = 1_700_000_000
VALUES = np.random.default_rng(8).normal(size=(20, 6))


def bag(folder: Path, picks=range(20), values: np.ndarray = VALUES, topics=("/ft/wrench",)) -> Path:
    """A ROS 2 bag of the ``picks`` of samples at 500 Hz on every topic."""
    samples = [(START + 0.002 * k, values[k].reshape(2, 3)) for k in picks]
    held = [Message(WRENCH[0], stamp, wrench=wrench) for stamp, wrench in samples]
    recorded = [(START + sent / 1e6, message) for sent, message in enumerate(held)]
    return write_bag(folder, "sqlite3", dict.fromkeys(topics, recorded))


def test_wrenches_of_a_bag_keep_their_numbers_and_the_times_of_their_headers(tmp_path):
    result = read_force_bag(bag(tmp_path))
    np.testing.assert_array_equal(np.hstack([result.force, result.torque]), VALUES)
    np.testing.assert_allclose(result.time, np.arange(20) / 500, rtol=0, atol=0.5e-6)
    assert result.rate == pytest.approx(500, rel=1e-3) and set(result.counts.values()) == {0}


def test_doubled_messages_and_gaps_are_counted(tmp_path):
    result = read_force_bag(bag(tmp_path, [0, 1, 1, 2, 3, 7, 8, 9, 10]))
    assert (result.counts["doubled_rows"], result.counts["missing_samples"]) == (1, 3)


def test_one_of_several_topics_is_chosen_by_the_option(tmp_path):
    file = bag(tmp_path, topics=("/left", "/right"))
    assert "2 topics of WrenchStamped" in refusal(read_force_bag, file).message
    result = read_force_bag(file, ForceLogOptions(topic="/right"))
    np.testing.assert_array_equal(result.force, VALUES[:, :3])


def test_values_that_are_not_finite_and_stamps_that_go_back_are_refused_by_sample(tmp_path):
    broken = VALUES.copy()
    broken[7, 4] = np.nan
    error = refusal(read_force_bag, bag(tmp_path, values=broken))
    assert "not finite" in error.message and error.evidence["sample"] == 7
    (tmp_path / "back").mkdir()
    error = refusal(read_force_bag, bag(tmp_path / "back", [0, 1, 2, 3, 4, 2, 6]))
    assert "goes back" in error.message and error.evidence["sample"] == 5


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
