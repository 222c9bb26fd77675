"""Forces in ROS bags: numbers and times that were put in come out, gaps are counted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_typestore

from pipeline.core.errors import RecordingError
from pipeline.formats.force.bag import WRENCH, read_force_bag
from pipeline.formats.force.record import ForceLogOptions

STORE = get_typestore(Stores.ROS2_HUMBLE)
START = 1_700_000_000
VALUES = np.random.default_rng(8).normal(size=(20, 6))


def bag(folder: Path, picks=range(20), values: np.ndarray = VALUES, topics=("/ft/wrench",)) -> Path:
    """A ROS 2 bag of the ``picks`` of samples at 500 Hz on every topic."""
    (kind,) = WRENCH
    time, vector, wrench, header, message = (
        STORE.types[name]
        for name in (
            "builtin_interfaces/msg/Time",
            "geometry_msgs/msg/Vector3",
            "geometry_msgs/msg/Wrench",
            "std_msgs/msg/Header",
            kind,
        )
    )
    with Writer(folder / "bag", version=8) as writer:
        for topic in topics:
            connection = writer.add_connection(topic, kind, typestore=STORE)
            for sent, k in enumerate(picks):
                stamp = time(sec=START, nanosec=2_000_000 * k)
                parts = (vector(*part) for part in values[k].reshape(2, 3).tolist())
                one = message(header(stamp=stamp, frame_id="sensor"), wrench(*parts))
                writer.write(connection, START * 10**9 + sent, STORE.serialize_cdr(one, kind))
    return folder / "bag"


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
    with pytest.raises(RecordingError, match="2 topics of WrenchStamped"):
        read_force_bag(file)
    result = read_force_bag(file, ForceLogOptions(topic="/right"))
    np.testing.assert_array_equal(result.force, VALUES[:, :3])


def test_values_that_are_not_finite_and_stamps_that_go_back_are_refused_by_sample(tmp_path):
    broken = VALUES.copy()
    broken[7, 4] = np.nan
    with pytest.raises(RecordingError, match="not finite") as caught:
        read_force_bag(bag(tmp_path, values=broken))
    assert caught.value.evidence["sample"] == 7
    (tmp_path / "back").mkdir()
    with pytest.raises(RecordingError, match="goes back") as caught:
        read_force_bag(bag(tmp_path / "back", [0, 1, 2, 3, 4, 2, 6]))
    assert caught.value.evidence["sample"] == 5
