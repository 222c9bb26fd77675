"""Commanded trajectories as plain CSV: pose and velocity of the end-effector in the plane of a
planar arm, commanded joint angles of any arm, or both.
"""

from collections.abc import Callable
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

    def choose(labels: list[str]) -> list[str]:
        joints = list(
            dict.fromkeys(label for label in labels if label.startswith("q:"))
        )
        plane = not joints or not {*COLUMNS[1:]}.isdisjoint(labels)
        return [*(COLUMNS if plane else ["t"]), *joints]

    table = _even_rows(file, choose, "; or t and q:JOINT of each joint")
    turning = [name for name in table if name == "phi" or name.startswith("q:")]
    jumps = np.abs(np.diff(table[turning], axis=0)) > np.pi
    if jumps.any():
        row, column = np.argwhere(jumps)[0].tolist()
        before, after = table[turning[column]].iloc[row : row + 2]
        at = f"{turning[column]} jumps by {after - before:.4g} rad at t = {table.t[row + 1]:.6g} s"
        need = "a commanded angle must be continuous beyond ±π, without jumps of 2π = 6.283 rad"
        raise RecordingError(f"{at}: {need}; export unwrapped angles", file=file)
    return table.rename(columns=dict(zip(COLUMNS, FAMILIES, strict=True)))


def _even_rows(
    file: Path, choose: Callable[[list[str]], list[str]], otherwise: str = ""
) -> pd.DataFrame:
    """Return the columns ``choose(labels)``, time first; RecordingError for unequal time steps."""
    sheet = read_sheet(file, separator=",", decimal=".")
    wanted, message, line = choose(sheet.labels), "", sheet.label_line
    if missing := [column for column in wanted if sheet.labels.count(column) != 1]:
        message = f"the header must name {', '.join(missing)} once each, of {', '.join(wanted)}"
        message += otherwise
    elif sheet.counts["cut_rows"]:
        message = (
            "the last row is short or has no line end: it may be cut; export it again"
        )
        line = sheet.lines[-1] + 1
    elif len(sheet.rows) < 2:
        message, line = "a trajectory needs at least two rows", sheet.lines[-1]
    if message:
        raise RecordingError(message, file=file, line=line)
    table = sheet.values([sheet.labels.index(column) for column in wanted])
    steps = np.diff(table[:, 0])
    step = float(np.median(steps))
    uneven = (np.abs(steps - step) > STEP_TOLERANCE) | (steps <= 0)
    if uneven.any():
        first = int(np.argmax(uneven))
        message = f"the time step is {steps[first]:.6g} s, its median {step:.6g} s; all time steps "
        message += "must be equal and positive"
        raise RecordingError(message, file=file, line=sheet.lines[first + 1])
    return pd.DataFrame(table, columns=wanted)


def write_trajectory(file: Path, trajectory: pd.DataFrame) -> None:
    """Write t and, if present, poses x, velocities v and joint angles q, without rounding."""
    joints, plane = (
        columns("q", members(trajectory, "q")),
        bool(members(trajectory, "x")),
    )
    chosen, header = (
        [*(names if plane else ["t"]), *joints] for names in (FAMILIES, COLUMNS)
    )
    trajectory[chosen].to_csv(file, index=False, header=header, lineterminator="\n")


def _begins(head: Head) -> bool:
    labels = (
        {cell.strip().strip('"') for cell in head.lines[0].split(",")}
        if head.lines
        else set()
    )
    joints = {label for label in labels if label.startswith("q:")}
    return set(COLUMNS) <= labels or (bool(joints) and labels == {"t"} | joints)


FORMAT = Format("commanded trajectory", Kind.TRAJECTORY, read_trajectory, _begins)
