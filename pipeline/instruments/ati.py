"""ATI DAQ F/T logs: six axes of force and torque as the sensor's own .NET program writes them, in the culture of its PC.

A first line may tell what was skipped; then one row of labels, whose last four are settings (``Frequency = 1000``) and have no column
under them, or several rows of labels, units and settings; then one quoted row a sample, as a rule without its time. Cultures with a
decimal comma separate cells by semicolons. Instead of forces the program may have written the voltages of the gauges, ``G0`` to ``G5``.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from pipeline.errors import RecordingError
from pipeline.instruments.delimited import NUMBER, cells_of
from pipeline.instruments.force_clock import rate_of, read_clock, seconds_of
from pipeline.instruments.force_record import (
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
)  # fmt: skip
from pipeline.instruments.number_sheet import Sheet, bare, columns_of, read_sheet, unit_of

DELAY = re.compile(r'"?(Paused for|Skipped)\s+(\d+)')
GAUGE = re.compile(r"G([0-5])")
TIMES = re.compile(r"t|time ?(stamp)?", re.IGNORECASE)
NUMBERS = re.compile(r"(sample|sequence|packet)( ?(number|no\.?|#))?", re.IGNORECASE)
NO_OPTIONS = LogOptions()


def read_daqft(file: Path, options: LogOptions = NO_OPTIONS) -> ForceRecord:
    """Record in ``file``, in N, N·m and s; gauge voltages become forces and torques by the calibration of ``options``.

    Where a column holds times or sample numbers, by its label or as ``t`` of the options, lost rows leave a gap; where none does, the
    samples follow each other at the stated rate, and nothing shows that a row was lost.

    ``counts``: ``repeated_rows`` (equal to the row before) and ``zero_rows``, both kept; ``blank_rows``; ``cut_rows`` (a last row that is
    short or has no line end: the program was stopped while it wrote, so the row is dropped); ``paused_ms`` or ``skipped_samples``
    between the start and the first sample; with times or numbers those of :func:`pipeline.instruments.force_clock.read_clock`.

    Raises RecordingError, with the line and the option that settles it where there is one, for a label without a known unit, an axis that
    is missing or named twice, gauge voltages without a calibration, no row of labels, no frequency or averaging level, no sample, and
    malformed rows.
    """
    sheet = read_sheet(file, separator=options.separator, decimal=options.decimal, key=OPTION)
    if sheet.header and sheet.header[0].lstrip('"').startswith("Start Time"):
        raise RecordingError("this is a log of a Net F/T: set format to netft", file=file, line=1, key=f"{OPTION}.format")
    top = 1 if sheet.header and DELAY.match(sheet.header[0]) else 0
    cells = [cells_of(line, sheet.separator, file=file, number=number) for line, number in _under(sheet, top)]
    settings = dict(re.split(r"\s*=\s*", cell, maxsplit=1) for row in cells for cell in row if "=" in cell)
    rows = [[cell for cell in row if "=" not in cell] for row in cells]
    if not any(rows):
        advice = "name the columns by number in a log of format table"
        raise RecordingError(f"the row of labels is missing or cut; {advice}", file=file, line=top + 1, key=f"{OPTION}.format")
    index = next((i for i, row in enumerate(rows) if any(axis_of(cell) or GAUGE.fullmatch(cell) for cell in row)), 0)
    labels, label_line = rows[index], sheet.header_lines[top + index]
    if not sheet.rows:
        message = "the labels are followed by no whole sample: in no line are half of the cells numbers; record again"
        raise RecordingError(message, file=file, line=label_line)
    if sheet.width != len(labels):
        raise RecordingError(f"the row has {sheet.width} cells under {len(labels)} labels", file=file, line=sheet.lines[0])
    serial = settings.get("F/T Serial Number", "")
    check_serial(serial, options, file=file)
    if options.columns:
        check_columns(options.columns, file=file)
    below = next((row for row in rows[index + 1 :] if len(row) == len(labels)), [""] * len(labels))
    stated = [unit_of(label) or under.strip("()[] ") or None for label, under in zip(labels, below, strict=True)]
    if not options.columns and any(map(GAUGE.fullmatch, labels)) and not any(map(axis_of, labels)):
        values = _forces_of_gauges(sheet, labels, options, file, label_line)
    else:
        columns = _columns(labels, options, file, label_line)
        units = {axis: stated[column] for axis, column in columns.items()}
        values = sheet.values(list(columns.values())) * si_factors(list(columns), units, options, file=file, line=label_line)
    time, rate, clocked = _clock(sheet, labels, stated, settings, options, label_line)
    counts = sheet.counts
    if clocked:
        keep, found = read_clock(time, values, sheet.lines, place="line", file=file)
        time, values, counts = time[keep], values[keep], counts | found
    counts = repeats(values) | counts
    if top:
        delay = DELAY.match(sheet.header[0])
        counts["paused_ms" if delay[1] == "Paused for" else "skipped_samples"] = int(delay[2])
    return ForceRecord(time, *with_torque(values), rate, serial, settings.get("Time Started", ""), counts)


def _under(sheet: Sheet, top: int) -> list[tuple[str, int]]:
    return list(zip(sheet.header[top:], sheet.header_lines[top:], strict=True))


def _columns(labels: list[str], options: LogOptions, file: Path, line: int) -> dict[str, int]:
    """Column of each axis, the three forces and, where there are any, the three torques: by the options, else by the labels."""
    if options.columns:
        named = {axis: options.columns[axis] for axis in (*FORCES, *TORQUES) if axis in options.columns}
        return columns_of(labels, named, len(labels), file=file, line=line, key=f"{OPTION}.columns")
    found: dict[str, int] = {}
    for column, label in enumerate(labels):
        axis = axis_of(label)
        if axis in found:
            message = f"two columns are labelled {label.split('(')[0].strip()}; name each axis by its number in columns"
            raise RecordingError(message, file=file, line=line, key=f"{OPTION}.columns")
        if axis:
            found[axis] = column
    wanted = [*FORCES, *(TORQUES if set(TORQUES) & set(found) else ())]
    if missing := [axis for axis in wanted if axis not in found]:
        named = ", ".join(f"{'Force' if axis in FORCES else 'Torque'} {axis[1].upper()}" for axis in missing)
        message = f"no column is labelled {named}, only {', '.join(labels)}; correct the labels or name the axes in columns"
        raise RecordingError(message, file=file, line=line, key=f"{OPTION}.columns")
    return {axis: found[axis] for axis in wanted}


def _forces_of_gauges(sheet: Sheet, labels: list[str], options: LogOptions, file: Path, line: int) -> np.ndarray:
    """(N, 6) N and N·m: the calibration's matrix times the voltages. A bias is linear too, so the tare takes it out afterwards."""
    if options.calibration is None:
        message = "gauge voltages need the transducer's calibration; no column is labelled Force X, Force Y, Force Z"
        raise RecordingError(message, file=file, line=line, key=f"{OPTION}.calibration")
    places = {int(match[1]): column for column, label in enumerate(labels) if (match := GAUGE.fullmatch(label))}
    if len(places) != 6:
        raise RecordingError(f"the log has the gauges {sorted(places)}, not 0 to 5 once each", file=file, line=line)
    calibration = options.calibration
    stated = dict.fromkeys(FORCES, calibration.force_unit) | dict.fromkeys(TORQUES, calibration.torque_unit)
    factors = si_factors([*FORCES, *TORQUES], stated, options, file=file, line=line)
    return sheet.values([places[gauge] for gauge in range(6)]) @ calibration.matrix.T * factors


def _clock(
    sheet: Sheet, labels: list[str], stated: list[str | None], settings: dict[str, str], options: LogOptions, line: int
) -> tuple[np.ndarray, float, bool]:  # fmt: skip
    """(N,) times in s, samples a second, and whether the log has times or sample numbers to tell them by."""
    named = options.columns.get("t") if options.columns else next((i for i, label in enumerate(labels) if _is_clock(label)), None)
    if named is None:
        rate = _rate(settings, options, sheet, line)
        return np.arange(len(sheet.rows)) / rate, rate, False
    column = columns_of(labels, {"t": named}, len(labels), file=sheet.file, line=line, key=f"{OPTION}.columns")["t"]
    if NUMBERS.fullmatch(bare(labels[column])):
        rate, numbers = _rate(settings, options, sheet, line), sheet.values([column])[:, 0]
        return (numbers - numbers[0]) / rate, rate, True
    time = seconds_of(sheet, column, stated[column], options, line)
    return time, rate_of(time), True


def _is_clock(label: str) -> bool:
    return any(kind.fullmatch(bare(label)) for kind in (TIMES, NUMBERS))


def _rate(settings: dict[str, str], options: LogOptions, sheet: Sheet, line: int) -> float:
    """Samples a second: sampling frequency over averaging level, else the option's."""
    stated = []
    for key in ("Frequency", "Averaging Level"):
        text = settings.get(key)
        # in a culture of decimal commas a point is of thousands, or of another culture
        plain = text is not None and NUMBER.fullmatch(text if sheet.decimal == "." else text.replace(".", "?").replace(",", "."))
        if not plain and options.rate is not None:
            return options.rate
        if not plain:
            found = f"state no {key}" if text is None else f"state {key} = {text}, which can be read in two ways or none"
            message = f"the labels {found}, so samples have no time; state the rate"
            raise RecordingError(message, file=sheet.file, line=line, key=f"{OPTION}.rate")
        stated.append(float(text.replace(sheet.decimal, ".")))
        if not 0 < stated[-1] < np.inf:
            raise RecordingError(f"{key} = {text} gives samples no time", file=sheet.file, line=line, key=key)
    rate = stated[0] / stated[1]
    if options.rate is not None and not np.isclose(options.rate, rate):
        message = f"the log states {rate:g} samples a second, the option {options.rate:g}"
        raise RecordingError(message, file=sheet.file, key=f"{OPTION}.rate")
    return rate


def write_daqft(file: Path, record: ForceRecord, *, decimal: str = ".") -> None:
    """Write ``record`` in N and N·m as the program does on a PC whose culture has the given ``decimal`` mark ("." or ",").

    Fifteen significant digits, as .NET prints a double, and averaging level 1; the counts are not written.
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
