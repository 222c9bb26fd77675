"""Tables of forces from any program, and their clock: options or labels say which column is which,
options or the header in which unit.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.force.record import (
    FORCES,
    OPTION,
    TORQUES,
    ForceLogOptions,
    ForceRecord,
    axis_of,
    repeats,
    si_factors,
    with_torque,
)
from pipeline.formats.format import Format, Kind
from pipeline.formats.number_sheet import Sheet, read_sheet
from pipeline.formats.units import TIME_UNITS, bare, spelled

KEY = f"{OPTION}.columns"
TIMES = re.compile(r"t|time ?(stamp)?", re.IGNORECASE)
NUMBERS = re.compile(r"(sample|(rdt )?sequence|packet)( ?(number|no\.?|#))?", re.IGNORECASE)
JITTER = 0.1  # of the median step


def read_force_table(file: Path, options: ForceLogOptions) -> ForceRecord:
    """Return the record in ``file``, in N, N·m and s, of the columns that ``options`` name: fx, fy,
    fz, and as there are t, tx, ty, tz; without any name, of those whose labels say what they are.

    Units are those behind a label, in the line below the labels, or of the options. Without a
    column t, samples follow each other at the option's rate. ``counts``: ``repeated_rows`` and
    ``zero_rows``, both kept; ``blank_rows``; ``cut_rows``; and with times those of
    :func:`read_clock`.

    Raises RecordingError, with the line and the option that settles it where there is one, for axes
    or units that nothing names, a time that goes back, and malformed rows.
    """
    sheet = force_sheet(file, options)

    def rate() -> float:
        if options.rate is None:
            message = "neither a column t nor a rate gives the samples a time; set rate to the "
            raise RecordingError(f"{message}samples a second", file=file, key=f"{OPTION}.rate")
        return options.rate

    return timed_record(sheet, axis_values(sheet, options), options, rate)


def force_sheet(file: Path, options: ForceLogOptions, **form: str) -> Sheet:
    """Return the table in ``file``; RecordingError where it has no sample or lacks a column."""
    form = {"separator": options.separator, "decimal": options.decimal} | form
    sheet = read_sheet(file, key=OPTION, **form)
    if not sheet.rows:
        message = "no whole sample below the labels: no line holds numbers; record again"
        raise RecordingError(message, file=file, line=sheet.header_lines[-1])
    sheet.require_cells()
    return sheet


def axis_values(
    sheet: Sheet,
    options: ForceLogOptions,
    stated: Mapping[str, str | None] | None = None,
    per_unit: np.ndarray | float = 1.0,
) -> np.ndarray:
    """Return (N, 3 or 6) forces in N and, where there are any, torques in N·m; units of the axes
    are those ``stated``, else those of the header, and ``per_unit`` numbers are one of them.
    """
    columns = axis_columns(sheet, options)
    stated = stated or {axis: sheet.unit(column) for axis, column in columns.items()}
    factors = si_factors(stated, options, file=sheet.file, line=sheet.label_line)
    return sheet.values([*columns.values()]) * (factors / per_unit)


def axis_columns(sheet: Sheet, options: ForceLogOptions) -> dict[str, int]:
    """Return the column of each axis, the three forces and, where there are any, the three torques:
    by the options, else by the labels.
    """
    named = {axis: column for axis, column in options.columns.items() if axis != "t"}
    message = ""
    if unknown := sorted({*named} - {*FORCES, *TORQUES}):
        message = f"no axis {', '.join(unknown)}; there are t, fx, fy, fz, tx, ty, tz"
    for column, label in enumerate(() if options.columns else sheet.labels):
        if (axis := axis_of(label)) in named:
            message = f"two columns are labelled {sheet.labels[named[axis]]}; name each axis by its"
            message += " number in columns"
        named |= {axis: column} if axis else {}
    wanted = [*FORCES, *(TORQUES if {*TORQUES} & {*named} else ())]
    if (missing := [axis for axis in wanted if axis not in named]) and not message:
        there = f", only {', '.join(sheet.labels)}" if sheet.labels else ""
        message = f"no column is named or labelled {', '.join(missing)}{there}; correct the labels,"
        message += " or name the forces and all torques or none in columns"
    if message:
        raise RecordingError(message, file=sheet.file, line=sheet.label_line, key=KEY)
    return sheet.columns({axis: named[axis] for axis in wanted}, KEY)


def timed_record(
    sheet: Sheet,
    values: np.ndarray,
    options: ForceLogOptions,
    rate: Callable[[], float],
    *,
    serial: str = "",
    started: str = "",
    more: Mapping[str, int] | None = None,
) -> ForceRecord:
    """Return the record of ``values`` (N, axes), timed by a column of times or sample numbers, else
    by the ``rate``; ``more`` are counts beside those of :func:`read_force_table`.
    """
    labels = [bare(label) for label in sheet.labels]
    fits = [
        n for kind in (TIMES, NUMBERS) for n, label in enumerate(labels) if kind.fullmatch(label)
    ]
    named = options.columns.get("t") if options.columns else next(iter(fits), None)
    clocked: dict[str, int] = {}
    if named is None:
        frequency = rate()
        time = np.arange(len(values)) / frequency
    else:
        column = sheet.columns({"t": named}, KEY)["t"]
        numbered = bool(labels) and NUMBERS.fullmatch(labels[column]) is not None
        scale = rate() if numbered else _unit_of_time(sheet, column, options)
        ticks = sheet.values([column])[:, 0]
        time = (ticks - ticks[0]) / scale if numbered else (ticks - ticks[0]) * scale
        keep, clocked = read_clock(time, values, sheet.lines, place="line", file=sheet.file)
        time, values = time[keep], values[keep]
        frequency = scale if numbered else rate_of(time)
    counts = repeats(values) | sheet.counts | clocked | (more or {})
    return ForceRecord(time, *with_torque(values), frequency, serial, started, counts)


def _unit_of_time(sheet: Sheet, column: int, options: ForceLogOptions) -> float:
    """Return the unit of the ``column`` of times in s, of the header, else of the option."""
    stated, option = sheet.unit(column), options.time_unit
    unit, message = spelled(stated) if stated else option, ""
    if unit not in TIME_UNITS:
        problem = f"the time has no known unit{f' ({unit!r})' if unit else ''}"
        message = f"{problem}: state one of {', '.join(TIME_UNITS)}"
    elif stated and option and unit != spelled(option):
        message = f"the time is in {unit} by the log and in {option} by the option"
    if message:
        where = {"file": sheet.file, "line": sheet.label_line, "key": f"{OPTION}.time_unit"}
        raise RecordingError(message, **where)
    return TIME_UNITS[unit]


def read_clock(
    time: np.ndarray, values: np.ndarray, places: list[int], *, place: str, file: object
) -> tuple[np.ndarray, dict[str, int]]:
    """Return which of N samples to keep (N,), and counts of what their ``time`` (N,) in s shows of
    ``values`` (N, axes).

    Counts: ``doubled_rows`` (the same sample at the same time, not kept), ``equal_times`` (another
    sample at the same time, kept), ``uneven_steps`` (off the median by more than a tenth of it:
    jitter) and ``missing_samples`` (that would fit into the longer steps). Raises RecordingError,
    with the number in ``places`` (N) of the ``place`` (line, sample) there, for a time that goes
    back, and for one that most samples share with the one before.
    """
    steps = np.diff(time)
    if (steps < 0).any():
        row = int(np.argmax(steps < 0)) + 1
        message = f"the time goes back to {time[row]:.9g} s: rows are swapped or of two recordings"
        raise RecordingError(message, file=file, **{place: places[row]})
    doubled = (steps == 0) & (values[1:] == values[:-1]).all(axis=1)
    keep = np.append(True, ~doubled)
    steps = np.diff(time[keep])
    median = float(np.median(steps)) if len(steps) else 0.0
    if len(steps) and median == 0:
        message = "most samples share their time with the one before: no clock"
        raise RecordingError(message, file=file, **{place: places[0]})
    return keep, {
        "doubled_rows": int(doubled.sum()),
        "equal_times": int(np.sum(steps == 0)),
        "uneven_steps": int(np.sum(np.abs(steps - median) > JITTER * median)),
        "missing_samples": int(np.sum(np.rint(steps[steps > 1.5 * median] / median) - 1)),
    }


def rate_of(time: np.ndarray) -> float:
    """Return samples a second by the median step of ``time`` (N,) in s; NaN of a single sample."""
    return float(1 / np.median(np.diff(time))) if len(time) > 1 else float("nan")


FORMAT = Format("table of forces", Kind.FORCE, read_force_table, option="table")
