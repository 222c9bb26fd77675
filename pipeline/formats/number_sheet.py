"""A table of numbers as any program writes it: the last line says how many cells a row has, the
rows begin at the first line whose cells hold numbers wherever the last lines do, and everything
above (settings, title, labels, units) is the header.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
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
TREES = (".json", ".jsonl", ".yaml", ".yml", ".xml")  # endings of files that hold no table
DATE = re.compile(r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}|\d{1,2}:\d{2}(:\d{2})?")


@dataclass(frozen=True)
class Sheet:
    """Rows of numbers, and the lines above them."""

    file: Path
    header: list[str]
    labels: list[str]  # (width,) of the columns; empty where no line above the rows labels them
    units: list[str]  # cells of a line of units below the labels
    label_line: int  # of the labels, else of the first row
    rows: list[str]
    lines: list[int]  # (N,) places of the rows in the file, from 1
    separator: str
    decimal: str
    numeric: list[int]  # columns of numbers, from 0
    # blank_rows; cut_rows: a last row that is short or has no line end, which is left out
    counts: dict[str, int]

    @property
    def width(self) -> int:
        """Cells of a row, without those that are empty behind the last one with a label."""
        return max(len(self.labels), self.numeric[-1] + 1)

    @cached_property
    def last(self) -> list[str]:
        """Cells of the last row."""
        return _split(self.rows[-1], self.separator)

    @property
    def settings(self) -> dict[str, str]:
        """Header statements ``name = value`` of a cell and ``name: value`` of a line."""
        cells = [
            cell for line in self.header for cell in _split(line.lstrip("#% "), self.separator)
        ]
        stated = [cell.partition("=") for cell in cells if "=" in cell]
        lines = [line.strip().strip('"') for line in self.header if "=" not in line]
        stated += [line.partition(":") for line in lines if ":" in line]
        return {name.strip(): value.strip() for name, _, value in stated}

    @property
    def angle_unit(self) -> str | None:
        """Unit of all angles, where a setting of OpenSim states it."""
        return {"yes": "deg", "no": "rad"}.get(self.settings.get("inDegrees", "").lower())

    @property
    def left_out(self) -> dict[str, str]:
        """Columns that hold no numbers, by label or number, and their content."""
        named = {}
        for column in {*range(max(len(self.labels), _filled(self.last)))} - {*self.numeric}:
            cell, label = ("".join(row[column : column + 1]) for row in (self.last, self.labels))
            what = "nothing" if cell in MISSING else "words"
            named[label or str(column)] = "dates or times" if DATE.search(cell) else what
        return named

    def words(self, column: int) -> list[str]:
        """Return (N,) the cells of a column as they are written; empty where a row has too few."""
        return [(_split(row, self.separator)[column:] or [""])[0] for row in self.rows]

    def unit(self, column: int) -> str | None:
        """Return the unit that the header states for a ``column``, behind its label or below it."""
        behind = unit_of("".join(self.labels[column : column + 1]))
        return behind or "".join(self.units[column : column + 1]).strip("()[] ") or None

    def columns(self, wanted: Mapping[str, str | int], key: str) -> dict[str, int]:
        """Return the column of each quantity of ``wanted``, by its label, with or without a unit,
        or by its number from 0; RecordingError with the option's ``key`` for none and for two.
        """
        columns = {}
        for quantity, name in wanted.items():
            fits = [c for c, label in enumerate(self.labels) if name in (label, bare(label))]
            if isinstance(name, int):
                fits = [name] if 0 <= name < len(self.last) else []
            if len(fits) != 1:
                there = ", ".join(self.labels) or "; ".join(self.header)[:300] or "nothing"
                message = f"{quantity}: {len(fits)} columns have the label or number (from 0) "
                message += f"{name!r}, one is required; the labels above the {self.width} columns "
                message += f"are {there}"
                raise RecordingError(message, file=self.file, line=self.label_line, key=key)
            columns[quantity] = fits[0]
        return columns

    def values(self, columns: list[int]) -> np.ndarray:
        """Return (N, len(columns)) the numbers; RecordingError with the line of no number."""
        form = {"separator": self.separator, "decimal": self.decimal}
        return numbers_of(self.rows, self.lines, columns, file=self.file, **form)


def read_sheet(
    file: Path, *, separator: str | None = None, decimal: str | None = None, key: str = ""
) -> Sheet:
    """Return the table in ``file``, split by ``separator`` (comma, semicolon, tab or blank) with
    the ``decimal`` mark given or found. Raises RecordingError for a known format that is no table,
    for lines that are neither header nor rows, for fewer cells than labels, and, naming the options
    below ``key``, for points and commas in one table and whole numbers between commas under no
    header, which may be decimal fractions; ConfigError for options that are no separator or mark.
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
    if not places:
        raise RecordingError("the file holds no whole line; record again", file=file)
    lines = [text.lines[place - 1] for place in places]
    tail = lines[: -REMARKS - 1 : -1]
    likely = next((line for line in tail if _is_rowlike(line)), lines[-1])
    mark = separator or _separator_of(likely)
    if mark == SPACE:
        lines = [SPACE.join(line.lstrip("#%").split()) for line in lines]
    end = len(lines) - tail.index(likely)  # of the rows; below are lines of words
    split = [_split(line, mark) for line in lines[max(end - SAMPLED, 0) : end]]
    before = {len(cells) for cells in split[-3:-1]}
    if len(before) == 1 and len(split[-1]) < max(before) and _numbers(split[-2]):
        end, split = end - 1, split[:-1]
    counts = {"blank_rows": len(text.lines) - len(places)}
    counts["cut_rows"] = (text.cut is not None) + len(lines) - end
    last, numeric = split[-1], _numeric_columns(split)
    rows = enumerate(_split(line, mark) for line in lines[: end if numeric else 0])
    if (top := next((n for n, row in rows if _is_row(row, numeric, last)), end)) == end:
        message = f"no line holds numbers below {lines[end - 1][:80]!r}, where a table has rows of"
        raise RecordingError(f"{message} them; record or export it again", file=file)
    if top + 1 < end and _counts_on(_split(lines[top], mark)):
        top += 1  # labels that are numbers, as pandas writes them
    header = lines[:top], *_header(lines[:top], places, mark, last, numeric, file)
    signs = [sign for sign in ".," if sign != mark and any(sign in row for row in lines[top:end])]
    if decimal is None and len(signs) > 1:  # those of the columns of numbers alone
        rows = (enumerate(_split(row, mark)) for row in lines[top:end])
        held = "".join(cell for row in rows for column, cell in row if column in numeric)
        if len(signs := [sign for sign in signs if sign in held]) > 1:
            message = "decimal points and decimal commas in one table; mend it, or set decimal"
            raise RecordingError(message, file=file, key=key)
    chosen = decimal or "".join(signs)
    if not chosen and mark == "," and separator is None and len(last) > 1 and not header[1]:
        message = "whole numbers between commas, or decimal commas? Set separator and decimal, or "
        message += "save it with semicolons"
        raise RecordingError(message, file=file, line=places[top], key=key)
    body = lines[top:end], places[top:end], mark, chosen or "."
    return Sheet(file, *header, *body, numeric, counts)


def _is_rowlike(line: str) -> bool:
    """Return whether a line has not more words than numbers."""
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
    numbers = 2 * _numbers(pieces) >= len(pieces) or "," not in line
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
    """Return the columns of numbers in at least half of the last lines of one width."""
    alike = []
    for cells in reversed(split):
        if len(cells) == len(split[-1]):
            if not any(_is_number(cell) or cell in MISSING[1:] for cell in cells):
                break
            alike.append(cells)
    columns = enumerate(zip(*alike, strict=True))
    return [number for number, cells in columns if 2 * _numbers([*cells]) >= len(alike)]


def _is_row(cells: list[str], numeric: list[int], last: list[str]) -> bool:
    held = [cells[column] for column in numeric] if len(cells) == len(last) else []
    return _numbers(held) > 0 and all(_is_number(cell) or cell in MISSING for cell in held)


def _counts_on(cells: list[str]) -> bool:
    """Return whether cells are labels that are numbers: nothing or a word, then 0, 1, 2 …"""
    if len(cells) < 3 or _is_number(cells[0]):
        return False
    numbers = [int(cell) for cell in cells[1:] if re.fullmatch(r"\d{1,4}", cell)]
    return bool(numbers) and numbers == [*range(numbers[0], numbers[0] + len(cells) - 1)]


def _header(
    lines: list[str], places: list[int], mark: str, last: list[str], numeric: list[int], file: Path
) -> tuple[list[str], list[str], int]:
    """Return labels, the units below them, and the labels' line; RecordingError for a line that is
    a damaged row or a row of another form, and for more labels than cells.
    """

    def fault(problem: str, line: int) -> RecordingError:
        return RecordingError(f"{problem}: export it again, or mend the line", file=file, line=line)

    for line, place in zip(lines, places, strict=False):
        for other in SEPARATORS:
            cells = line.split() if other == SPACE else _split(line, other)
            filled = [cell for cell in cells if cell]
            if len(filled) > 2 and _numbers(filled) == len(filled) and not _counts_on(cells):
                raise fault(f"numbers in another form than below, or damaged: {line[:80]!r}", place)
    above = [_split(line.lstrip("#% "), mark) for line in lines]
    cells = above[-1] if above else []
    numbers = _numbers([cells[column] for column in numeric if column < len(cells)])
    if numbers and not _counts_on(cells) and (len(cells) == len(last) or numbers == len(cells)):
        message = f"words and numbers in a damaged row: {lines[-1][:80]!r}"
        raise fault(message, places[len(lines) - 1])
    if len(last) < len(labels := [cell for cell in cells if cell and "=" not in cell]):
        message = f"the row has {len(last)} cells under {len(labels)} labels up to {labels[-1]!r}"
        raise fault(message, places[len(lines)])
    units: list[str] = []
    for place, cells in reversed([*zip(places, above, strict=False)]):
        cells = [cell for cell in cells if "=" not in cell]  # settings have no column
        filled, width = _filled(cells), len(last)
        if not re.search(r"\w", "".join(cells)):
            continue
        stated = len(cells) > 1 and all(map(is_unit, filter(None, cells)))
        if stated and not units and place > places[0]:
            units = cells
        elif numeric[-1] < filled <= width and (filled > 1 or width == 1):
            return (cells + [""] * width)[: max(filled, _filled(last))], units, place
    return [], units, places[len(lines)]


def _begins(head: Head) -> bool:
    """Return whether the reader finds rows in the beginning, or refuses an option or a line."""
    if head.text is None or not head.lines or head.suffix in TREES or foreign(head.text):
        return False
    *lines, last = head.text.split("\n")
    try:
        sheet = _sheet(Text(lines or [last], None), head.file, None, None, "")
    except RecordingError as error:
        return bool({"key", "line"} & {*error.evidence})
    if len(sheet.rows) < 2:
        return bool(sheet.labels) and len(sheet.numeric) == sheet.width
    return bool(sheet.labels) or len(sheet.numeric) >= min(2, len(sheet.last))


FORMAT = Format("table of numbers", Kind.TABLE, read_sheet, _begins)
