"""Bags of both ROS versions: topics, messages, joint states by name, and what is refused."""

import re
from pathlib import Path

import numpy as np
import pytest
from case_tables import cases_beside
from numpy.testing import assert_allclose, assert_array_equal
from ros_bags import CONTROLLER_STATE, Message, image, write_bag
from rosbags.highlevel import AnyReader
from sample_options import made
from source_code import ROOT
from written_logs import refusal

from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.dataset import JointLogSection
from pipeline.formats.format import is_bag
from pipeline.formats.joints.bag import JOINT_STATE, read_joint_bag
from pipeline.formats.joints.log import LogOptions
from pipeline.formats.rosbag import choose_topic, messages, seconds, summary, topics
from pipeline.recordings.movement import read_logged_movement, read_movement
from pipeline.tools.inspect.command import inspect

cases = cases_beside(__file__)
CASES = ROOT.parent / "shared/cases"
IMAGE = "sensor_msgs/msg/Image"
INFO = "sensor_msgs/msg/CameraInfo"
PIXELS = np.arange(12, dtype=np.uint16).reshape(3, 4)
START = 1700000000.0
FORMS = (
    "ros1",
    "ros1_lz4",
    "ros1_bz2",
    "sqlite3",
    "zstd",
    "zstd_file",
    "mcap",
    "mcap_zstd",
)


def first(message: object) -> tuple[float, int]:
    return seconds(message), int(message.data.view("<u2")[0])


def read_all(bag: Path) -> list[tuple[float, int]]:
    return [*messages(bag, "/depth", first)]


def recorded(folder: Path, form: str, count: int = 5) -> Path:
    depth = []
    colour = []
    for number in range(count):
        stamp = START + 0.04 * number
        depth.append((stamp, image(PIXELS + number, stamp)))
        colour.append((stamp + 0.001, image(PIXELS, stamp)))
    topics = {"/depth": depth, "/colour": colour, "/empty": []}
    return write_bag(folder, form, topics, kinds={"/empty": IMAGE})


@pytest.mark.parametrize("form", FORMS)
def test_messages_come_in_order_with_the_time_of_their_headers(tmp_path, form):
    bag = recorded(tmp_path, form)
    assert is_bag(bag) and topics(bag) == {"/depth": IMAGE, "/colour": IMAGE}

    stamps, pixels = zip(*messages(bag, "/depth", first), strict=True)
    assert_allclose(stamps, START + 0.04 * np.arange(5), rtol=0, atol=1e-6)
    assert pixels == (0, 1, 2, 3, 4)


@pytest.mark.parametrize("form", FORMS)
def test_a_cut_bag_is_refused(tmp_path, form):
    bag = recorded(tmp_path, form)
    files = [bag] if bag.is_file() else [*bag.glob("take*")]
    content = files[0].read_bytes()
    for share in (0.0, 0.3, 0.6):
        files[0].write_bytes(content[: int(share * len(content))])
        refusal(read_all, bag)


def test_a_topic_is_the_only_one_or_the_chosen_one(tmp_path):
    bag = recorded(tmp_path, "ros1")
    assert choose_topic(bag, (IMAGE,), "/depth") == "/depth"

    there = r"there are /colour \(Image\), /depth \(Image\)"
    choices = [(IMAGE, None), (INFO, None), (IMAGE, "/elsewhere"), (INFO, "/depth")]
    for kind, chosen in choices:
        error = refusal(choose_topic, bag, (kind,), chosen)
        assert re.search(there, error.message)
    with pytest.raises(RecordingError, match="no topic '/else'"):
        next(messages(bag, "/else", first))


@cases("no bags")
def test_files_that_are_no_bags_are_refused(tmp_path, file, text):
    place = tmp_path / file
    place.parent.mkdir(exist_ok=True)
    place.write_text(text)
    bag = place.parent if place.name == "metadata.yaml" else place
    refusal(topics, bag)


def test_an_absent_file_and_a_folder_are_no_bags(tmp_path):
    refusal(topics, tmp_path / "absent.bag")
    assert not is_bag(tmp_path / "absent.bag") and not is_bag(tmp_path)


@cases("counts")
def test_a_bag_that_lost_a_message_or_does_not_count_them_is_refused(
    tmp_path,
    count,
    words,
):
    metadata = recorded(tmp_path, "sqlite3") / "metadata.yaml"
    text = metadata.read_text()
    assert text.count("message_count: 5") == 2
    metadata.write_text(text.replace("message_count: 5", f"message_count:{count}"))
    assert words in refusal(read_all, metadata.parent).message


NONE = np.zeros(0)
AB = LogOptions(joints=2, names=("a", "b"))


def state(
    stamp: float,
    *,
    names: tuple[str, ...] = ("a", "b"),
    turned: float = 0.0,
    **fields: np.ndarray,
) -> Message:
    """Angles that grow by 1 and 2 rad a second; of ``names``, a then b, in their order."""
    time = stamp - 1
    angles = {"a": time + turned, "b": 2 * time + turned, "finger": 0.02}
    position = np.array([angles.get(name, np.nan) for name in names])
    fields = {"velocity": NONE, "effort": NONE} | fields
    return Message(JOINT_STATE, stamp, name=list(names), position=position, **fields)


def states(late: float = 0.0, **fields: object) -> list[tuple[float, Message]]:
    stamps = 1 + np.arange(6) / 100 + late
    return [(stamp, state(stamp, **fields)) for stamp in stamps]


@pytest.mark.parametrize("form", ["ros1", "sqlite3", "mcap"])
def test_commands_are_interpolated_at_the_times_of_the_measured_angles(tmp_path, form):
    recorded = {
        "/joint_states": states(),
        "/joint_commands": states(0.004, names=("b", "a")),
    }
    bag = write_bag(tmp_path, form, recorded)

    angles, counts = read_movement({bag: AB}, 100.0)

    # the first measured angles come before the first command
    assert_allclose(angles["actual"], angles["target"], atol=1e-12)
    assert_allclose(angles["actual"][:, 1], 0.02 * np.arange(1, 6), atol=1e-12)
    assert (counts["interpolated_rows"], counts["rows_without_command"]) == (5, 1)


FINGER = [
    (stamp - 0.001, state(stamp - 0.001, names=("finger",))) for stamp, _ in states()
]
TURNS = [(t, state(t, names=("ab", "ba")[k % 2])) for k, (t, _) in enumerate(states())]
BETWEEN = sorted([*FINGER, *states(0.002)], key=lambda message: message[0])
TWICE = sorted([*states(), *states()[2:4]], key=lambda message: message[0])
MEASURED = {
    "control": (states(), {}),
    "gripper first": (FINGER + states(), {"messages_of_other_joints": 6}),
    "gripper between": (BETWEEN, {"messages_of_other_joints": 6}),
    "twice": (TWICE, {"doubled_rows": 2}),
    "order changes": (TURNS, {}),
}


@pytest.mark.parametrize("options", [AB, LogOptions()])
@pytest.mark.parametrize("name", MEASURED)
def test_what_other_publishers_send_is_passed_over_and_repeated_messages_are_dropped(
    tmp_path,
    options,
    name,
):
    measured, counted = MEASURED[name]
    recorded = {"/joint_states": measured, "/joint_commands": states(-0.001)}
    bag = write_bag(tmp_path, "ros1", recorded)

    log = read_joint_bag(bag, options)

    assert log.joints == ("a", "b")
    assert_allclose(log.signals["actual"][:, 1], 2 * log.signals["actual"][:, 0])

    names = ("messages_of_other_joints", "doubled_rows")
    assert {name: log.counts[name] for name in names if name in log.counts} == counted


@pytest.mark.parametrize(
    "kind",
    ["std_msgs/msg/Float64MultiArray", "trajectory_msgs/msg/JointTrajectory"],
)
def test_a_topic_that_may_have_the_command_is_named_as_not_read_with_the_remedy(
    tmp_path,
    kind,
):
    held = {"/joint_states": states(), "/commands": []}
    bag = write_bag(tmp_path, "sqlite3", held, kinds={"/commands": kind})
    words = f"{kind.rpartition('/')[2]} is not read.*publish them as JointState"
    assert re.search(words, summary(bag).passed_over["/commands"])

    options = made(JointLogSection, joints=["a", "b"])
    with pytest.raises(ConfigError, match=f"target angles of run; /commands: {words}"):
        read_logged_movement("run", bag, options, 100.0)


OLD_POINTS = ("desired", "actual")
NEW_POINTS = ("reference", "feedback")


def controller_states(
    points: tuple[str, str] = OLD_POINTS,
    late: float = 0.0,
) -> list[tuple[float, Message]]:
    """States of a controller of the joints b and a: commands as of :func:`states`, at 1 and 2
    rad/s; angles measured 0.1 rad below.
    """
    recorded = []
    for stamp, message in states(late, names=("b", "a")):
        commanded = message.fields["position"]
        fields = {
            points[0]: {"positions": commanded, "velocities": np.array([2.0, 1.0])},
            points[1]: {"positions": commanded - 0.1, "effort": np.array([6.0, 5.0])},
        }
        names = ["b", "a"]
        state = Message(CONTROLLER_STATE, stamp, joint_names=names, **fields)
        recorded.append((stamp, state))
    return recorded


CONTROLLERS = {  # form of the bag, points with values, topics beside /arm/state
    "ROS 1": ("ros1", OLD_POINTS, {}),
    "newer points": ("mcap", NEW_POINTS, {}),
    "joint states beside it": ("mcap", OLD_POINTS, {"/joint_states": states(0.004)}),
    "two names": ("sqlite3", OLD_POINTS, {"/arm/c_state": controller_states()}),
}


@pytest.mark.parametrize("name", CONTROLLERS)
def test_the_state_of_a_controller_has_the_command_and_the_measured_angles(
    tmp_path,
    name,
):
    form, points, beside = CONTROLLERS[name]
    recorded = {"/arm/state": controller_states(points)} | beside
    log = read_joint_bag(write_bag(tmp_path, form, recorded), AB)
    commanded = np.outer(np.arange(6) / 100, [1.0, 2.0])

    assert_allclose(log.signals["target"], commanded, atol=1e-12)
    assert_allclose(log.signals["actual"], commanded - 0.1, atol=1e-12)
    assert (log.joints, log.counts["interpolated_rows"]) == (("a", "b"), 0)


def test_commands_of_a_controller_are_interpolated_at_chosen_measured_angles(tmp_path):
    recorded = {"/arm/state": controller_states(), "/joint_states": states(0.004)}
    signals = {name: ["/arm/state"] for name in ("target", "speed", "torque")}
    signals["actual"] = ["/joint_states"]
    bag = write_bag(tmp_path, "mcap", recorded)

    log = read_joint_bag(bag, LogOptions(names=("a", "b"), signals=signals))

    assert_allclose(log.signals["target"], log.signals["actual"], atol=1e-9)
    assert log.signals["speed"].tolist() == [[1, 2]] * 5
    assert log.signals["torque"].tolist() == [[5, 6]] * 5


@pytest.mark.parametrize("run", ["run_1", "run_2"])
def test_the_public_case_of_a_controller_state_is_read_as_rosbags_reads_it(run):
    case = CASES / "45-commands-in-controller-state" / run
    if not case.is_dir():
        pytest.skip("the cases are not beside the project")
    log = read_joint_bag(case, LogOptions())
    topic = "/scaled_pos_joint_traj_controller/state"
    desired = []
    actual = []
    with AnyReader([case]) as reader:
        chosen = [c for c in reader.connections if c.topic == topic]
        for connection, _, content in reader.messages(chosen):
            message = reader.deserialize(content, connection.msgtype)
            desired.append(message.desired.positions)
            actual.append(message.actual.positions)

    assert_array_equal(log.signals["target"], desired)
    assert_array_equal(log.signals["actual"], actual)


def test_efforts_and_velocities_are_read_as_what_they_are(tmp_path):
    fields = {"velocity": np.array([1.0, 2.0]), "effort": np.array([5.0, 6.0])}
    bag = write_bag(tmp_path, "ros1", {"/joint_states": states(**fields)})
    options = LogOptions(
        signals={k: ["/joint_states"] for k in ("actual", "speed", "torque")},
    )

    log = read_joint_bag(bag, options)

    assert log.signals["speed"].tolist() == [[1, 2]] * 6
    assert log.signals["torque"].tolist() == [[5, 6]] * 6

    bag = write_bag(tmp_path, "sqlite3", {"/joint_states": states()})
    with pytest.raises(RecordingError, match=r"no velocity of a, b \(speed\)"):
        read_joint_bag(bag, options)


def test_a_wrapped_command_is_unwrapped_before_it_is_interpolated(tmp_path):
    wrapped = states(0.004)
    for _, message in wrapped:
        angles = message.fields["position"] + 3.1
        message.fields["position"] = (angles + np.pi) % (2 * np.pi) - np.pi
    bag = write_bag(
        tmp_path,
        "ros1",
        {"/joint_states": states(turned=3.1), "/joint_commands": wrapped},
    )

    signals, counts = read_movement({bag: AB}, 100.0)

    assert_allclose(signals["actual"], signals["target"], atol=1e-9)
    assert counts["unwrapped_jumps"] == 2


REFUSED = [
    (
        {"/joint_states": states(), "/arm/joint_states": states()},
        AB,
        "2 topics could hold",
    ),
    (
        {"/arm/state": controller_states(), "/hand/state": controller_states()},
        AB,
        "2 topics could hold the target values: .*: /arm/state, /hand/state",
    ),
    ({"/joint_states": [], "/arm/joint_states": []}, AB, "the bag has none"),
    ({"/joint_states": [*states(), states()[0]]}, AB, "does not increase"),
    (
        {"/joint_states": [*states(), (1.05, state(1.05, turned=0.1))]},
        AB,
        "does not increase",
    ),
    (
        {"/joint_states": [*states(), (2.0, state(2.0, names=("a",)))]},
        AB,
        "no position of b",
    ),
    (
        {"/joint_states": states()},
        LogOptions(names=("c",)),
        "joints c; the joints are a, b",
    ),
    (
        {"/joint_states": states(), "/joint_commands": states(9.0)},
        AB,
        "no measured angle",
    ),
]


@pytest.mark.parametrize(("recorded", "options", "words"), REFUSED)
def test_what_does_not_fit_is_refused(tmp_path, recorded, options, words):
    for number, (topic, held) in enumerate(recorded.items()):
        # messages are read in the order of their recording
        recorded[topic] = [
            (1 + number + k / 100, message) for k, (_, message) in enumerate(held)
        ]
    bag = write_bag(
        tmp_path,
        "ros1",
        recorded,
        kinds=dict.fromkeys(recorded, JOINT_STATE),
    )
    with pytest.raises(RecordingError, match=words):
        read_joint_bag(bag, options)


def test_inspect_takes_a_bag_for_a_joint_log_where_nothing_else_in_it_is_analysed(
    tmp_path,
):
    recorded = {"/joint_states": states(), "/joint_commands": states()}
    for _, message in recorded["/joint_states"]:  # of a mobile robot
        message.fields["name"] = [*message.fields["name"], "wheel"]
        message.fields["position"] = np.append(message.fields["position"], np.nan)
    (finding,) = inspect(write_bag(tmp_path, "ros1", recorded))

    assert (finding.kind, finding.facts["joint_names"]) == ("joints", ["a", "b"])
    assert finding.gaps["joints_without_values"] == 1

    recorded |= {"/depth": [(1.0, image(np.full((2, 2), 900, np.uint16), 1.0))]}
    (finding,) = inspect(write_bag(tmp_path, "sqlite3", recorded))
    assert finding.kind == "bag"
