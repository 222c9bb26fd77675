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
HEADING = re.compile(
    r'^"?(Paused for|Skipped)\s+\d|Frequency\s*=|Averaging Level\s*=|F/T Serial Number\s*='
    r'|"?Force X\b'
)


def read_daqft(file: Path, options: ForceLogOptions = NO_OPTIONS) -> ForceRecord:
    """Return the record in ``file``, in N, N·m and s; the calibration of ``options`` converts gauge
    voltages. Without a column of times or sample numbers, samples are equally spaced at the stated
    rate. ``counts`` and errors are as in :func:`read_force_table`, with ``paused_ms`` or
    ``skipped_samples`` before the first sample. RecordingError also for gauge voltages without a
    calibration, and for no frequency or averaging level.
    """
    sheet = read_sheet(
        file, separator=options.separator, decimal=options.decimal, key=OPTION
    )
    if _is_netft(sheet.header):
        message = "this is a log of a Net F/T: set format to netft"
        raise RecordingError(message, file=file, key=f"{OPTION}.format")
    settings, calibrated = sheet.settings, getattr(options.calibration, "serial", "")
    serial, started = (
        settings.get(name, "") for name in ("F/T Serial Number", "Time Started")
    )
    if serial and calibrated and serial != calibrated:
        message = (
            f"the log is of the transducer {serial}, the calibration of {calibrated}"
        )
        raise RecordingError(message, file=file, key=f"{OPTION}.calibration")
    named = options.columns or any(map(forces.axis_of, sheet.labels))
    gauged = not named and not {*GAUGES}.isdisjoint(sheet.labels)
    columns, factors, units = (_gauges if gauged else forces.axis_factors)(
        sheet, options
    )
    about = {"serial": serial, "started": started, "units": units, "counts": {}}
    if delay := DELAY.match("".join(sheet.header[:1])):
        kind = "paused_ms" if delay[1] == "Paused for" else "skipped_samples"
        about["counts"] = {kind: int(delay[2])}
    rate = partial(_rate, sheet, options)
    return forces.sheet_record(sheet, options, columns, factors, rate, **about)


def _gauges(
    sheet: Sheet, options: ForceLogOptions
) -> tuple[list[int], np.ndarray, dict]:
    """Return the columns of G0 to G5 and the matrix (6, 6) of the calibration. It has no offset, so
    that the tare removes the bias of the gauges.
    """
    if options.calibration is None or sorted({*GAUGES} & {*sheet.labels}) != GAUGES:
        message = "no column is labelled Force X, Force Y, Force Z; gauge voltages need columns G0 "
        message += "to G5 and the transducer's calibration"
        where = {
            "file": sheet.file,
            "line": sheet.label_line,
            "key": f"{OPTION}.calibration",
        }
        raise RecordingError(message, **where)
    return [*map(sheet.labels.index, GAUGES)], options.calibration.matrix, {}


def _rate(sheet: Sheet, options: ForceLogOptions) -> float:
    """Return the sample rate in Hz: sampling frequency over averaging level, else the option."""
    stated, rate = [], options.rate
    for key in ("Frequency", "Averaging Level"):
        text = sheet.settings.get(key, "")
        # with decimal commas, a point separates thousands
        plain = (
            text if sheet.decimal == "." else text.replace(".", "?").replace(",", ".")
        )
        stated += [float(plain)] if NUMBER.fullmatch(plain) else []
    whole = len(stated) == 2 and all(0 < number < np.inf for number in stated)
    own = stated[0] / stated[1] if whole else rate
    if own is None or (rate is not None and not np.isclose(rate, own)):
        message = f"the sample rate in Hz is {own} in the log (Frequency over Averaging Level) and "
        message += f"{rate} by the option; set rate to the right one"
        where = {"file": sheet.file, "line": sheet.label_line, "key": f"{OPTION}.rate"}
        raise RecordingError(message, **where)
    return own


def write_daqft(file: Path, record: ForceRecord, *, decimal: str = ".") -> None:
    """Write ``record`` as DAQ F/T does, in N and N·m, with the ``decimal`` mark "." or ","."""
    separator = ";" if decimal == "," else ","
    labels = [f"Force {axis} (N)" for axis in "XYZ"] + [
        f"Torque {axis} (N-m)" for axis in "XYZ"
    ]
    labels += [
        f"Frequency = {record.rate:.15G}".replace(".", decimal),
        "Averaging Level = 1",
    ]
    labels += [
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
    sheet = read_sheet(
        file, separator=",", decimal=".", key=OPTION
    )  # whatever the PC's marks
    if not _is_netft(sheet.header):
        message = "no row of labels with 'RDT Sequence': no log of a Net F/T, or a truncated one"
        raise RecordingError(message, file=file, key=f"{OPTION}.format")
    settings, counted = sheet.settings, options.counts
    stated = {
        kind: settings.get(f"{kind.title()} Units") for kind in ("force", "torque")
    }
    columns, factors, units = forces.axis_factors(sheet, options, stated)

    def positive(name: str, option: str) -> float:
        text = settings.get(name, "")
        if not NUMBER.fullmatch(text) or not 0 < float(text) < np.inf:
            message = f"{name} in the header must be > 0, got {text!r}"
            raise RecordingError(message, file=file, key=f"{OPTION}.{option}")
        return float(text)

    if counted is None:
        cells = [cell for column in columns for cell in sheet.words(column)]
        counted = not any("." in cell or "e" in cell.lower() for cell in cells)
        if not counted and not np.any(sheet.values(columns) % 1):
            message = "all numbers are whole but have a decimal point, so that they may be counts "
            message += "or not: set counts to true or false"
            where = {"line": sheet.label_line, "key": f"{OPTION}.counts"}
            raise RecordingError(message, file=file, **where)
    if counted:
        kinds = ["Force"] * 3 + ["Torque"] * (len(columns) - 3)
        factors = factors / [
            positive(f"Counts per Unit {kind}", "counts") for kind in kinds
        ]
    axes = dict(zip([*forces.FORCES, *forces.TORQUES], columns, strict=False))
    timed = replace(options, columns=axes | {"t": "RDT Sequence"})
    status = sheet.words(
        sheet.columns({"status": "Status (hex)"}, forces.KEY)["status"]
    )
    about = {"started": settings.get("Start Time", ""), "units": units}
    rate = options.rate or positive("RDT Sample Rate", "rate")
    record = forces.sheet_record(sheet, timed, columns, factors, lambda: rate, **about)
    counts = dict(record.counts)
    counts["lost_packets"] = counts.pop("missing_samples")
    counts["status_rows"] = sum(bool(word.strip("0x")) for word in status)
    return replace(record, counts=counts)


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
