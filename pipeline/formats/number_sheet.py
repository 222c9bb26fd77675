"""Tables of numbers of any program: cells by label or number, units, repaired missing numbers."""

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.core.errors import ConfigError, RecordingError
from pipeline.formats import delimited
from pipeline.formats.delimited import MISSING, split_line
from pipeline.formats.format import Format, Head, Kind
from pipeline.formats.sheet_layout import (
    HEADER_END,
    SEPARATORS,
    THOUSANDS,
    Layout,
    layout_of,
)

# suffixes of files that are not tables
TREES = (".json", ".jsonl", ".yaml", ".yml", ".xml")
# line that ends the header → program that writes it
ORIGINS = {"endheader": "of OpenSim (MOT, STO)", HEADER_END: "of LabVIEW (LVM)"}
IN_DEGREES = {"yes": "deg", "no": "rad"}
LONGEST_GAP = 10  # longest interpolated gap, in median steps of the column
SPARSEST = 50  # greatest number of rows per number in a column
LIST = re.compile(r"(?:array\()?[\[(]\s*[-+.\d][-+.\deE,;\s]*[\])]\)?")
SPLIT_LIST = re.compile(r"[\[(]\s*[-+.\d][-+.\deE\s]*,[-+.\deE,\s]*[\])]")
LISTS = "lists of numbers"
# least columns, and columns over rows, of a table on its side
WIDE = 100
WIDER = 10
DATE = re.compile(r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}|\d{1,2}:\d{2}(:\d{2})?")


class Samples(NamedTuple):
    """Complete rows of chosen columns: every cell has a number."""

    values: np.ndarray  # (M, columns)
    rows: np.ndarray  # (M,) row numbers in the table, from 0
    # rows_without_numbers, rows_without_measured_angle (only numbers in other columns) and
    # incomplete_end_rows (all left out), interpolated_cells
    counts: dict[str, int]


@dataclass(frozen=True, kw_only=True)
class Sheet(Layout):
    """Table of numbers: its rows and its header."""

    file: Path
    decimal: str

    @property
    def width(self) -> int:
        """Number of cells per row, up to the last labelled or numeric column."""
        return max(len(self.labels), self.numeric[-1] + 1)

    @property
    def settings(self) -> dict[str, str]:
        """Settings of the header: cells ``name = value`` and lines ``name: value``."""
        settings = {}
        for line in self.header:
            for cell in split_line(line.lstrip("#% "), self.separator):
                name, mark, value = cell.partition("=")
                if mark:
                    settings[name.strip()] = value.strip()
        for line in self.header:
            name, mark, value = line.strip().strip('"').partition(":")
            if mark and "=" not in line:
                settings[name.strip()] = value.strip()
        return settings

    @property
    def origin(self) -> str | None:
        """Program that wrote the table, if the line that ends the header identifies it."""
        for line in self.header:
            ending = line.strip(" ,;\t")
            if ending in ORIGINS:
                return ORIGINS[ending]
        return None

    @property
    def left_out(self) -> dict[str, str]:
        """Label or number of each column without numbers → its content."""
        contents = {}
        last = self.last
        width = max(len(self.labels), delimited.filled_width(last))
        for column in range(width):
            if column not in self.numeric:
                name = _cell(self.labels, column) or str(column)
                contents[name] = _content_of(_cell(last, column))
        return contents

    def words(self, column: int) -> list[str]:
        """Return (N,) the text of a column's cells; empty text where a row is too short."""
        return [_cell(split_line(row, self.separator), column) for row in self.rows]

    def unit(self, column: int, kind: str = "") -> str | None:
        """Return the unit of a ``column``, stated in the header behind or below the label, or of an
        angle or a time (``kind``) as a word of the label, or by OpenSim's setting ``inDegrees``.
        """
        label = _cell(self.labels, column)
        unit = delimited.unit_of(label) or _cell(self.units, column).strip("()[] ")
        if not unit and kind:
            unit = delimited.unit_in_name(label, kind)
        if not unit and kind == "angle":
            unit = IN_DEGREES.get(self.settings.get("inDegrees", "").lower())
        return unit or None

    def columns(self, wanted: Mapping[str, str | int], key: str) -> dict[str, int]:
        """Return quantity → column number, from quantity → label (with or without its unit) or
        column number from 0; RecordingError with the option's ``key`` unless one column fits.
        """
        columns = {}
        for quantity, name in wanted.items():
            if isinstance(name, int):
                fits = [name] if 0 <= name < len(self.last) else []
            else:
                fits = []
                for column, label in enumerate(self.labels):
                    if name in (label, delimited.bare(label)):
                        fits.append(column)
            if len(fits) != 1:
                header = "; ".join(self.header)[:300]
                raise RecordingError(
                    f"{quantity}: {len(fits)} columns have the label or number (from 0) {name!r}, "
                    f"one is required; the labels above the {self.width} columns are "
                    f"{', '.join(self.labels) or header or 'nothing'}",
                    file=self.file,
                    line=self.label_line,
                    key=key,
                )
            columns[quantity] = fits[0]
        return columns

    def values(self, columns: list[int], *, gaps: bool = False) -> np.ndarray:
        """Return numbers (N, columns); a missing one is NaN if ``gaps``, else RecordingError."""
        return delimited.numbers_of(
            self.rows,
            self.lines,
            columns,
            file=self.file,
            separator=self.separator,
            decimal=self.decimal,
            gaps=gaps,
        )

    def samples(
        self,
        columns: list[int],
        clock: int | None = None,
        at: Collection[int] = (),
    ) -> Samples:
        """Return the rows with a number in one of the columns ``at`` (default all but ``clock``),
        between the first and the last number of each column. A missing cell is interpolated
        linearly over the column ``clock`` (default the row number). RecordingError with the line
        for a row without a time, a gap of more than LONGEST_GAP median steps of the column, and a
        column with fewer than two numbers or fewer than one number in SPARSEST rows.
        """
        values = self.values(columns, gaps=True)
        present = ~np.isnan(values)
        if present.all():
            return Samples(values, np.arange(len(values)), {})
        signals = [place for place, column in enumerate(columns) if column != clock]
        leading = [place for place in signals if columns[place] in at] or signals
        rows = np.flatnonzero(present[:, signals].any(axis=1))
        filled = values[rows]
        present = present[rows]
        x = rows.astype(float)
        if clock is not None:
            x = filled[:, columns.index(clock)]
            untimed = np.isnan(x)
            if untimed.any():
                raise self._fault(clock, rows[untimed.argmax()], "has no number")

        led = present[:, leading].any(axis=1)
        inside = led.copy()
        for place in signals:
            column = columns[place]
            numbers = np.flatnonzero(present[:, place])
            if len(numbers) < max(2, len(rows) / SPARSEST):
                problem = f"has {len(numbers)} numbers in {len(rows)} rows"
                raise self._fault(column, min(rows, default=0), problem)
            inside[: numbers[0]] = False
            inside[numbers[-1] + 1 :] = False
            wide = inside & ~present[:, place] & _in_long_gaps(x, numbers)
            if wide.any():
                problem = (
                    f"has no number in a gap of more than {LONGEST_GAP} of its steps"
                )
                raise self._fault(column, rows[wide.argmax()], problem)
            filled[:, place] = np.interp(x, x[numbers], filled[numbers, place])
        if not inside.any():
            problem = "has no number at the times of the other columns"
            raise self._fault(columns[leading[0]], 0, problem)

        counts = {
            "rows_without_numbers": len(values) - len(rows),
            "rows_without_measured_angle": int((~led).sum()),
            "incomplete_end_rows": int((led & ~inside).sum()),
            "interpolated_cells": int((~present[inside]).sum()),
        }
        counts = {name: count for name, count in counts.items() if count}
        return Samples(filled[inside], rows[inside], counts)

    def _fault(self, column: int, row: int, problem: str) -> RecordingError:
        label = _cell(self.labels, column)
        message = (
            f"column {column + 1} {label} {problem}; fill it in, or leave the row out"
        )
        return RecordingError(message, file=self.file, line=self.lines[row])


def _in_long_gaps(x: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """Return (N,) whether a row of a column, with ``numbers`` in some rows, is in a gap of more
    than LONGEST_GAP of its median steps over ``x`` (N,).
    """
    following = np.searchsorted(numbers, np.arange(len(x)))
    steps = np.diff(x[numbers])
    step_of_row = steps[following.clip(1, len(steps)) - 1]
    return step_of_row > LONGEST_GAP * np.median(steps)


def _cell(cells: list[str], column: int) -> str:
    """Return the cell of a ``column``, empty text behind the last cell."""
    return cells[column] if column < len(cells) else ""


def _content_of(cell: str) -> str:
    """Return the content of a column without numbers, by its last ``cell``."""
    if cell in MISSING:
        return "nothing"
    if LIST.fullmatch(cell):
        return LISTS
    return "dates or times" if DATE.search(cell) else "words"


def read_sheet(
    file: Path,
    *,
    separator: str | None = None,
    decimal: str | None = None,
    key: str = "",
) -> Sheet:
    """Return the table in ``file`` with the ``separator`` (comma, semicolon, tab or blank) and the
    ``decimal`` mark; None detects them. Raises RecordingError for another format, a line that is
    neither header nor row, and a row with fewer cells than labels; with ``key``, the option to set,
    for mixed decimal marks and integers between commas. Raises ConfigError for other marks.
    """
    allowed = separator in (None, *SEPARATORS) and decimal in (None, ".", ",")
    if not allowed or (decimal is not None and decimal == separator):
        raise ConfigError(
            f"separator {separator!r} must be a comma, semicolon, tab or blank, and decimal "
            f"{decimal!r} a point or comma other than the separator",
            key=key,
        )
    return _sheet(delimited.read_text(file), Path(file), separator, decimal, key)


def _sheet(
    text: delimited.Text,
    file: Path,
    separator: str | None,
    decimal: str | None,
    key: str,
) -> Sheet:
    foreign = delimited.foreign("\n".join(text.lines[:3]) + "\n")
    if foreign:
        name, remedy = foreign
        message = f"this is a {name}, which is not read; {remedy}"
        raise RecordingError(message, file=file)
    layout = layout_of(text, file, separator)
    _require_separate_numbers(layout, file)
    sign = decimal or _decimal_mark(layout, file, key)
    detected = separator is None and layout.separator == "," and len(layout.last) > 1
    points = any("." in row for row in layout.rows)
    if detected and not (sign or points or layout.labels):
        raise RecordingError(
            "the commas may separate whole numbers or be decimal commas: set separator and "
            "decimal, or save it with semicolons",
            file=file,
            line=layout.lines[0],
            key=key,
        )
    sheet = Sheet(**vars(layout), file=file, decimal=sign or ".")
    rows = delimited.with_nanoseconds(
        sheet.rows,
        sheet.labels,
        sheet.separator,
        sheet.decimal,
    )
    return replace(sheet, rows=rows)


def _require_separate_numbers(layout: Layout, file: Path) -> None:
    """Raise RecordingError for a table of far more columns than rows, for lists whose commas also
    separate the cells, and for the first numeric cell with marks for thousands.
    """
    width = len(layout.last)
    if width >= WIDE and width > WIDER * len(layout.rows):
        raise RecordingError(
            f"the table of {len(layout.rows)} rows and {width} columns lies on its side, "
            "one row per signal: transpose it, so that each row holds the values of one time",
            file=file,
            line=layout.lines[0],
        )
    last = layout.rows[-1]
    if layout.separator == "," and '"' not in last and SPLIT_LIST.search(last):
        raise RecordingError(
            "lists of numbers in brackets, whose commas also separate the cells: write each number "
            "in a column of its own, or save the table as Parquet",
            file=file,
            line=layout.lines[-1],
        )
    for line, number in zip(layout.rows, layout.lines, strict=True):
        if not THOUSANDS.search(line):
            continue
        cells = split_line(line, layout.separator)
        for column in layout.numeric:
            cell = _cell(cells, column)
            match = THOUSANDS.fullmatch(cell)
            if match:
                sign = {".": "point", ",": "comma"}.get(match[1] or match[2], "mark")
                raise RecordingError(
                    f"column {column + 1} holds {cell!r} from this line on: a {sign} for "
                    "thousands; write the numbers without it",
                    file=file,
                    line=number,
                )


def _decimal_mark(layout: Layout, file: Path, key: str) -> str:
    """Return the decimal mark in numeric cells, empty for whole numbers; RecordingError for
    both marks. Marks in columns without numbers do not count.
    """
    seen: dict[str, tuple[str, int]] = {}  # mark → first cell with it, line
    signs = [sign for sign in ".," if sign != layout.separator]
    for line, number in zip(layout.rows, layout.lines, strict=True):
        for sign in signs:
            if sign in seen or sign not in line:
                continue
            cells = split_line(line, layout.separator)
            numbers = [_cell(cells, column) for column in layout.numeric]
            marked = [cell for cell in numbers if sign in cell]
            if marked:
                seen[sign] = marked[0], number
        if len(seen) == 2:
            (first, first_line), (second, second_line) = seen.values()
            raise RecordingError(
                "decimal points and decimal commas in one table "
                f"({first!r} in line {first_line}, {second!r} in line {second_line}), or marks for "
                "thousands: write all numbers with one decimal mark and without marks for "
                "thousands, or set decimal",
                file=file,
                key=key,
            )
    return "".join(seen)


def _begins(head: Head) -> bool:
    """Return whether the reader finds rows, or an error that names an option or a line."""
    if head.text is None or not head.lines or head.suffix in TREES:
        return False
    if delimited.foreign(head.text):
        return False
    *lines, last = head.text.split("\n")
    try:
        sheet = _sheet(delimited.Text(lines or [last], None), head.file, None, None, "")
    except RecordingError as error:
        return not {"key", "line"}.isdisjoint(error.evidence)
    if len(sheet.rows) < 2:
        return bool(sheet.labels) and len(sheet.numeric) == sheet.width
    return bool(sheet.labels) or len(sheet.numeric) >= min(2, len(sheet.last))


FORMAT = Format("table of numbers", Kind.TABLE, read_sheet, _begins)
