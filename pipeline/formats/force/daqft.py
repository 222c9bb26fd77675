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
from pipeline.formats.delimited import NUMBER
from pipeline.formats.force.record import (
    FORCES,
    OPTION,
    TORQUES,
    ForceLogOptions,
    ForceRecord,
    axis_of,
    check_serial,
    si_factors,
)
from pipeline.formats.force.table import axis_values, force_sheet, timed_record
from pipeline.formats.format import Format, Head, Kind, Stated
from pipeline.formats.number_sheet import Sheet, read_sheet

DELAY = re.compile(r'"?(Paused for|Skipped)\s+(\d{1,18})\b')
GAUGE = re.compile(r"G([0-5])")
HEADING = re.compile(
    r'^"?(Paused for|Skipped)\s+\d|Frequency\s*=|Averaging Level\s*=|F/T Serial Number\s*='
    r'|"?Force X\b'
)
NO_OPTIONS = ForceLogOptions()


def read_daqft(file: Path, options: ForceLogOptions = NO_OPTIONS) -> ForceRecord:
    """Return the record in ``file``, in N, N·m and s; gauge voltages become forces and torques by
    the calibration of ``options``.

    Where a column holds times or sample numbers, by its label or as ``t`` of the options, lost rows
    leave a gap; where none does, the samples follow each other at the stated rate, and nothing
    shows that a row was lost.

    ``counts`` as of :func:`pipeline.formats.force.table.read_force_table`, and ``paused_ms`` or
    ``skipped_samples`` between the start and the first sample. A last row that is short or has no
    line end is dropped: the program was stopped while it wrote.

    Raises RecordingError as there, and for gauge voltages without a calibration, no row of labels,
    and no frequency or averaging level.
    """
    sheet = force_sheet(file, options)
    if sheet.header and sheet.header[0].lstrip('"').startswith("Start Time"):
        raise RecordingError(
            "this is a log of a Net F/T: set format to netft",
            file=file,
            line=1,
            key=f"{OPTION}.format",
        )
    if not sheet.labels:
        raise RecordingError(
            f"no line above the rows of {len(sheet.last)} cells labels them all: it is missing or "
            "cut; name the columns by number in a log of format table",
            file=file,
            line=sheet.lines[0],
            key=f"{OPTION}.format",
        )
    settings = sheet.settings
    serial = settings.get("F/T Serial Number", "")
    check_serial(serial, options, file=file)
    gauges = [label for label in sheet.labels if GAUGE.fullmatch(label)]
    if gauges and not options.columns and not any(map(axis_of, sheet.labels)):
        values = _forces_of_gauges(sheet, options)
    else:
        values = axis_values(sheet, options)
    delay = DELAY.match(sheet.header[0])
    name = "paused_ms" if delay and delay[1] == "Paused for" else "skipped_samples"
    return timed_record(
        sheet,
        values,
        options,
        lambda: _rate(settings, options, sheet),
        serial=serial,
        started=settings.get("Time Started", ""),
        more={name: int(delay[2])} if delay else {},
    )


def _forces_of_gauges(sheet: Sheet, options: ForceLogOptions) -> np.ndarray:
    """(N, 6) N and N·m: the calibration's matrix times the voltages. A bias is linear too, so the
    tare takes it out afterwards.
    """
    where = {"file": sheet.file, "line": sheet.label_line}
    if options.calibration is None:
        message = (
            "gauge voltages need the transducer's calibration; no column is labelled "
            "Force X, Force Y, Force Z"
        )
        raise RecordingError(message, **where, key=f"{OPTION}.calibration")
    found = [(GAUGE.fullmatch(label), column) for column, label in enumerate(sheet.labels)]
    places = {int(gauge[1]): column for gauge, column in found if gauge}
    if len(places) != 6:
        raise RecordingError(
            f"the log has the gauges {sorted(places)}, not 0 to 5 once each", **where
        )
    calibration = options.calibration
    stated = dict.fromkeys(FORCES, calibration.force_unit)
    stated |= dict.fromkeys(TORQUES, calibration.torque_unit)
    factors = si_factors([*FORCES, *TORQUES], stated, options, **where)
    return sheet.values([places[gauge] for gauge in range(6)]) @ calibration.matrix.T * factors


def _rate(settings: dict[str, str], options: ForceLogOptions, sheet: Sheet) -> float:
    """Samples a second: sampling frequency over averaging level, else the option's."""
    stated, where = [], {"file": sheet.file, "line": sheet.label_line}
    for key in ("Frequency", "Averaging Level"):
        text = settings.get(key)
        # in a culture of decimal commas a point is of thousands, or of another culture
        plain = text is not None and NUMBER.fullmatch(
            text if sheet.decimal == "." else text.replace(".", "?").replace(",", ".")
        )
        if not plain and options.rate is not None:
            return options.rate
        if not plain:
            problem = (
                f"state no {key}"
                if text is None
                else f"state {key} = {text}, which can be read in two ways or none"
            )
            message = f"the labels {problem}, so samples have no time; state the rate"
            raise RecordingError(message, **where, key=f"{OPTION}.rate")
        stated.append(float(text.replace(sheet.decimal, ".")))
        if not 0 < stated[-1] < np.inf:
            raise RecordingError(f"{key} = {text} gives samples no time", **where, key=key)
    rate = stated[0] / stated[1]
    if options.rate is not None and not np.isclose(options.rate, rate):
        message = f"the log states {rate:g} samples a second, the option {options.rate:g}"
        raise RecordingError(message, file=sheet.file, key=f"{OPTION}.rate")
    return rate


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
    """Separator and decimal mark, and the units of the labels."""
    sheet = read_sheet(file, key=OPTION)
    units = {}
    for quantity, axes in (("force", FORCES), ("torque", TORQUES)):
        stated = {sheet.unit(n) for n, label in enumerate(sheet.labels) if axis_of(label) in axes}
        if len(stated := stated - {None}) == 1:
            units[quantity] = stated.pop()
    separator = {";": "semicolons", ",": "commas", "\t": "tabs"}.get(sheet.separator, "blanks")
    mark = "comma" if sheet.decimal == "," else "point"
    facts = {"separator": sheet.separator, "decimal": sheet.decimal}
    return Stated(f"{separator} and decimal {mark}", units, facts)


FORMAT = Format("ATI DAQ F/T log", Kind.FORCE, read_daqft, _begins, _states, option="daqft")
