"""Joint logs in MATLAB's files (.mat, of the versions 5 to 7.2)."""

from __future__ import annotations

import zlib
from math import prod
from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.format import Format, Head, Kind, begins
from pipeline.formats.joints.arrays import Arrays, log_of
from pipeline.formats.joints.log import JointLog, LogOptions

HDF5 = b"MATLAB 7.3"  # another format, HDF5, under the same ending
NUMBERS = {"double", "single"} | {
    f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)
}
# ways in which a file can be damaged, as the library says it
DAMAGE = (ValueError, TypeError, OSError, EOFError, KeyError, IndexError, NotImplementedError)
DAMAGE += (RuntimeError, OverflowError, zlib.error)


def read_mat(file: Path, options: LogOptions) -> JointLog:
    """As :func:`pipeline.formats.joints.arrays.log_of`, of the matrices of the file, a vector's
    one row or column being one number a row; RecordingError too for what is no such file.
    """
    # here, as most logs are none
    from scipy.io import loadmat, whosmat
    from scipy.io.matlab import MatReadError

    damage = (*DAMAGE, MatReadError)
    if Head.read(file).content.startswith(HDF5):
        raise RecordingError("version 7.3 is not read; save it with -v7", file=file)

    def load(name: str) -> np.ndarray:
        try:
            values = loadmat(file, variable_names=[name])[name]
        except damage as error:
            raise _damaged(file, error) from None
        return values.reshape(shapes[name])

    try:
        held = whosmat(file)
    except damage as error:
        raise _damaged(file, error) from None
    shapes = {name: _shape(shape, kind) for name, shape, kind in held}
    return log_of(Arrays(file, shapes, load), options)


def _shape(shape: tuple[int, ...], kind: str) -> tuple[int, ...]:
    if kind not in NUMBERS:
        return ()
    # MATLAB has no arrays of one dimension
    return (prod(shape),) if len(shape) == 2 and 1 in shape else tuple(shape)


def _damaged(file: Path, error: Exception) -> RecordingError:
    reason = " ".join(str(error).split())[:200] or type(error).__name__
    return RecordingError(f"the file is damaged ({reason}); save it again", file=file)


FORMAT = Format(
    "MATLAB file of joints", Kind.JOINTS, read_mat, begins(b"MATLAB 5.0 MAT-file", HDF5)
)
