"""Joint logs of a robot's controller, of any format: signals of all joints on one clock."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError

OPTION = "dataset.joint_log"


@dataclass(frozen=True)
class JointLog:
    """N samples of all joints: ``actual`` and ``target`` in rad, commanded ``speed`` in rad/s."""

    time: np.ndarray  # (N,) s on the controller's clock, increasing
    signals: Mapping[str, np.ndarray]  # each (N, joints)
    # cut_rows, blank_rows and doubled_rows (the same line at the same time, left out), as there are
    counts: dict[str, int]
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
    wrong = (np.diff(log.time) <= 0) & ~doubled
    if wrong.any():
        at = place(int(np.argmax(wrong)) + 1)
        raise RecordingError("the time does not increase", file=file, **at)
    keep = np.append(True, ~doubled)
    signals = {name: rows[keep] for name, rows in log.signals.items()}
    counts = log.counts | {"doubled_rows": int(doubled.sum())}
    return replace(log, time=log.time[keep], signals=signals, counts=counts)
