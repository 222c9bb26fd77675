"""Plain tables of forces from any program: which column is what, and in which unit, stands in the
option or in the table's own header.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.force.clock import rate_of, read_clock, seconds_of
from pipeline.formats.force.record import (
    FORCES,
    OPTION,
    TORQUES,
    ForceRecord,
    LogOptions,
    check_columns,
    repeats,
    si_factors,
    with_torque,
)
from pipeline.formats.format import Format, Kind
from pipeline.formats.labels import columns_of, unit_of
from pipeline.formats.number_sheet import Sheet, read_sheet

KEY = f"{OPTION}.columns"


def read_force_table(file: Path, options: LogOptions) -> ForceRecord:
    """Record in ``file``, in N, N·m and s, of the columns that ``options`` name: fx, fy, fz, and as
    there are t, tx, ty, tz.

    Units stand in brackets behind a label, in the line below the labels, or in the options. Without
    a column t, samples follow each other at the option's rate. ``counts``: ``repeated_rows`` and
    ``zero_rows``, both kept; ``blank_rows``; ``cut_rows``; and with times those of
    :func:`pipeline.formats.force.clock.read_clock`.

    Raises RecordingError, with the line and the option that settles it where there is one, for axes
    or units that nothing names, a time that goes back, and malformed rows.
    """
    sheet = read_sheet(file, separator=options.separator, decimal=options.decimal, key=OPTION)
    check_columns(options.columns, file=file)
    if not sheet.rows:
        raise RecordingError(
            "no whole sample: in no line are half of the cells numbers; record again",
            file=file,
            line=sheet.header_lines[-1],
        )
    sheet.require_cells()
    columns, units, line = _named(sheet, options)
    axes = [axis for axis in (*FORCES, *TORQUES) if axis in columns]
    values = sheet.values([columns[axis] for axis in axes]) * si_factors(
        axes, units, options, file=file, line=line
    )
    counts = dict(sheet.counts)
    if "t" in columns:
        time = seconds_of(sheet, columns["t"], units.get("t"), options, line)
        keep, clock_counts = read_clock(time, values, sheet.lines, place="line", file=file)
        time, values, counts = time[keep], values[keep], counts | clock_counts
        rate = rate_of(time)
    elif options.rate is None:
        raise RecordingError(
            "neither a column t nor a rate gives the samples a time",
            file=file,
            key=f"{OPTION}.rate",
        )
    else:
        rate = options.rate
        time = np.arange(len(values)) / rate
    return ForceRecord(time, *with_torque(values), rate, "", "", repeats(values) | counts)


def _named(sheet: Sheet, options: LogOptions) -> tuple[dict[str, int], dict[str, str | None], int]:
    """Columns by quantity, the units that the header states for them, and the line of the
    labels.
    """
    names = [name for name in options.columns.values() if isinstance(name, str)]
    if not names and not sheet.header:
        return (
            columns_of(
                [], options.columns, sheet.width, file=sheet.file, line=sheet.lines[0], key=KEY
            ),
            {},
            sheet.lines[0],
        )
    if not names:
        rows = [
            row
            for row in map(sheet.header_cells, range(len(sheet.header)))
            if len(row) == sheet.width
        ]
        columns = columns_of(
            [], options.columns, sheet.width, file=sheet.file, line=sheet.lines[0], key=KEY
        )
        label_rows, line = rows, sheet.lines[0]
    else:
        index = sheet.label_row(names)
        label_rows = [sheet.header_cells(i) for i in range(index, len(sheet.header))]
        line = sheet.header_lines[index]
        if len(label_rows[0]) != sheet.width:
            message = f"the row has {sheet.width} cells under {len(label_rows[0])} labels"
            raise RecordingError(message, file=sheet.file, line=sheet.lines[0])
        columns = columns_of(
            label_rows[0], options.columns, sheet.width, file=sheet.file, line=line, key=KEY
        )
        label_rows = [row for row in label_rows if len(row) == sheet.width]
    units = {}
    for quantity, column in columns.items():
        behind = [unit for row in label_rows if (unit := unit_of(row[column]))]
        below = [row[column] for row in label_rows[1:2] if row[column]]
        units[quantity] = next(iter(behind or below), None)
    return columns, units, line


FORMAT = Format("table of forces", Kind.FORCE, read_force_table, option="table")
