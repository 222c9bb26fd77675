"""Joint logs in ROS bags: JointState messages, and states of trajectory controllers, which hold the
commanded and the measured values of one control cycle. Joints are read by name.
"""

from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.core.angles import unwrap
from pipeline.core.errors import RecordingError
from pipeline.formats import rosbag
from pipeline.formats.format import Format, Head, Kind, is_bag
from pipeline.formats.joints.log import (
    ANGLES,
    OPTION,
    JointLog,
    LogOptions,
    increasing,
)
from pipeline.formats.joints.names import named_like

JOINT_STATE = "sensor_msgs/msg/JointState"
CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"
JOINT_TYPES = (JOINT_STATE, CONTROLLER_STATE)
# signal → field of a JointState; other signals are in the field effort
FIELDS = {"speed": "velocity", "velocity": "velocity"}
FIELDS |= dict.fromkeys((*ANGLES, "position"), "position")
# field of a JointState → field of a JointTrajectoryPoint
POINT_FIELDS = {"position": "positions", "velocity": "velocities", "effort": "effort"}
# points of a controller's state, the field of newer versions of control_msgs first
COMMANDED_POINTS = ("reference", "desired")
MEASURED_POINTS = ("feedback", "actual")
COMMANDED_SIGNALS = ("target", "speed")


def read_joint_bag(file: Path, options: LogOptions) -> JointLog:
    """Return the signals in the bag ``file``, in rad and rad/s as the messages define. The option
    ``signals``, else the topic's name, assigns a topic to a signal. ``actual`` and ``target`` are
    positions, ``speed`` and ``velocity`` velocities, other signals efforts. In a controller's state
    ``target`` and ``speed`` are commanded, all other signals measured. Joints are read by
    name: the ``names`` of ``options``, by default the joints of the message with the most joints.

    Commands are interpolated at the times of measured angles. ``counts``: ``interpolated_rows``;
    ``rows_without_command`` (before the first or after the last command, left out);
    ``messages_of_other_joints`` (skipped); ``joints_without_values`` in any message (left out, if
    ``names`` does not name them); ``doubled_rows`` (left out); ``unwrapped_jumps`` of circular
    joints. Raises RecordingError for an unreadable bag, and for no topic or several; with
    the message's number (from 0), where a joint has no value or the time does not increase.
    """
    joints = tuple(options.names)
    counts = Counter()
    logs = {}
    for signal, topic in sorted(_topics(file, options).items()):
        log = _read_topic(file, topic, signal, joints)
        joints = log.joints
        values = log.signals[signal]
        counts += log.counts
        if signal in ANGLES:
            evidence = {"signal": signal, "file": file, "circular": options.circular}
            values, removed = unwrap(values, log.time, joints, **evidence)
            counts["unwrapped_jumps"] += removed
        logs[signal] = log.time, values

    time, measured = logs.pop("actual")
    commanded = np.ones(len(time), bool)
    interpolated = np.zeros(len(time), bool)
    signals = {"actual": measured}
    for signal, (stamps, values) in logs.items():
        commanded &= (stamps[0] <= time) & (time <= stamps[-1])
        interpolated |= ~np.isin(time, stamps)
        joint_values = [np.interp(time, stamps, joint) for joint in values.T]
        signals[signal] = np.column_stack(joint_values)
    if not commanded.any():
        raise RecordingError(
            f"no measured angle, from {time[0]:.10g} to {time[-1]:.10g} s by the headers, is "
            "within the times of the commands: record both by one clock",
            file=file,
        )
    repaired = {
        "interpolated_rows": int((interpolated & commanded).sum()),
        "rows_without_command": int((~commanded).sum()),
    }
    signals = {signal: rows[commanded] for signal, rows in signals.items()}
    time = time[commanded] - time[0]
    return JointLog(time, signals, dict(+counts) | repaired, joints)


def _topics(file: Path, options: LogOptions) -> dict[str, str]:
    """Return signal → topic by the options, else by :func:`_likely_topics`; always with
    ``actual``.
    """
    summary = rosbag.summary(file)
    types = {topic: kind for topic, (kind, count) in summary.topics.items() if count}
    present = sorted(topic for topic, kind in types.items() if kind in JOINT_TYPES)
    readable = {t: kind for t, kind in types.items() if t not in summary.passed_over}
    columns = {"actual": None} | dict(options.signals or {"target": None})
    chosen: dict[str, str] = {}
    # the command first: a controller's state holds the measured angles beside it
    for signal in sorted(columns, key=lambda name: name == "actual"):
        if columns[signal]:
            topics = [*columns[signal]]
        elif signal == "actual" and types.get(chosen.get("target")) == CONTROLLER_STATE:
            topics = [chosen["target"]]
        else:
            topics = _likely_topics(signal, readable)
        if len(topics) == 1 and topics[0] in present:
            chosen[signal] = topics[0]
        elif topics or signal == "actual":
            raise RecordingError(
                f"{len(topics)} topics could hold the {signal} values: name one of the topics "
                "of JointState or JointTrajectoryControllerState in signals: "
                f"{', '.join(present) or 'the bag has none'}",
                file=file,
                key=f"{OPTION}.signals",
            )
    return chosen


def _likely_topics(signal: str, types: dict[str, str]) -> Sequence[str]:
    """Return the topics of JointState that have the name of the ``signal`` (for measured angles,
    the only such topic), else the states of controllers.
    """
    if signal not in ANGLES:
        return []
    states = sorted(topic for topic, kind in types.items() if kind == JOINT_STATE)
    if signal == "actual" and len(states) == 1:
        return states
    named = named_like(signal, states)
    if named:
        return named
    controllers = {}  # some versions publish a state under two names below their own
    for topic, kind in sorted(types.items()):
        if kind == CONTROLLER_STATE:
            controllers[topic.rpartition("/")[0]] = topic
    return [*controllers.values()]


def _joint_values(message: object, signal: str) -> tuple[float, dict[str, float]]:
    """Return the time in s and joint → value of the ``signal``, NaN for a missing value."""
    field = FIELDS.get(signal, "effort")
    if hasattr(message, "joint_names"):  # the state of a controller
        joints = message.joint_names
        values = []
        commanded = signal in COMMANDED_SIGNALS
        for name in COMMANDED_POINTS if commanded else MEASURED_POINTS:
            point = getattr(message, name, None)
            numbers = getattr(point, POINT_FIELDS[field], ())
            if len(numbers) and not values:
                values = numbers.tolist()
    else:
        joints = message.name
        values = getattr(message, field).tolist()
    present = dict(zip(joints, values, strict=False))
    return rosbag.seconds(message), dict.fromkeys(joints, np.nan) | present


def _read_topic(
    file: Path,
    topic: str,
    signal: str,
    joints: tuple[str, ...],
) -> JointLog:
    """Return the ``signal`` of the ``joints`` (default the joints of the longest message)."""
    where = {"file": file, "topic": topic}
    samples = [*rosbag.messages(file, topic, partial(_joint_values, signal=signal))]
    messages = [values for _, values in samples]
    finite = {
        joint for values in messages for joint in values if np.isfinite(values[joint])
    }
    longest = joints or tuple(max(messages, key=len, default=()))
    # without names, wheels that have no position in any message are no joints of the arm
    joints = joints or tuple(joint for joint in longest if joint in finite)
    numbers = [n for n, values in enumerate(messages) if {*joints} & {*values}]
    if not numbers:
        present = sorted({joint for values in messages for joint in values})
        raise RecordingError(
            f"no message has the joints {', '.join(joints) or 'of an arm'}; the joints are "
            f"{', '.join(present) or 'none'}",
            key=f"{OPTION}.joints",
            **where,
        )

    rows = np.full((len(numbers), len(joints)), np.nan)
    for row, number in enumerate(numbers):
        rows[row] = [messages[number].get(joint, np.nan) for joint in joints]
    complete = np.isfinite(rows).all(axis=1)
    if not complete.all():
        row = int(complete.argmin())
        missing = ", ".join(np.array(joints)[~np.isfinite(rows[row])])
        field = FIELDS.get(signal, "effort")
        raise RecordingError(
            f"the message has no {field} of {missing} ({signal}): name the arm's joints alone",
            number=numbers[row],
            key=f"{OPTION}.joints",
            **where,
        )
    counts = {
        "messages_of_other_joints": len(samples) - len(numbers),
        "joints_without_values": len(longest) - len(joints),
    }
    time = np.array([samples[number][0] for number in numbers])
    log = JointLog(time, {signal: rows}, counts, joints)
    return increasing(log, lambda row: {"number": numbers[row], **where})


def _has_joints(head: Head) -> bool:
    """Return whether ``head`` is of a bag with a topic of joint values."""
    if not is_bag(head.file):
        return False
    try:
        types = rosbag.topics(head.file).values()
    except RecordingError:
        return False  # the error of the bag reader tells the reason
    return not {*types}.isdisjoint(JOINT_TYPES)


FORMAT = Format("joint states in a ROS bag", Kind.JOINTS, read_joint_bag, _has_joints)
