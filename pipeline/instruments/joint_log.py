"""Plain joint logs of a robot's controller: no header, one line a sample, time and one value a joint, separated by commas."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.errors import RecordingError
from pipeline.instruments.delimited import is_blank, numbers_of, read_text

CLOCK_TOLERANCE = 0.1  # of a step


@dataclass(frozen=True)
class JointLog:
    """N samples of all joints: angles in rad or speeds in rad/s, whichever the controller logged."""

    time: np.ndarray  # (N,) s on the controller's clock, increasing
    values: np.ndarray  # (N, joints)
    counts: dict[str, int]  # see read_joint_log


def read_joint_log(file: Path, *, joints: int) -> JointLog:
    """Log in ``file`` of a robot with that many ``joints``; logs of one movement may differ in length.

    A controller that is stopped while it writes leaves a last line that is short or has no line end: it is dropped. ``counts``:
    ``cut_rows`` (0 or 1) and ``blank_rows``. Raises RecordingError with the line for any other line of another width, a value that is
    not a finite number and a time that does not increase.
    """
    text = read_text(file)
    places = [number for number, line in enumerate(text.lines, start=1) if not is_blank(line, ",")]
    counts = {"cut_rows": int(text.cut is not None), "blank_rows": len(text.lines) - len(places)}
    if text.cut is None and places and text.lines[places[-1] - 1].count(",") < joints:
        places.pop()
        counts["cut_rows"] = 1
    if not places:
        raise RecordingError("the log holds no whole line; record again", file=file)
    rows = [text.lines[place - 1] for place in places]
    found = rows[0].count(",")
    if found != joints:
        raise RecordingError(f"the line has a time and {found} values, not {joints}; check the number of joints", file=file, line=places[0])
    table = numbers_of(rows, places, list(range(joints + 1)), file=file)
    time = table[:, 0]
    if (np.diff(time) <= 0).any():
        raise RecordingError("the time does not increase", file=file, line=places[int(np.argmax(np.diff(time) <= 0)) + 1])
    return JointLog(time, table[:, 1:], counts)


def read_movement(folder: Path, files: Sequence[str], *, joints: int, rate: float) -> tuple[list[np.ndarray], dict[str, int]]:
    """Values (N, joints) of the logs ``files`` of one movement, row by row at the same times, as many as the shortest log has.

    ``counts``: those of :func:`read_joint_log` over all logs, and ``rows_without_partner`` that were left out because another log ends
    before them. Raises RecordingError for clocks that disagree or do not step at ``rate`` (1/s) throughout.
    """
    logs = [read_joint_log(Path(folder) / file, joints=joints) for file in files]
    length = min(len(log.time) for log in logs)
    time = logs[0].time[:length]
    uneven = np.abs(np.diff(time) * rate - 1) > CLOCK_TOLERANCE
    if uneven.any():
        row = int(np.argmax(uneven))
        message = f"the log steps by {time[row + 1] - time[row]:.6g} s at {time[row]:.6g} s, not by 1/{rate:g} s; samples are missing"
        raise RecordingError(message, file=Path(folder) / files[0])
    for file, log in zip(files, logs, strict=True):
        if (np.abs(log.time[:length] - time) * rate > CLOCK_TOLERANCE).any():
            raise RecordingError(f"the times are not those of {files[0]}; take logs of one recording", file=Path(folder) / file)
    counts = {name: sum(log.counts[name] for log in logs) for name in logs[0].counts}
    counts["rows_without_partner"] = sum(len(log.time) - length for log in logs)
    return [log.values[:length] for log in logs], counts


def write_joint_log(file: Path, log: JointLog) -> None:
    """Write ``log`` with six decimals, which is what controllers print: 1 µs and 1 µrad."""
    table = np.column_stack([log.time, log.values])
    row = ", ".join(["%.6f"] * table.shape[1]) + "\n"
    Path(file).write_bytes((row * len(table) % tuple(table.ravel().tolist())).encode())
