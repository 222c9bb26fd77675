"""Commanded trajectories as plain CSV: pose and velocity of the end-effector in the plane of a
planar arm, commanded joint angles of any arm, or both.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.core.columns import PLANE, columns, members
from pipeline.core.errors import RecordingError
from pipeline.formats.format import Format, Head, Kind
from pipeline.formats.number_sheet import read_sheet

COLUMNS = ["t", "x", "z", "phi", "vx", "vz", "vphi"]  # s, m, m, rad, m/s, m/s, rad/s
FAMILIES = ["t", *columns("x", PLANE), *columns("v", PLANE)]
STEP_TOLERANCE = 1.01e-6  # s: two times of six decimals round a step by a microsecond


def read_trajectory(file: Path) -> pd.DataFrame:
    """Return the trajectory in ``file``, one row per time step: t in s; poses x (m, m, rad) and
    velocities v (m/s, m/s, rad/s), joint angles q in rad, or both. The file has the columns ``t``
    and ``x, z, phi, vx, vz, vphi``, one ``q:JOINT`` per joint, or both. Raises RecordingError, with
    the line if known, for a missing column, fewer than two rows, a cell without a finite number and
    a last row without line end. Time steps must be positive and equal to a microsecond; angles must
    not jump by more than half a turn.
    """
    table = _even_rows(file)
    turning = [name for name in table if name == "phi" or name.startswith("q:")]
    jumps = np.abs(np.diff(table[turning], axis=0)) > np.pi
    if jumps.any():
        row, column = np.argwhere(jumps)[0].tolist()
        name = turning[column]
        before, after = table[name].iloc[row : row + 2]
        raise RecordingError(
            f"{name} jumps by {after - before:.4g} rad at t = {table.t[row + 1]:.6g} s: "
            "a commanded angle must be continuous beyond ±π, without jumps of 2π = 6.283 rad; "
            "export unwrapped angles",
            file=file,
        )
    return table.rename(columns=dict(zip(COLUMNS, FAMILIES, strict=True)))


def _commanded_columns(labels: list[str]) -> list[str]:
    """Return the columns to read: of the plane, unless there are only joints, and of the joints."""
    joints = [label for label in dict.fromkeys(labels) if label.startswith("q:")]
    plane = not joints or not {*COLUMNS[1:]}.isdisjoint(labels)
    return [*(COLUMNS if plane else ["t"]), *joints]


def _even_rows(file: Path) -> pd.DataFrame:
    """Return the commanded columns, time first; RecordingError for unequal time steps."""
    sheet = read_sheet(file, separator=",", decimal=".")
    wanted = _commanded_columns(sheet.labels)
    missing = [column for column in wanted if sheet.labels.count(column) != 1]
    if missing:
        raise RecordingError(
            f"the header must name {', '.join(missing)} once each, of {', '.join(wanted)}; "
            "or t and q:JOINT of each joint",
            file=file,
            line=sheet.label_line,
        )
    last = sheet.lines[-1]
    if sheet.counts["cut_rows"]:
        message = (
            "the last row is short or has no line end: it may be cut; export it again"
        )
        raise RecordingError(message, file=file, line=last + 1)
    if len(sheet.rows) < 2:
        message = "a trajectory needs at least two rows"
        raise RecordingError(message, file=file, line=last)
    table = sheet.values([sheet.labels.index(column) for column in wanted])
    steps = np.diff(table[:, 0])
    step = float(np.median(steps))
    uneven = (np.abs(steps - step) > STEP_TOLERANCE) | (steps <= 0)
    if uneven.any():
        first = int(np.argmax(uneven))
        raise RecordingError(
            f"the time step is {steps[first]:.6g} s, its median {step:.6g} s; all time steps must "
            "be equal and positive",
            file=file,
            line=sheet.lines[first + 1],
        )
    return pd.DataFrame(table, columns=wanted)


def write_trajectory(file: Path, trajectory: pd.DataFrame) -> None:
    """Write t and, if present, poses x, velocities v and joint angles q, without rounding."""
    joints = columns("q", members(trajectory, "q"))
    families = labels = ["t"]
    if members(trajectory, "x"):
        families = FAMILIES
        labels = COLUMNS
    table = trajectory[[*families, *joints]]
    header = [*labels, *joints]
    table.to_csv(file, index=False, header=header, lineterminator="\n")


def _begins(head: Head) -> bool:
    cells = head.lines[0].split(",") if head.lines else []
    labels = {cell.strip().strip('"') for cell in cells}
    joints = {label for label in labels if label.startswith("q:")}
    return set(COLUMNS) <= labels or (bool(joints) and labels == {"t"} | joints)


FORMAT = Format("commanded trajectory", Kind.TRAJECTORY, read_trajectory, _begins)
