"""Net F/T logs: what the demonstration program of ATI's network transducers collects, as
comma-separated text.

Lines of ``key: value`` (start time, RDT sample rate, units, counts per unit) come first, then the
labels and one row a packet: status, RDT sequence, F/T sequence, Fx … Tz, the PC's time. Manuals and
earlier versions have counts, which are whole; later versions have divided them already, and print
every number with a decimal point.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.force.record import (
    FORCES,
    OPTION,
    ForceLogOptions,
    ForceRecord,
    repeats,
    si_factors,
    with_torque,
)
from pipeline.formats.force.table import axis_columns, force_sheet
from pipeline.formats.format import Format, Kind, Stated
from pipeline.formats.number_sheet import Sheet, read_sheet

STATUS = re.compile(r"(0x)?[0-9a-fA-F]{1,8}")
NO_OPTIONS = ForceLogOptions()


def read_netft(file: Path, options: ForceLogOptions = NO_OPTIONS) -> ForceRecord:
    """Return the record in ``file``, in N, N·m and s; the time is that of the RDT sequence, so that
    lost packets leave a gap.

    ``counts``: ``repeated_rows`` and ``zero_rows``, both kept; ``blank_rows``; ``cut_rows``;
    ``doubled_rows`` (a packet's row again, left out); ``lost_packets`` (missing in the sequence);
    ``status_rows`` (the transducer reported a condition with them; kept).

    Raises RecordingError, with the line and the option that settles it where there is one, for a
    header without rate, units or, where it has counts, counts per unit; numbers that may be counts
    or not; a sequence that goes back; and malformed rows.
    """
    sheet = force_sheet(file, replace(options, separator=",", decimal="."))
    if not any("RDT Sequence" in line for line in sheet.header):
        raise RecordingError(
            "no row of labels with 'RDT Sequence': no log of a Net F/T, or cut",
            file=file,
            key=f"{OPTION}.format",
        )
    settings, key = sheet.settings, f"{OPTION}.columns"
    columns = axis_columns(sheet, options)
    places = sheet.columns({"status": "Status (hex)", "sequence": "RDT Sequence"}, key)
    for word, line in zip(sheet.words(places["status"]), sheet.lines, strict=True):
        if not STATUS.fullmatch(word):
            raise RecordingError(
                f"the status {word!r} is no hexadecimal number", file=file, line=line
            )
    table = sheet.values([places["sequence"], *columns.values()])
    keep, lost = _in_sequence(table, sheet.lines, file)
    values = table[keep, 1:] * _factors(sheet, columns, settings, options)
    flags = np.array([int(word, 16) for word in sheet.words(places["status"])])
    counts = repeats(values) | sheet.counts
    counts |= {
        "doubled_rows": int(len(keep) - keep.sum()),
        "lost_packets": lost,
        "status_rows": int(np.count_nonzero(flags[keep])),
    }
    rate = options.rate or _positive(settings, "RDT Sample Rate", "rate", file)
    time = (table[keep, 0] - table[0, 0]) / rate
    return ForceRecord(time, *with_torque(values), rate, "", settings.get("Start Time", ""), counts)


def _in_sequence(table: np.ndarray, places: list[int], file: Path) -> tuple[np.ndarray, int]:
    """Which rows to keep, and how many packets the sequence lacks; RecordingError where it goes
    back or a packet has two readings.
    """
    steps = np.diff(table[:, 0])
    doubled = (table[1:] == table[:-1]).all(axis=1)
    wrong = (steps <= 0) & ~doubled | (steps % 1 != 0)
    if wrong.any():
        row = int(np.argmax(wrong)) + 1
        message = (
            f"the RDT sequence goes from {table[row - 1, 0]:.10g} to "
            f"{table[row, 0]:.10g}: rows are swapped or of two recordings"
        )
        raise RecordingError(message, file=file, line=places[row])
    return np.append(True, ~doubled), int(np.sum(np.maximum(steps - 1, 0)))


def _factors(
    sheet: Sheet, columns: dict[str, int], settings: dict[str, str], options: ForceLogOptions
) -> np.ndarray:
    units = {
        axis: settings.get("Force Units" if axis in FORCES else "Torque Units") for axis in columns
    }
    file, line, counts = sheet.file, sheet.label_line, options.counts
    factors = si_factors(list(columns), units, options, file=file, line=line)
    if counts is None:
        cells = [cell for column in columns.values() for cell in sheet.words(column)]
        counts = not any("." in cell or "e" in cell.lower() for cell in cells)
        if not counts and all(float(cell).is_integer() for cell in cells):
            message = (
                "numbers with a decimal point that are all whole may be counts or "
                "not: set counts to true or false"
            )
            raise RecordingError(message, file=file, line=line, key=f"{OPTION}.counts")
    if not counts:
        return factors
    kinds = ["Force" if axis in FORCES else "Torque" for axis in columns]
    return factors / [_positive(settings, f"Counts per Unit {k}", "counts", file) for k in kinds]


def _positive(settings: dict[str, str], name: str, option: str, file: Path) -> float:
    try:
        value = float(settings[name])
    except (KeyError, ValueError):
        raise RecordingError(
            f"the header states no {name}", file=file, key=f"{OPTION}.{option}"
        ) from None
    if not 0 < value < np.inf:
        raise RecordingError(f"{name} is {value:g}", file=file, key=f"{OPTION}.{option}")
    return value


def _states(file: Path) -> Stated:
    settings = read_sheet(file, separator=",", decimal=".", key=OPTION).settings
    named = {name: unit for name, unit in settings.items() if name.endswith("Units")}
    return Stated(units={name.split()[0].lower(): unit for name, unit in named.items()})


FORMAT = Format(
    "ATI Net F/T log",
    Kind.FORCE,
    read_netft,
    lambda head: any("RDT Sequence" in line for line in head.lines[:30]),
    _states,
    option="netft",
)
