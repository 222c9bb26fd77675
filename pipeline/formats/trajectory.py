"""The commanded trajectory as plain CSV: pose and velocity of the end-effector in the plane of the
chain, the joint angles, which say what an arm of any joints is told, or both.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.core.columns import PLANE, columns, members
from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import Text, cells_of, is_blank, numbers_of, read_text
from pipeline.formats.format import Format, Head, Kind

COLUMNS = ["t", "x", "z", "phi", "vx", "vz", "vphi"]  # s, m, m, rad, m/s, m/s, rad/s
# a time printed with six decimals is up to half a microsecond off, a step up to one
STEP_TOLERANCE = 1.01e-6


def read_trajectory(file: Path) -> pd.DataFrame:
    """Trajectory in ``file``: one row a time step, the column t in s and, float64, the families x
    and v of the task's rows in m, m, rad and per second, the family q of the joints in rad, or
    both.

    The header names the columns ``t, x, z, phi, vx, vz, vphi``, ``t`` and ``q:JOINT`` of each
    joint, or all of them, in any order. Raises RecordingError, with the line where there is one,
    for missing columns, fewer than two rows, a value that is not a finite number, steps that are
    not positive and equal within a microsecond, an angle that jumps by more than half a turn, and
    a last row without line end, which may have lost digits.
    """
    text = _whole_text(file)
    labels = cells_of(text.lines[0], ",", file=file, number=1)
    joints = list(dict.fromkeys(label for label in labels if label.startswith("q:")))
    whole = not joints or not {*COLUMNS[1:]}.isdisjoint(labels)
    wanted = [*(COLUMNS if whole else ["t"]), *joints]
    table = _even_rows(text, labels, wanted, "; or t and q:JOINT of each joint", file)
    turning = [column for column in wanted if column in ("phi", *joints)]
    angles = table[:, [wanted.index(column) for column in turning]]
    jumps = np.abs(np.diff(angles, axis=0)) > np.pi
    if jumps.any():
        row, column = np.argwhere(jumps)[0].tolist()
        raise RecordingError(
            f"{turning[column]} jumps by {angles[row + 1, column] - angles[row, column]:.4g} rad "
            f"at t = {table[row + 1, 0]:.6g} s: a commanded angle goes on beyond ±π and is not "
            "wrapped by 2π = 6.283 rad; export it so",
            file=file,
        )
    return pd.DataFrame(table, columns=[*(_families() if whole else ["t"]), *joints])


def read_poses(file: Path, task: Sequence[str]) -> pd.DataFrame:
    """Poses in ``file``: one row a time step, the columns t in s and the rows of the ``task`` by
    their names, in m and rad, in any order; others may stand beside them. Raises as
    :func:`read_trajectory` does.
    """
    text = _whole_text(file)
    labels = cells_of(text.lines[0], ",", file=file, number=1)
    wanted = ["t", *task]
    return pd.DataFrame(_even_rows(text, labels, wanted, "", file), columns=wanted)


def _whole_text(file: Path) -> Text:
    text = read_text(file)
    if text.cut is not None:
        line = len(text.lines) + 1
        raise RecordingError(
            "the last row has no line end, so it may be cut; export the trajectory again",
            file=file,
            line=line,
        )
    return text


def _even_rows(
    text: Text, labels: list[str], wanted: list[str], otherwise: str, file: Path
) -> np.ndarray:
    """(rows, columns) the ``wanted`` columns under ``labels``, time first, its steps equal;
    ``otherwise`` ends the refusal of a header without them.
    """
    if missing := [column for column in wanted if labels.count(column) != 1]:
        raise RecordingError(
            f"the header must name {', '.join(missing)} once each, of {', '.join(wanted)}"
            f"{otherwise}",
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
    return table


def write_trajectory(file: Path, trajectory: pd.DataFrame) -> None:
    """Write t and, of ``trajectory``, the families x and v of the plane and the family q, as far as
    it has them; every number reads back bit for bit.
    """
    joints = columns("q", members(trajectory, "q"))
    whole = bool(members(trajectory, "x"))
    chosen = [*(_families() if whole else ["t"]), *joints]
    header = [*(COLUMNS if whole else ["t"]), *joints]
    trajectory[chosen].to_csv(file, index=False, header=header, lineterminator="\n")


def _families() -> list[str]:
    return ["t", *columns("x", PLANE), *columns("v", PLANE)]


def _begins(head: Head) -> bool:
    labels = {cell.strip().strip('"') for cell in head.lines[0].split(",")} if head.lines else set()
    joints = {label for label in labels if label.startswith("q:")}
    return set(COLUMNS) <= labels or (bool(joints) and labels == {"t"} | joints)


FORMAT = Format("commanded trajectory", Kind.TRAJECTORY, read_trajectory, _begins)
