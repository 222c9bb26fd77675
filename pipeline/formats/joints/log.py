"""Plain joint logs of a robot's controller: one line a sample, time and one value a joint, in a
file a signal or in one table.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.labels import columns_of, unit_of
from pipeline.formats.number_sheet import Sheet, read_sheet
from pipeline.formats.units import TIME_UNITS

CLOCK_TOLERANCE = 0.1  # of a step
ANGLE_UNITS = {"rad": 1.0, "deg": np.pi / 180}
SPELLINGS = {
    "radian": "rad",
    "radians": "rad",
    "degree": "deg",
    "degrees": "deg",
    "°": "deg",
    "sec": "s",
    "seconds": "s",
    "µs": "us",
}
# no joint of an arm turns farther from its zero than this, so that angles beyond are in another
# unit
MOST_TURNS = 4
OPTION = "dataset.joint_log"


@dataclass(frozen=True)
class JointLog:
    """N samples of all joints: angles in rad or speeds in rad/s, whichever the controller
    logged.
    """

    time: np.ndarray  # (N,) s on the controller's clock, increasing
    values: np.ndarray  # (N, joints)
    counts: dict[str, int]  # see read_joint_log


@dataclass(frozen=True)
class Layout:
    """How a controller writes its logs (section dataset.joint_log)."""

    # column by label, or by number from 0; None: the rows follow each other at ``rate``
    time: str | int | None = 0
    rate: float = np.nan  # 1/s, of logs without a time
    separator: str | None = None  # as found
    decimal: str | None = None  # as found
    angle_unit: str = "rad"
    time_unit: str = "s"


PLAIN = Layout()


def read_joint_log(
    file: Path, *, joints: int, columns: Sequence[str | int] | None = None, layout: Layout = PLAIN
) -> JointLog:
    """Log in ``file`` of a robot with that many ``joints``; logs of one movement may differ in
    length.

    ``columns`` (joints) are those of the joints by label or by number from 0; without them a line
    holds the time and the joints and nothing else. A controller that is stopped while it writes
    leaves a last line that is short or has no line end: it is dropped. ``counts``: ``cut_rows``,
    ``blank_rows`` and ``doubled_rows`` (the same line at the same time, left out). Raises
    RecordingError with the line for any other line of another width, a value that is not a finite
    number and a time that does not increase; with the option that settles it for a column that is
    not there, for a unit in the header that is not the option's and for angles beyond four turns.
    """
    sheet = read_sheet(file, separator=layout.separator, decimal=layout.decimal, key=OPTION)
    if not sheet.rows:
        raise RecordingError(
            "the header is followed by no whole line; record again",
            file=file,
            line=sheet.header_lines[-1],
        )
    first = 0 if layout.time is None else 1
    if columns is None:
        if sheet.width != joints + first:
            content = f"{'a time and ' if first else ''}{sheet.width - first} values"
            message = (
                f"the line has {content}, not {joints}; check the number of joints, or "
                "name their columns in signals"
            )
            raise RecordingError(message, file=file, line=sheet.lines[0])
        columns = list(range(first, joints + first))
    places = _places(
        sheet, {f"joint {number}": column for number, column in enumerate(columns, start=1)}, layout
    )
    table = sheet.values(places)
    values = table[:, first:] * ANGLE_UNITS[layout.angle_unit]
    if np.abs(values).max() > MOST_TURNS * 2 * np.pi:
        row = int(np.argmax(np.abs(values).max(axis=1)))
        message = (
            f"{np.abs(values).max():.6g} rad, or rad/s, is not a joint of an arm: is "
            f"the angle_unit {layout.angle_unit}?"
        )
        raise RecordingError(message, file=file, line=sheet.lines[row], key=f"{OPTION}.angle_unit")
    if layout.time is None:
        return JointLog(
            np.arange(len(values)) / layout.rate, values, sheet.counts | {"doubled_rows": 0}
        )
    time = table[:, 0] * TIME_UNITS[layout.time_unit]
    return _increasing(sheet, time, values)


def _places(sheet: Sheet, columns: Mapping[str, str | int], layout: Layout) -> list[int]:
    """Columns of the time, where there is one, and of the joints."""
    wanted = {**({} if layout.time is None else {"time": layout.time}), **columns}
    names = [name for name in wanted.values() if isinstance(name, str)]
    labels, line = [], sheet.lines[0]
    if names:
        index = sheet.label_row(names)
        labels, line = sheet.header_cells(index), sheet.header_lines[index]
        if len(labels) != sheet.width:
            raise RecordingError(
                f"the row has {sheet.width} cells under {len(labels)} labels",
                file=sheet.file,
                line=sheet.lines[0],
            )
    places = columns_of(
        labels, wanted, sheet.width, file=sheet.file, line=line, key=f"{OPTION}.signals"
    )
    _check_units(sheet, places, layout)
    return list(places.values())


def _check_units(sheet: Sheet, places: Mapping[str, int], layout: Layout) -> None:
    """RecordingError where a header's unit, in brackets behind a label or in a row below the
    labels, is another than the option's.
    """
    for index in range(len(sheet.header)):
        cells = sheet.header_cells(index)
        for quantity, column in places.items() if len(cells) == sheet.width else ():
            unit = (unit_of(cells[column]) or cells[column]).strip().lower().removesuffix("/s")
            key, units = (
                ("time_unit", TIME_UNITS) if quantity == "time" else ("angle_unit", ANGLE_UNITS)
            )
            unit = SPELLINGS.get(unit, unit)
            if unit in units and unit != getattr(layout, key):
                message = (
                    f"the {quantity} is in {unit} by the header and in "
                    f"{getattr(layout, key)} by the option"
                )
                raise RecordingError(
                    message, file=sheet.file, line=sheet.header_lines[index], key=f"{OPTION}.{key}"
                )


def _increasing(sheet: Sheet, time: np.ndarray, values: np.ndarray) -> JointLog:
    steps = np.diff(time)
    doubled = (steps == 0) & (values[1:] == values[:-1]).all(axis=1)
    wrong = (steps <= 0) & ~doubled
    if wrong.any():
        raise RecordingError(
            "the time does not increase",
            file=sheet.file,
            line=sheet.lines[int(np.argmax(wrong)) + 1],
        )
    keep = np.append(True, ~doubled)
    return JointLog(time[keep], values[keep], sheet.counts | {"doubled_rows": int(doubled.sum())})


def read_movement(
    folder: Path,
    files: Sequence[str],
    *,
    joints: int,
    rate: float,
    columns: Sequence[Sequence[str | int] | None] | None = None,
    layout: Layout = PLAIN,
) -> tuple[list[np.ndarray], dict[str, int]]:
    """Values (N, joints) of the logs ``files`` of one movement, row by row at the same times, as
    many as the shortest log has.

    ``columns`` of each log and ``layout`` as in :func:`read_joint_log`; one table of several
    signals is named once for each of them. ``counts``: those of :func:`read_joint_log` over all
    logs, and ``rows_without_partner`` that were left out because another log ends before them.
    Raises RecordingError for clocks that disagree or do not step at ``rate`` (1/s) throughout.
    """
    named = zip(files, columns or [None] * len(files), strict=True)
    logs = [
        read_joint_log(Path(folder) / file, joints=joints, columns=chosen, layout=layout)
        for file, chosen in named
    ]
    length = min(len(log.time) for log in logs)
    time = logs[0].time[:length]
    uneven = np.abs(np.diff(time) * rate - 1) > CLOCK_TOLERANCE
    if uneven.any():
        row = int(np.argmax(uneven))
        message = (
            f"the log steps by {time[row + 1] - time[row]:.6g} s at {time[row]:.6g} "
            f"s, not by 1/{rate:g} s; samples are missing"
        )
        raise RecordingError(message, file=Path(folder) / files[0])
    for file, log in zip(files, logs, strict=True):
        if (np.abs(log.time[:length] - time) * rate > CLOCK_TOLERANCE).any():
            raise RecordingError(
                f"the times are not those of {files[0]}; take logs of one recording",
                file=Path(folder) / file,
            )
    # a table that holds several signals counts once
    counted = {file: log.counts for file, log in zip(files, logs, strict=True)}
    counts = {
        name: sum(log_counts[name] for log_counts in counted.values()) for name in logs[0].counts
    }
    counts["rows_without_partner"] = sum(len(log.time) - length for log in logs)
    return [log.values[:length] for log in logs], counts
