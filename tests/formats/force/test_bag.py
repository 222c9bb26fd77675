"""Forces in ROS bags: numbers and times that were put in come out, gaps are counted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from ros_bags import Message, write_bag
from written_logs import refusal

from pipeline.formats.force.bag import WRENCH, read_force_bag
from pipeline.formats.force.record import ForceLogOptions

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
