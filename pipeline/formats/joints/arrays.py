"""Joint logs that are arrays with names: NumPy's archives (.npz), MATLAB's files (.mat, of the
versions 5 to 7.2, structs by dotted path) and Parquet, whose columns share a name before a number.
One array holds the times, and one (N, joints) the angles of each signal.

Damaged ones can end the process of the library, and small ones unfold to any size: they are read in
a process of its own.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from pathlib import Path

import numpy as np
from numpy.lib import format as npy

from pipeline.core.bounds import MIB, bounds, require
from pipeline.core.errors import RecordingError
from pipeline.formats.format import Format, Head, Kind, begins, read_alone
from pipeline.formats.joints.log import OPTION, JointLog, LogOptions, increasing
from pipeline.formats.joints.names import (
    columns_by_name,
    is_derivative,
    named_like,
    possibly_speed,
)
from pipeline.formats.units import ANGLE_UNITS, TIME_UNITS

HDF5 = b"MATLAB 7.3"  # another format, HDF5, under the ending of a MATLAB file
ARRAY = re.compile(r"(.+):(\d+)")  # a column of an array
MEMBER = slice(30, 286)  # bytes of a ZIP file with the name of its first member


@dataclass(frozen=True)
class Arrays:
    """Arrays of ``file`` by name, with their shapes, () of what holds no plain numbers; ``held``
    lacks those that are larger than the bound.
    """

    file: Path
    shapes: Mapping[str, tuple[int, ...]]
    held: Mapping[str, np.ndarray]

    def named(self, quantity: str, given: object = None) -> str:
        """Return the array of a ``quantity``, time or a signal: the ``given`` one, else that whose
        name says it.
        """
        if isinstance(given, str):
            named = [given] if given in self.shapes else []
        else:
            size = 1 if quantity == "time" else 2
            fits = [name for name, shape in self.shapes.items() if len(shape) in (0, size)]
            named = named_like(quantity, fits) or named_like(quantity, self.shapes)
            if not named and quantity == "target":
                named = self._no_speeds()
        if len(named) != 1:
            what = f"{' and '.join(named)} could each be" if named else "no array is named like"
            key = f"{OPTION}.{'time' if quantity == 'time' else 'signals'}"
            message = f"{what} the {quantity}: name the array; there are {self}"
            raise RecordingError(message, file=self.file, key=key)
        return named[0]

    def __str__(self) -> str:
        return ", ".join(f"{name} {shape}" for name, shape in sorted(self.shapes.items())) or "none"

    def _no_speeds(self) -> list[str]:
        """Return the arrays named qd that are not the derivative of the measured angles."""
        measured = self.read(self.named("actual"), 2)
        alike = [n for n in possibly_speed(self.shapes) if self.shapes[n] == measured.shape]
        rows = np.arange(len(measured), dtype=float)
        return [n for n in alike if not is_derivative(self.read(n, 2), measured, rows)]

    def read(self, name: str, dimensions: int) -> np.ndarray:
        """Return the array as float64, of so many ``dimensions``; RecordingError with the place of
        what is no finite number.
        """
        shape, where = self.shapes[name], {"file": self.file, "array": name}
        require("part_mib", prod(shape) * 8 / MIB, f"MiB of numbers in {name}", self.file)
        if len(shape) != dimensions or 0 in shape:
            wanted = "a number a row" if dimensions == 1 else "a row of joints a time"
            message = f"{name} is no array of plain numbers with {wanted}; its shape is {shape}"
            raise RecordingError(message, **where)
        values = self.held[name].astype(float)
        if not np.isfinite(values).all():
            row = int(np.argwhere(~np.isfinite(values))[0, 0])
            message = f"{name} holds {values[row]}, where finite numbers are required"
            raise RecordingError(message, row=row, **where)
        return values

    def signal(self, signal: str, columns: Sequence[object] | None) -> np.ndarray:
        """Return (N, joints) the array that ``columns`` name, a column each, or the columns
        ARRAY:COLUMN of arrays.
        """
        if columns is None or (len(columns) == 1 and columns[0] in self.shapes):
            return self.read(self.named(signal, columns and columns[0]), 2)
        held = []
        for column in map(str, columns):
            part = ARRAY.fullmatch(column)
            shape = self.shapes.get(part[1] if part else column, ())
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
    angles as far as an array's name says which it is; rows are counted from 0.

    Raises RecordingError for a damaged file; with the array and row, for arrays of another shape
    than (N, joints), numbers that are not finite and times that do not increase; with the option
    that settles it for a name that is not there or not the only one.
    """
    head = Head.read(file)
    if head.content.startswith(HDF5):
        raise RecordingError("version 7.3 is not read; save it with -v7", file=file)
    read = next((read for read, begin in READERS if begin(head)), _npz)
    held = read_alone(read, Path(file), file=file, advice="save it again")
    arrays = Arrays(Path(file), *held)
    chosen = options.signals or dict.fromkeys(("actual", "target"))
    signals = {name: arrays.signal(name, columns) for name, columns in chosen.items()}
    signals = {name: rows * ANGLE_UNITS[options.angle_unit] for name, rows in signals.items()}
    length = {len(rows) for rows in signals.values()}
    if options.time is None:
        clock, time = None, np.arange(max(length)) / options.rate
    else:
        clock = arrays.named("time", options.time)
        time = arrays.read(clock, 1) * TIME_UNITS[options.time_unit]
    if length != {len(time)}:
        rows = ", ".join(f"{len(rows)} of {name}" for name, rows in signals.items())
        raise RecordingError(f"{len(time)} times for {rows} angles", file=file, array=clock)
    log = JointLog(time, signals, {})
    return increasing(log, file, lambda row: {"array": clock, "row": row})


Shapes = dict[str, tuple[int, ...]]
Held = dict[str, np.ndarray]


def _is_plain(shape: tuple[int, ...], dtype: np.dtype) -> bool:
    """Return whether an array holds numbers, and no more than the bound."""
    return dtype.kind in "fiu" and prod(shape) * dtype.itemsize <= bounds().part_mib * MIB


def _npz(file: Path) -> tuple[Shapes, Held]:
    """Return the arrays of a NumPy archive; objects are never loaded."""
    shapes: Shapes = {}
    held: Held = {}
    headers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    with zipfile.ZipFile(file) as members:
        for member in members.infolist():
            name = member.filename.removesuffix(".npy")
            with members.open(member) as stream:
                # raises ValueError of what is no array
                shape, _, dtype = headers[npy.read_magic(stream)](stream)
            shapes[name] = shape if dtype.kind in "fiu" else ()
            # the size that the header asks for is what would be taken in memory
            if _is_plain(shape, dtype) and prod(shape) * dtype.itemsize <= member.file_size:
                with members.open(member) as stream:
                    held[name] = npy.read_array(stream, allow_pickle=False)
            elif shapes[name] and prod(shape) * dtype.itemsize > member.file_size:
                shapes[name] = ()
    return shapes, held


def _mat(file: Path) -> tuple[Shapes, Held]:
    """Return the matrices of a MATLAB file, those in structs by their path, as ``rec.q``, a
    vector's with one dimension.
    """
    # here, as most logs are none
    from scipy.io import loadmat

    held = dict(_in_structs("", loadmat(file, simplify_cells=True)))
    return {name: values.shape for name, values in held.items()}, held


def _in_structs(path: str, held: Mapping[str, object]) -> Iterator[tuple[str, np.ndarray]]:
    for name, value in held.items():
        if path or not name.startswith("__"):
            if isinstance(value, Mapping):
                yield from _in_structs(f"{path}{name}.", value)
            elif isinstance(value, np.ndarray) and _is_plain(value.shape, value.dtype):
                # MATLAB has no arrays of one dimension
                yield f"{path}{name}", value.ravel() if 1 in value.shape else value
            else:
                yield f"{path}{name}", np.empty(())


def _parquet(file: Path) -> tuple[Shapes, Held]:
    """Return the columns of numbers of a Parquet table, each by its label and, where several share
    a name before their number, together by that name.
    """
    from pyarrow import parquet, types

    metadata = parquet.read_metadata(file)
    schema = metadata.schema.to_arrow_schema()
    plain = [one for one in schema if types.is_integer(one.type) or types.is_floating(one.type)]
    labels = [one.name for one in plain]
    if len({*labels}) < len(labels):
        raise RecordingError("two of its columns have one name; rename one of them", file=file)
    require("part_mib", metadata.num_rows * 8 / MIB, "MiB of numbers in a column", file)
    held = {name: parquet.read_table(file, columns=[name]).column(0).to_numpy() for name in labels}
    if any(len(column) != metadata.num_rows for column in held.values()):
        raise ValueError(f"a column has not the {metadata.num_rows} rows that are announced")
    for name, group in columns_by_name(labels).items():
        if name not in held and len(group) > 1:
            held[name] = np.column_stack([held[label] for label in group])
    return {name: values.shape for name, values in held.items()}, held


def _npz_begins(head: Head) -> bool:
    return head.content.startswith(b"PK\x03\x04") and b".npy" in head.content[MEMBER]


_mat_begins, _parquet_begins = begins(b"MATLAB 5.0 MAT-file", HDF5), begins(b"PAR1")
READERS: tuple[tuple[Callable, Callable], ...] = ((_mat, _mat_begins), (_parquet, _parquet_begins))
FORMAT = (
    Format("MATLAB file of joints", Kind.JOINTS, read_arrays, _mat_begins),
    Format("NumPy archive of joints", Kind.JOINTS, read_arrays, _npz_begins),
    Format("Parquet table of joints", Kind.JOINTS, read_arrays, _parquet_begins),
)
