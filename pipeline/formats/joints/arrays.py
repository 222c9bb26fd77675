"""Joint logs as arrays with names: NumPy's archives (.npz), MATLAB's files (.mat up to version 7.2,
structs by dotted path) and Parquet, whose columns share a name before a number. One array holds the
times, and one (N, joints) each signal. A process of its own reads them, since damaged files can end
it and small ones unfold to any size.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from pipeline.core.bounds import MIB, require
from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import ANGLE_UNITS, TIME_UNITS
from pipeline.formats.format import Format, Head, Kind, begins, read_alone
from pipeline.formats.joints.log import OPTION, JointLog, LogOptions, increasing
from pipeline.formats.joints.names import (
    columns_by_name,
    named_like,
    possibly_speed,
    signals_of_groups,
)

HDF5 = (b"MATLAB 7.3", b"\x89HDF")  # another format under the ending of a MATLAB file
MEMBER = slice(30, 286)  # bytes of a ZIP file with the name of its first member
Held = dict[str, np.ndarray]


def read_arrays(file: Path, options: LogOptions) -> JointLog:
    """Return the signals of ``options`` in ``file``, by default the measured and commanded angles
    by their names; columns of an array are ``ARRAY:COLUMN``, from 0. Raises RecordingError for a
    damaged file; with the array and row (from 0), for numbers that are not finite and times that do
    not increase; with the option, for a name that is missing, not unique or not of numbers.
    """
    head = Head.read(file)
    if head.content.startswith(HDF5):
        raise RecordingError("version 7.3 is not read; save it with -v7", file=file)
    read = _mat if _mat_begins(head) else _parquet if _parquet_begins(head) else _npz
    held = read_alone(read, Path(file), file=file, advice="save it again")
    arrays = {name: np.atleast_2d(one.T) for name, one in held.items() if one.ndim in (1, 2)}
    groups, columns = {}, {}
    for name, rows in arrays.items():
        groups[name] = [f"{name}:{j}" for j in range(len(rows))] if held[name].ndim == 2 else [name]
        columns |= zip(groups[name], rows, strict=True)

    def numbers(quantity: str, names: Sequence[object]) -> np.ndarray:
        labels = [label for name in map(str, names) for label in groups.get(name, [name])]
        chosen = [columns[label] for label in labels if label in columns]
        if not labels or len(chosen) < len(labels) or len({*map(len, chosen)}) > 1:
            there = ", ".join(f"{name} {one.shape}" for name, one in sorted(held.items())) or "none"
            message = f"the {quantity} must be an array of a row of numbers a time, found {names}; "
            message += f"name it, or its columns ARRAY:COLUMN. There are {there}"
            key = f"{OPTION}.{'time' if quantity == 'time' else 'signals'}"
            raise RecordingError(message, file=file, key=key)
        require("part_mib", sum(map(len, chosen)) * 8 / MIB, f"MiB of the {quantity}", file)
        values = np.column_stack(chosen).astype(float)
        if (wrong := ~np.isfinite(values)).any():
            row, column = np.argwhere(wrong)[0].tolist()
            message = f"{labels[column]} holds {values[row, column]}, not a finite number"
            raise RecordingError(message, file=file, array=labels[column], row=row)
        return values

    named = [options.time]
    if isinstance(options.time, int):
        named = named_like("time", [name for name in arrays if held[name].ndim == 1])
    clock, time = (named[0] if len(named) == 1 else None), None
    if clock is not None:
        time = numbers("time", named)[:, 0] * TIME_UNITS[options.time_unit]
    chosen = {name: labels for name, labels in options.signals.items() if labels}
    wanted = options.signals or ("actual", "target")
    if {*wanted} - {*chosen}:
        tables = {name: [name] for name in arrays if held[name].ndim == 2}
        numbers_mib = sum(held[name].size for name in tables) * 8 / MIB
        require("memory_mib", numbers_mib, "MiB of numbers in unnamed arrays", file)
        values = {name: held[name].astype(float) for name in tables}
        with np.errstate(over="ignore", invalid="ignore"):  # of damaged numbers
            found, guessed = signals_of_groups(tables, values, time)
        if guessed and not possibly_speed(found["target"]):
            del found["target"]
        chosen = found | chosen
    unit = ANGLE_UNITS[options.angle_unit]
    signals = {name: numbers(name, chosen.get(name, ())) * unit for name in wanted}
    length = {name: len(rows) for name, rows in signals.items()}
    if time is None:
        time = np.arange(max(length.values())) / options.rate
        if options.time is not None:
            numbers("time", ())
    if {*length.values()} != {len(time)}:
        rows = ", ".join(f"{count} of {name}" for name, count in length.items())
        message = f"{len(time)} times for {rows} angles; save a row of joints for each time"
        message += " (transpose arrays that have a row for each joint)"
        raise RecordingError(message, file=file, array=clock)
    return increasing(JointLog(time, signals, {}), file, lambda row: {"array": clock, "row": row})


def _npz(file: Path) -> Held:
    """Return the arrays of a NumPy archive; objects are never loaded."""
    held: Held = {}
    with np.load(file, allow_pickle=False) as archive:
        for name in archive.files:
            try:
                held[name] = _plain(archive[name])
            except ValueError as error:
                if "pickle" not in str(error):
                    raise
                held[name] = np.empty(())
    return held


def _plain(value: object) -> np.ndarray:
    """Return an array of numbers as it is, dates and durations in s (since 1970), lists of one
    length as rows; an array of the shape () for any other ``value``.
    """
    kind = value.dtype.kind if isinstance(value, np.ndarray) else ""
    if kind == "O" and value.ndim == 1 and len({np.shape(row) for row in value}) == 1:
        return _plain(np.stack(value)) if np.shape(value[0]) else np.empty(())
    if kind in ("m", "M"):
        return (value - np.zeros(1, value.dtype)) / np.timedelta64(1, "s")
    return value if kind and kind in "fiu" else np.empty(())


def _mat(file: Path) -> Held:
    """Return the matrices of a MATLAB file, those in structs by their path, as ``rec.q``."""
    from scipy.io import loadmat  # here, as few logs are MATLAB files

    held = dict(_in_structs("", loadmat(file, simplify_cells=True)))
    # MATLAB has no arrays of one dimension
    return {name: one.ravel() if 1 in one.shape else one for name, one in held.items()}


def _in_structs(path: str, held: Mapping[str, object]) -> Iterator[tuple[str, np.ndarray]]:
    for name, value in held.items():
        if isinstance(value, Mapping):
            yield from _in_structs(f"{path}{name}.", value)
        elif path or not name.startswith("__"):
            yield f"{path}{name}", _plain(value)


def _parquet(file: Path) -> Held:
    """Return the columns of numbers, and together those that share a name before their number."""
    from pyarrow import parquet

    table = parquet.read_table(file)
    table.validate()
    columns = {name: _plain(table[name].to_numpy()) for name in table.column_names}
    held = {name: values for name, values in columns.items() if values.ndim}
    for name, group in columns_by_name([*held]).items():
        if name not in held and len(group) > 1:
            held[name] = np.column_stack([held[label] for label in group])
    return held


def _npz_begins(head: Head) -> bool:
    return head.content.startswith(b"PK\x03\x04") and b".npy" in head.content[MEMBER]


def _mat_begins(head: Head) -> bool:
    # version 4 has no mark
    return head.content.startswith((b"MATLAB 5.0 MAT-file", HDF5[0])) or head.suffix == ".mat"


_parquet_begins = begins(b"PAR1")
FORMAT = (
    Format("MATLAB file of joints", Kind.JOINTS, read_arrays, _mat_begins),
    Format("NumPy archive of joints", Kind.JOINTS, read_arrays, _npz_begins),
    Format("Parquet table of joints", Kind.JOINTS, read_arrays, _parquet_begins),
)
