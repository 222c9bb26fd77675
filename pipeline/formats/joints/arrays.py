"""Joint logs that are arrays with names: NumPy's archives (.npz), MATLAB's files (.mat, of the
versions 5 to 7.2, structs by dotted path) and Parquet, whose columns share a name before a number.
One array holds the times, and one (N, joints) the angles of each signal.
"""

from __future__ import annotations

import re
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from pathlib import Path

import numpy as np
from numpy.lib import format as npy

from pipeline.core.bounds import MIB, call_alone, require
from pipeline.core.errors import RecordingError
from pipeline.formats.joints.log import OPTION, JointLog, LogOptions, increasing
from pipeline.formats.joints.names import (
    columns_by_name,
    is_derivative,
    named_like,
    possibly_speed,
)
from pipeline.formats.units import ANGLE_UNITS, TIME_UNITS

# ways in which a file can be damaged, as the libraries say it
DAMAGE = (ValueError, TypeError, OSError, EOFError, KeyError, IndexError, NotImplementedError)
DAMAGE += (RuntimeError, ArithmeticError, zlib.error, zipfile.BadZipFile)


@dataclass(frozen=True)
class Arrays:
    """The arrays of ``file`` by name, with their shapes, () of what holds no plain numbers; none is
    read before it is needed.
    """

    file: Path
    shapes: Mapping[str, tuple[int, ...]]
    load: Callable[[str], np.ndarray]

    def named(self, quantity: str, given: object = None) -> str:
        """Return the array of a ``quantity``, time or a signal: the ``given`` one, else that whose
        name says it.
        """
        if isinstance(given, str):
            named = [given] if given in self.shapes else []
        else:
            size = 1 if quantity == "time" else 2
            held = [name for name, shape in self.shapes.items() if len(shape) in (0, size)]
            named = named_like(quantity, held) or named_like(quantity, self.shapes)
            if not named and quantity == "target":
                named = self._no_speeds()
        if len(named) != 1:
            what = f"{' and '.join(named)} could each be" if named else "no array is named like"
            there_are = ", ".join(f"{name} {shape}" for name, shape in sorted(self.shapes.items()))
            raise RecordingError(
                f"{what} the {quantity}: name the array; there are {there_are or 'none'}",
                file=self.file,
                key=f"{OPTION}.{'time' if quantity == 'time' else 'signals'}",
            )
        return named[0]

    def _no_speeds(self) -> list[str]:
        """Arrays named qd that are not the derivative of the measured angles."""
        measured = self.read(self.named("actual"), 2)
        alike = [n for n in possibly_speed(self.shapes) if self.shapes[n] == measured.shape]
        rows = np.arange(len(measured), dtype=float)
        return [n for n in alike if not is_derivative(self.read(n, 2), measured, rows)]

    def read(self, name: str, dimensions: int) -> np.ndarray:
        """Return the array as float64, of so many ``dimensions``; RecordingError with the place of
        what is no finite number.
        """
        shape = self.shapes[name]
        require("part_mib", prod(shape) * 8 / MIB, f"MiB of numbers in {name}", self.file)
        if len(shape) != dimensions or 0 in shape:
            wanted = "a number a row" if dimensions == 1 else "a row of joints a time"
            message = f"{name} is no array of plain numbers with {wanted}; its shape is {shape}"
            raise RecordingError(message, file=self.file, array=name)
        values = self.load(name).astype(float)
        if not np.isfinite(values).all():
            row = int(np.argwhere(~np.isfinite(values))[0, 0])
            message = f"{name} holds {values[row]}, where finite numbers are required"
            raise RecordingError(message, file=self.file, array=name, row=row)
        return values

    def signal(self, signal: str, columns: Sequence[object] | None) -> np.ndarray:
        """Return (N, joints) the array that ``columns`` name, a column each, or the columns
        ARRAY:COLUMN of arrays.
        """
        if columns is None or (len(columns) == 1 and columns[0] in self.shapes):
            return self.read(self.named(signal, columns and columns[0]), 2)
        if all(len(self.shapes.get(str(column), ())) == 1 for column in columns):
            return np.column_stack([self.read(str(column), 1) for column in columns])
        parts = [re.fullmatch(r"(.+):(\d+)", str(column)) for column in columns]
        arrays = {part[1]: self.shapes.get(part[1], ()) for part in parts if part}
        if not all(
            part and len(arrays[part[1]]) == 2 and int(part[2]) < arrays[part[1]][1]
            for part in parts
        ):
            there_are = ", ".join(f"{name} {shape}" for name, shape in sorted(self.shapes.items()))
            raise RecordingError(
                f"{signal}: {list(columns)} are not one array or columns ARRAY:COLUMN from 0; "
                f"there are {there_are}",
                file=self.file,
                key=f"{OPTION}.signals",
            )
        held = {name: self.read(name, 2) for name in arrays}
        return np.column_stack([held[part[1]][:, int(part[2])] for part in parts])


def log_of(arrays: Arrays, options: LogOptions) -> JointLog:
    """Return the signals of ``options`` in ``arrays``, by default the measured and the commanded
    angles as far as an array's name says which it is; rows are counted from 0.

    Raises RecordingError, with the array and row, for arrays of another shape than (N, joints),
    numbers that are not finite and times that do not increase; with the option that settles it for
    a name that is not there or not the only one.
    """
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
        message = f"{len(time)} times for {rows} angles"
        raise RecordingError(message, file=arrays.file, array=clock)
    log = JointLog(time, signals, {})
    return increasing(log, arrays.file, lambda row: {"array": clock, "row": row})


def damaged(file: Path, error: Exception | str) -> RecordingError:
    """Return what is raised for a file that its library cannot read."""
    reason = " ".join(str(error).split())[:200] or type(error).__name__
    return RecordingError(f"the file is damaged ({reason}); save it again", file=file)


def npz_arrays(file: Path) -> Arrays:
    """Return the arrays of a NumPy archive; RecordingError for what is none. Objects are never
    loaded, and nothing of more bytes than its member announces.
    """

    def load(name: str) -> np.ndarray:
        try:
            with np.load(file, allow_pickle=False) as archive:
                return archive[name]
        except DAMAGE as error:
            raise damaged(file, error) from None

    shapes: dict[str, tuple[int, ...]] = {}
    headers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    try:
        with zipfile.ZipFile(file) as members:
            for member in members.infolist():
                with members.open(member) as stream:
                    # raises ValueError of what is no array
                    shape, _, dtype = headers[npy.read_magic(stream)](stream)
                # the size that the header asks for is what would be taken in memory
                plain = dtype.kind in "fiu" and prod(shape) * dtype.itemsize <= member.file_size
                shapes[member.filename.removesuffix(".npy")] = shape if plain else ()
    except DAMAGE as error:
        reason = f"no whole archive of arrays: {error}"
        raise damaged(file, f"{reason}; write it with numpy.savez") from None
    return Arrays(file, shapes, load)


def mat_arrays(file: Path) -> Arrays:
    """Return the matrices of a MATLAB file, those in structs by their path, as ``rec.q``, a
    vector's with one dimension; RecordingError for a file that is damaged.
    """
    try:  # damaged structs can end the process of the library
        arrays = call_alone(_matrices, file, file=file)
    except RecordingError as error:
        if "ends the process" not in error.message:
            raise
        raise damaged(file, "SciPy cannot read it") from None
    shapes = {name: values.shape for name, values in arrays.items()}
    return Arrays(file, shapes, arrays.__getitem__)


def _matrices(file: Path) -> dict[str, np.ndarray]:
    # here, as most logs are none
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        return dict(_in_structs("", loadmat(file, simplify_cells=True)))
    except (*DAMAGE, MatReadError) as error:
        raise damaged(file, error) from None


def _in_structs(path: str, held: Mapping[str, object]) -> Iterator[tuple[str, np.ndarray]]:
    for name, value in held.items():
        if path or not name.startswith("__"):
            if isinstance(value, Mapping):
                yield from _in_structs(f"{path}{name}.", value)
            elif isinstance(value, np.ndarray) and value.dtype.kind in "fiu":
                # MATLAB has no arrays of one dimension
                yield f"{path}{name}", value.ravel() if 1 in value.shape else value
            else:
                yield f"{path}{name}", np.empty(())


def parquet_arrays(file: Path) -> Arrays:
    """Return the columns of numbers of a Parquet table, each by its label and, where several share
    a name before their number, together by that name; RecordingError for a damaged one.
    """
    import pyarrow as pa
    from pyarrow import parquet, types

    errors = (pa.ArrowException, OSError)

    def load(label: str) -> np.ndarray:
        try:
            column = parquet.read_table(file, columns=[label]).column(0).to_numpy()
        except errors as error:
            raise damaged(file, error) from None
        if len(column) != rows:
            raise damaged(file, f"{len(column)} of {rows} rows of {label}")
        return column

    def loaded(name: str) -> np.ndarray:
        if name in together:
            return np.column_stack([load(label) for label in together[name]])
        return load(name)

    try:
        metadata = parquet.read_metadata(file)
        schema = metadata.schema.to_arrow_schema()
    except errors as error:
        raise damaged(file, error) from None
    plain = [one for one in schema if types.is_integer(one.type) or types.is_floating(one.type)]
    labels, rows = [one.name for one in plain], metadata.num_rows
    if len({*labels}) < len(labels):
        raise RecordingError("two of its columns have one name; rename one of them", file=file)
    groups = columns_by_name(labels)
    together = {n: held for n, held in groups.items() if n not in labels and len(held) > 1}
    shapes: dict[str, tuple[int, ...]] = dict.fromkeys(labels, (rows,))
    shapes |= {name: (rows, len(held)) for name, held in together.items()}
    return Arrays(file, shapes, loaded)
