"""A table of numbers as any program writes it: the last line says how many cells a row has, the
rows begin at the first line whose cells hold numbers wherever the last lines do, and everything
above (settings, title, labels) is the header.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from pipeline.core.errors import ConfigError, RecordingError
from pipeline.formats.delimited import (
    MISSING,
    NUMBER,
    Text,
    cells_of,
    foreign,
    numbers_of,
    read_text,
)
from pipeline.formats.format import Format, Head, Kind
from pipeline.formats.units import bare, is_unit, unit_of

SPACE = " "  # as a separator: any number of blanks
SEPARATORS = (",", ";", "\t", SPACE)
SAMPLED = 40  # last lines that separate columns of numbers from others
REMARKS = 5  # lines of words below the rows, at most
HALF = 0.5  # of these lines hold a number in a column of numbers
TREES = (".json", ".jsonl", ".yaml", ".yml", ".xml")  # endings of files that hold no table
DATE = re.compile(r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}|\d{1,2}:\d{2}(:\d{2})?")


@dataclass(frozen=True)
class Sheet:
    """Rows of numbers, and the lines above them."""

    file: Path
    header: list[str]
    header_lines: list[int]
    rows: list[str]
    lines: list[int]  # (N,) places of the rows in the file, from 1
    separator: str
    decimal: str
    # blank_rows; cut_rows: a last row that is short or has no line end, which is left out
    counts: dict[str, int]
    numeric: list[int]  # columns of numbers, from 0

    @cached_property
    def last(self) -> list[str]:
        """Cells of the last row."""
        return cells_of(self.rows[-1], self.separator, file=self.file, number=self.lines[-1])

    @cached_property
    def above(self) -> list[list[str]]:
        """Cells of the lines of the header, without the mark of a comment before them."""
        return [_split(line.lstrip("#% "), self.separator) for line in self.header]

    @property
    def width(self) -> int:
        """Cells of a row, without those that are empty behind the last one with a label."""
        return max(len(self.labels), max(self.numeric, default=-1) + 1) or len(self.last)

    @property
    def labels(self) -> list[str]:
        """(width,) label of each column; empty where no line above the rows labels them."""
        return self._labels[0]

    @property
    def label_line(self) -> int:
        """Line of the labels, else of the first row."""
        return self._labels[1]

    @cached_property
    def _labels(self) -> tuple[list[str], int, list[str]]:
        """Labels, their line and the cells below them that state units."""
        units, width = [], len(self.last)
        for index, line in reversed([*enumerate(self.header_lines)]):
            # settings have no column under them
            cells = [cell for cell in self.above[index] if "=" not in cell]
            if not re.search(r"\w", "".join(cells)):
                continue
            if not units and index and len(cells) > 1 and all(map(is_unit, filter(None, cells))):
                units = cells
            elif max(self.numeric, default=-1) < (filled := _filled(cells)) <= width and (
                filled > 1 or width == 1
            ):
                return (cells + [""] * width)[: max(filled, _filled(self.last))], line, units
        return [], self.lines[0], units

    @property
    def settings(self) -> dict[str, str]:
        """Header statements ``name = value`` of a cell and ``name: value`` of a line."""
        stated = [cell.partition("=") for cells in self.above for cell in cells if "=" in cell]
        lines = [line.strip().strip('"') for line in self.header if ":" in line]
        stated += [line.partition(":") for line in lines if "=" not in line]
        return {name.strip(): value.strip() for name, _, value in stated}

    @property
    def angle_unit(self) -> str | None:
        """Unit of all angles, where a setting of OpenSim states it."""
        return {"yes": "deg", "no": "rad"}.get(self.settings.get("inDegrees", "").lower())

    def words(self, column: int) -> list[str]:
        """Return (N,) the cells of a column as they are written; empty where a row has too few."""
        return [(_split(row, self.separator)[column:] or [""])[0] for row in self.rows]

    def unit(self, column: int) -> str | None:
        """Return the unit that the header states for a ``column``, behind its label or below it."""
        labels, _, below = self._labels
        behind = unit_of(labels[column]) if column < len(labels) else None
        return behind or (below[column].strip("()[] ") if column < len(below) else None) or None

    @property
    def left_out(self) -> dict[str, str]:
        """Columns that hold no numbers, by label or number, and their content."""
        named = {}
        for column in {*range(max(len(self.labels), _filled(self.last)))} - {*self.numeric}:
            cell, label = ("".join(row[column : column + 1]) for row in (self.last, self.labels))
            what = "nothing" if cell in MISSING else "words"
            named[label or str(column)] = "dates or times" if DATE.search(cell) else what
        return named

    def columns(self, wanted: Mapping[str, str | int], key: str) -> dict[str, int]:
        """Return the column of each quantity, which ``wanted`` names by a label, with or without
        its unit, or by a number from 0; RecordingError with the ``key`` of the option for one that
        is not there or there twice, and for rows that lack a column of their labels.
        """
        self.require_cells()
        columns = {}
        for quantity, name in wanted.items():
            fits = [c for c, label in enumerate(self.labels) if name in (label, bare(label))]
            there = ", ".join(self.labels) or "; ".join(self.header)[:300] or "nothing"
            problem = f"{len(fits)} columns are labelled {name!r} for {quantity}; the labels above "
            problem += f"the numbers are {there}. A number from 0 names a column too"
            if isinstance(name, int):
                fits = [name] if 0 <= name < len(self.last) else []
                problem = f"{quantity} is column {name} (from 0) of rows of {self.width} cells"
            if len(fits) != 1:
                raise RecordingError(problem, file=self.file, line=self.label_line, key=key)
            columns[quantity] = fits[0]
        return columns

    def require_cells(self) -> None:
        """Raise RecordingError where the header labels more columns than the rows have."""
        labels = [cell for cell in (self.above or [[]])[-1] if cell and "=" not in cell]
        if (held := len(self.last)) < len(labels):
            message = f"the row has {held} cells under {len(labels)} labels, the last of which is "
            message += f"{labels[-1]!r}: a column is missing; export the log again, "
            message += "or take the label out"
            raise RecordingError(message, file=self.file, line=self.lines[0])

    def values(self, columns: list[int]) -> np.ndarray:
        """Return (N, len(columns)) the numbers; RecordingError with the line of no number."""
        form = {"separator": self.separator, "decimal": self.decimal}
        return numbers_of(self.rows, self.lines, columns, file=self.file, **form)


def read_sheet(
    file: Path, *, separator: str | None = None, decimal: str | None = None, key: str
) -> Sheet:
    """Return the table in ``file``, split by ``separator`` (comma, semicolon, tab or blank) with
    the given ``decimal`` mark, or as found.

    Raises RecordingError for a known format that is no table, for lines that are neither header nor
    rows, and, naming the options below ``key``, for points and commas in one table and for whole
    numbers between commas under no header, which may be halves of decimal fractions. Raises
    ConfigError for options that are no separator or mark.
    """
    known = separator in (None, *SEPARATORS) and decimal in (None, ".", ",")
    if not known or (decimal is not None and decimal == separator):
        message = f"separator {separator!r} and decimal {decimal!r}: one of comma, semicolon, tab, "
        raise ConfigError(f"{message}blank, and another of point, comma", key=key)
    return _sheet(read_text(file), Path(file), separator, decimal, key)


def _sheet(text: Text, file: Path, separator: str | None, decimal: str | None, key: str) -> Sheet:
    if other := foreign("\n".join(text.lines[:3]) + "\n"):
        raise RecordingError(f"this is a {other[0]}, which is not read: {other[1]}", file=file)
    places = [number for number, line in enumerate(text.lines, start=1) if line.strip(' \t,;"')]
    counts = {"blank_rows": len(text.lines) - len(places), "cut_rows": int(text.cut is not None)}
    if not places:
        raise RecordingError("the log holds no whole line; record again", file=file)
    lines = [text.lines[place - 1] for place in places]
    tail = lines[: -REMARKS - 1 : -1]
    likely = next((line for line in tail if _is_rowlike(line)), lines[-1])
    mark = separator or _separator_of(likely)
    if mark == SPACE:
        lines = [SPACE.join(line.lstrip("#%").split()) for line in lines]
    remarks = tail.index(likely)  # lines of words below the rows
    split = [_split(line, mark) for line in lines[len(lines) - remarks - SAMPLED :]]
    split = split[: len(split) - remarks]
    before = [len(cells) for cells in split[-3:-1]]
    if len({*before}) == 1 and len(split[-1]) < before[0] and _numbers(split[-2]):
        remarks, split = remarks + 1, split[:-1]
    if remarks:
        lines, places = lines[:-remarks], places[:-remarks]
        counts["cut_rows"] += remarks
    width, numeric, top = len(split[-1]), _numeric_columns(split), len(lines)
    if numeric:
        rows = (i for i, line in enumerate(lines) if _is_row(_split(line, mark), width, numeric))
        top = next(rows, top)
    if top + 1 < len(lines) and _counts_on(_split(lines[top], mark)):
        top += 1  # labels that are numbers, as pandas writes them
    above, below = (lines[:top], places[:top]), (lines[top:], places[top:])
    sheet = Sheet(file, *above, *below, mark, ".", counts, numeric)
    if not sheet.rows:
        return sheet
    _require_header(sheet, key)
    chosen = decimal or _decimal(sheet, key)
    if chosen is None and mark == "," and separator is None and width > 1 and not sheet.labels:
        sheet.require_cells()
        message = "whole numbers between commas, or decimal commas? Set separator and decimal, or "
        message += "save it with semicolons"
        raise RecordingError(message, file=file, line=places[top], key=key)
    return replace(sheet, decimal=chosen or ".")


def _is_rowlike(line: str) -> bool:
    """Return whether a line can be a row, whole or cut: it has not more words than numbers."""
    pieces = re.split(r'[,;\s"]+', line)
    words = [piece for piece in pieces if piece not in MISSING and re.search(r"^[^\W\d]", piece)]
    return len(words) <= _numbers(pieces) > 0


def _separator_of(line: str) -> str:
    if mark := next((mark for mark in ";\t" if mark in line), ""):
        return mark
    pieces = line.split()
    # commas that never touch a blank are decimal marks of cells that blanks keep apart
    spaced = len(pieces) > 1 and not any("," in (piece[0], piece[-1]) for piece in pieces)
    # a date and a time have a blank between them too
    numbers = _numbers(pieces) >= HALF * len(pieces) or "," not in line
    return SPACE if spaced and numbers and '"' not in line else ","


def _split(line: str, mark: str) -> list[str]:
    """Return the cells of a line, roughly: quotes that do not close are the reader's to refuse."""
    if '"' in line:
        try:
            return cells_of(line, mark, file=Path(), number=0)
        except RecordingError:
            pass
    return [cell.strip().strip('"') for cell in line.split(mark)]


def _filled(cells: list[str]) -> int:
    """Return the number of cells up to the last one with content."""
    return max((n for n, cell in enumerate(cells, start=1) if cell), default=0)


def _is_number(cell: str) -> bool:
    return NUMBER.fullmatch(cell.replace(",", ".")) is not None


def _numbers(cells: list[str]) -> int:
    return sum(map(_is_number, cells))


def _numeric_columns(split: list[list[str]]) -> list[int]:
    """Return the columns that hold numbers in at least half of the last lines of one width, from
    the last line up to one that holds none.
    """
    alike = []
    for cells in reversed(split):
        if len(cells) == len(split[-1]):
            if not any(_is_number(cell) or cell in MISSING[1:] for cell in cells):
                break
            alike.append(cells)
    shares = [_numbers([*column]) / len(alike) for column in zip(*alike, strict=True)]
    return [column for column, share in enumerate(shares) if share >= HALF]


def _is_row(cells: list[str], width: int, numeric: list[int]) -> bool:
    held = [cells[column] for column in numeric] if len(cells) == width else []
    return _numbers(held) > 0 and all(_is_number(cell) or cell in MISSING for cell in held)


def _counts_on(cells: list[str]) -> bool:
    """Return whether cells are labels that are numbers: nothing or a word, then 0, 1, 2 …"""
    if len(cells) < 3 or _is_number(cells[0]):
        return False
    numbers = [int(cell) for cell in cells[1:] if re.fullmatch(r"\d{1,4}", cell)]
    return bool(numbers) and numbers == [*range(numbers[0], numbers[0] + len(cells) - 1)]


def _require_header(sheet: Sheet, key: str) -> None:
    """Raise RecordingError for a line of the header that is a row, damaged or of another form."""
    for line, place in zip(sheet.header, sheet.header_lines, strict=True):
        for other in SEPARATORS:
            cells = line.split() if other == SPACE else _split(line, other)
            filled = [cell for cell in cells if cell]
            if len(filled) > 2 and _numbers(filled) == len(filled) and not _counts_on(cells):
                message = f"numbers in another form than below, or a damaged row: {line[:80]!r}"
                raise RecordingError(message, file=sheet.file, line=place, key=key)
    cells = sheet.above[-1] if sheet.header else []
    numbers = _numbers([cells[column] for column in sheet.numeric if column < len(cells)])
    whole = len(cells) == len(sheet.last) or numbers == len(cells)
    if numbers and whole and not _counts_on(cells):
        message = f"words and numbers in one line: a damaged row, or labels? {sheet.header[-1]!r}"
        raise RecordingError(message[:160], file=sheet.file, line=sheet.header_lines[-1])


def _decimal(sheet: Sheet, key: str) -> str | None:
    """Return the decimal mark of the columns of numbers, None where they hold none; RecordingError
    at the first row with the other one.
    """
    rows = sheet.rows
    held = [sign for sign in ".," if sign != sheet.separator and any(sign in row for row in rows)]
    if len(held) < 2:
        return held[0] if held else None
    proven = None
    for row, line in zip(rows, sheet.lines, strict=True):
        cells = _split(row, sheet.separator)
        numbers = "".join(cells[column] for column in sheet.numeric if column < len(cells))
        for sign in filter(numbers.__contains__, ".,"):
            if proven not in (None, sign):
                message = "decimal points and decimal commas in one table; mend it, or set decimal"
                raise RecordingError(message, file=sheet.file, line=line, key=key)
            proven = sign
    return proven


def _begins(head: Head) -> bool:
    """Return whether the reader finds rows in the beginning, or refuses an option or a line."""
    if head.text is None or not head.lines or head.suffix in TREES or foreign(head.text):
        return False
    *lines, last = head.text.split("\n")
    try:
        sheet = _sheet(Text(lines or [last], None), head.file, None, None, "")
    except RecordingError as error:
        return "key" in error.evidence or "line" in error.evidence
    if len(sheet.rows) < 2:
        return bool(sheet.rows and sheet.labels) and len(sheet.numeric) == sheet.width
    return bool(sheet.labels) or len(sheet.numeric) >= min(2, len(sheet.last))


FORMAT = Format("table of numbers", Kind.TABLE, read_sheet, _begins, fallback=True)
