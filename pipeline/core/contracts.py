"""Tables and numbers between stages, checked on write and on read against their declarations in
:mod:`pipeline.core.tables`.
"""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.core.columns import columns as family_columns
from pipeline.core.columns import members
from pipeline.core.errors import ContractError
from pipeline.core.tables import PAPER, Column, declared, expanded


def _check(table: pd.DataFrame, name: str, columns: dict[str, Column], file: Path) -> pd.DataFrame:
    for fault, column in _faults(table, columns):
        raise ContractError(
            f"table {name!r} breaks its contract: {fault}", file=file, column=column
        )
    return table


def _faults(table: pd.DataFrame, columns: dict[str, Column]) -> Iterator[tuple[str, str]]:
    """What breaks the declaration, and in which column."""
    yield from (("is missing", name) for name in columns if name not in table.columns)
    yield from (("is not declared", name) for name in table.columns if name not in columns)
    if list(table.columns) != list(columns):
        yield "the columns are not in the order declared", table.columns[0]
    for name, column in columns.items():
        if fault := column.fault(table[name]):
            yield fault, name


def write(table: pd.DataFrame, name: str, folder: Path, declarations: Path = PAPER) -> None:
    """Write ``table`` as ``folder/name.parquet`` after checking it; the same table gives the same
    bytes. ``declarations`` is the file that declares it.
    """
    file = Path(folder) / f"{name}.parquet"
    columns = expanded(declared(declarations)[name], list(table.columns))
    unknown = [column for column in table.columns if column not in columns]
    known = [column for column in columns if column in table.columns]
    table = table[known + unknown].reset_index(drop=True)
    for column, definition in columns.items():
        # counts of any width, but never what would have to be rounded
        whole = column in table.columns and pd.api.types.is_integer_dtype(table[column])
        if whole and definition.kind == "count":
            table[column] = table[column].astype("int64")
    _check(table, name, columns, file).to_parquet(file, index=False, compression="zstd")


def read(name: str, folder: Path, declarations: Path = PAPER) -> pd.DataFrame:
    """Read and check ``folder/name.parquet``; ContractError names the stage's folder where it is
    missing.
    """
    file = Path(folder) / f"{name}.parquet"
    if not file.is_file():
        raise ContractError(
            f"there is no table {name!r}: the dataset lacks the instrument for it, or its stage "
            "has not run",
            file=file,
        )
    from pyarrow.parquet import ParquetFile

    try:
        # pandas' own reader imports what a folder of such files would need
        with ParquetFile(file) as stored:
            table = stored.read(use_pandas_metadata=True).to_pandas()
    except (OSError, ValueError) as error:
        raise ContractError(
            f"table {name!r} cannot be read ({error}); run its stage again", file=file
        ) from None
    columns = expanded(declared(declarations)[name], list(table.columns))
    return _check(table, name, columns, file)


def exists(name: str, folder: Path) -> bool:
    """Whether the stage that owns ``folder`` wrote table ``name`` (it does not where the dataset
    lacks the instrument).
    """
    return (Path(folder) / f"{name}.parquet").is_file()


def write_metrics(metrics: dict, file: Path) -> None:
    """Write numbers for ``dvc metrics`` as JSON, in full precision; ContractError for one that is
    not finite.
    """
    plain = {
        name: value.item() if isinstance(value, np.generic) else value
        for name, value in metrics.items()
    }
    if broken := [name for name, value in plain.items() if not math.isfinite(value)]:
        raise ContractError(f"{', '.join(broken)} not finite", file=file)
    write_text(json.dumps(plain, indent=2) + "\n", file)


def write_text(text: str, file: Path) -> None:
    """Write ``file`` whole or not at all, its folder with it."""
    file.parent.mkdir(parents=True, exist_ok=True)
    partial = file.with_name(f".{file.name}.partial")
    partial.write_text(text, encoding="utf-8")
    partial.replace(file)


@contextmanager
def replacing(folder: Path) -> Iterator[Path]:
    """A fresh folder to write into that takes the place of ``folder`` when the block ends well, and
    vanishes when it does not.
    """
    folder = Path(folder)
    partial = folder.with_name(f".{folder.name}.partial")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    try:
        yield partial
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise
    if folder.exists():
        shutil.rmtree(folder)
    partial.rename(folder)


def stacked(
    table: pd.DataFrame, columns: str | list[str], *, by: str = "take"
) -> tuple[list[str], np.ndarray]:
    """Names (N,) and values (N, K, n) of a table that holds the same K rows for each value of
    ``by``, in the order of the table; ``columns`` are named, or a family.
    """
    if isinstance(columns, str):
        columns = family_columns(columns, members(table, columns))
    codes, names = pd.factorize(table[by])
    values = table[columns].to_numpy()
    if (
        not len(names)
        or len(values) % len(names)
        or np.any(codes.reshape(len(names), -1) != np.arange(len(names))[:, None])
    ):
        raise ContractError(
            f"not every {by} has the same number of rows, one after the other",
            lengths=table[by].value_counts().to_dict(),
        )
    return list(names), values.reshape(len(names), -1, len(columns))
