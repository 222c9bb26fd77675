"""Joint angles in ROS bags: messages of the type JointState, in rad and rad/s by the definition of
the type; one topic has the measured angles, another the commanded ones.
"""

from collections import Counter
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.core.angles import unwrap
from pipeline.core.errors import RecordingError
from pipeline.formats.format import Format, Head, Kind, is_bag
from pipeline.formats.joints.log import OPTION, JointLog, LogOptions
from pipeline.formats.joints.names import named_like

JOINT_STATE = "sensor_msgs/msg/JointState"
ANGLES = ("actual", "target")
# signal → field of a message; every other signal is its effort
FIELDS = {"speed": "velocity", "velocity": "velocity"}
FIELDS |= dict.fromkeys((*ANGLES, "position"), "position")


def read_joint_bag(file: Path, options: LogOptions) -> JointLog:
    """Return the measured and the commanded angles in the bag ``file``, each of the topic that
    ``signals`` names or whose name says which it is; other signals are the efforts of their topic,
    ``speed`` and ``velocity`` its velocities. Joints are those of ``options``, else those of the
    message with the most, each read by its name.

    Counted are ``interpolated_rows`` (commands, at the times of the measured angles),
    ``rows_without_command`` (before the first or after the last, left out),
    ``messages_of_other_joints`` (passed over), ``doubled_rows`` (dropped) and ``unwrapped_jumps``
    of circular joints. Raises RecordingError for a bag that cannot be read, no topic or several,
    and, with the message from 0, for a joint without a value and a time that does not increase.
    """
    joints, counts, logs = tuple(options.names), Counter(), {}
    for signal, topic in sorted(_topics(file, options).items()):
        time, values, joints = _values(file, topic, signal, joints, counts)
        if signal in ANGLES:
            evidence = {"signal": signal, "file": file, "circular": options.circular}
            values, removed = unwrap(values, time, joints, **evidence)
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
    """Return signal → topic, of those that are named or name themselves; always ``actual``."""
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
            message = f"{len(named)} topics could hold the {signal} values: name one of the topics "
            message += f"of JointState, {', '.join(held) or 'of which there are none'}"
            raise RecordingError(message, file=file, key=f"{OPTION}.signals")
    return place


def _sample(message: object, name: str) -> tuple[float, dict[str, float]]:
    from pipeline.formats.rosbag import seconds

    values = np.asarray(getattr(message, name)).tolist()
    held = dict(zip(message.name, values, strict=False))
    return seconds(message), dict.fromkeys(message.name, np.nan) | held


def _values(
    file: Path, topic: str, signal: str, joints: tuple[str, ...], counts: Counter
) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Return times (N,) in s and values (N, joints) of a ``signal``, and its joints."""
    from pipeline.formats.rosbag import messages

    name = FIELDS.get(signal, "effort")
    held = [*messages(file, topic, partial(_sample, name=name))]
    joints = joints or tuple(max((values for _, values in held), key=len, default=()))
    times, rows, where = [-np.inf], [], {"file": file, "topic": topic}
    for number, (time, values) in enumerate(held):
        row = [values.get(joint, np.nan) for joint in joints]
        missing = [joint for joint, one in zip(joints, row, strict=True) if not np.isfinite(one)]
        if not {*joints} & {*values}:
            counts["messages_of_other_joints"] += 1
        elif rows and (time, row) == (times[-1], rows[-1]):
            counts["doubled_rows"] += 1
        elif missing or time <= times[-1]:
            message = f"the message has no {name} of {', '.join(missing)} ({signal})"
            message = message if missing else "the time does not increase"
            raise RecordingError(message, number=number, **where)
        else:
            times.append(time)
            rows.append(row)
    if not rows:
        others = ", ".join(sorted({joint for _, values in held for joint in values})) or "none"
        message = f"no message has the joints {', '.join(joints) or 'of an arm'}; there are "
        raise RecordingError(message + others, key=f"{OPTION}.joints", **where)
    return np.array(times[1:]), np.array(rows), joints


def _begins(head: Head) -> bool:
    if not is_bag(head.file):
        return False
    from pipeline.formats.rosbag import topics

    try:
        return JOINT_STATE in topics(head.file).values()
    except RecordingError:
        return False  # the reader of any bag says why


FORMAT = Format("joint states in a ROS bag", Kind.JOINTS, read_joint_bag, _begins)
