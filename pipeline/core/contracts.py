"""Tables and numbers between stages, checked against their declarations in tables.yaml."""

import errno
import json
import math
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.core.columns import columns as family_columns
from pipeline.core.columns import members
from pipeline.core.errors import ContractError
from pipeline.core.typed_yaml import read_yaml

TABLES = Path(__file__).parents[1] / "tables.yaml"
DECLARATION = re.compile(
    r"(?P<kind>real|log|count|flag|text)"
    r"(?: \((?P<among>[^)]*)\))?(?: (?P<low>[^ .]+)\.\.(?P<high>[^ ]*))?(?P<gaps> gaps)?"
    r"(?P<optional> optional)? \| .+",
)
TYPES = {"real": "float64", "log": "float64", "count": "int64", "flag": "bool"}


class Column(NamedTuple):
    """Declaration of a column: ``gaps`` allows missing values, ``optional`` a missing column."""

    kind: str
    low: float
    high: float
    among: tuple[str, ...]
    gaps: bool
    optional: bool

    @classmethod
    def parse(cls, text: str) -> "Column":
        """Return the column that ``text`` declares."""
        if (parts := DECLARATION.fullmatch(text)) is None:
            raise ValueError(f"not the declaration of a column: {text!r}")
        kind = parts["kind"]
        least = 0 if kind == "count" else -np.inf
        return cls(
            kind=kind,
            low=float(parts["low"] or least),
            high=float(parts["high"] or np.inf),
            among=tuple(re.findall("[^, ][^,]*", parts["among"] or "")),
            gaps=kind == "log" or parts["gaps"] is not None,
            optional=parts["optional"] is not None,
        )

    def fault(self, values: pd.Series) -> str | None:
        """Return the first rule that ``values`` break, with the first value that breaks it."""
        if self.kind == "text":
            if pd.api.types.infer_dtype(values) not in {"string", "empty"}:
                return "must be text"
            rules = {"must have no gaps": values.isna()}
            if self.among:
                rule = f"must be one of {', '.join(self.among)}"
                rules[rule] = ~values.isin(self.among)
        elif str(values.dtype) != TYPES[self.kind]:
            return f"must be {TYPES[self.kind]}, not {values.dtype}"
        else:
            numbers = values.to_numpy()
            rules = {}
            if not self.gaps:
                rules["must have no gaps"] = np.isnan(numbers)
            if self.kind == "real":
                rules["must be finite"] = np.isinf(numbers)
            rules["must not be plus infinity"] = numbers == np.inf
            rules[f"must be at least {self.low:g}"] = numbers < self.low
            rules[f"must be at most {self.high:g}"] = numbers > self.high
        for rule, broken in rules.items():
            if np.any(broken):
                return f"{rule}, not {values.to_numpy()[np.argmax(broken)]}"
        return None


@cache
def read_declarations(file: Path = TABLES) -> dict[str, dict[str, Column]]:
    """Return the columns by name of every table of ``file``; ``*`` names a family."""
    tables = {}
    for name, lines in read_yaml(file).items():
        if name.startswith("."):
            continue
        columns = {column: Column.parse(text) for column, text in lines.items()}
        tables[name] = columns
    return tables


def expand_families(
    declaration: dict[str, Column],
    present: list[str],
) -> dict[str, Column]:
    """Return the ``declaration`` with each family replaced by its members among ``present``."""
    columns = {}
    for name, column in declaration.items():
        pattern = re.escape(name).replace(r"\*", "[^:]+")
        family = [label for label in present if re.fullmatch(pattern, str(label))]
        if not family and not column.optional:
            family = [name]
        columns |= dict.fromkeys(family, column)
    return columns


def _require_fit(
    table: pd.DataFrame,
    name: str,
    columns: dict[str, Column],
    file: Path,
) -> None:
    """Raise ContractError with the file and the column of the first fault."""
    faults: dict[str, str | None] = {}
    for column in columns:
        if column not in table.columns:
            faults[column] = "is missing"
    for column in table.columns:
        if column not in columns:
            faults[column] = "is not declared"
    if not faults:
        faults = {column: rule.fault(table[column]) for column, rule in columns.items()}
    for column, fault in faults.items():
        if fault:
            message = f"table {name!r} breaks its contract: {fault}"
            raise ContractError(message, file=file, column=column)


def write(
    table: pd.DataFrame,
    name: str,
    folder: Path,
    declarations: Path = TABLES,
) -> None:
    """Check ``table`` and write ``folder/name.parquet``, with equal bytes for equal tables."""
    file = Path(folder) / f"{name}.parquet"
    columns = expand_families(
        read_declarations(declarations)[name],
        list(table.columns),
    )
    undeclared = [column for column in table.columns if column not in columns]
    present = [column for column in columns if column in table.columns]
    table = table[present + undeclared].reset_index(drop=True)
    for column in present:
        # integers of any width; numbers that would be rounded are refused below
        if columns[column].kind == "count" and pd.api.types.is_integer_dtype(
            table[column],
        ):
            table[column] = table[column].astype("int64")
    _require_fit(table, name, columns, file)
    with naming(file):
        table.to_parquet(file, index=False, compression="zstd")


def read(name: str, folder: Path, declarations: Path = TABLES) -> pd.DataFrame:
    """Read and check ``folder/name.parquet``; ContractError names the file where it is missing."""
    file = Path(folder) / f"{name}.parquet"
    if not file.is_file():
        absent = "the dataset lacks its instrument, or its stage has not run; run `dvc repro`"
        raise ContractError(f"there is no table {name!r}: {absent}", file=file)
    from pyarrow.parquet import ParquetFile

    try:
        # pandas' own reader imports modules for folders of such files, which takes time
        with ParquetFile(file) as stored:
            table = stored.read(use_pandas_metadata=True).to_pandas()
    except (OSError, ValueError) as error:
        message = f"table {name!r} cannot be read ({error}); run its stage again"
        raise ContractError(message, file=file) from None
    columns = expand_families(read_declarations(declarations)[name], list(table))
    _require_fit(table, name, columns, file)
    return table


def exists(name: str, folder: Path) -> bool:
    """Return True if a stage has written table ``name``; False if its instrument is missing."""
    return (Path(folder) / f"{name}.parquet").is_file()


def write_metrics(metrics: dict, file: Path) -> None:
    """Write numbers as JSON in full precision; ContractError for one that is not finite."""
    if broken := [name for name, value in metrics.items() if not math.isfinite(value)]:
        raise ContractError(f"{', '.join(broken)} not finite", file=file)
    text = json.dumps(metrics, indent=2, default=lambda number: number.item())
    write_text(f"{text}\n", file)


def write_text(text: str, file: Path) -> None:
    """Write ``file`` completely or not at all, and its folder."""
    file.parent.mkdir(parents=True, exist_ok=True)
    partial = _partial(file)
    with naming(file):
        partial.write_text(text, encoding="utf-8")
        partial.replace(file)


@contextmanager
def replacing(folder: Path) -> Iterator[Path]:
    """Yield an empty folder; it replaces ``folder`` on success, else it is removed. Raises
    ContractError where ``folder`` is a link: what lies there may not be the stage's.
    """
    folder = Path(folder)
    if folder.is_symlink():
        message = f"the output folder is a link to {folder.readlink()}, whose content the stage "
        message += "would replace: remove the link, and run it again"
        raise ContractError(message, file=folder)
    partial = _partial(folder)
    partial.mkdir(parents=True)
    try:
        with naming(folder):
            yield partial
        if folder.exists():
            shutil.rmtree(folder)
        partial.rename(folder)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


@contextmanager
def naming(place: Path) -> Iterator[None]:
    """Name ``place`` in an OSError of the block without a file name, as of a full disk."""
    try:
        yield
    except OSError as error:
        # by NumPy, which does not state the system's reason
        if "requested and" in str(error):
            error.errno = errno.ENOSPC
        if error.errno and error.filename is None:
            error.filename = os.fspath(place)
        raise


def _partial(place: Path) -> Path:
    """Path of this process's unfinished ``place``; removes what ended processes have left."""
    for left in place.parent.glob(f".{place.name}.*.partial"):
        process = left.name.split(".")[-2]
        if process != str(os.getpid()) and Path("/proc", process).exists():
            continue
        if left.is_dir():
            shutil.rmtree(left)
        else:
            left.unlink(missing_ok=True)
    return place.with_name(f".{place.name}.{os.getpid()}.partial")


def stacked(
    table: pd.DataFrame,
    columns: str | list[str],
) -> tuple[list[str], np.ndarray]:
    """Return the names of the takes (N,) and the ``columns``, a list or a family, as (N, K, n).

    Raises ContractError where the takes have unequal numbers of consecutive rows.
    """
    if isinstance(columns, str):
        columns = family_columns(columns, members(table, columns))
    codes, names = pd.factorize(table["take"])
    count = len(names)
    rows_of_take = len(table) // max(count, 1)
    consecutive = np.repeat(np.arange(count), rows_of_take)
    if not count or not np.array_equal(codes, consecutive):
        lengths = table["take"].value_counts().to_dict()
        message = "every take must have the same number of consecutive rows"
        raise ContractError(message, lengths=lengths)
    rows = table[columns].to_numpy()
    return list(names), rows.reshape(count, -1, len(columns))
