"""Joint logs in NumPy's archives (.npz)."""

from __future__ import annotations

import zipfile
import zlib
from math import prod
from pathlib import Path

import numpy as np
from numpy.lib import format as npy

from pipeline.core.errors import RecordingError
from pipeline.formats.format import Format, Head, Kind
from pipeline.formats.joints.arrays import Arrays, log_of
from pipeline.formats.joints.log import JointLog, LogOptions

BEGINNING = b"PK\x03\x04"
NAME = slice(30, 286)  # of a ZIP file's bytes, where the name of its first member stands
# ways in which an archive can be damaged, as the libraries say it
DAMAGE = (ValueError, OSError, EOFError, KeyError, NotImplementedError, RuntimeError)
DAMAGE += (zipfile.BadZipFile, zlib.error)


def read_npz(file: Path, options: LogOptions) -> JointLog:
    """As :func:`pipeline.formats.joints.arrays.log_of`; RecordingError too for what is no archive
    of arrays.
    """

    def load(name: str) -> np.ndarray:
        try:
            with np.load(file, allow_pickle=False) as archive:
                return archive[name]
        except DAMAGE as error:
            raise _damaged(file, error) from None

    return log_of(Arrays(file, _shapes(file), load), options)


def _shapes(file: Path) -> dict[str, tuple[int, ...]]:
    """The arrays by name, () for what is no array of plain numbers."""
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
                if dtype.kind not in "fiu" or size > member.file_size:
                    shape = ()
                shapes[name] = shape
    except DAMAGE as error:
        raise _damaged(file, error) from None
    return shapes


def _damaged(file: Path, error: Exception) -> RecordingError:
    reason = str(error).splitlines()[0] if str(error) else type(error).__name__
    message = f"this is no whole archive of arrays ({reason}); save it again with numpy.savez"
    return RecordingError(message, file=file)


def _begins(head: Head) -> bool:
    return head.content.startswith(BEGINNING) and b".npy" in head.content[NAME]


FORMAT = Format("NumPy archive of joints", Kind.JOINTS, read_npz, _begins)
