"""Joint logs of a robot's controller: signals of all joints on one clock, whatever the format."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.core.errors import RecordingError

OPTION = "dataset.joint_log"
ANGLES = ("actual", "target")


@dataclass(frozen=True)
class JointLog:
    """N samples of all joints: ``actual`` and ``target`` in rad, commanded ``speed`` in rad/s."""

    time: np.ndarray  # (N,) s on the controller's clock, increasing
    signals: Mapping[str, np.ndarray]  # signal → (N, joints)
    # numbers of omitted or interpolated rows and cells; see the reader
    counts: dict[str, int]
    joints: tuple[str, ...] = ()  # joint names in column order, if the file states them
    lines: Sequence[int] = ()  # (N,) line numbers of the samples, if the file has lines
    guesses: Mapping[str, str] = field(default_factory=dict)  # signal → reason
    arrays: Mapping[str, Sequence[str]] = field(default_factory=dict)  # guessed → names
    clock: str = ""  # name of the array of the times, if the file has one
    time_unit: str = ""  # unit of the times, if the file states it
    angle_unit: str = ""  # unit of the angles, if the file states it
    recordings: int = 1  # number of recordings in the file


@dataclass(frozen=True)
class LogOptions:
    """Facts that a log does not state (section dataset.joint_log)."""

    # label or number (from 0) of the time column; None: rows are equally spaced at ``rate``
    time: str | int | None = 0
    rate: float = np.nan  # Hz, of logs without a time column
    # (N,) s, times of the rows of a table without a time column
    clock: np.ndarray | None = None
    separator: str | None = None  # None: detected
    decimal: str | None = None  # None: detected
    angle_unit: str = "rad"
    time_unit: str = "s"
    joints: int | None = None  # number of joints; None: all joints of the log
    # names of the joints; joint names in a log must equal them
    names: Sequence[str] = ()
    # signal → factor of its values, one number or one per joint (default 1)
    factors: Mapping[str, float | Sequence[float]] = field(default_factory=dict)
    guess: bool = False  # whether signals may be found by their values (arrays)
    # signal → columns of its joints (labels, or numbers from 0); None: all columns behind the time
    signals: Mapping[str, Sequence[str | int] | None] = field(default_factory=dict)
    # number (from 0) of the recording, of a file of several
    recording: int | None = None
    # (joints,) whether a joint revolves, else it is linear
    circular: np.ndarray | bool = True


def increasing(log: JointLog, place: Callable[[int], dict[str, object]]) -> JointLog:
    """Return ``log`` without rows equal to the row before (counted as ``doubled_rows``);
    RecordingError with ``place(row)`` of the first other row whose time does not increase.
    """
    values = np.hstack([log.time[:, None], *log.signals.values()])
    doubled = (values[1:] == values[:-1]).all(axis=1)
    time = log.time
    backward = (np.diff(time) <= 0) & ~doubled
    if backward.any():
        row = int(np.argmax(backward)) + 1
        before = float(time[row - 1])
        after = float(time[row])
        raise RecordingError(
            f"the time does not increase (from {before:.16g} to {after:.16g} s): choose another "
            "column of times, or print its fraction with all its digits; if the file holds several "
            "recordings, write each to a file of its own",
            **place(row),
        )
    distinct = np.append(True, ~doubled)
    lines = np.array(log.lines)
    return replace(
        log,
        time=time[distinct],
        signals={name: rows[distinct] for name, rows in log.signals.items()},
        counts=log.counts | {"doubled_rows": int(doubled.sum())},
        lines=lines[distinct].tolist() if len(lines) else (),
    )
