"""Delimited text as instruments write it: whole lines, and the numbers between the separators."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.core.bounds import read_whole
from pipeline.core.errors import RecordingError

# in each of its ways to go on the next letter differs, so that no text takes it long
NUMBER = re.compile(r"\s*[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?\s*")
GREATEST = 1e20  # of what is measured, and beyond any time in ns: squares of it stay finite
# a blank cell and what C runtimes print for a sample that is not there
MISSING = ("", "NaN", "nan", "NAN", "-nan(ind)", "1.#QNAN", "-1.#IND")


@dataclass(frozen=True)
class Text:
    """The lines of a file that have their line end, and what follows the last line end (None where
    nothing does).

    A file cut at any byte keeps ``lines`` true: only ``cut`` can hold a number that lost digits, so
    no reader takes a number from it.
    """

    lines: list[str]
    cut: str | None


def read_text(file: Path) -> Text:
    """Lines of ``file`` without their ends (CRLF, LF or CR) and a byte-order mark; UTF-8, else the
    single bytes of a PC's code page.

    Raises RecordingError where the file cannot be read, is empty or is not text.
    """
    try:
        content = read_whole(file)
    except OSError as error:
        raise RecordingError(f"the file cannot be read ({error.strerror})", file=file) from None
    if not content.strip():
        raise RecordingError("the file is empty; export or copy it again", file=file)
    if b"\0" in content:
        raise RecordingError(
            "this is not plain text (it holds zero bytes); export it as UTF-8 text", file=file
        )
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    *lines, last = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    return Text(lines, last or None)


def cells_of(line: str, separator: str, *, file: Path, number: int) -> list[str]:
    """The cells of one line, unquoted and stripped; RecordingError at line ``number`` where its
    quotes do not close.
    """
    try:
        return [
            cell.strip() for cell in next(csv.reader([line], delimiter=separator, strict=True), [])
        ]
    except csv.Error as error:
        raise RecordingError(
            f"the cells cannot be told apart ({error})", file=file, line=number
        ) from None


def is_blank(line: str, separator: str) -> bool:
    """Whether a line holds no cell with content: nothing, or separators alone."""
    return not line.replace(separator, "").strip()


def numbers_of(
    rows: list[str],
    line_numbers: list[int],
    columns: list[int],
    *,
    file: Path,
    separator: str = ",",
    decimal: str = ".",
    gaps: bool = False,
) -> np.ndarray:
    """(N, len(columns)) float64 of N rows in the order of ``columns``, each correctly rounded; NaN
    where ``gaps`` and a cell is missing.

    ``line_numbers`` (N) are the rows' places in the file. Cells of other columns may hold anything.
    Raises RecordingError with the line for a row with more or fewer cells than the first one, a
    cell that is not a number, one beyond GREATEST, and a missing one unless ``gaps``.
    """
    width = rows[0].count(separator)
    for row, number in zip(rows, line_numbers, strict=True):
        if row.count(separator) != width:
            # a separator within quotes separates nothing
            held, first = (
                len(cells_of(line, separator, file=file, number=number)) for line in (row, rows[0])
            )
            if held != first:
                raise RecordingError(
                    f"the row has {held} cells where the first has {first}: truncated or damaged",
                    file=file,
                    line=number,
                )
    try:
        table = pd.read_csv(
            io.StringIO("\n".join(rows)),
            sep=separator,
            decimal=decimal,
            header=None,
            usecols=sorted(set(columns)),
            dtype="float64",
            keep_default_na=False,
            na_values=list(MISSING),
            skipinitialspace=True,
            skip_blank_lines=False,
        )
        values = table[columns].to_numpy()
    except ValueError:
        values = np.full((len(rows), len(columns)), np.inf)
    wrong = np.abs(values) > GREATEST
    if len(values) != len(rows) or wrong.any() or (not gaps and np.isnan(values).any()):
        raise _first_fault(
            rows, line_numbers, columns, file=file, separator=separator, decimal=decimal, gaps=gaps
        )
    return values


def _first_fault(
    rows: list[str],
    line_numbers: list[int],
    columns: list[int],
    *,
    file: Path,
    separator: str,
    decimal: str,
    gaps: bool,
) -> RecordingError:
    for row, number in zip(rows, line_numbers, strict=True):
        cells = cells_of(row, separator, file=file, number=number)
        for column in columns:
            cell = cells[column] if column < len(cells) else ""
            if cell in MISSING:
                if not gaps:
                    return RecordingError(
                        f"column {column + 1} has no number", file=file, line=number
                    )
                continue
            plain = cell if decimal == "." else cell.replace(".", "?").replace(decimal, ".")
            if not NUMBER.fullmatch(plain):
                fault = "not a finite number"
            elif abs(float(plain)) > GREATEST:
                fault = f"beyond {GREATEST:g}, which nothing measures"
            else:
                continue
            return RecordingError(
                f"column {column + 1} holds {cell[:80]!r}, {fault}", file=file, line=number
            )
    return RecordingError("the cells cannot be told apart", file=file)
