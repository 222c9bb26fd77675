"""Joint angles in ROS bags: messages of the type JointState, in rad and rad/s by the definition of
the type; one topic has the measured angles, another the commanded ones.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.bag_path import is_bag
from pipeline.formats.format import Format, Head, Kind
from pipeline.formats.joints.log import OPTION, JointLog, LogOptions, unwrapped
from pipeline.formats.joints.names import named_like

JOINT_STATE = "sensor_msgs/msg/JointState"


def read_joint_bag(file: Path, options: LogOptions) -> JointLog:
    """The measured and the commanded angles in the bag ``file``, each of the topic that ``signals``
    names or whose name says which it is; joints in the order of the first measured message.

    Commands have their own times: at each time of the measured angles, those between two commands
    are interpolated on a straight line, counted as ``interpolated_rows``, and measured angles
    before the first command or after the last are left out, counted as ``rows_without_command``.
    Raises RecordingError for a bag that cannot be read, no topic or several that could be meant,
    messages that lack a joint or an angle, and times that do not increase; messages count from 0.
    """
    joints: tuple[str, ...] = ()
    logs, jumps = {}, 0
    for signal, topic in sorted(_topics(file, options).items()):
        time, values, joints = _values(file, topic, signal, joints)
        if signal != "speed":  # before anything is interpolated over a jump
            values, removed = unwrapped(values, time, joints, signal=signal, file=file)
            jumps += removed
        logs[signal] = time, values
    time, measured = logs.pop("actual")
    signals, keep, beside = (
        {"actual": measured},
        np.ones(len(time), bool),
        np.zeros(len(time), bool),
    )
    for signal, (stamps, values) in logs.items():
        keep &= (stamps[0] <= time) & (time <= stamps[-1])
        beside |= ~np.isin(time, stamps)
        signals[signal] = np.column_stack([np.interp(time, stamps, joint) for joint in values.T])
    if not keep.any():
        raise RecordingError("no command stands at the time of a measured angle", file=file)
    counts = {
        "interpolated_rows": int((beside & keep).sum()),
        "rows_without_command": int((~keep).sum()),
    } | ({"unwrapped_jumps": jumps} if jumps else {})
    signals = {signal: values[keep] for signal, values in signals.items()}
    return JointLog(time[keep] - time[0], signals, counts, joints)


def _topics(file: Path, options: LogOptions) -> dict[str, str]:
    """Signal → topic, of those that are named or name themselves; the measured angles always."""
    # here, as most logs are no bags
    from pipeline.formats.rosbag import topics

    held = sorted(name for name, kind in topics(file).items() if kind == JOINT_STATE)
    place = {}
    for signal, columns in {"actual": None, **(options.signals or {"target": None})}.items():
        named = [*columns] if columns else named_like(signal, held)
        if len(named) == 1 and named[0] in held:
            place[signal] = named[0]
        elif named or signal == "actual":
            raise RecordingError(
                f"no one topic for the {signal} angles: name it; there are of JointState "
                f"{', '.join(held) or 'none'}",
                file=file,
                key=f"{OPTION}.signals",
            )
    return place


def _values(
    file: Path, topic: str, signal: str, joints: tuple[str, ...]
) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Times (N,) in s and values (N, joints) of a ``signal``, and the joints: those given, or those
    of the topic's first message.
    """
    from pipeline.formats.rosbag import messages, seconds

    times, rows = [], []
    for number, message in enumerate(messages(file, topic)):
        where = {"file": file, "topic": topic, "number": number}
        joints = joints or tuple(message.name)
        values = message.velocity if signal == "speed" else message.position
        held = dict(zip(message.name, np.asarray(values).tolist(), strict=False))
        if missing := [name for name in joints if not np.isfinite(held.get(name, np.nan))]:
            raise RecordingError(f"no {signal} value of {', '.join(missing)}", **where)
        times.append(seconds(message, **where))
        rows.append([held[name] for name in joints])
        if len(times) > 1 and times[-1] <= times[-2]:
            raise RecordingError("the time does not increase", **where)
    if not rows or not joints:
        raise RecordingError("the topic holds no joint", file=file, topic=topic)
    return np.array(times), np.array(rows), joints


def _begins(head: Head) -> bool:
    if not is_bag(head.file):
        return False
    from pipeline.formats.rosbag import topics

    try:
        return JOINT_STATE in topics(head.file).values()
    except RecordingError:
        return False  # said by what reads any bag


FORMAT = Format("joint states in a ROS bag", Kind.JOINTS, read_joint_bag, _begins)
