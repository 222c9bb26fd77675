"""Logs of ATI's programs DAQ F/T (in the number format of the PC) and Net F/T.

A DAQ F/T log has an optional line of skipped samples; one or more rows with labels, units and
settings (such as ``Frequency = 1000``); then one quoted row per sample, with forces or gauge
voltages ``G0`` to ``G5``, usually without time. A PC with decimal commas writes semicolons between
cells.

A Net F/T log has lines ``key: value`` (start time, RDT sample rate, units, counts per unit), the
labels, and one row per packet: integer counts in earlier versions, later decimal fractions.
"""

import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import NUMBER
from pipeline.formats.force import record as forces
from pipeline.formats.force.record import (
    NO_OPTIONS,
    OPTION,
    ForceLogOptions,
    ForceRecord,
)
from pipeline.formats.format import Format, Kind
from pipeline.formats.number_sheet import Sheet, read_sheet

DELAY = re.compile(r'"?(Paused for|Skipped)\s+(\d{1,18})\b')
GAUGES = [f"G{n}" for n in range(6)]
NOT_WHOLE = re.compile("[.eE]")
HEADING = re.compile(
    r'^"?(Paused for|Skipped)\s+\d|Frequency\s*=|Averaging Level\s*=|F/T Serial Number\s*='
    r'|"?Force X\b',
)


def read_daqft(file: Path, options: ForceLogOptions = NO_OPTIONS) -> ForceRecord:
    """Return the record in ``file``, in N, N·m and s; the calibration of ``options`` converts gauge
    voltages. Without a column of times or sample numbers, samples are equally spaced at the stated
    rate. ``counts`` and errors are as in :func:`read_force_table`, with ``paused_ms`` or
    ``skipped_samples`` before the first sample. RecordingError also for gauge voltages without a
    calibration, and for no frequency or averaging level.
    """
    sheet = read_sheet(
        file,
        separator=options.separator,
        decimal=options.decimal,
        key=OPTION,
    )
    if _is_netft(sheet.header):
        message = "this is a log of a Net F/T: set format to netft"
        raise RecordingError(message, file=file, key=f"{OPTION}.format")
    serial = sheet.settings.get("F/T Serial Number", "")
    calibrated = getattr(options.calibration, "serial", "")
    if serial and calibrated and serial != calibrated:
        message = (
            f"the log is of the transducer {serial}, the calibration of {calibrated}"
        )
        raise RecordingError(message, file=file, key=f"{OPTION}.calibration")
    named = options.columns or any(forces.axis_of(label) for label in sheet.labels)
    if named or {*GAUGES}.isdisjoint(sheet.labels):
        columns, factors, units = forces.axis_factors(sheet, options)
    else:
        columns, factors, units = _gauges(sheet, options)
    counts = {}
    delay = DELAY.match("".join(sheet.header[:1]))
    if delay:
        kind = "paused_ms" if delay[1] == "Paused for" else "skipped_samples"
        counts[kind] = int(delay[2])
    return forces.sheet_record(
        sheet,
        options,
        columns,
        factors,
        partial(_rate, sheet, options),
        serial=serial,
        started=sheet.settings.get("Time Started", ""),
        units=units,
        counts=counts,
    )


def _gauges(
    sheet: Sheet,
    options: ForceLogOptions,
) -> tuple[list[int], np.ndarray, dict]:
    """Return the columns of G0 to G5 and the matrix (6, 6) of the calibration. It has no offset, so
    that the tare removes the bias of the gauges.
    """
    if options.calibration is None or not {*GAUGES} <= {*sheet.labels}:
        raise RecordingError(
            "no column is labelled Force X, Force Y, Force Z; gauge voltages need columns G0 to G5 "
            "and the transducer's calibration",
            file=sheet.file,
            line=sheet.label_line,
            key=f"{OPTION}.calibration",
        )
    return [*map(sheet.labels.index, GAUGES)], options.calibration.matrix, {}


def _rate(sheet: Sheet, options: ForceLogOptions) -> float:
    """Return the sample rate in Hz: sampling frequency over averaging level, else the option."""
    numbers = []
    rate = options.rate
    for key in ("Frequency", "Averaging Level"):
        text = sheet.settings.get(key, "")
        if sheet.decimal != ".":  # a point separates thousands
            text = text.replace(".", "?").replace(",", ".")
        if NUMBER.fullmatch(text) and 0 < float(text) < np.inf:
            numbers.append(float(text))
    stated = rate
    if len(numbers) == 2:
        frequency, averaged = numbers
        stated = frequency / averaged
    if stated is None or (rate is not None and not np.isclose(rate, stated)):
        raise RecordingError(
            f"the sample rate in Hz is {stated} in the log (Frequency over Averaging Level) and "
            f"{rate} by the option; set rate to the right one",
            file=sheet.file,
            line=sheet.label_line,
            key=f"{OPTION}.rate",
        )
    return stated


def write_daqft(file: Path, record: ForceRecord, *, decimal: str = ".") -> None:
    """Write ``record`` as DAQ F/T does, in N and N·m, with the ``decimal`` mark "." or ","."""
    separator = ";" if decimal == "," else ","
    labels = [f"Force {axis} (N)" for axis in "XYZ"]
    labels += [f"Torque {axis} (N-m)" for axis in "XYZ"]
    labels += [
        f"Frequency = {record.rate:.15G}".replace(".", decimal),
        "Averaging Level = 1",
        f"F/T Serial Number = {record.serial}",
        f"Time Started = {record.started}",
    ]
    row = separator.join(['"%.15G"'] * 6) + "\r\n"
    values = np.hstack([record.force, record.torque])
    rows = row * len(values) % tuple(values.ravel().tolist())
    header = separator.join(f'"{label}"' for label in labels) + "\r\n"
    Path(file).write_bytes((header + rows.replace(".", decimal)).encode())


def read_netft(file: Path, options: ForceLogOptions = NO_OPTIONS) -> ForceRecord:
    """Return the record in ``file``, in N, N·m and s. The time is the RDT sequence number over the
    sample rate, with a gap for lost packets. ``counts`` and errors are as in
    :func:`read_force_table`, with ``lost_packets`` and ``status_rows`` (status not 0; kept).
    RecordingError also for a header without rate, units or counts per unit, and where numbers may
    be counts or not.
    """
    # whatever the PC's marks
    sheet = read_sheet(file, separator=",", decimal=".", key=OPTION)
    if not _is_netft(sheet.header):
        message = "no row of labels with 'RDT Sequence': no log of a Net F/T, or a truncated one"
        raise RecordingError(message, file=file, key=f"{OPTION}.format")
    settings = sheet.settings
    stated = {
        "force": settings.get("Force Units"),
        "torque": settings.get("Torque Units"),
    }
    columns, factors, units = forces.axis_factors(sheet, options, stated)
    counted = options.counts
    if counted is None:
        counted = _are_counts(sheet, columns)
    if counted:
        per_unit = []
        for kind in ["Force"] * 3 + ["Torque"] * (len(columns) - 3):
            per_unit.append(_positive(sheet, f"Counts per Unit {kind}", "counts"))
        factors = factors / per_unit
    axes = dict(zip([*forces.FORCES, *forces.TORQUES], columns, strict=False))
    timed = replace(options, columns=axes | {"t": "RDT Sequence"})
    rate = options.rate or _positive(sheet, "RDT Sample Rate", "rate")
    record = forces.sheet_record(
        sheet,
        timed,
        columns,
        factors,
        lambda: rate,
        started=settings.get("Start Time", ""),
        units=units,
    )
    status = sheet.columns({"status": "Status (hex)"}, forces.KEY)["status"]
    faulty = [word for word in sheet.words(status) if word.strip("0x")]
    counts = dict(record.counts)
    counts["lost_packets"] = counts.pop("missing_samples")
    counts["status_rows"] = len(faulty)
    return replace(record, counts=counts)


def _are_counts(sheet: Sheet, columns: list[int]) -> bool:
    """Return whether the numbers are counts, without a decimal point; RecordingError for whole
    numbers with one.
    """
    for column in columns:
        if any(map(NOT_WHOLE.search, sheet.words(column))):
            break
    else:
        return True
    if not np.any(sheet.values(columns) % 1):
        raise RecordingError(
            "all numbers are whole but have a decimal point, so that they may be counts or not: "
            "set counts to true or false",
            file=sheet.file,
            line=sheet.label_line,
            key=f"{OPTION}.counts",
        )
    return False


def _positive(sheet: Sheet, name: str, option: str) -> float:
    """Return the setting ``name`` of the header; RecordingError with the ``option`` unless > 0."""
    text = sheet.settings.get(name, "")
    number = float(text) if NUMBER.fullmatch(text) else np.nan
    if not 0 < number < np.inf:
        message = f"{name} in the header must be > 0, got {text!r}"
        raise RecordingError(message, file=sheet.file, key=f"{OPTION}.{option}")
    return number


def _is_netft(lines: list[str]) -> bool:
    return any("RDT Sequence" in line for line in lines[:30])


FORMAT = (
    Format(
        "ATI Net F/T log",
        Kind.FORCE,
        read_netft,
        lambda head: _is_netft(head.lines),
        "netft",
    ),
    Format(
        "ATI DAQ F/T log",
        Kind.FORCE,
        read_daqft,
        lambda head: any(HEADING.search(line) for line in head.lines[:4]),
        "daqft",
    ),
)
