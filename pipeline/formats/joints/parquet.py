"""Joint logs in Parquet: a column the time, and one a joint of each signal."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.format import Format, Kind, begins
from pipeline.formats.joints.arrays import log_of, of_columns
from pipeline.formats.joints.log import JointLog, LogOptions


def read_parquet(file: Path, options: LogOptions) -> JointLog:
    """As :func:`pipeline.formats.joints.arrays.log_of`, of the columns of numbers: ``signals`` name
    those of the joints, or what these share before their number, and by default as far as that says
    what it is. An empty cell is refused as any other that is no number.
    """
    # here, as most logs are none
    import pyarrow as pa
    from pyarrow import parquet, types

    def load(label: str) -> np.ndarray:
        try:
            column = parquet.read_table(file, columns=[label]).column(0).to_numpy()
        except (pa.ArrowException, OSError) as error:
            raise _damaged(file, error) from None
        if len(column) != metadata.num_rows:
            raise _damaged(file, f"{len(column)} of {metadata.num_rows} rows of {label}")
        return column

    try:
        metadata = parquet.read_metadata(file)
        schema = metadata.schema.to_arrow_schema()
    except (pa.ArrowException, OSError) as error:
        raise _damaged(file, error) from None
    labels = [
        field.name
        for field in schema
        if types.is_integer(field.type) or types.is_floating(field.type)
    ]
    if len({*labels}) < len(labels):
        message = "two of its columns have one name; write it anew"
        raise RecordingError(message, file=file)
    return log_of(of_columns(file, labels, metadata.num_rows, load), options)


def _damaged(file: Path, error: Exception | str) -> RecordingError:
    reason = " ".join(str(error).split())[:200] or type(error).__name__
    return RecordingError(f"the file is damaged ({reason}); write it again", file=file)


FORMAT = Format("Parquet table of joints", Kind.JOINTS, read_parquet, begins(b"PAR1"))
