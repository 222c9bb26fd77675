"""Net F/T logs: what the demonstration program of ATI's network transducers collects, as
comma-separated text.

Lines of ``key: value`` (start time, RDT sample rate, units, counts per unit) come first, then the
labels and one row a packet: status, RDT sequence, F/T sequence, Fx … Tz, the PC's time. Manuals and
earlier versions have counts, which are whole; later versions have divided them already, and print
every number with a decimal point.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import cells_of, numbers_of, read_text
from pipeline.formats.force.record import (
    FORCES,
    OPTION,
    TORQUES,
    ForceRecord,
    LogOptions,
    axis_of,
    repeats,
    si_factors,
    with_torque,
)
from pipeline.formats.format import Format, Kind, Stated
from pipeline.formats.labels import columns_of

SETTING = re.compile(
    r'"?(Start Time|RDT Sample Rate|Force Units|Counts per Unit Force|Torque Units|Counts per '
    r"Unit Torque):(.*)"
)
STATUS = re.compile(r"(0x)?[0-9a-fA-F]{1,8}")
NO_OPTIONS = LogOptions()


def read_netft(file: Path, options: LogOptions = NO_OPTIONS) -> ForceRecord:
    """Record in ``file``, in N, N·m and s; the time is that of the RDT sequence, so that lost
    packets leave a gap.

    ``counts``: ``repeated_rows`` and ``zero_rows``, both kept; ``blank_rows``; ``cut_rows``;
    ``doubled_rows`` (a packet's row again, left out); ``lost_packets`` (missing in the sequence);
    ``status_rows`` (the transducer reported a condition with them; kept).

    Raises RecordingError, with the line and the option that settles it where there is one, for a
    header without rate, units or, where it has counts, counts per unit; numbers that may be counts
    or not; a sequence that goes back; and malformed rows.
    """
    text = read_text(file)
    top = next((i for i, line in enumerate(text.lines) if "RDT Sequence" in line), None)
    if top is None:
        raise RecordingError(
            "no row of labels with 'RDT Sequence': no log of a Net F/T, or cut",
            file=file,
            key=f"{OPTION}.format",
        )
    settings = _settings(text.lines[:top])
    labels = cells_of(text.lines[top], ",", file=file, number=top + 1)
    places = [
        number
        for number, line in enumerate(text.lines[top + 1 :], start=top + 2)
        if line.strip(' ,"')
    ]
    if not places:
        raise RecordingError(
            "the labels are followed by no whole sample; record again", file=file, line=top + 1
        )
    columns = _columns(labels, options, file, top + 1)
    rows = [cells_of(text.lines[place - 1], ",", file=file, number=place) for place in places]
    # the PC's time, which comes last, may hold commas of its own
    extra = len(rows[0]) - len(labels) if labels[-1] == "Time" else 0
    for row, place in zip(rows, places, strict=True):
        if extra < 0 or len(row) != len(labels) + extra:
            raise RecordingError(
                f"the row has {len(row)} cells under {len(labels)} labels: truncated or damaged",
                file=file,
                line=place,
            )
        if not STATUS.fullmatch(row[columns["status"]]):
            raise RecordingError(
                f"the status {row[columns['status']]!r} is no hexadecimal number",
                file=file,
                line=place,
            )
    axes = [axis for axis in (*FORCES, *TORQUES) if axis in columns]
    wanted = ["sequence", *axes]
    # joined by what no number holds, so that a decimal comma is no separator
    joined = [";".join(row[columns[name]] for name in wanted) for row in rows]
    table = numbers_of(joined, places, list(range(len(wanted))), file=file, separator=";")
    status = np.array([int(row[columns["status"]], 16) for row in rows])
    keep, lost = _in_sequence(table, places, file)
    values = table[keep, 1:] * _factors(axes, rows, columns, settings, options, file, top + 1)
    counts = repeats(values) | {
        "blank_rows": len(text.lines) - top - 1 - len(places),
        "cut_rows": int(text.cut is not None),
        "doubled_rows": int(len(keep) - keep.sum()),
        "lost_packets": lost,
        "status_rows": int(np.count_nonzero(status[keep])),
    }
    rate = options.rate or _positive(settings, "RDT Sample Rate", "rate", file)
    time = (table[keep, 0] - table[0, 0]) / rate
    return ForceRecord(time, *with_torque(values), rate, "", settings.get("Start Time", ""), counts)


def _columns(labels: list[str], options: LogOptions, file: Path, line: int) -> dict[str, int]:
    named = {"status": "Status (hex)", "sequence": "RDT Sequence"}
    axes = options.columns or {axis: label for label in labels if (axis := axis_of(label))}
    key = f"{OPTION}.columns"
    if missing := [axis for axis in FORCES if axis not in axes]:
        raise RecordingError(
            f"no column for {', '.join(missing)}; there is {', '.join(labels)}",
            file=file,
            line=line,
            key=key,
        )
    if 0 < len(set(TORQUES) & set(axes)) < 3:
        raise RecordingError(
            f"a torque is missing; there is {', '.join(labels)}", file=file, line=line, key=key
        )
    return columns_of(labels, {**named, **axes}, len(labels), file=file, line=line, key=key)


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
    axes: list[str],
    rows: list[list[str]],
    columns: dict[str, int],
    settings: dict[str, str],
    options: LogOptions,
    file: Path,
    line: int,
) -> np.ndarray:
    units = {
        axis: settings.get("Force Units" if axis in FORCES else "Torque Units") for axis in axes
    }
    factors = si_factors(axes, units, options, file=file, line=line)
    cells = [row[columns[axis]] for row in rows for axis in axes]
    if options.counts is None:
        fractional = any("." in cell or "e" in cell.lower() for cell in cells)
        if fractional and all(float(cell).is_integer() for cell in cells):
            message = (
                "numbers with a decimal point that are all whole may be counts or "
                "not: set counts to true or false"
            )
            raise RecordingError(message, file=file, line=line, key=f"{OPTION}.counts")
        counts = not fractional
    else:
        counts = options.counts
    if not counts:
        return factors
    per_unit = [
        _positive(
            settings, f"Counts per Unit {'Force' if axis in FORCES else 'Torque'}", "counts", file
        )
        for axis in axes
    ]
    return factors / per_unit


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


def _settings(lines: list[str]) -> dict[str, str]:
    settings = filter(None, map(SETTING.fullmatch, lines))
    return {match[1]: match[2].strip().removesuffix('"').rstrip() for match in settings}


def _states(file: Path) -> Stated:
    settings = _settings(read_text(file).lines[:12]).items()
    units = {name.split()[0].lower(): unit for name, unit in settings if name.endswith("Units")}
    return Stated(units=units)


FORMAT = Format(
    "ATI Net F/T log",
    Kind.FORCE,
    read_netft,
    lambda head: any("RDT Sequence" in line for line in head.lines[:30]),
    _states,
    option="netft",
)
