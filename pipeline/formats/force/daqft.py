"""Logs of ATI's programs: DAQ F/T, in the culture of its PC, and Net F/T.

DAQ F/T: a first line may say what was skipped; then labels, units and settings (``Frequency =
1000``, which have no column under them) in one row or several; then one quoted row a sample, of
forces or of the gauges' voltages ``G0`` to ``G5``, as a rule without its time. Cultures with a
decimal comma separate cells by semicolons.

Net F/T: lines of ``key: value`` (start time, RDT sample rate, units, counts per unit), the labels,
and one row a packet. Earlier versions have counts, which are whole; later ones have divided them,
and print every number with a decimal point.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import NUMBER
from pipeline.formats.force.record import (
    FORCES,
    KEY,
    NO_OPTIONS,
    OPTION,
    TORQUES,
    ForceLogOptions,
    ForceRecord,
    axis_columns,
    axis_of,
    axis_values,
    calibrated_factors,
    force_sheet,
    timed_record,
)
from pipeline.formats.format import Format, Head, Kind
from pipeline.formats.number_sheet import Sheet

DELAY = re.compile(r'"?(Paused for|Skipped)\s+(\d{1,18})\b')
GAUGES = [f"G{n}" for n in range(6)]
STATUS = re.compile(r"(0x)?[0-9a-fA-F]{1,8}")
HEADING = re.compile(
    r'^"?(Paused for|Skipped)\s+\d|Frequency\s*=|Averaging Level\s*=|F/T Serial Number\s*='
    r'|"?Force X\b'
)
PLAIN = {"separator": ",", "decimal": "."}  # form of a Net F/T log in every culture


def read_daqft(file: Path, options: ForceLogOptions = NO_OPTIONS) -> ForceRecord:
    """Return the record in ``file``, in N, N·m and s; gauge voltages become forces and torques by
    the calibration of ``options``. Without a column of times or sample numbers the samples follow
    each other at the stated rate, and nothing shows that a row was lost.

    ``counts`` and errors as of :func:`pipeline.formats.force.record.read_force_table`, and
    ``paused_ms`` or ``skipped_samples`` before the first sample. RecordingError too for gauge
    voltages without a calibration, no row of labels, and no frequency or averaging level.
    """
    sheet = force_sheet(file, options)
    where = {"file": file, "key": f"{OPTION}.format"}
    if sheet.header and sheet.header[0].lstrip('"').startswith("Start Time"):
        raise RecordingError("this is a log of a Net F/T: set format to netft", line=1, **where)
    if not sheet.labels:
        message = f"no line above the rows of {len(sheet.last)} cells labels them all; name the "
        message += "columns by number in a log of format table"
        raise RecordingError(message, line=sheet.lines[0], **where)
    settings, theirs = sheet.settings, getattr(options.calibration, "serial", "")
    serial, started = (settings.get(name, "") for name in ("F/T Serial Number", "Time Started"))
    if serial and theirs and serial != theirs:
        message = f"the log is of the transducer {serial}, the calibration of {theirs}"
        raise RecordingError(message, file=file, key=f"{OPTION}.calibration")
    forces = options.columns or any(map(axis_of, sheet.labels))
    voltages = not forces and not {*GAUGES}.isdisjoint(sheet.labels)
    values = (_forces_of_gauges if voltages else axis_values)(sheet, options)
    delay = DELAY.match(sheet.header[0])
    name = "paused_ms" if delay and delay[1] == "Paused for" else "skipped_samples"
    units = {}
    for quantity, axes in (("force", FORCES), ("torque", TORQUES)):
        stated = {sheet.unit(n) for n, label in enumerate(sheet.labels) if axis_of(label) in axes}
        if len(stated := stated - {None}) == 1:
            units[quantity] = stated.pop()
    record = timed_record(sheet, values, options, lambda: _rate(settings, options, sheet))
    counts = record.counts | ({name: int(delay[2])} if delay else {})
    return replace(record, serial=serial, started=started, counts=counts, units=units)


def _forces_of_gauges(sheet: Sheet, options: ForceLogOptions) -> np.ndarray:
    """Return (N, 6) N and N·m: the calibration's matrix times the voltages. A bias is linear too,
    so the tare takes it out afterwards.
    """
    found, message = [label for label in sheet.labels if label in GAUGES], ""
    if options.calibration is None:
        message = "gauge voltages need the transducer's calibration; no column is labelled "
        message += "Force X, Force Y, Force Z"
    elif sorted(found) != GAUGES:
        message = f"the log has the gauges {', '.join(found)}, not 0 to 5 once each"
    if message:
        where = {"file": sheet.file, "line": sheet.label_line, "key": f"{OPTION}.calibration"}
        raise RecordingError(message, **where)
    factors = calibrated_factors(options.calibration, options)
    volts = sheet.values([sheet.labels.index(label) for label in GAUGES])
    return volts @ options.calibration.matrix.T * factors


def _rate(settings: dict[str, str], options: ForceLogOptions, sheet: Sheet) -> float:
    """Return samples a second: sampling frequency over averaging level, else the option's."""
    stated, where = [], {"file": sheet.file, "line": sheet.label_line, "key": f"{OPTION}.rate"}
    for key in ("Frequency", "Averaging Level"):
        text = settings.get(key, "")
        # in a culture of decimal commas a point is of thousands, or of another culture
        plain = text if sheet.decimal == "." else text.replace(".", "?").replace(",", ".")
        if not NUMBER.fullmatch(plain):
            if options.rate is not None:
                return options.rate
            problem = f"{key} = {text}, which is no plain number" if text else f"no {key}"
            message = f"the labels state {problem}, so samples have no time; state the rate"
            raise RecordingError(message, **where)
        stated.append(float(plain))
        if not 0 < stated[-1] < np.inf:
            raise RecordingError(f"{key} = {text} gives samples no time", **where | {"key": key})
    rate = stated[0] / stated[1]
    if options.rate is not None and not np.isclose(options.rate, rate):
        message = f"the log states {rate:g} samples a second, the option {options.rate:g}"
        raise RecordingError(message, **where)
    return rate


def write_daqft(file: Path, record: ForceRecord, *, decimal: str = ".") -> None:
    """Write ``record`` in N and N·m, with fifteen significant digits and averaging level 1, as the
    program does on a PC whose culture has the given ``decimal`` mark ("." or ",").
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


def read_netft(file: Path, options: ForceLogOptions = NO_OPTIONS) -> ForceRecord:
    """Return the record in ``file``, in N, N·m and s; the time is the RDT sequence over the sample
    rate, so that lost packets leave a gap.

    ``counts`` and errors as of :func:`pipeline.formats.force.record.read_force_table`, with
    ``missing_samples`` as ``lost_packets``, and ``status_rows`` (with a condition; kept).
    RecordingError too for a header without rate, units or counts per unit, and for numbers that may
    be counts or not.
    """
    sheet = force_sheet(file, options, **PLAIN)
    if not any("RDT Sequence" in line for line in sheet.header):
        message = "no row of labels with 'RDT Sequence': no log of a Net F/T, or cut"
        raise RecordingError(message, file=file, key=f"{OPTION}.format")
    settings, columns = sheet.settings, axis_columns(sheet, options)

    def positive(name: str, option: str) -> float:
        text = settings.get(name, "")
        if not NUMBER.fullmatch(text) or not 0 < float(text) < np.inf:
            message = f"the header must state {name} above 0, not {text!r}"
            raise RecordingError(message, file=file, key=f"{OPTION}.{option}")
        return float(text)

    status = sheet.words(sheet.columns({"status": "Status (hex)"}, KEY)["status"])
    for word, line in zip(status, sheet.lines, strict=True):
        if not STATUS.fullmatch(word):
            message = f"the status {word!r} is no hexadecimal number"
            raise RecordingError(message, file=file, line=line)
    kinds = {axis: "Force" if axis in FORCES else "Torque" for axis in columns}
    units = {axis: settings.get(f"{kind} Units") for axis, kind in kinds.items()}
    per_unit = np.ones(len(kinds))
    if _holds_counts(sheet, columns, options):
        per_unit[:] = [positive(f"Counts per Unit {kind}", "counts") for kind in kinds.values()]
    values = axis_values(sheet, options, units, per_unit)
    timed = replace(options, columns=columns | {"t": "RDT Sequence"})
    named = {k.lower(): settings[f"{k} Units"] for k in kinds.values() if f"{k} Units" in settings}
    rate = options.rate
    record = timed_record(sheet, values, timed, lambda: rate or positive("RDT Sample Rate", "rate"))
    counts = dict(record.counts)
    counts["lost_packets"] = counts.pop("missing_samples")
    counts["status_rows"] = sum(int(word, 16) != 0 for word in status)
    return replace(record, started=settings.get("Start Time", ""), counts=counts, units=named)


def _holds_counts(sheet: Sheet, columns: dict[str, int], options: ForceLogOptions) -> bool:
    if options.counts is not None:
        return options.counts
    cells = [cell for column in columns.values() for cell in sheet.words(column)]
    pointed = any("." in cell or "e" in cell.lower() for cell in cells)
    if pointed and not np.any(sheet.values([*columns.values()]) % 1):
        message = "numbers with a decimal point that are all whole may be counts or not: set counts"
        where = {"file": sheet.file, "line": sheet.label_line, "key": f"{OPTION}.counts"}
        raise RecordingError(f"{message} to true or false", **where)
    return not pointed


def _begins(head: Head) -> bool:
    return any(HEADING.search(line) for line in head.lines[:4])


def _netft_begins(head: Head) -> bool:
    return any("RDT Sequence" in line for line in head.lines[:30])


FORMAT = (
    Format("ATI Net F/T log", Kind.FORCE, read_netft, _netft_begins, "netft"),
    Format("ATI DAQ F/T log", Kind.FORCE, read_daqft, _begins, "daqft"),
)
