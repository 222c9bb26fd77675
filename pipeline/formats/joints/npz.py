"""Joint logs in NumPy's archives (.npz), read by :mod:`pipeline.formats.joints.arrays`."""

from __future__ import annotations

from pathlib import Path

from pipeline.formats.format import Format, Head, Kind
from pipeline.formats.joints.arrays import log_of, npz_arrays
from pipeline.formats.joints.log import JointLog, LogOptions

NAME = slice(30, 286)  # of a ZIP file's bytes, where the name of its first member is


def read_npz(file: Path, options: LogOptions) -> JointLog:
    """Return the log as :func:`pipeline.formats.joints.arrays.log_of`."""
    return log_of(npz_arrays(file), options)


def _begins(head: Head) -> bool:
    return head.content.startswith(b"PK\x03\x04") and b".npy" in head.content[NAME]


FORMAT = Format("NumPy archive of joints", Kind.JOINTS, read_npz, _begins)
