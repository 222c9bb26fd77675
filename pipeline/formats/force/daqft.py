"""ATI DAQ F/T logs: six axes of force and torque as the sensor's own .NET program writes them, in
the culture of its PC.

A first line may tell what was skipped; then one row of labels, whose last four are settings
(``Frequency = 1000``) and have no column under them, or several rows of labels, units and settings;
then one quoted row a sample, as a rule without its time. Cultures with a decimal comma separate
cells by semicolons. Instead of forces the program may have written the voltages of the gauges,
``G0`` to ``G5``.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import cells_of
from pipeline.formats.force.clock import read_clock
from pipeline.formats.force.daqft_clock import clock_of
from pipeline.formats.force.record import (
    FORCES,
    OPTION,
    TORQUES,
    ForceRecord,
    LogOptions,
    axis_of,
    check_columns,
    check_serial,
    repeats,
    si_factors,
    with_torque,
)
from pipeline.formats.format import Format, Head, Kind, Stated
from pipeline.formats.labels import columns_of, unit_of
from pipeline.formats.number_sheet import Sheet, read_sheet

DELAY = re.compile(r'"?(Paused for|Skipped)\s+(\d{1,18})\b')
GAUGE = re.compile(r"G([0-5])")
HEADING = re.compile(
    r'^"?(Paused for|Skipped)\s+\d|Frequency\s*=|Averaging Level\s*=|F/T Serial Number\s*='
    r'|"?Force X\b'
)
NO_OPTIONS = LogOptions()


def read_daqft(file: Path, options: LogOptions = NO_OPTIONS) -> ForceRecord:
    """Record in ``file``, in N, N·m and s; gauge voltages become forces and torques by the
    calibration of ``options``.

    Where a column holds times or sample numbers, by its label or as ``t`` of the options, lost rows
    leave a gap; where none does, the samples follow each other at the stated rate, and nothing
    shows that a row was lost.

    ``counts``: ``repeated_rows`` (equal to the row before) and ``zero_rows``, both kept;
    ``blank_rows``; ``cut_rows`` (a last row that is short or has no line end: the program was
    stopped while it wrote, so the row is dropped); ``paused_ms`` or ``skipped_samples`` between the
    start and the first sample; with times or numbers those of
    :func:`pipeline.formats.force.clock.read_clock`.

    Raises RecordingError, with the line and the option that settles it where there is one, for a
    label without a known unit, an axis that is missing or named twice, gauge voltages without a
    calibration, no row of labels, no frequency or averaging level, no sample, and malformed rows.
    """
    sheet = read_sheet(file, separator=options.separator, decimal=options.decimal, key=OPTION)
    if sheet.header and sheet.header[0].lstrip('"').startswith("Start Time"):
        raise RecordingError(
            "this is a log of a Net F/T: set format to netft",
            file=file,
            line=1,
            key=f"{OPTION}.format",
        )
    top = 1 if sheet.header and DELAY.match(sheet.header[0]) else 0
    cells = [
        cells_of(line, sheet.separator, file=file, number=number)
        for line, number in _under(sheet, top)
    ]
    settings = dict(
        map(str.strip, cell.split("=", 1)) for row in cells for cell in row if "=" in cell
    )
    rows = [[cell for cell in row if "=" not in cell] for row in cells]
    if not any(rows):
        advice = "name the columns by number in a log of format table"
        raise RecordingError(
            f"the row of labels is missing or cut; {advice}",
            file=file,
            line=top + 1,
            key=f"{OPTION}.format",
        )
    index = next(
        (
            i
            for i, row in enumerate(rows)
            if any(axis_of(cell) or GAUGE.fullmatch(cell) for cell in row)
        ),
        0,
    )
    labels, label_line = rows[index], sheet.header_lines[top + index]
    if not sheet.rows:
        message = (
            "the labels are followed by no whole sample: in no line are half of the "
            "cells numbers; record again"
        )
        raise RecordingError(message, file=file, line=label_line)
    if sheet.width != len(labels):
        raise RecordingError(
            f"the row has {sheet.width} cells under {len(labels)} labels",
            file=file,
            line=sheet.lines[0],
        )
    serial = settings.get("F/T Serial Number", "")
    check_serial(serial, options, file=file)
    if options.columns:
        check_columns(options.columns, file=file)
    below = next((row for row in rows[index + 1 :] if len(row) == len(labels)), [""] * len(labels))
    stated = [
        unit_of(label) or under.strip("()[] ") or None
        for label, under in zip(labels, below, strict=True)
    ]
    if not options.columns and any(map(GAUGE.fullmatch, labels)) and not any(map(axis_of, labels)):
        values = _forces_of_gauges(sheet, labels, options, file, label_line)
    else:
        columns = _columns(labels, options, file, label_line)
        units = {axis: stated[column] for axis, column in columns.items()}
        values = sheet.values(list(columns.values())) * si_factors(
            list(columns), units, options, file=file, line=label_line
        )
    time, rate, clocked = clock_of(sheet, labels, stated, settings, options, label_line)
    counts = sheet.counts
    if clocked:
        keep, clock_counts = read_clock(time, values, sheet.lines, place="line", file=file)
        time, values, counts = time[keep], values[keep], counts | clock_counts
    counts = repeats(values) | counts
    if top:
        delay = DELAY.match(sheet.header[0])
        counts["paused_ms" if delay[1] == "Paused for" else "skipped_samples"] = int(delay[2])
    return ForceRecord(
        time, *with_torque(values), rate, serial, settings.get("Time Started", ""), counts
    )


def _under(sheet: Sheet, top: int) -> list[tuple[str, int]]:
    return list(zip(sheet.header[top:], sheet.header_lines[top:], strict=True))


def _columns(labels: list[str], options: LogOptions, file: Path, line: int) -> dict[str, int]:
    """Column of each axis, the three forces and, where there are any, the three torques: by the
    options, else by the labels.
    """
    if options.columns:
        named = {
            axis: options.columns[axis] for axis in (*FORCES, *TORQUES) if axis in options.columns
        }
        return columns_of(labels, named, len(labels), file=file, line=line, key=f"{OPTION}.columns")
    columns: dict[str, int] = {}
    for column, label in enumerate(labels):
        axis = axis_of(label)
        if axis in columns:
            message = (
                f"two columns are labelled {label.split('(')[0].strip()}; name each "
                "axis by its number in columns"
            )
            raise RecordingError(message, file=file, line=line, key=f"{OPTION}.columns")
        if axis:
            columns[axis] = column
    wanted = [*FORCES, *(TORQUES if set(TORQUES) & set(columns) else ())]
    if missing := [axis for axis in wanted if axis not in columns]:
        named = ", ".join(
            f"{'Force' if axis in FORCES else 'Torque'} {axis[1].upper()}" for axis in missing
        )
        message = (
            f"no column is labelled {named}, only {', '.join(labels)}; correct the "
            "labels or name the axes in columns"
        )
        raise RecordingError(message, file=file, line=line, key=f"{OPTION}.columns")
    return {axis: columns[axis] for axis in wanted}


def _forces_of_gauges(
    sheet: Sheet, labels: list[str], options: LogOptions, file: Path, line: int
) -> np.ndarray:
    """(N, 6) N and N·m: the calibration's matrix times the voltages. A bias is linear too, so the
    tare takes it out afterwards.
    """
    if options.calibration is None:
        message = (
            "gauge voltages need the transducer's calibration; no column is labelled "
            "Force X, Force Y, Force Z"
        )
        raise RecordingError(message, file=file, line=line, key=f"{OPTION}.calibration")
    places = {
        int(match[1]): column
        for column, label in enumerate(labels)
        if (match := GAUGE.fullmatch(label))
    }
    if len(places) != 6:
        raise RecordingError(
            f"the log has the gauges {sorted(places)}, not 0 to 5 once each", file=file, line=line
        )
    calibration = options.calibration
    stated = dict.fromkeys(FORCES, calibration.force_unit) | dict.fromkeys(
        TORQUES, calibration.torque_unit
    )
    factors = si_factors([*FORCES, *TORQUES], stated, options, file=file, line=line)
    return sheet.values([places[gauge] for gauge in range(6)]) @ calibration.matrix.T * factors


def write_daqft(file: Path, record: ForceRecord, *, decimal: str = ".") -> None:
    """Write ``record`` in N and N·m as the program does on a PC whose culture has the given
    ``decimal`` mark ("." or ",").

    Fifteen significant digits, as .NET prints a double, and averaging level 1; the counts are not
    written.
    """
    separator = ";" if decimal == "," else ","
    labels = [f"Force {axis} (N)" for axis in "XYZ"] + [f"Torque {axis} (N-m)" for axis in "XYZ"]
    labels += [f"Frequency = {record.rate:.15G}".replace(".", decimal), "Averaging Level = 1"]
    labels += [f"F/T Serial Number = {record.serial}", f"Time Started = {record.started}"]
    row = separator.join(['"%.15G"'] * 6) + "\r\n"
    values = np.hstack([record.force, record.torque])
    rows = row * len(values) % tuple(values.ravel().tolist())
    header = separator.join(f'"{label}"' for label in labels) + "\r\n"
    Path(file).write_bytes((header + rows.replace(".", decimal)).encode())


def _begins(head: Head) -> bool:
    return any(HEADING.search(line) for line in head.lines[:4])


def _states(file: Path) -> Stated:
    """Separator and decimal mark, and the units behind the labels or in the row below them."""
    sheet = read_sheet(file, key=OPTION)
    header = [sheet.header_cells(index) for index in range(len(sheet.header))]
    units = {}
    for quantity, axes in (("force", FORCES), ("torque", TORQUES)):
        behind, below = set(), set()
        for row, under in zip(header, [*header[1:], []], strict=True):
            columns = [column for column, cell in enumerate(row) if axis_of(cell) in axes]
            behind |= {unit for column in columns if (unit := unit_of(row[column]))}
            below |= {under[column] for column in columns if column < len(under)} - {""}
        if len(stated := behind or below) == 1:
            units[quantity] = stated.pop()
    separator = {";": "semicolons", ",": "commas", "\t": "tabs"}.get(sheet.separator, "blanks")
    mark = "comma" if sheet.decimal == "," else "point"
    facts = {"separator": sheet.separator, "decimal": sheet.decimal}
    return Stated(f"{separator} and decimal {mark}", units, facts)


FORMAT = Format("ATI DAQ F/T log", Kind.FORCE, read_daqft, _begins, _states, option="daqft")
