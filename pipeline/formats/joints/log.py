"""Joint logs of a robot's controller: signals of all joints on one clock, from a plain table or
from messages JointState of a ROS bag.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.core.angles import unwrap
from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import ANGLE_UNITS, TIME_UNITS, spelled
from pipeline.formats.format import Format, Head, Kind, is_bag
from pipeline.formats.joints.names import named_like
from pipeline.formats.number_sheet import read_sheet

OPTION = "dataset.joint_log"
FLAT = (
    "; one number a line is one column: signals: {actual: [0]} with time: null reads it as one "
    "joint, else write the joints of one time in one line"
)
JOINT_STATE = "sensor_msgs/msg/JointState"
ANGLES = ("actual", "target")
# signal → field of a message; every other signal is its effort
FIELDS = {"speed": "velocity", "velocity": "velocity"}
FIELDS |= dict.fromkeys((*ANGLES, "position"), "position")


@dataclass(frozen=True)
class JointLog:
    """N samples of all joints: ``actual`` and ``target`` in rad, commanded ``speed`` in rad/s."""

    time: np.ndarray  # (N,) s on the controller's clock, increasing
    signals: Mapping[str, np.ndarray]  # each (N, joints)
    counts: dict[str, int]  # of rows and cells that were left out or filled; see the reader
    joints: tuple[str, ...] = ()  # their names in order, where the file states them


@dataclass(frozen=True)
class LogOptions:
    """Options for what a log does not say (section dataset.joint_log)."""

    # column by label, or by number from 0; None: the rows follow each other at ``rate``
    time: str | int | None = 0
    rate: float = np.nan  # 1/s, of logs without a time
    separator: str | None = None  # as found
    decimal: str | None = None  # as found
    angle_unit: str = "rad"
    time_unit: str = "s"
    joints: int | None = None  # as many as the log holds
    names: Sequence[str] = ()  # of the joints; those that a log states have to be these
    # signal → factor of its values, one number or one a joint (default 1)
    factors: Mapping[str, float | Sequence[float]] = field(default_factory=dict)
    # the signals to be read, each with the columns of its joints by label or by number from 0; None
    # for all columns behind the time
    signals: Mapping[str, Sequence[str | int] | None] = field(default_factory=dict)
    circular: np.ndarray | bool = True  # (joints,) which turn; others' values are no angles


def increasing(log: JointLog, file: Path, place: Callable[[int], dict[str, object]]) -> JointLog:
    """Return ``log`` without rows that repeat the one before (``doubled_rows``); RecordingError at
    the ``place`` of the first other row whose time does not increase.
    """
    values = np.hstack([log.time[:, None], *log.signals.values()])
    doubled = (values[1:] == values[:-1]).all(axis=1)
    if (wrong := (np.diff(log.time) <= 0) & ~doubled).any():
        at = place(int(np.argmax(wrong)) + 1)
        raise RecordingError("the time does not increase", file=file, **at)
    keep = np.append(True, ~doubled)
    signals = {name: rows[keep] for name, rows in log.signals.items()}
    counts = log.counts | {"doubled_rows": int(doubled.sum())}
    return replace(log, time=log.time[keep], signals=signals, counts=counts)


def read_joint_table(file: Path, options: LogOptions) -> JointLog:
    """Return the signals of ``options`` in ``file``, at the times of rows with a measured angle.
    ``counts`` are those of :func:`read_sheet` and :meth:`Sheet.samples`. RecordingError as these,
    with the line for a time that does not increase; with the option for a column that is not there
    and for another unit in the header.
    """
    sheet = read_sheet(file, separator=options.separator, decimal=options.decimal, key=OPTION)
    wanted = {} if options.time is None else {"time": options.time}
    first, chosen = len(wanted), {}  # signal → its columns of the values
    for signal, columns in options.signals.items():
        if columns is None and sheet.width != options.joints + first:
            values = f"{'a time and ' if first else ''}{sheet.width - first} values"
            message = f"the line has {values}, not {options.joints}; check joints, or name the "
            message += f"columns in signals{FLAT if sheet.width == 1 else ''}"
            raise RecordingError(message, file=file, line=sheet.lines[0])
        named = range(first, sheet.width) if columns is None else columns
        chosen[signal] = slice(len(wanted) - first, len(wanted) - first + len(named))
        wanted |= {f"joint {n} ({signal})": column for n, column in enumerate(named, start=1)}
    places = sheet.columns(wanted, f"{OPTION}.signals")
    for quantity, column in places.items():
        time = quantity == "time"
        unit = spelled(sheet.unit(column) or (not time and sheet.angle_unit) or "")
        key, units = ("time_unit", TIME_UNITS) if time else ("angle_unit", ANGLE_UNITS)
        if unit in units and unit != (given := getattr(options, key)):
            message = f"the {quantity} is in {unit} by the header and in {given} by the option"
            where = {"file": file, "line": sheet.label_line, "key": f"{OPTION}.{key}"}
            raise RecordingError(message, **where)
    measured = [column for name, column in places.items() if name.endswith("(actual)")]
    samples = sheet.samples([*places.values()], places.get("time"), measured)
    time = samples.rows / options.rate
    if first:
        time = samples.values[:, 0] * TIME_UNITS[options.time_unit]
    values = samples.values[:, first:] * ANGLE_UNITS[options.angle_unit]
    signals = {signal: values[:, columns] for signal, columns in chosen.items()}
    log = JointLog(time, signals, sheet.counts | samples.counts)
    return increasing(log, file, lambda row: {"line": sheet.lines[samples.rows[row]]})


def joint_labels(signal: str, joints: Sequence[str]) -> list[str]:
    """Return the columns of a ``signal`` of the ``joints``."""
    return [f"{signal}_{joint}" for joint in joints]


def write_joint_table(
    file: Path, time: np.ndarray, signals: Mapping[str, np.ndarray], joints: Sequence[str]
) -> None:
    """Write ``time`` (N,) in s and the ``signals``, each (N, joints) in rad, with six and seven
    decimals, under a row of :func:`joint_labels`.
    """
    header = ["time", *(label for signal in signals for label in joint_labels(signal, joints))]
    table = np.column_stack([time, *signals.values()])
    row = ",".join(["%.6f", *["%.7f"] * (table.shape[1] - 1)]) + "\n"
    rows = row * len(table) % tuple(table.ravel().tolist())
    Path(file).write_text(",".join(header) + "\n" + rows, newline="")


def read_joint_bag(file: Path, options: LogOptions) -> JointLog:
    """Return the signals in the bag ``file``, in rad and rad/s by the definition of JointState,
    each of the topic that ``signals`` names or whose name says which it is: ``actual`` and
    ``target`` angles, ``speed`` and ``velocity``; other signals are efforts. Joints are those of
    ``options``, else those of the message with the most, each read by its name.

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
    from pipeline.formats.rosbag import topics  # here, as most logs are no bags

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


BAG = Format("joint states in a ROS bag", Kind.JOINTS, read_joint_bag, _begins)
# it looks like any other table: what is no other log of joints is read as one
TABLE = Format("table of joints", Kind.JOINTS, read_joint_table)
FORMAT = (BAG, TABLE)
