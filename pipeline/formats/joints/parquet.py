"""Joint logs in Parquet: a column the time, and one a joint of each signal, read by
:mod:`pipeline.formats.joints.arrays`.
"""

from __future__ import annotations

from pathlib import Path

from pipeline.formats.format import Format, Kind, begins
from pipeline.formats.joints.arrays import log_of, parquet_arrays
from pipeline.formats.joints.log import JointLog, LogOptions


def read_parquet(file: Path, options: LogOptions) -> JointLog:
    """Return the log as :func:`pipeline.formats.joints.arrays.log_of`; an empty cell is refused."""
    return log_of(parquet_arrays(file), options)


FORMAT = Format("Parquet table of joints", Kind.JOINTS, read_parquet, begins(b"PAR1"))
