"""Joint logs that are arrays with names: NumPy's archives (.npz), MATLAB's files (.mat up to
version 7.2, structs by dotted path) and Parquet, whose columns share a name before a number. One
array holds the times, and one (N, joints) the angles of each signal. They are read in a process of
its own, since damaged ones can end it, and small ones unfold to any size.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.core.bounds import MIB, require
from pipeline.core.errors import RecordingError
from pipeline.formats.format import Format, Head, Kind, begins, read_alone
from pipeline.formats.joints.log import OPTION, JointLog, LogOptions, increasing
from pipeline.formats.joints.names import columns_by_name, is_derivative, named_like, possibly_speed
from pipeline.formats.units import ANGLE_UNITS, TIME_UNITS

HDF5 = (b"MATLAB 7.3", b"\x89HDF")  # another format under the ending of a MATLAB file
ARRAY = re.compile(r"(.+):(\d+)")  # a column of an array
MEMBER = slice(30, 286)  # bytes of a ZIP file with the name of its first member
Held = dict[str, np.ndarray]


@dataclass(frozen=True)
class NamedArrays:
    """Arrays of ``file`` by name, of the shape () where it holds no plain numbers."""

    file: Path
    held: Mapping[str, np.ndarray]

    def named(self, quantity: str, given: object = None) -> str:
        """Return the name of the array of a ``quantity``: the ``given`` one, else by its name."""
        if isinstance(given, str):
            named = [given] if given in self.held else []
        else:
            size = 1 if quantity == "time" else 2
            fits = [name for name, values in self.held.items() if values.ndim in (0, size)]
            named = named_like(quantity, fits) or named_like(quantity, self.held)
            if not named and quantity == "target":
                named = self._no_speeds()
        if len(named) != 1:
            what = f"{' and '.join(named)} could each be" if named else "no array is named like"
            key = f"{OPTION}.{'time' if quantity == 'time' else 'signals'}"
            message = f"{what} the {quantity}: name the array; there are {self}"
            raise RecordingError(message, file=self.file, key=key)
        return named[0]

    def __str__(self) -> str:
        return ", ".join(f"{name} {one.shape}" for name, one in sorted(self.held.items())) or "none"

    def _no_speeds(self) -> list[str]:
        """Return the arrays named qd that are not the derivative of the measured angles."""
        measured = self.read(self.named("actual"), 2)
        alike = [n for n in possibly_speed(self.held) if self.held[n].shape == measured.shape]
        rows = np.arange(len(measured), dtype=float)
        return [n for n in alike if not is_derivative(self.read(n, 2), measured, rows)]

    def read(self, name: str, dimensions: int) -> np.ndarray:
        """Return the array as float64; RecordingError with the place of no finite number."""
        values, where = self.held[name], {"file": self.file, "array": name}
        require("part_mib", values.size * 8 / MIB, f"MiB of numbers in {name}", self.file)
        if values.ndim != dimensions or not values.size:
            wanted = "a number a row" if dimensions == 1 else "a row of joints a time"
            message = f"{name} is no array of plain numbers with {wanted}; its shape is "
            raise RecordingError(f"{message}{values.shape}", **where)
        values = values.astype(float)
        if not np.isfinite(values).all():
            row = int(np.argwhere(~np.isfinite(values))[0, 0])
            message = f"{name} holds {values[row]}, where finite numbers are required"
            raise RecordingError(message, row=row, **where)
        return values

    def signal(self, signal: str, columns: Sequence[object] | None) -> np.ndarray:
        """Return (N, joints) of an array, or of arrays or columns ARRAY:COLUMN."""
        if columns is None or (len(columns) == 1 and columns[0] in self.held):
            return self.read(self.named(signal, columns and columns[0]), 2)
        held = []
        for column in map(str, columns):
            part = ARRAY.fullmatch(column)
            shape = np.shape(self.held.get(part[1] if part else column, 0))
            if not part and len(shape) == 1:
                held.append(self.read(column, 1))
            elif part and len(shape) == 2 and int(part[2]) < shape[1]:
                held.append(self.read(part[1], 2)[:, int(part[2])])
            else:
                message = f"{signal}: {column} is no array and no column ARRAY:COLUMN from 0; there"
                key = f"{OPTION}.signals"
                raise RecordingError(f"{message} are {self}", file=self.file, key=key)
        return np.column_stack(held)


def read_arrays(file: Path, options: LogOptions) -> JointLog:
    """Return the signals of ``options`` in ``file``, by default the measured and the commanded
    angles by their names.

    Raises RecordingError for a damaged file; with the array and row (from 0), for another shape
    than (N, joints), numbers that are not finite and times that do not increase; with the option
    that settles it for a name that is not there or not the only one.
    """
    head = Head.read(file)
    if head.content.startswith(HDF5):
        raise RecordingError("version 7.3 is not read; save it with -v7", file=file)
    read = _mat if _mat_begins(head) else _parquet if _parquet_begins(head) else _npz
    arrays = NamedArrays(file, read_alone(read, Path(file), file=file, advice="save it again"))
    chosen = options.signals or dict.fromkeys(("actual", "target"))
    unit = ANGLE_UNITS[options.angle_unit]
    signals = {name: arrays.signal(name, columns) * unit for name, columns in chosen.items()}
    length = {name: len(rows) for name, rows in signals.items()}
    clock, time = None, np.arange(max(length.values())) / options.rate
    if options.time is not None:
        clock = arrays.named("time", options.time)
        time = arrays.read(clock, 1) * TIME_UNITS[options.time_unit]
    if {*length.values()} != {len(time)}:
        rows = ", ".join(f"{count} of {name}" for name, count in length.items())
        message = f"{len(time)} times for {rows} angles; save a row of joints for each time"
        message += " (transpose arrays that have a row for each joint)"
        raise RecordingError(message, file=file, array=clock)
    log = JointLog(time, signals, {})
    return increasing(log, file, lambda row: {"array": clock, "row": row})


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
    """Return ``value`` where it is an array of plain numbers, dates and times in s (since 1970),
    lists of one length as rows; else an array of the shape ().
    """
    kind = value.dtype.kind if isinstance(value, np.ndarray) else ""
    if kind == "O" and value.ndim == 1 and len({np.shape(row) for row in value}) == 1:
        return _plain(np.stack(value)) if np.shape(value[0]) else np.empty(())
    if kind in ("m", "M"):
        return (value - np.zeros(1, value.dtype)) / np.timedelta64(1, "s")
    return value if kind and kind in "fiu" else np.empty(())


def _mat(file: Path) -> Held:
    """Return the matrices of a MATLAB file, those in structs by their path, as ``rec.q``."""
    # here, as most logs are none
    from scipy.io import loadmat

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
    if len({*table.column_names}) < len(table.column_names):
        raise RecordingError("two of its columns have one name; rename one of them", file=file)
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
