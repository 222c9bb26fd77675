"""Joint logs in NumPy's archives (.npz): an array of times, and one of the joints' angles a signal,
(N, joints), under names that the option gives or that say what they are.
"""

from __future__ import annotations

import re
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import prod
from pathlib import Path

import numpy as np
from numpy.lib import format as npy

from pipeline.core.errors import RecordingError
from pipeline.formats.format import Format, Head, Kind
from pipeline.formats.joints.log import ANGLE_UNITS, OPTION, JointLog, LogOptions, increasing
from pipeline.formats.units import TIME_UNITS

MOST_BYTES = 1 << 30  # of one array, unpacked
BEGINNING = b"PK\x03\x04"
NAME = slice(30, 286)  # of a ZIP file's bytes, where the name of its first member stands
# what is meant without an option, written without case and signs
NAMES = {
    "time": ("t", "time", "times", "timestamp", "timestamps", "stamp", "stamps"),
    "actual": (
        *("q", "qactual", "actualq", "qmeasured", "measuredq", "position", "positions"),
        *("actualpositions", "measuredpositions", "jointpositions", "angles", "jointangles"),
    ),
    "target": (
        *("qtarget", "targetq", "qdesired", "desiredq", "qd", "qcommanded", "commandedq", "qcmd"),
        *("targetpositions", "desiredpositions", "commandedpositions", "targetangles"),
    ),
}
# ways in which an archive can be damaged, as the libraries say it
DAMAGE = (ValueError, OSError, EOFError, KeyError, NotImplementedError, RuntimeError)


@dataclass(frozen=True)
class Archive:
    """The arrays of ``file`` by name, with their shapes; none is read before it is asked for."""

    file: Path
    shapes: Mapping[str, tuple[int, ...]]

    @classmethod
    def opened(cls, file: Path) -> Archive:
        """RecordingError for what is no archive of arrays of plain numbers within MOST_BYTES."""
        shapes = {}
        try:
            with zipfile.ZipFile(file) as members:
                for member in members.infolist():
                    name = member.filename.removesuffix(".npy")
                    with members.open(member) as stream:
                        # raises ValueError of what is no array
                        read = {
                            (1, 0): npy.read_array_header_1_0,
                            (2, 0): npy.read_array_header_2_0,
                        }
                        shape, _, dtype = read[npy.read_magic(stream)](stream)
                    # the size that the header asks for is what would be taken in memory
                    size = prod(shape) * dtype.itemsize
                    if dtype.kind not in "fiu" or size > min(MOST_BYTES, member.file_size):
                        shape = ()
                    shapes[name] = shape
        except (*DAMAGE, zipfile.BadZipFile, zlib.error) as error:
            raise _damaged(file, error) from None
        return cls(file, shapes)

    def named(self, quantity: str, given: object) -> str:
        """The array of a ``quantity`` of NAMES: the ``given`` one, else what its name says."""
        if isinstance(given, str):
            named = [given] if given in self.shapes else []
        else:
            plain = {name: re.sub(r"[^a-z0-9]", "", name.lower()) for name in self.shapes}
            named = [name for name in self.shapes if plain[name] in NAMES[quantity]]
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
        if len(shape) != dimensions or 0 in shape:
            wanted = "a number a row" if dimensions == 1 else "a row of joints a time"
            message = f"{name} is no array of plain numbers with {wanted}; its shape is {shape}"
            raise RecordingError(message, file=self.file, array=name)
        try:
            with np.load(self.file, allow_pickle=False) as archive:
                values = archive[name].astype(float)
        except (*DAMAGE, zipfile.BadZipFile, zlib.error) as error:
            raise _damaged(self.file, error) from None
        if not np.isfinite(values).all():
            row = int(np.argwhere(~np.isfinite(values))[0, 0])
            message = f"{name} holds {values[row]} where numbers have to stand"
            raise RecordingError(message, file=self.file, array=name, row=row)
        return values


def read_npz(file: Path, options: LogOptions) -> JointLog:
    """The signals of ``options`` in ``file``, by default the measured and the commanded angles as
    far as an array's name says which it is; rows are counted from 0.

    Raises RecordingError, with the array and row, for what is no archive, arrays of another shape
    than (N, joints), numbers that are not finite and times that do not increase; with the option
    that settles it for a name that is not there or not the only one.
    """
    archive = Archive.opened(file)
    chosen = options.signals or dict.fromkeys(("actual", "target"))
    signals = {name: _signal(archive, name, columns) for name, columns in chosen.items()}
    signals = {name: rows * ANGLE_UNITS[options.angle_unit] for name, rows in signals.items()}
    length = {len(rows) for rows in signals.values()}
    if options.time is None:
        clock, time = None, np.arange(max(length)) / options.rate
    else:
        clock = archive.named("time", options.time)
        time = archive.read(clock, 1) * TIME_UNITS[options.time_unit]
    if length != {len(time)}:
        rows = ", ".join(f"{len(rows)} of {name}" for name, rows in signals.items())
        raise RecordingError(f"{len(time)} times for {rows} angles", file=file, array=clock)
    return increasing(JointLog(time, signals, {}), file, lambda row: {"array": clock, "row": row})


def _signal(archive: Archive, signal: str, columns: Sequence[object] | None) -> np.ndarray:
    """(N, joints) the array that ``columns`` name, or the columns ARRAY:COLUMN of arrays."""
    if columns is None or (len(columns) == 1 and columns[0] in archive.shapes):
        return archive.read(archive.named(signal, columns and columns[0]), 2)
    parts = [re.fullmatch(r"(.+):(\d+)", str(column)) for column in columns]
    arrays = {part[1]: archive.shapes.get(part[1], ()) for part in parts if part}
    if not all(
        part and len(arrays[part[1]]) == 2 and int(part[2]) < arrays[part[1]][1] for part in parts
    ):
        there_are = ", ".join(f"{name} {shape}" for name, shape in sorted(archive.shapes.items()))
        raise RecordingError(
            f"{signal}: {list(columns)} are not one array or columns ARRAY:COLUMN from 0; there "
            f"are {there_are}",
            file=archive.file,
            key=f"{OPTION}.signals",
        )
    held = {name: archive.read(name, 2) for name in arrays}
    return np.column_stack([held[part[1]][:, int(part[2])] for part in parts])


def _damaged(file: Path, error: Exception) -> RecordingError:
    reason = str(error).splitlines()[0] if str(error) else type(error).__name__
    message = f"this is no whole archive of arrays ({reason}); save it again with numpy.savez"
    return RecordingError(message, file=file)


def _begins(head: Head) -> bool:
    return head.content.startswith(BEGINNING) and b".npy" in head.content[NAME]


FORMAT = Format("NumPy archive of joints", Kind.JOINTS, read_npz, _begins)
