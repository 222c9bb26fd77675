"""Joint logs of a robot's controller: signals of all joints on one clock, from a plain table or
from the JointState messages of a ROS bag.
"""

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.core.angles import unwrap
from pipeline.core.errors import RecordingError
from pipeline.formats import rosbag
from pipeline.formats.delimited import UNITS, spelled
from pipeline.formats.format import Format, Head, Kind, is_bag
from pipeline.formats.joints.names import (
    is_names,
    match_joints,
    named_like,
    states_joints,
)
from pipeline.formats.number_sheet import Sheet, read_sheet

OPTION = "dataset.joint_log"
JOINT_STATE = "sensor_msgs/msg/JointState"
ANGLES = ("actual", "target")
# signal → field of a message; other signals are in the field effort
FIELDS = {"speed": "velocity", "velocity": "velocity"}
FIELDS |= dict.fromkeys((*ANGLES, "position"), "position")


@dataclass(frozen=True)
class JointLog:
    """N samples of all joints: ``actual`` and ``target`` in rad, commanded ``speed`` in rad/s."""

    time: np.ndarray  # (N,) s on the controller's clock, increasing
    signals: Mapping[str, np.ndarray]  # signal → (N, joints)
    counts: dict[
        str, int
    ]  # numbers of omitted or interpolated rows and cells; see the reader
    joints: tuple[str, ...] = ()  # joint names in column order, if the file states them
    lines: Sequence[int] = ()  # (N,) line numbers of the samples, if the file has lines
    guesses: Mapping[str, str] = field(default_factory=dict)  # signal → reason
    arrays: Mapping[str, Sequence[str]] = field(default_factory=dict)  # guessed → names
    clock: str = ""  # name of the array of the times, if the file has one
    time_unit: str = ""  # unit of the times, if the file states it
    angle_unit: str = ""  # unit of the angles, if the file states it


@dataclass(frozen=True)
class LogOptions:
    """Facts that a log does not state (section dataset.joint_log)."""

    # label or number (from 0) of the time column; None: rows are equally spaced at ``rate``
    time: str | int | None = 0
    rate: float = np.nan  # Hz, of logs without a time column
    clock: np.ndarray | None = (
        None  # (N,) s, times of the rows of a table without a time column
    )
    separator: str | None = None  # None: detected
    decimal: str | None = None  # None: detected
    angle_unit: str = "rad"
    time_unit: str = "s"
    joints: int | None = None  # number of joints; None: all joints of the log
    names: Sequence[
        str
    ] = ()  # names of the joints; joint names in a log must equal them
    # signal → factor of its values, one number or one per joint (default 1)
    factors: Mapping[str, float | Sequence[float]] = field(default_factory=dict)
    guess: bool = False  # whether signals may be found by their values (arrays)
    # signal → columns of its joints (labels, or numbers from 0); None: all columns behind the time
    signals: Mapping[str, Sequence[str | int] | None] = field(default_factory=dict)
    circular: np.ndarray | bool = (
        True  # (joints,) whether a joint revolves, else it is linear
    )


def increasing(log: JointLog, place: Callable[[int], dict[str, object]]) -> JointLog:
    """Return ``log`` without rows equal to the row before (counted as ``doubled_rows``);
    RecordingError with ``place(row)`` of the first other row whose time does not increase.
    """
    values = np.hstack([log.time[:, None], *log.signals.values()])
    doubled = (values[1:] == values[:-1]).all(axis=1)
    if (backward := (np.diff(log.time) <= 0) & ~doubled).any():
        row = int(np.argmax(backward)) + 1
        before, after = log.time[row - 1 : row + 1].tolist()
        message = f"the time does not increase (from {before:.16g} to {after:.16g} s): choose "
        message += "another column of times, or print its fraction with all its digits; if the file"
        message += " holds several recordings, write each to a file of its own"
        raise RecordingError(message, **place(row))
    keep = np.append(True, ~doubled)
    signals = {name: rows[keep] for name, rows in log.signals.items()}
    counts = log.counts | {"doubled_rows": int(doubled.sum())}
    lines = np.array(log.lines)[keep].tolist() if len(log.lines) else ()
    return replace(
        log, time=log.time[keep], signals=signals, counts=counts, lines=lines
    )


def read_joint_table(file: Path, options: LogOptions) -> JointLog:
    """Return the signals that ``options`` name in the table ``file``; see :func:`log_of_sheet`."""
    sheet = read_sheet(
        file, separator=options.separator, decimal=options.decimal, key=OPTION
    )
    return log_of_sheet(sheet, options)


def log_of_sheet(sheet: Sheet, options: LogOptions) -> JointLog:
    """Return the signals that ``options`` name in the ``sheet``, from rows with a measured angle,
    each column in its own unit if the header states one. ``counts`` are the counts of
    :func:`read_sheet` and :meth:`Sheet.samples`. Raises RecordingError as these functions do; with
    the line, where the time does not increase; with the option, where a column is missing, and
    where the header states another unit of the time or of the first signal, or other joints.
    """
    wanted = {} if options.time is None else {"time": options.time}
    first, chosen = (
        len(wanted),
        {},
    )  # chosen: signal → slice of the columns of ``values``
    for signal, columns in options.signals.items():
        if columns is None and sheet.width != options.joints + first:
            values = f"{'a time and ' if first else ''}{sheet.width - first} values"
            message = f"the line has {values}, not {options.joints}; correct joints, or name the "
            message += "columns in signals"
            raise RecordingError(message, file=sheet.file, line=sheet.lines[0])
        named = range(first, sheet.width) if columns is None else columns
        chosen[signal] = slice(len(wanted), len(wanted) + len(named))
        wanted |= {
            f"joint {n} ({signal})": column for n, column in enumerate(named, start=1)
        }
    places, factors = sheet.columns(wanted, f"{OPTION}.signals"), []
    checked = {
        "time",
        *(name for name in places if name.endswith(f"({next(iter(chosen))})")),
    }
    where = {"file": sheet.file, "line": sheet.label_line}
    stated: dict[str, dict[str, str]] = {
        "time": {},
        "angle": {},
    }  # kind → unit → quantity
    for quantity, column in places.items():
        kind = "time" if quantity == "time" else "angle"
        unit = spelled(sheet.unit(column, kind) or "")
        given, known = getattr(options, f"{kind}_unit"), UNITS[kind]
        if unit in UNITS[f"unread_{kind}"]:
            message = f"the {quantity} is in {unit} by the header: convert it to "
            raise RecordingError(
                f"{message}{' or '.join(known)}, or correct the header", **where
            )
        if quantity in checked and unit in known:
            stated[kind][unit] = quantity
        lengths = UNITS["length"] if kind == "angle" else {}  # of linear joints
        factors.append(known.get(unit) or known[given] * lengths.get(unit, 1.0))
    for kind, units in stated.items():  # columns of several units need no single one
        if units and (given := getattr(options, f"{kind}_unit")) not in units:
            unit, quantity = next(iter(units.items()))
            message = f"the {quantity} is in {unit} by the header and in {given} by the option"
            raise RecordingError(message, **where, key=f"{OPTION}.{kind}_unit")
    measured = [column for name, column in places.items() if name.endswith("(actual)")]
    labels = [sheet.labels[column] for column in measured if sheet.labels]
    named = match_joints(names_in_cells(sheet, len(measured)) or labels, options.names)
    if (
        {*named} == {*options.names}
        and states_joints(named)
        and named != [*options.names]
    ):
        message = (
            f"the columns of the measured angles are {', '.join(named)} by their names"
        )
        raise RecordingError(message, **where, key=f"{OPTION}.joints")
    samples = sheet.samples([*places.values()], places.get("time"), measured)
    values, lines = (
        samples.values * np.array(factors),
        [sheet.lines[row] for row in samples.rows],
    )
    time = values[:, 0] if first else _times_of_rows(sheet, samples.rows, options)
    signals = {signal: values[:, columns] for signal, columns in chosen.items()}
    log = JointLog(time, signals, sheet.counts | samples.counts, lines=lines)
    return increasing(log, lambda row: {"file": sheet.file, "line": lines[row]})


def _times_of_rows(sheet: Sheet, rows: np.ndarray, options: LogOptions) -> np.ndarray:
    """Return the times (M,) in s of the ``rows`` (M,) of a ``sheet`` without a column of times."""
    if options.clock is None:
        return rows / options.rate
    if len(options.clock) != len(sheet.rows):
        message = f"the table has {len(sheet.rows)} rows beside {len(options.clock)} times: name "
        message += "the table of the times of these rows, or time null for even rows"
        raise RecordingError(message, file=sheet.file, key=f"{OPTION}.time")
    return options.clock[rows]


def read_clock(file: Path, options: LogOptions) -> np.ndarray:
    """Return the times (N,) in s in the ``file``, a table of one column, in the unit of its label,
    else of the ``options``.
    """
    sheet = read_sheet(
        file, separator=options.separator, decimal=options.decimal, key=OPTION
    )
    if len(sheet.numeric) != 1:
        message = (
            f"a table of times has one column of numbers, this one {len(sheet.numeric)}"
        )
        raise RecordingError(message, file=file, key=f"{OPTION}.time")
    column = sheet.numeric[0]
    unit = spelled(sheet.unit(column, "time") or "")
    factor = UNITS["time"].get(unit, UNITS["time"][options.time_unit])
    return sheet.values([column])[:, 0] * factor


def names_in_cells(sheet: Sheet, count: int) -> list[str]:
    """Return ``count`` joints' names in cells, or none; RecordingError where they change."""
    columns = {n for n, label in enumerate(sheet.labels) if is_names(label)} - {
        *sheet.numeric
    }
    if not columns:
        return []
    stated = [*zip(*map(sheet.words, sorted(columns)), strict=True)]
    if changed := next((n for n, each in enumerate(stated) if each != stated[0]), 0):
        message = (
            "the joints' names differ from the first row: write the joints in one order"
        )
        raise RecordingError(message, file=sheet.file, line=sheet.lines[changed])
    names = [
        name for cell in stated[0] for name in re.findall(r"[A-Za-z_][\w./-]*", cell)
    ]
    return names if len(names) == count else []


def joint_labels(signal: str, joints: Sequence[str]) -> list[str]:
    """Return the column label ``signal_joint`` of each of the ``joints``."""
    return [f"{signal}_{joint}" for joint in joints]


def write_joint_table(
    file: Path,
    time: np.ndarray,
    signals: Mapping[str, np.ndarray],
    joints: Sequence[str],
) -> None:
    """Write ``time`` (N,) in s and ``signals`` (N, joints) in rad below :func:`joint_labels`."""
    header = [
        "time",
        *(label for signal in signals for label in joint_labels(signal, joints)),
    ]
    table = np.column_stack([time, *signals.values()])
    row = ",".join(["%.6f", *["%.7f"] * (table.shape[1] - 1)]) + "\n"
    rows = row * len(table) % tuple(table.ravel().tolist())
    Path(file).write_text(",".join(header) + "\n" + rows, newline="")


def read_joint_bag(file: Path, options: LogOptions) -> JointLog:
    """Return the signals in the bag ``file``, in rad and rad/s as JointState defines. The option
    ``signals``, else the topic's name, assigns a topic to a signal. ``actual`` and ``target`` are
    positions, ``speed`` and ``velocity`` velocities, other signals efforts. Joints are read by
    name: the ``names`` of ``options``, by default the joints of the message with the most joints.

    Commands are interpolated at the times of measured angles. ``counts``: ``interpolated_rows``;
    ``rows_without_command`` (before the first or after the last command, left out);
    ``messages_of_other_joints`` (skipped); ``joints_without_values`` in any message (left out, if
    ``names`` does not name them); ``doubled_rows`` (left out); ``unwrapped_jumps`` of circular
    joints. Raises RecordingError for an unreadable bag, and for no topic or several; with
    the message's number (from 0), where a joint has no value or the time does not increase.
    """
    joints, counts, logs = tuple(options.names), Counter(), {}
    for signal, topic in sorted(_topics(file, options).items()):
        log = _read_topic(file, topic, signal, joints)
        joints, values = log.joints, log.signals[signal]
        counts += log.counts
        if signal in ANGLES:
            evidence = {"signal": signal, "file": file, "circular": options.circular}
            values, removed = unwrap(values, log.time, joints, **evidence)
            counts["unwrapped_jumps"] += removed
        logs[signal] = log.time, values
    time, measured = logs.pop("actual")
    keep, interpolated, signals = (
        np.ones(len(time), bool),
        np.zeros(len(time), bool),
        {},
    )
    for signal, (stamps, values) in logs.items():
        keep &= (stamps[0] <= time) & (time <= stamps[-1])
        interpolated |= ~np.isin(time, stamps)
        signals[signal] = np.column_stack(
            [np.interp(time, stamps, joint) for joint in values.T]
        )
    if not keep.any():
        message = f"no measured angle, from {time[0]:.10g} to {time[-1]:.10g} s by the headers, is "
        message += "within the times of the commands: record both by one clock"
        raise RecordingError(message, file=file)
    repaired = {"interpolated_rows": int((interpolated & keep).sum())}
    repaired["rows_without_command"] = int((~keep).sum())
    signals = {
        signal: rows[keep] for signal, rows in ({"actual": measured} | signals).items()
    }
    return JointLog(time[keep] - time[0], signals, dict(+counts) | repaired, joints)


def _topics(file: Path, options: LogOptions) -> dict[str, str]:
    """Return signal → topic by the options, else by the topics' names; always with ``actual``."""
    present = sorted(
        name for name, kind in rosbag.topics(file).items() if kind == JOINT_STATE
    )
    chosen = {}
    for signal, columns in {
        "actual": None,
        **(options.signals or {"target": None}),
    }.items():
        fits = (
            [*columns]
            if columns
            else named_like(signal, present)
            if signal in ANGLES
            else []
        )
        if not columns and signal == "actual" and len(present) == 1:
            fits = present
        if len(fits) == 1 and fits[0] in present:
            chosen[signal] = fits[0]
        elif fits or signal == "actual":
            message = f"{len(fits)} topics could hold the {signal} values: name one of the topics "
            message += (
                f"of JointState in signals: {', '.join(present) or 'the bag has none'}"
            )
            raise RecordingError(message, file=file, key=f"{OPTION}.signals")
    return chosen


def _sample(message: object, name: str) -> tuple[float, dict[str, float]]:
    """Return the time in s and joint → value in the field ``name``, NaN for a missing value."""
    values = np.asarray(getattr(message, name)).tolist()
    present = dict(zip(message.name, values, strict=False))
    return rosbag.seconds(message), dict.fromkeys(message.name, np.nan) | present


def _read_topic(
    file: Path, topic: str, signal: str, joints: tuple[str, ...]
) -> JointLog:
    """Return the ``signal`` of the ``joints`` (default the joints of the longest message)."""
    name, where = FIELDS.get(signal, "effort"), {"file": file, "topic": topic}
    samples = [*rosbag.messages(file, topic, partial(_sample, name=name))]
    longest = joints or tuple(
        max((values for _, values in samples), key=len, default=())
    )
    # without names, wheels that have no position in any message are no joints of the arm
    measured = {
        joint for _, values in samples for joint in values if np.isfinite(values[joint])
    }
    joints = joints or tuple(joint for joint in longest if joint in measured)
    numbers = [n for n, (_, values) in enumerate(samples) if {*joints} & {*values}]
    if not numbers:
        others = (
            ", ".join(sorted({joint for _, values in samples for joint in values}))
            or "none"
        )
        message = f"no message has the joints {', '.join(joints) or 'of an arm'}; the joints are "
        raise RecordingError(message + others, key=f"{OPTION}.joints", **where)
    rows = np.array(
        [[samples[n][1].get(joint, np.nan) for joint in joints] for n in numbers]
    )
    if not (finite := np.isfinite(rows)).all():
        row = int(finite.all(axis=1).argmin())
        missing = ", ".join(np.array(joints)[~finite[row]])
        message = f"the message has no {name} of {missing} ({signal}): name the arm's joints alone"
        raise RecordingError(
            message, number=numbers[row], key=f"{OPTION}.joints", **where
        )
    counts = {"messages_of_other_joints": len(samples) - len(numbers)}
    counts["joints_without_values"] = len(longest) - len(joints)
    log = JointLog(
        np.array([samples[n][0] for n in numbers]), {signal: rows}, counts, joints
    )
    return increasing(log, lambda row: {"number": numbers[row], **where})


def _begins(head: Head) -> bool:
    if not is_bag(head.file):
        return False
    try:
        return JOINT_STATE in rosbag.topics(head.file).values()
    except RecordingError:
        return False  # the error of the bag reader tells the reason


BAG = Format("joint states in a ROS bag", Kind.JOINTS, read_joint_bag, _begins)
# a table of joints has no mark: any table that no other format recognises is read as one
TABLE = Format("table of joints", Kind.JOINTS, read_joint_table)
FORMAT = (BAG, TABLE)
