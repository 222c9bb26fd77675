"""The table of a whole survey, which may be too long for memory, written group by group."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import closing
from pathlib import Path

import pandas as pd
import pyarrow
from pyarrow.parquet import ParquetWriter

GROUP = 100_000  # rows of a group of the file at least: what is in memory at once


def write(tables: Iterable[pd.DataFrame], folder: Path) -> None:
    """Write ``tables``, each of which keeps the contract, as one, group by group; equal tables give
    equal bytes.
    """
    groups = _groups(tables)
    first = pyarrow.Table.from_pandas(next(groups), preserve_index=False)
    with closing(
        ParquetWriter(folder / "survey.parquet", first.schema, compression="zstd")
    ) as file:
        file.write_table(first)
        for group in groups:
            file.write_table(
                pyarrow.Table.from_pandas(group, schema=first.schema, preserve_index=False)
            )


def _groups(tables: Iterable[pd.DataFrame]) -> Iterator[pd.DataFrame]:
    """``tables`` joined, as many at a time as make up a group."""
    waiting, rows = [], 0
    for table in tables:
        waiting.append(table)
        rows += len(table)
        if rows >= GROUP:
            yield pd.concat(waiting, ignore_index=True)
            waiting, rows = [], 0
    if waiting:
        yield pd.concat(waiting, ignore_index=True)
