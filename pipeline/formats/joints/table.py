"""Joint logs as tables of text: a column of times and one column per joint and signal."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import UNITS, spelled
from pipeline.formats.format import Format, Kind
from pipeline.formats.joints.log import OPTION, JointLog, LogOptions, increasing
from pipeline.formats.joints.names import is_names, match_joints, states_joints
from pipeline.formats.number_sheet import Sheet, read_sheet


def read_joint_table(file: Path, options: LogOptions) -> JointLog:
    """Return the signals that ``options`` name in the table ``file``; see :func:`log_of_sheet`."""
    return log_of_sheet(_sheet_of(file, options), options)


def _sheet_of(file: Path, options: LogOptions) -> Sheet:
    separator = options.separator
    decimal = options.decimal
    return read_sheet(file, separator=separator, decimal=decimal, key=OPTION)


def log_of_sheet(sheet: Sheet, options: LogOptions) -> JointLog:
    """Return the signals that ``options`` name in the ``sheet``, from rows with a measured angle,
    each column in its own unit if the header states one. ``counts`` are the counts of
    :func:`read_sheet` and :meth:`Sheet.samples`. Raises RecordingError as these functions do; with
    the line, where the time does not increase; with the option, where a column is missing, and
    where the header states another unit of the time or of the first signal, or other joints.
    """
    wanted = _columns_of_signals(sheet, options)
    clock = {} if options.time is None else {"time": options.time}
    places = sheet.columns(clock | dict(wanted), f"{OPTION}.signals")
    first_signal = next(iter(options.signals), "")
    factors = _si_factors(sheet, places, first_signal, options)
    measured = [places[name] for name in wanted if name.endswith("(actual)")]
    _require_named_joints(sheet, measured, options.names)

    samples = sheet.samples([*places.values()], places.get("time"), measured)
    values = samples.values * np.array(factors)
    lines = [sheet.lines[row] for row in samples.rows]
    if clock:
        time = values[:, 0]
    else:
        time = _times_of_rows(sheet, samples.rows, options)
    signals = {}
    start = len(clock)
    for signal in options.signals:
        names = [name for name in wanted if name.endswith(f" ({signal})")]
        end = start + len(names)
        signals[signal] = values[:, start:end]
        start = end
    log = JointLog(time, signals, sheet.counts | samples.counts, lines=lines)
    return increasing(log, lambda row: {"file": sheet.file, "line": lines[row]})


def _columns_of_signals(sheet: Sheet, options: LogOptions) -> dict[str, str | int]:
    """Return ``joint NUMBER (SIGNAL)`` → label or number of its column, by the options."""
    first = 0 if options.time is None else 1
    wanted = {}
    for signal, columns in options.signals.items():
        if columns is None:
            columns = range(first, sheet.width)
            if len(columns) != options.joints:
                time = "a time and " if first else ""
                raise RecordingError(
                    f"the line has {time}{len(columns)} values, not {options.joints}; correct "
                    "joints, or name the columns in signals",
                    file=sheet.file,
                    line=sheet.lines[0],
                )
        for number, column in enumerate(columns, start=1):
            wanted[f"joint {number} ({signal})"] = column
    return wanted


def _si_factors(
    sheet: Sheet,
    places: Mapping[str, int],
    first_signal: str,
    options: LogOptions,
) -> list[float]:
    """Return the factor to s, rad or m of each quantity in ``places`` (quantity → column);
    RecordingError for a unit that is not read, and for another unit of the time or of the
    ``first_signal`` than the option's.
    """
    where = {"file": sheet.file, "line": sheet.label_line}
    stated: dict[str, dict[str, str]] = {"time": {}, "angle": {}}  # unit → quantity
    factors = []
    for quantity, column in places.items():
        kind = "time" if quantity == "time" else "angle"
        unit = spelled(sheet.unit(column, kind) or "")
        factor_of_unit = UNITS[kind]
        if unit in UNITS[f"unread_{kind}"]:
            raise RecordingError(
                f"the {quantity} is in {unit} by the header: convert it to "
                f"{' or '.join(factor_of_unit)}, or correct the header",
                **where,
            )
        checked = quantity == "time" or quantity.endswith(f"({first_signal})")
        if checked and unit in factor_of_unit:
            stated[kind][unit] = quantity
        if unit in factor_of_unit:
            factors.append(factor_of_unit[unit])
        else:
            lengths = UNITS["length"] if kind == "angle" else {}  # of linear joints
            option = factor_of_unit[getattr(options, f"{kind}_unit")]
            factors.append(option * lengths.get(unit, 1.0))

    for kind, quantities in stated.items():
        option = getattr(options, f"{kind}_unit")
        if quantities and option not in quantities:  # several units need no single one
            unit, quantity = next(iter(quantities.items()))
            raise RecordingError(
                f"the {quantity} is in {unit} by the header and in {option} by the option",
                **where,
                key=f"{OPTION}.{kind}_unit",
            )
    return factors


def _require_named_joints(
    sheet: Sheet,
    measured: Sequence[int],
    joints: Sequence[str],
) -> None:
    """Raise RecordingError if cells or labels of the columns ``measured`` name the ``joints`` in
    another order.
    """
    labels = [sheet.labels[column] for column in measured if sheet.labels]
    names = names_in_cells(sheet, len(measured)) or labels
    named = match_joints(names, joints)
    if {*named} == {*joints} and states_joints(named) and named != [*joints]:
        raise RecordingError(
            f"the columns of the measured angles are {', '.join(named)} by their names",
            file=sheet.file,
            line=sheet.label_line,
            key=f"{OPTION}.joints",
        )


def _times_of_rows(sheet: Sheet, rows: np.ndarray, options: LogOptions) -> np.ndarray:
    """Return the times (M,) in s of the ``rows`` (M,) of a ``sheet`` without a column of times."""
    if options.clock is None:
        return rows / options.rate
    if len(options.clock) != len(sheet.rows):
        raise RecordingError(
            f"the table has {len(sheet.rows)} rows beside {len(options.clock)} times: name "
            "the table of the times of these rows, or time null for even rows",
            file=sheet.file,
            key=f"{OPTION}.time",
        )
    return options.clock[rows]


def read_clock(file: Path, options: LogOptions) -> np.ndarray:
    """Return the times (N,) in s in the ``file``, a table of one column, in the unit of its label,
    else of the ``options``.
    """
    sheet = _sheet_of(file, options)
    if len(sheet.numeric) != 1:
        raise RecordingError(
            f"a table of times has one column of numbers, this one {len(sheet.numeric)}",
            file=file,
            key=f"{OPTION}.time",
        )
    column = sheet.numeric[0]
    unit = spelled(sheet.unit(column, "time") or "")
    factor = UNITS["time"].get(unit, UNITS["time"][options.time_unit])
    return sheet.values([column])[:, 0] * factor


def names_in_cells(sheet: Sheet, count: int) -> list[str]:
    """Return ``count`` joints' names in cells, or none; RecordingError where they change."""
    columns = [n for n, label in enumerate(sheet.labels) if is_names(label)]
    words = [sheet.words(n) for n in columns if n not in sheet.numeric]
    if not words:
        return []
    rows = [*zip(*words, strict=True)]
    for row, line in zip(rows, sheet.lines, strict=True):
        if row != rows[0]:
            message = "the joints' names differ from the first row: write the joints in one order"
            raise RecordingError(message, file=sheet.file, line=line)
    names = re.findall(r"[A-Za-z_][\w./-]*", " ".join(rows[0]))
    return names if len(names) == count else []


def joint_labels(signal: str, joints: Sequence[str]) -> list[str]:
    """Return the column label ``signal_joint`` of each of the ``joints``."""
    return [f"{signal}_{joint}" for joint in joints]


def write_joint_table(
    file: Path,
    time: np.ndarray,
    signals: Mapping[str, np.ndarray],
    joints: Sequence[str],
) -> None:
    """Write ``time`` (N,) in s and ``signals`` (N, joints) in rad below :func:`joint_labels`."""
    header = ["time"]
    for signal in signals:
        header += joint_labels(signal, joints)
    table = np.column_stack([time, *signals.values()])
    row = ",".join(["%.6f", *["%.7f"] * (table.shape[1] - 1)]) + "\n"
    rows = row * len(table) % tuple(table.ravel().tolist())
    Path(file).write_text(",".join(header) + "\n" + rows, newline="")


# a table of joints has no mark: any table that no other format recognises is read as one
FORMAT = Format("table of joints", Kind.JOINTS, read_joint_table)
