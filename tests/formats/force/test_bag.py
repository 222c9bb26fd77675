from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_typestore

from pipeline.core.errors import RecordingError
from pipeline.formats.force.bag import read_force_bag
from pipeline.formats.force.record import ForceLogOptions

STORE = get_typestore(Stores.ROS2_HUMBLE)
START = 1_700_000_000
VALUES = np.random.default_rng(8).normal(size=(20, 6))


def bag(
    folder,
    values: np.ndarray = VALUES,
    stamps: np.ndarray | None = None,
    topics: tuple[str, ...] = ("/ft/wrench",),
):
    """A ROS 2 bag of the samples at 500 Hz on every topic."""
    kinds = STORE.types
    stamps = np.arange(len(values)) * 2_000_000 if stamps is None else stamps
    with Writer(folder / "bag", version=8) as writer:
        for topic in topics:
            connection = writer.add_connection(
                topic, "geometry_msgs/msg/WrenchStamped", typestore=STORE
            )
            for sent, (stamp, row) in enumerate(zip(stamps.tolist(), values.tolist(), strict=True)):
                time = kinds["builtin_interfaces/msg/Time"](
                    sec=START + stamp // 10**9, nanosec=stamp % 10**9
                )
                force, torque = (
                    kinds["geometry_msgs/msg/Vector3"](*part) for part in (row[:3], row[3:])
                )
                wrench = kinds["geometry_msgs/msg/Wrench"](force=force, torque=torque)
                header = kinds["std_msgs/msg/Header"](stamp=time, frame_id="sensor")
                message = kinds["geometry_msgs/msg/WrenchStamped"](header=header, wrench=wrench)
                writer.write(
                    connection,
                    START * 10**9 + sent,
                    STORE.serialize_cdr(message, "geometry_msgs/msg/WrenchStamped"),
                )
    return folder / "bag"


def test_wrenches_of_a_bag_keep_their_numbers_and_the_times_of_their_headers(tmp_path):
    result = read_force_bag(bag(tmp_path))
    np.testing.assert_array_equal(np.hstack([result.force, result.torque]), VALUES)
    np.testing.assert_allclose(result.time, np.arange(20) / 500, rtol=0, atol=0.5e-6)
    assert result.rate == pytest.approx(500, rel=1e-3) and set(result.counts.values()) == {0}


def test_doubled_messages_and_gaps_are_counted(tmp_path):
    picks = [0, 1, 1, 2, 3, 7, 8, 9, 10]
    result = read_force_bag(bag(tmp_path, VALUES[picks], np.array(picks) * 2_000_000))
    np.testing.assert_array_equal(result.force, VALUES[sorted(set(picks)), :3])
    assert (result.counts["doubled_rows"], result.counts["missing_samples"]) == (1, 3)


def test_one_of_several_topics_is_chosen_by_the_option(tmp_path):
    file = bag(tmp_path, topics=("/left", "/right"))
    with pytest.raises(RecordingError, match="/left"):
        read_force_bag(file)
    assert (
        len(read_force_bag(file, dataclasses.replace(ForceLogOptions(), topic="/left")).time) == 20
    )


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_values_that_are_not_finite_are_refused_with_their_sample(tmp_path, value):
    broken = VALUES.copy()
    broken[7, 2] = value
    with pytest.raises(RecordingError, match="not finite") as caught:
        read_force_bag(bag(tmp_path, broken))
    assert caught.value.evidence["sample"] == 7


def test_stamps_that_go_back_are_refused_with_their_sample(tmp_path):
    stamps = np.arange(20) * 2_000_000
    stamps[[4, 5]] = stamps[[5, 4]]
    with pytest.raises(RecordingError, match="goes back") as caught:
        read_force_bag(bag(tmp_path, VALUES, stamps))
    assert caught.value.evidence["sample"] == 5
