"""Plain joint logs of a robot's controller: no header, one line a sample, time and one value a joint, separated by commas."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.errors import RecordingError
from pipeline.instruments.delimited import is_blank, numbers_of, read_text


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


def write_joint_log(file: Path, log: JointLog) -> None:
    """Write ``log`` with six decimals, which is what controllers print: 1 µs and 1 µrad."""
    table = np.column_stack([log.time, log.values])
    row = ", ".join(["%.6f"] * table.shape[1]) + "\n"
    Path(file).write_bytes((row * len(table) % tuple(table.ravel().tolist())).encode())
