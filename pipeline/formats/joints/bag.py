"""Joint angles in ROS bags: messages of the type JointState, in rad and rad/s by the definition of
the type; one topic has the measured angles, another the commanded ones.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from pipeline.core.angles import unwrapped
from pipeline.core.errors import RecordingError
from pipeline.formats.bag_path import is_bag
from pipeline.formats.format import Format, Head, Kind
from pipeline.formats.joints.log import OPTION, JointLog, LogOptions
from pipeline.formats.joints.names import named_like

JOINT_STATE = "sensor_msgs/msg/JointState"
ANGLES = ("actual", "target")
# other signals → the field of a message that they are; every other signal is its effort
FIELDS = {"speed": "velocity", "velocity": "velocity", "position": "position"}


def read_joint_bag(file: Path, options: LogOptions) -> JointLog:
    """Return the measured and the commanded angles in the bag ``file``, each of the topic that
    ``signals`` names or whose name says which it is; other signals are the efforts of their topic,
    ``speed`` and ``velocity`` its velocities. Joints are those of ``options``, else those of the
    first measured message, each read by its name.

    Commands have their own times: at each time of the measured angles, those between two commands
    are interpolated on a straight line, counted as ``interpolated_rows``, and measured angles
    before the first command or after the last are left out, counted as ``rows_without_command``.
    Messages without any of the joints are passed over, counted as ``messages_of_other_joints``, and
    a message that repeats the one before is dropped, counted as ``doubled_rows``. Angles are
    unwrapped before they are interpolated, counted as ``unwrapped_jumps``.

    Raises RecordingError for a bag that cannot be read, no topic or several that could be meant,
    messages that have some of the joints or lack a value, and times that do not increase; messages
    count from 0.
    """
    joints, counts = tuple(options.names), Counter()
    logs = {}
    for signal, topic in sorted(_topics(file, options).items()):
        time, values, joints = _values(file, topic, signal, joints, counts)
        if signal in ANGLES:
            values, removed = unwrapped(
                values, time, joints, circular=options.circular, signal=signal, file=file
            )
            counts["unwrapped_jumps"] += removed
        logs[signal] = time, values
    time, measured = logs.pop("actual")
    signals = {"actual": measured}
    keep, beside = np.ones(len(time), bool), np.zeros(len(time), bool)
    for signal, (stamps, values) in logs.items():
        keep &= (stamps[0] <= time) & (time <= stamps[-1])
        beside |= ~np.isin(time, stamps)
        signals[signal] = np.column_stack([np.interp(time, stamps, joint) for joint in values.T])
    if not keep.any():
        raise RecordingError("no command has the time of a measured angle", file=file)
    repaired = {name: count for name, count in counts.items() if count}
    repaired["interpolated_rows"] = int((beside & keep).sum())
    repaired["rows_without_command"] = int((~keep).sum())
    signals = {signal: values[keep] for signal, values in signals.items()}
    return JointLog(time[keep] - time[0], signals, repaired, joints)


def _topics(file: Path, options: LogOptions) -> dict[str, str]:
    """Signal → topic, of those that are named or name themselves; the measured angles always."""
    # here, as most logs are no bags
    from pipeline.formats.rosbag import topics

    held = sorted(name for name, kind in topics(file).items() if kind == JOINT_STATE)
    place = {}
    for signal, columns in {"actual": None, **(options.signals or {"target": None})}.items():
        named = [*columns] if columns else named_like(signal, held) if signal in ANGLES else []
        if not columns and signal == "actual" and len(held) == 1:
            named = held
        if len(named) == 1 and named[0] in held:
            place[signal] = named[0]
        elif named or signal == "actual":
            raise RecordingError(
                f"{len(named)} topics could hold the {signal} values: name one of the topics of "
                f"JointState, {', '.join(held) or 'of which there are none'}",
                file=file,
                key=f"{OPTION}.signals",
            )
    return place


def _values(
    file: Path, topic: str, signal: str, joints: tuple[str, ...], counts: Counter
) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Times (N,) in s and values (N, joints) of a ``signal``, and the joints: those given, or those
    of the topic's first message.
    """
    from pipeline.formats.rosbag import messages, seconds

    name = "position" if signal in ANGLES else FIELDS.get(signal, "effort")
    held = []
    for number, message in enumerate(messages(file, topic)):
        where = {"file": file, "topic": topic, "number": number}
        values = np.asarray(getattr(message, name)).tolist()
        held.append((where, message.name, values, seconds(message, **where)))
    there = [tuple(names) for _, names, _, _ in held]
    joints = joints or max(there, key=len, default=())
    times, rows = [], []
    for where, names, values, time in held:
        if not {*joints} & {*names}:
            counts["messages_of_other_joints"] += 1
            continue
        value = dict(zip(names, values, strict=False))
        if missing := [joint for joint in joints if not np.isfinite(value.get(joint, np.nan))]:
            raise RecordingError(
                f"the message has no {name} of {', '.join(missing)} ({signal})", **where
            )
        row = [value[joint] for joint in joints]
        if times and (time, row) == (times[-1], rows[-1]):
            counts["doubled_rows"] += 1
            continue
        if times and time <= times[-1]:
            raise RecordingError("the time does not increase", **where)
        times.append(time)
        rows.append(row)
    if not rows:
        others = ", ".join(sorted({joint for names in there for joint in names})) or "none"
        raise RecordingError(
            f"no message has the joints {', '.join(joints) or 'of an arm'}; there are {others}",
            file=file,
            topic=topic,
            key=f"{OPTION}.joints",
        )
    return np.array(times), np.array(rows), joints


def _begins(head: Head) -> bool:
    if not is_bag(head.file):
        return False
    from pipeline.formats.rosbag import topics

    try:
        return JOINT_STATE in topics(head.file).values()
    except RecordingError:
        return False  # the reader of any bag says why


FORMAT = Format("joint states in a ROS bag", Kind.JOINTS, read_joint_bag, _begins)
