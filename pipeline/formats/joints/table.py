"""Plain joint logs of a robot's controller: one line a sample, time and one value a joint, in a
file a signal or in one table; options say which column is which.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.format import Format, Kind
from pipeline.formats.joints.log import OPTION, JointLog, LogOptions, increasing
from pipeline.formats.number_sheet import read_sheet
from pipeline.formats.units import ANGLE_UNITS, TIME_UNITS, spelled

FLAT = (
    "; one number a line is one column: signals: {actual: [0]} with time: null reads it as one "
    "joint, else write the joints of one time in one line"
)


def read_joint_table(file: Path, options: LogOptions) -> JointLog:
    """Return the signals of ``options`` in ``file``; a last line that is short or has no line end
    is dropped and counted. RecordingError with the line for any other line of another width, a
    value that is not a finite number and a time that does not increase; with the option that
    settles it for a column that is not there, and for another unit in the header.
    """
    sheet = read_sheet(file, separator=options.separator, decimal=options.decimal, key=OPTION)
    wanted = {} if options.time is None else {"time": options.time}
    first, chosen = len(wanted), {}  # signal → its columns of the values
    for signal, columns in options.signals.items():
        if columns is None and sheet.width != options.joints + first:
            values = f"{'a time and ' if first else ''}{sheet.width - first} values"
            message = f"the line has {values}, not {options.joints}; check joints, or name the "
            message += f"columns in signals{FLAT if sheet.width == 1 else ''}"
            raise RecordingError(message, file=file, line=sheet.lines[0])
        named = range(first, sheet.width) if columns is None else columns
        chosen[signal] = slice(len(wanted) - first, len(wanted) - first + len(named))
        wanted |= {f"joint {n} ({signal})": column for n, column in enumerate(named, start=1)}
    places = sheet.columns(wanted, f"{OPTION}.signals")
    for quantity, column in places.items():
        time = quantity == "time"
        unit = spelled(sheet.unit(column) or (not time and sheet.angle_unit) or "")
        key, units = ("time_unit", TIME_UNITS) if time else ("angle_unit", ANGLE_UNITS)
        if unit in units and unit != (given := getattr(options, key)):
            message = f"the {quantity} is in {unit} by the header and in {given} by the option"
            where = {"file": file, "line": sheet.label_line, "key": f"{OPTION}.{key}"}
            raise RecordingError(message, **where)
    measured = [column for name, column in places.items() if name.endswith("(actual)")]
    samples = sheet.samples([*places.values()], places.get("time"), measured)
    table, time = samples.values, samples.rows / options.rate
    if first:
        time = table[:, 0] * TIME_UNITS[options.time_unit]
    values = table[:, first:] * ANGLE_UNITS[options.angle_unit]
    signals = {signal: values[:, columns] for signal, columns in chosen.items()}
    log = JointLog(time, signals, sheet.counts | samples.counts)
    return increasing(log, file, lambda row: {"line": sheet.lines[samples.rows[row]]})


def joint_labels(signal: str, joints: Sequence[str]) -> list[str]:
    """Return the columns of a ``signal`` of the ``joints``."""
    return [f"{signal}_{joint}" for joint in joints]


def write_joint_table(
    file: Path, time: np.ndarray, signals: Mapping[str, np.ndarray], joints: Sequence[str]
) -> None:
    """Write ``time`` (N,) in s and the ``signals``, each (N, joints) in rad, with six and seven
    decimals, under a row of :func:`joint_labels`.
    """
    header = ["time", *(label for signal in signals for label in joint_labels(signal, joints))]
    table = np.column_stack([time, *signals.values()])
    row = ",".join(["%.6f", *["%.7f"] * (table.shape[1] - 1)]) + "\n"
    rows = row * len(table) % tuple(table.ravel().tolist())
    Path(file).write_text(",".join(header) + "\n" + rows, newline="")


# it looks like any other table: what is no other log of joints is read as one
FORMAT = Format("table of joints", Kind.JOINTS, read_joint_table)
