"""Joint states in ROS bags of both versions: joints by name, commands at the times of the measured
angles, refused where either is not there.
"""

from __future__ import annotations

import numpy as np
import pytest
from ros_bags import Message, image, write_bag

from pipeline.core.errors import RecordingError
from pipeline.formats.joints.bag import JOINT_STATE, read_joint_bag
from pipeline.formats.joints.log import LogOptions
from pipeline.recordings.movement import read_movement
from pipeline.tools.inspect.examine import inspect

NONE = np.zeros(0)


def state(stamp: float, *, names: tuple[str, ...] = ("a", "b"), turned: float = 0.0) -> Message:
    """Angles that grow by 1 and 2 rad a second; of ``names``, a then b, in their order."""
    angle = {"a": stamp - 1 + turned, "b": 2 * (stamp - 1) + turned}
    held = np.array([angle.get(name, np.nan) for name in names])
    return Message(JOINT_STATE, stamp, name=list(names), position=held, velocity=NONE, effort=NONE)


def states(late: float = 0.0, **fields: object) -> list[tuple[float, Message]]:
    stamps = 1 + np.arange(6) / 100 + late
    return [(stamp, state(stamp, **fields)) for stamp in stamps]


@pytest.mark.parametrize("form", ["ros1", "sqlite3", "mcap"])
def test_commands_are_interpolated_at_the_times_of_the_measured_angles(tmp_path, form):
    recorded = {"/joint_states": states(), "/joint_commands": states(0.004, names=("b", "a"))}
    bag = write_bag(tmp_path, form, recorded)
    angles, counts = read_movement({bag: LogOptions(joints=2, names=("a", "b"))}, 100.0)
    # the first measured angles come before the first command
    np.testing.assert_allclose(angles["actual"], angles["target"], atol=1e-12)
    np.testing.assert_allclose(angles["actual"][:, 1], 0.02 * np.arange(1, 6), atol=1e-12)
    assert (counts["interpolated_rows"], counts["rows_without_command"]) == (5, 1)


@pytest.mark.parametrize(
    ("recorded", "words"),
    [
        ({"/joint_commands": states()}, "no one topic for the actual angles"),
        ({"/joint_states": [], "/arm/joint_states": []}, "no one topic"),
        ({"/joint_states": [*states(), states()[0]]}, "does not increase"),
        ({"/joint_states": [*states(names=("b",)), (2.0, state(2.0, names=("a",)))]}, "value of b"),
        ({"/joint_states": states(), "/joint_commands": states(9.0)}, "no command stands"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path, recorded, words):
    for number, (topic, held) in enumerate(recorded.items()):
        # messages are read in the order of their recording
        recorded[topic] = [(1 + number + k / 100, message) for k, (_, message) in enumerate(held)]
    bag = write_bag(tmp_path, "ros1", recorded, kinds=dict.fromkeys(recorded, JOINT_STATE))
    with pytest.raises(RecordingError, match=words):
        read_joint_bag(bag, LogOptions())


def test_other_joints_than_the_option_names_are_refused(tmp_path):
    bag = write_bag(tmp_path, "ros1", {"/joint_states": states(), "/joint_commands": states()})
    with pytest.raises(RecordingError, match="states its joints as a, b"):
        read_movement({bag: LogOptions(joints=2, names=("b", "a"))}, 100.0)


def test_inspect_takes_a_bag_for_a_joint_log_where_nothing_else_in_it_is_analysed(tmp_path):
    recorded = {"/joint_states": states(), "/joint_commands": states()}
    (finding,) = inspect(write_bag(tmp_path, "ros1", recorded))
    assert (finding.kind, finding.facts["joint_names"]) == ("joints", ["a", "b"])
    frames = [(1.0, image(np.full((2, 2), 900, np.uint16), 1.0))]
    (tmp_path / "seen").mkdir()
    (finding,) = inspect(write_bag(tmp_path / "seen", "ros1", recorded | {"/depth": frames}))
    assert finding.kind == "bag"
