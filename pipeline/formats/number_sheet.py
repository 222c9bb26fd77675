"""A table of numbers as any program writes it: header or none, one of several separators, decimal
point or comma.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.core.errors import ConfigError, RecordingError
from pipeline.formats.delimited import MISSING, NUMBER, cells_of, numbers_of, read_text
from pipeline.formats.format import Format, Head, Kind
from pipeline.formats.labels import bare

SPACE = " "  # as a separator: any run of blanks
SEPARATORS = (",", ";", "\t", SPACE)
HALF = 0.5  # of a line's cells are numbers: a row, even where others are damaged or hold words


@dataclass(frozen=True)
class Sheet:
    """The lines above the first number, and the rows of numbers below them with their places in the
    file.
    """

    file: Path
    header: list[str]
    header_lines: list[int]
    rows: list[str]
    lines: list[int]  # (N,) from 1
    separator: str
    decimal: str
    # blank_rows; cut_rows: a last row that is short or has no line end, which is left out
    counts: dict[str, int]

    @property
    def width(self) -> int:
        """Cells of the first row."""
        return self.rows[0].count(self.separator) + 1

    def header_cells(self, index: int) -> list[str]:
        """The cells of a line of the header, without the mark of a comment before them."""
        line = self.header[index].lstrip("#% ")
        return cells_of(line, self.separator, file=self.file, number=self.header_lines[index])

    def label_row(self, names: list[str]) -> int:
        """Index of the header's line that holds all of ``names``, exactly or before a unit in
        brackets.

        Raises RecordingError with what there is where no line holds them.
        """
        for index in range(len(self.header)):
            cells = self.header_cells(index)
            if not set(names) - {*cells, *map(bare, cells)}:
                return index
        shown = "; ".join(self.header) or "nothing"
        raise RecordingError(
            f"no line above the numbers names {', '.join(names)}; there is {shown[:300]}",
            file=self.file,
            line=1,
        )

    def require_cells(self) -> None:
        """RecordingError where the line above the rows labels more columns than these have: which
        of them is missing, nobody can tell.
        """
        cells = self.header_cells(len(self.header) - 1) if self.header else []
        labels = [cell for cell in cells if cell and "=" not in cell]  # settings have no column
        if len(labels) > self.width:
            raise RecordingError(
                f"the row has {self.width} cells under {len(labels)} labels, the last of which is "
                f"{labels[-1]!r}: a column is missing; export the log again",
                file=self.file,
                line=self.lines[0],
            )

    def values(self, columns: list[int]) -> np.ndarray:
        """(N, len(columns)) the numbers of the columns, 0 being the first; RecordingError with the
        line for a cell that is none.
        """
        return numbers_of(
            self.rows,
            self.lines,
            columns,
            file=self.file,
            separator=self.separator,
            decimal=self.decimal,
        )


def read_sheet(
    file: Path, *, separator: str | None = None, decimal: str | None = None, key: str
) -> Sheet:
    """The table in ``file``, split by ``separator`` (comma, semicolon, tab or blanks) with the
    given ``decimal`` mark, or as found.

    Found means: the rows allow one reading alone. Raises RecordingError that names the options
    below ``key`` where they do not: points and commas in one table, or whole numbers between commas
    under no header, which may be halves of decimal fractions. Raises ConfigError for options that
    are no separator or mark.
    """
    if (
        separator not in (None, *SEPARATORS)
        or decimal not in (None, ".", ",")
        or (decimal is not None and decimal == separator)
    ):
        message = (
            f"separator {separator!r} and decimal {decimal!r}: one of comma, "
            "semicolon, tab, blank, and another of point, comma"
        )
        raise ConfigError(message, key=key)
    text = read_text(file)
    places = [number for number, line in enumerate(text.lines, start=1) if line.strip(' \t,;"')]
    counts = {"blank_rows": len(text.lines) - len(places), "cut_rows": int(text.cut is not None)}
    if not places:
        raise RecordingError("the log holds no whole line; record again", file=file)
    mark = separator or _separator(text.lines[places[-1] - 1])
    lines = [text.lines[place - 1] for place in places]
    top = next(
        (index for index, line in enumerate(lines) if _numbers_in(line, mark) >= HALF), len(lines)
    )
    rows, row_lines = lines[top:], places[top:]
    for line, place in zip(lines[:top], places, strict=False):
        if rows and _cells(line, mark) == _cells(rows[0], mark) and _numbers_in(line, mark):
            raise RecordingError(
                f"words and numbers in one line: a damaged row, or labels? {line[:80]!r}",
                file=file,
                line=place,
            )
        if any(_cells(line, other) > 2 and _numbers_in(line, other) == 1 for other in SEPARATORS):
            raise RecordingError(
                f"numbers in another form than below: {line[:80]!r}", file=file, line=place, key=key
            )
    if mark == SPACE:
        lines, rows, mark = (
            ["\t".join(line.lstrip("#%").split()) for line in lines],
            ["\t".join(row.split()) for row in rows],
            "\t",
        )
    if len(rows) > 1 and rows[-1].count(mark) < rows[0].count(mark):
        rows, row_lines = rows[:-1], row_lines[:-1]
        counts["cut_rows"] += 1
    sheet = Sheet(
        Path(file), lines[:top], places[:top], rows, row_lines, mark, decimal or ".", counts
    )
    if decimal is not None or not rows:
        return sheet
    chosen = _decimal(rows, row_lines, mark, file, key)
    if chosen is None and mark == "," and separator is None and sheet.width > 1:
        if not any(len(sheet.header_cells(index)) >= sheet.width for index in range(top)):
            message = (
                "whole numbers between commas, or decimal commas? Set separator and "
                "decimal, or save it with semicolons"
            )
            raise RecordingError(message, file=file, line=row_lines[0], key=key)
    return Sheet(
        Path(file), lines[:top], places[:top], rows, row_lines, mark, chosen or ".", counts
    )


def _separator(line: str) -> str:
    for mark in ";\t":
        if mark in line:
            return mark
    pieces = line.split()
    # commas that never touch a blank are decimal marks of cells that blanks keep apart
    spaced = len(pieces) > 1 and not any(
        piece.startswith(",") or piece.endswith(",") for piece in pieces
    )
    # a date and a time have a blank between them too
    numbers = _numbers_in(line, SPACE) >= HALF or "," not in line
    return SPACE if spaced and numbers and '"' not in line else ","


def _cells(line: str, separator: str) -> int:
    return len(line.split() if separator == SPACE else line.split(separator))


def _numbers_in(line: str, separator: str) -> float:
    """The share of numbers among the cells with content."""
    cells = line.split() if separator == SPACE else line.split(separator)
    full = [cell for cell in (cell.strip().strip('"').strip() for cell in cells) if cell]
    return sum(
        NUMBER.fullmatch(cell.replace(",", ".")) is not None or cell in MISSING for cell in full
    ) / max(len(full), 1)


def _decimal(rows: list[str], lines: list[int], separator: str, file: Path, key: str) -> str | None:
    """The decimal mark of the rows, None where they hold none; RecordingError at the first row with
    the other one.
    """
    if separator == ",":
        return "." if any("." in row for row in rows) else None
    proven = None
    for row, line in zip(rows, lines, strict=True):
        for mark in ".,":
            if mark in row:
                if proven not in (None, mark):
                    message = (
                        "decimal points and decimal commas in one table; mend it, or "
                        "set decimal where one mark is not a decimal"
                    )
                    raise RecordingError(message, file=file, line=line, key=key)
                proven = mark
    return proven


def _begins(head: Head) -> bool:
    """Whether most of the last lines hold nothing but numbers, two or more of them."""
    lines = [
        line for line in head.lines[:-1] or head.lines if not line.lstrip().startswith(("#", "%"))
    ][-20:]
    rows = [re.findall(r"[^\s,;]+", line.replace('"', " ")) for line in lines]
    numeric = [
        len(row) > 1 and all(NUMBER.fullmatch(cell) or cell.lower() == "nan" for cell in row)
        for row in rows
    ]
    return sum(numeric) > len(lines) / 2


FORMAT = Format("table of numbers", Kind.TABLE, read_sheet, _begins, fallback=True)
