"""Plain joint logs of a robot's controller: one line a sample, time and one value a joint, in a
file a signal or in one table; which column is what stands in the option.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.format import Format, Kind
from pipeline.formats.joints.log import ANGLE_UNITS, OPTION, JointLog, LogOptions, increasing
from pipeline.formats.labels import columns_of, unit_of
from pipeline.formats.number_sheet import Sheet, read_sheet
from pipeline.formats.units import TIME_UNITS

SPELLINGS = {
    "radian": "rad",
    "radians": "rad",
    "degree": "deg",
    "degrees": "deg",
    "°": "deg",
    "sec": "s",
    "seconds": "s",
    "µs": "us",
}


def read_joint_table(file: Path, options: LogOptions) -> JointLog:
    """The signals of ``options`` in ``file``.

    A controller that is stopped while it writes leaves a last line that is short or has no line
    end: it is dropped and counted. Raises RecordingError with the line for any other line of
    another width, a value that is not a finite number and a time that does not increase; with the
    option that settles it for a column that is not there, and for a unit in the header that is not
    the option's.
    """
    sheet = read_sheet(file, separator=options.separator, decimal=options.decimal, key=OPTION)
    if not sheet.rows:
        raise RecordingError(
            "the header is followed by no whole line; record again",
            file=file,
            line=sheet.header_lines[-1],
        )
    wanted = {} if options.time is None else {"time": options.time}
    first, chosen = len(wanted), {}  # signal → its columns of the values
    for signal, columns in options.signals.items():
        named = _behind_the_time(sheet, options.joints, first) if columns is None else columns
        chosen[signal] = slice(len(wanted) - first, len(wanted) - first + len(named))
        wanted |= {f"joint {n} ({signal})": column for n, column in enumerate(named, start=1)}
    table = sheet.values(_places(sheet, wanted, options))
    values = table[:, first:] * ANGLE_UNITS[options.angle_unit]
    time = (
        table[:, 0] * TIME_UNITS[options.time_unit]
        if first
        else np.arange(len(table)) / options.rate
    )
    signals = {signal: values[:, columns] for signal, columns in chosen.items()}
    log = JointLog(time, signals, dict(sheet.counts))
    return increasing(log, file, lambda row: {"line": sheet.lines[row]})


def _behind_the_time(sheet: Sheet, joints: int, first: int) -> list[int]:
    """All columns from the ``first`` on; RecordingError where they are not one a joint."""
    if sheet.width != joints + first:
        content = f"{'a time and ' if first else ''}{sheet.width - first} values"
        message = (
            f"the line has {content}, not {joints}; check the number of joints, or "
            "name their columns in signals"
        )
        raise RecordingError(message, file=sheet.file, line=sheet.lines[0])
    return list(range(first, sheet.width))


def _places(sheet: Sheet, wanted: Mapping[str, str | int], options: LogOptions) -> list[int]:
    """Where the ``wanted`` columns are."""
    names = [name for name in wanted.values() if isinstance(name, str)]
    labels, line = [], sheet.lines[0]
    sheet.require_cells()
    if names:
        index = sheet.label_row(names)
        labels, line = sheet.header_cells(index), sheet.header_lines[index]
        if len(labels) != sheet.width:
            raise RecordingError(
                f"the row has {sheet.width} cells under {len(labels)} labels",
                file=sheet.file,
                line=sheet.lines[0],
            )
    places = columns_of(
        labels, wanted, sheet.width, file=sheet.file, line=line, key=f"{OPTION}.signals"
    )
    _check_units(sheet, places, options)
    return list(places.values())


def _check_units(sheet: Sheet, places: Mapping[str, int], options: LogOptions) -> None:
    """RecordingError where a header's unit, in brackets behind a label or in a row below the
    labels, is another than the option's.
    """
    for index in range(len(sheet.header)):
        cells = sheet.header_cells(index)
        for quantity, column in places.items() if len(cells) == sheet.width else ():
            unit = (unit_of(cells[column]) or cells[column]).strip().lower().removesuffix("/s")
            key, units = (
                ("time_unit", TIME_UNITS) if quantity == "time" else ("angle_unit", ANGLE_UNITS)
            )
            unit = SPELLINGS.get(unit, unit)
            if unit in units and unit != getattr(options, key):
                message = (
                    f"the {quantity} is in {unit} by the header and in "
                    f"{getattr(options, key)} by the option"
                )
                raise RecordingError(
                    message, file=sheet.file, line=sheet.header_lines[index], key=f"{OPTION}.{key}"
                )


# it looks like any other table: what is no other log of joints is read as one
FORMAT = Format("table of joints", Kind.JOINTS, read_joint_table)
