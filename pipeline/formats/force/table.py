"""Tables of forces from any program: options or labels say which column is what, options or the
header in which unit.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.cells import bare
from pipeline.formats.force.clock import rate_of, read_clock, seconds_of
from pipeline.formats.force.record import (
    FORCES,
    OPTION,
    TORQUES,
    ForceLogOptions,
    ForceRecord,
    axis_of,
    check_columns,
    repeats,
    si_factors,
    with_torque,
)
from pipeline.formats.format import Format, Kind
from pipeline.formats.number_sheet import Sheet, read_sheet

KEY = f"{OPTION}.columns"
TIMES = re.compile(r"t|time ?(stamp)?", re.IGNORECASE)
NUMBERS = re.compile(r"(sample|sequence|packet)( ?(number|no\.?|#))?", re.IGNORECASE)


def read_force_table(file: Path, options: ForceLogOptions) -> ForceRecord:
    """Return the record in ``file``, in N, N·m and s, of the columns that ``options`` name: fx, fy,
    fz, and as there are t, tx, ty, tz; without any name, of those whose labels say what they are.

    Units are those behind a label, in the line below the labels, or of the options. Without a
    column t, samples follow each other at the option's rate. ``counts``: ``repeated_rows`` and
    ``zero_rows``, both kept; ``blank_rows``; ``cut_rows``; and with times those of
    :func:`pipeline.formats.force.clock.read_clock`.

    Raises RecordingError, with the line and the option that settles it where there is one, for axes
    or units that nothing names, a time that goes back, and malformed rows.
    """
    sheet = force_sheet(file, options)
    values = axis_values(sheet, options)
    return timed_record(sheet, values, options, lambda: _rate(options, file))


def _rate(options: ForceLogOptions, file: Path) -> float:
    if options.rate is None:
        raise RecordingError(
            "neither a column t nor a rate gives the samples a time; set rate to the samples a "
            "second",
            file=file,
            key=f"{OPTION}.rate",
        )
    return options.rate


def force_sheet(file: Path, options: ForceLogOptions) -> Sheet:
    """Return the table in ``file``; RecordingError where it has no sample or lacks a column."""
    sheet = read_sheet(file, separator=options.separator, decimal=options.decimal, key=OPTION)
    if not sheet.rows:
        raise RecordingError(
            "no whole sample below the labels: no line holds numbers; record again",
            file=file,
            line=sheet.header_lines[-1],
        )
    sheet.require_cells()
    return sheet


def axis_values(sheet: Sheet, options: ForceLogOptions) -> np.ndarray:
    """Return (N, 3 or 6) forces in N and, where there are any, torques in N·m."""
    columns = axis_columns(sheet, options)
    units = {axis: sheet.unit(column) for axis, column in columns.items()}
    factors = si_factors(list(columns), units, options, file=sheet.file, line=sheet.label_line)
    return sheet.values(list(columns.values())) * factors


def axis_columns(sheet: Sheet, options: ForceLogOptions) -> dict[str, int]:
    """Return the column of each axis, the three forces and, where there are any, the three torques:
    by the options, else by the labels.
    """
    if options.columns:
        check_columns(options.columns, file=sheet.file)
        named = {axis: column for axis, column in options.columns.items() if axis != "t"}
        columns = sheet.columns(named, KEY)
    else:
        columns = {}
        for column, label in enumerate(sheet.labels):
            if axis := axis_of(label):
                columns.setdefault(axis, []).append(column)
        if doubled := [axis for axis, held in columns.items() if len(held) > 1]:
            message = (
                f"two columns are labelled {sheet.labels[columns[doubled[0]][0]]}; name each axis "
                "by its number in columns"
            )
            raise RecordingError(message, file=sheet.file, line=sheet.label_line, key=KEY)
        columns = {axis: held[0] for axis, held in columns.items()}
    wanted = [*FORCES, *(TORQUES if set(TORQUES) & set(columns) else ())]
    if missing := [axis for axis in wanted if axis not in columns]:
        there = f", only {', '.join(sheet.labels)}" if sheet.labels else ""
        message = (
            f"no column is labelled {', '.join(missing)}{there}; correct the labels or name the "
            "axes in columns"
        )
        raise RecordingError(message, file=sheet.file, line=sheet.label_line, key=KEY)
    return {axis: columns[axis] for axis in wanted}


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
    named = options.columns.get("t")
    if not options.columns:
        labels = [(n, bare(label)) for n, label in enumerate(sheet.labels)]
        fits = [n for kind in (TIMES, NUMBERS) for n, label in labels if kind.fullmatch(label)]
        named = fits[0] if fits else None
    counts = repeats(values) | sheet.counts
    if named is None:
        frequency = rate()
        time = np.arange(len(values)) / frequency
    else:
        column = sheet.columns({"t": named}, KEY)["t"]
        label = bare(sheet.labels[column]) if sheet.labels else ""
        if NUMBERS.fullmatch(label):
            numbers = sheet.values([column])[:, 0]
            frequency = rate()
            time = (numbers - numbers[0]) / frequency
        else:
            time = seconds_of(sheet, column, sheet.unit(column), options)
            frequency = None
        keep, clocked = read_clock(time, values, sheet.lines, place="line", file=sheet.file)
        time, values = time[keep], values[keep]
        counts = repeats(values) | sheet.counts | clocked
        frequency = frequency or rate_of(time)
    counts |= more or {}
    return ForceRecord(time, *with_torque(values), frequency, serial, started, counts)


FORMAT = Format("table of forces", Kind.FORCE, read_force_table, option="table")
