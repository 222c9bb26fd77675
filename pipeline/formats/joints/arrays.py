"""Joint logs that are arrays with names, in whatever file: one of times, and one of the joints'
angles a signal, (N, joints), under names that the option gives or that say what they are.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from pathlib import Path

import numpy as np

from pipeline.core.bounds import MIB, require
from pipeline.core.errors import RecordingError
from pipeline.formats.joints.log import ANGLE_UNITS, OPTION, JointLog, LogOptions, increasing
from pipeline.formats.joints.names import columns_by_name, named_like
from pipeline.formats.units import TIME_UNITS


@dataclass(frozen=True)
class Arrays:
    """The arrays of ``file`` by name, with their shapes, () of what holds no plain numbers; none is
    read before it is asked for.
    """

    file: Path
    shapes: Mapping[str, tuple[int, ...]]
    load: Callable[[str], np.ndarray]

    def named(self, quantity: str, given: object) -> str:
        """The array of a ``quantity``, time or a signal: the ``given`` one, else what its name
        says.
        """
        if isinstance(given, str):
            named = [given] if given in self.shapes else []
        else:
            named = named_like(quantity, self.shapes)
        if len(named) != 1:
            what = f"{' and '.join(named)} could each be" if named else "no array is named like"
            raise RecordingError(
                f"{what} the {quantity}: name the array; there are "
                f"{', '.join(sorted(self.shapes)) or 'none'}",
                file=self.file,
                key=f"{OPTION}.{'time' if quantity == 'time' else 'signals'}",
            )
        return named[0]

    def read(self, name: str, dimensions: int) -> np.ndarray:
        """The array as float64, of so many ``dimensions``; RecordingError with the place of what is
        no finite number.
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
            message = f"{name} holds {values[row]} where numbers have to stand"
            raise RecordingError(message, file=self.file, array=name, row=row)
        return values

    def signal(self, signal: str, columns: Sequence[object] | None) -> np.ndarray:
        """(N, joints) the array that ``columns`` name, a column each, or the columns ARRAY:COLUMN
        of arrays.
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
    """The signals of ``options`` in ``arrays``, by default the measured and the commanded angles as
    far as an array's name says which it is; rows are counted from 0.

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


def of_columns(file: Path, labels: Sequence[str], rows: int, load: Callable) -> Arrays:
    """Arrays of a table's columns, each by its label and, where several share a name before their
    number, together by that name; ``load(label)`` gives one as (N,).
    """
    together = {
        name: columns
        for name, columns in columns_by_name(labels).items()
        if name not in labels and len(columns) > 1
    }
    shapes: dict[str, tuple[int, ...]] = dict.fromkeys(labels, (rows,))
    shapes |= {name: (rows, len(columns)) for name, columns in together.items()}

    def loaded(name: str) -> np.ndarray:
        if name in together:
            return np.column_stack([load(label) for label in together[name]])
        return load(name)

    return Arrays(file, shapes, loaded)
