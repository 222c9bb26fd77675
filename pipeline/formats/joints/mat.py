"""Joint logs in MATLAB's files (.mat, of the versions 5 to 7.2), read by
:mod:`pipeline.formats.joints.arrays`.
"""

from __future__ import annotations

from pathlib import Path

from pipeline.core.errors import RecordingError
from pipeline.formats.format import Format, Head, Kind, begins
from pipeline.formats.joints.arrays import log_of, mat_arrays
from pipeline.formats.joints.log import JointLog, LogOptions

HDF5 = b"MATLAB 7.3"  # another format, HDF5, under the same ending


def read_mat(file: Path, options: LogOptions) -> JointLog:
    """Return the log as :func:`pipeline.formats.joints.arrays.log_of`."""
    if Head.read(file).content.startswith(HDF5):
        raise RecordingError("version 7.3 is not read; save it with -v7", file=file)
    return log_of(mat_arrays(file), options)


FORMAT = Format(
    "MATLAB file of joints", Kind.JOINTS, read_mat, begins(b"MATLAB 5.0 MAT-file", HDF5)
)
