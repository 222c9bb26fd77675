"""ATI DAQ F/T logs: six axes of force and torque as the sensor's own .NET program writes them, in the culture of its PC.

A first line may tell what was skipped; then one row of labels, whose last four are settings (``Frequency = 1000``) and have no column
under them, or several rows of labels, units and settings; then one quoted row a sample, without its time. Cultures with a decimal comma
separate cells by semicolons. Instead of forces the program may have written the voltages of the gauges, ``G0`` to ``G5``.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from pipeline.errors import RecordingError
from pipeline.instruments.delimited import cells_of
from pipeline.instruments.force_record import (
    FORCES,
    OPTION,
    TORQUES,
    ForceRecord,
    LogOptions,
    axis_of,
    check_serial,
    repeats,
    si_factors,
    with_torque,
)  # fmt: skip
from pipeline.instruments.number_sheet import Sheet, columns_of, read_sheet, unit_of

DELAY = re.compile(r'"?(Paused for|Skipped)\s+(\d+)')
GAUGE = re.compile(r"G([0-5])")
NO_OPTIONS = LogOptions()


def read_daqft(file: Path, options: LogOptions = NO_OPTIONS) -> ForceRecord:
    """Record in ``file``, in N, N·m and s; gauge voltages become forces and torques by the calibration of ``options``.

    ``counts``: ``repeated_rows`` (equal to the row before) and ``zero_rows``, both kept; ``blank_rows``; ``cut_rows`` (a last row that is
    short or has no line end: the program was stopped while it wrote, so the row is dropped); ``paused_ms`` or ``skipped_samples``
    between the start and the first sample.

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
        raise RecordingError("the labels are followed by no whole sample; record again", file=file, line=label_line)
    if sheet.width != len(labels):
        raise RecordingError(f"the row has {sheet.width} cells under {len(labels)} labels", file=file, line=sheet.lines[0])
    serial = settings.get("F/T Serial Number", "")
    check_serial(serial, options, file=file)
    rate = _rate(settings, options, sheet, file, label_line)
    if not options.columns and any(map(GAUGE.fullmatch, labels)) and not any(map(axis_of, labels)):
        values = _forces_of_gauges(sheet, labels, options, file, label_line)
    else:
        columns = _columns(labels, options, file, label_line)
        below = next((row for row in rows[index + 1 :] if len(row) == len(labels)), [])
        units = {axis: unit_of(labels[i]) or (below[i].strip("()[] ") or None if below else None) for axis, i in columns.items()}
        values = sheet.values(list(columns.values())) * si_factors(list(columns), units, options, file=file, line=label_line)
    counts = repeats(values) | sheet.counts
    if top:
        delay = DELAY.match(sheet.header[0])
        counts["paused_ms" if delay[1] == "Paused for" else "skipped_samples"] = int(delay[2])
    return ForceRecord(np.arange(len(values)) / rate, *with_torque(values), rate, serial, settings.get("Time Started", ""), counts)


def _under(sheet: Sheet, top: int) -> list[tuple[str, int]]:
    return list(zip(sheet.header[top:], sheet.header_lines[top:], strict=True))


def _columns(labels: list[str], options: LogOptions, file: Path, line: int) -> dict[str, int]:
    """Column of each axis, the three forces and, where there are any, the three torques: by the options, else by the labels."""
    if options.columns:
        return columns_of(labels, options.columns, len(labels), file=file, line=line, key=f"{OPTION}.columns")
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


def _rate(settings: dict[str, str], options: LogOptions, sheet: Sheet, file: Path, line: int) -> float:
    """Samples a second: sampling frequency over averaging level, else the option's."""
    if options.rate is not None and not {"Frequency", "Averaging Level"} & set(settings):
        return options.rate
    stated = []
    for key in ("Frequency", "Averaging Level"):
        try:
            value = float(settings[key].replace(sheet.decimal, "."))
        except (KeyError, ValueError):
            message = f"the labels state no {key}, so samples have no time; state the rate"
            raise RecordingError(message, file=file, line=line, key=f"{OPTION}.rate") from None
        if not 0 < value < np.inf:
            raise RecordingError(f"{key} = {value} gives samples no time", file=file, line=line, key=key)
        stated.append(value)
    rate = stated[0] / stated[1]
    if options.rate is not None and not np.isclose(options.rate, rate):
        raise RecordingError(f"the log states {rate:g} samples a second, the option {options.rate:g}", file=file, key=f"{OPTION}.rate")
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
