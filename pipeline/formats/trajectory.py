"""The commanded trajectory as plain CSV: pose and velocity of the end-effector in the plane of the
chain, or the joint angles, which say what an arm of any joints is told.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.core.columns import columns, members
from pipeline.core.errors import RecordingError
from pipeline.core.options.dataset import PLANE
from pipeline.formats.delimited import cells_of, is_blank, numbers_of, read_text
from pipeline.formats.format import Format, Head, Kind

COLUMNS = ["t", "x", "z", "phi", "vx", "vz", "vphi"]  # s, m, m, rad, m/s, m/s, rad/s
# a time printed with six decimals is up to half a microsecond off, a step up to one
STEP_TOLERANCE = 1.01e-6


def read_trajectory(file: Path) -> pd.DataFrame:
    """Trajectory in ``file``: one row a time step, the column t in s and, float64, either the
    families x and v of the task's rows in m, m, rad and per second, or the family q of the joints
    in rad.

    The header names the columns ``t, x, z, phi, vx, vz, vphi``, or ``t`` and ``q:JOINT`` of each
    joint, in any order. Raises RecordingError, with the line where there is one, for missing
    columns, fewer than two rows, a value that is not a finite number, steps that are not positive
    and equal within a microsecond, and a last row without line end, which may have lost digits.
    """
    text = read_text(file)
    if text.cut is not None:
        line = len(text.lines) + 1
        raise RecordingError(
            "the last row has no line end, so it may be cut; export the trajectory again",
            file=file,
            line=line,
        )
    labels = cells_of(text.lines[0], ",", file=file, number=1)
    joints = list(dict.fromkeys(label for label in labels if label.startswith("q:")))
    wanted = ["t", *joints] if joints else COLUMNS
    if missing := [column for column in wanted if labels.count(column) != 1]:
        raise RecordingError(
            f"the header must name {', '.join(missing)} once each, of {', '.join(wanted)}; or t "
            "and q:JOINT of each joint",
            file=file,
            line=1,
        )
    places = [
        number for number, line in enumerate(text.lines[1:], start=2) if not is_blank(line, ",")
    ]
    if len(places) < 2:
        raise RecordingError(
            "a trajectory needs at least two rows", file=file, line=len(text.lines)
        )
    rows = [text.lines[place - 1] for place in places]
    if rows[0].count(",") + 1 != len(labels):
        raise RecordingError(
            f"the row has {rows[0].count(',') + 1} cells under {len(labels)} labels",
            file=file,
            line=places[0],
        )
    table = numbers_of(rows, places, [labels.index(column) for column in wanted], file=file)
    steps = np.diff(table[:, 0])
    step = float(np.median(steps))
    uneven = (np.abs(steps - step) > STEP_TOLERANCE) | (steps <= 0)
    if uneven.any():
        first = int(np.argmax(uneven))
        message = (
            f"the step is {steps[first]:.6g} s, elsewhere {step:.6g} s; steps must be "
            "equal and positive"
        )
        raise RecordingError(message, file=file, line=places[first + 1])
    return pd.DataFrame(table, columns=wanted if joints else _families())


def write_trajectory(file: Path, trajectory: pd.DataFrame) -> None:
    """Write t and, of ``trajectory``, the family q where it has one, else the families x and v of
    the plane; every number reads back bit for bit.
    """
    joints = columns("q", members(trajectory, "q"))
    chosen, header = (["t", *joints], ["t", *joints]) if joints else (_families(), COLUMNS)
    trajectory[chosen].to_csv(file, index=False, header=header, lineterminator="\n")


def _families() -> list[str]:
    return ["t", *columns("x", PLANE), *columns("v", PLANE)]


def _begins(head: Head) -> bool:
    labels = {cell.strip().strip('"') for cell in head.lines[0].split(",")} if head.lines else set()
    joints = {label for label in labels if label.startswith("q:")}
    return set(COLUMNS) <= labels or (bool(joints) and labels == {"t"} | joints)


FORMAT = Format("commanded trajectory", Kind.TRAJECTORY, read_trajectory, _begins)
