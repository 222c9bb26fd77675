"""Tables of numbers of any program. The last line defines the number of cells per row. Rows begin
at the first line with numbers in the numeric columns of the last lines, below the header.
"""

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.core.errors import ConfigError, RecordingError
from pipeline.formats import delimited
from pipeline.formats.delimited import (
    MISSING,
    count_numbers,
    counts_on,
    is_number,
    split_line,
)
from pipeline.formats.format import Format, Head, Kind

SEPARATORS = (",", ";", "\t", delimited.SPACE)
SAMPLED = 40  # last lines, by which numeric columns are recognised
REMARKS = 5  # greatest number of lines of words below the rows
# suffixes of files that are not tables
TREES = (".json", ".jsonl", ".yaml", ".yml", ".xml")
# line of LabVIEW's measurement files, after each section
HEADER_END = "***End_of_Header***"
ORIGINS = {"endheader": "of OpenSim (MOT, STO)", HEADER_END: "of LabVIEW (LVM)"}
IN_DEGREES = {"yes": "deg", "no": "rad"}
LONGEST_GAP = 10  # longest interpolated gap, in median steps of the column
SPARSEST = 50  # greatest number of rows per number in a column
MEND = "export it again, or mend the line"
LIST = re.compile(r"(?:array\()?[\[(]\s*[-+.\d][-+.\deE,;\s]*[\])]\)?")
SPLIT_LIST = re.compile(r"[\[(]\s*[-+.\d][-+.\deE\s]*,[-+.\deE,\s]*[\])]")
LISTS = "lists of numbers"
WIDE, WIDER = 100, 10  # least columns, and columns over rows, of a table on its side
# number with a mark for thousands and a decimal mark, or with two marks for thousands
THOUSANDS = re.compile(
    r"[+-]?\d{1,3}(?:([.'\u2019 ])\d{3}(?:\1\d{3})*,\d+|([,'\u2019 ])\d{3}(?:\2\d{3})*\.\d+)"
)
DATE = re.compile(r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}|\d{1,2}:\d{2}(:\d{2})?")


class Samples(NamedTuple):
    """Complete rows of chosen columns: every cell has a number."""

    values: np.ndarray  # (M, columns)
    rows: np.ndarray  # (M,) row numbers in the table, from 0
    # rows_without_numbers, rows_without_measured_angle (numbers in other columns alone) and
    # incomplete_end_rows (all left out), interpolated_cells
    counts: dict[str, int]


@dataclass(frozen=True)
class Sheet:
    """Table of numbers: its rows and its header."""

    file: Path
    header: list[str]  # lines of settings, title, labels and units
    labels: list[str]  # (width,) column labels; empty if the table has none
    units: list[str]  # cells of a line of units below the labels
    label_line: int  # line number of the labels, else of the first row
    rows: list[str]
    lines: list[int]  # (N,) line numbers of the rows in the file, from 1
    separator: str
    decimal: str
    numeric: list[int]  # columns of numbers, from 0
    # blank_rows, remark_rows (with repeated headers), cut_rows (short last row or no line end)
    counts: dict[str, int]

    @property
    def width(self) -> int:
        """Number of cells per row, up to the last labelled or numeric column."""
        return max(len(self.labels), self.numeric[-1] + 1)

    @cached_property
    def last(self) -> list[str]:
        """Cells of the last row."""
        return split_line(self.rows[-1], self.separator)

    @property
    def settings(self) -> dict[str, str]:
        """Settings of the header: cells ``name = value`` and lines ``name: value``."""
        above = (split_line(line.lstrip("#% "), self.separator) for line in self.header)
        stated = [
            cell.partition("=") for cells in above for cell in cells if "=" in cell
        ]
        lines = [line.strip().strip('"') for line in self.header if "=" not in line]
        stated += [line.partition(":") for line in lines if ":" in line]
        return {name.strip(): value.strip() for name, _, value in stated}

    @property
    def origin(self) -> str | None:
        """Program that wrote the table, if the line that ends the header identifies it."""
        ends = {line.strip(" ,;\t") for line in self.header}
        return next((name for end, name in ORIGINS.items() if end in ends), None)

    @property
    def left_out(self) -> dict[str, str]:
        """Label or number of each column without numbers → its content."""
        contents = {}
        width = max(len(self.labels), delimited.filled_width(self.last))
        for column in {*range(width)} - {*self.numeric}:
            cell, label = (
                "".join(row[column : column + 1]) for row in (self.last, self.labels)
            )
            content = "dates or times" if DATE.search(cell) else "words"
            if LIST.fullmatch(cell):
                content = LISTS
            contents[label or str(column)] = "nothing" if cell in MISSING else content
        return contents

    def words(self, column: int) -> list[str]:
        """Return (N,) the text of a column's cells; empty text where a row is too short."""
        return [
            (split_line(row, self.separator)[column:] or [""])[0] for row in self.rows
        ]

    def unit(self, column: int, kind: str = "") -> str | None:
        """Return the unit of a ``column``, stated in the header behind or below the label, or of an
        angle or a time (``kind``) as a word of the label, or by OpenSim's setting ``inDegrees``.
        """
        label = "".join(self.labels[column : column + 1])
        below = "".join(self.units[column : column + 1]).strip("()[] ")
        named = kind and delimited.unit_in_name(label, kind)
        setting = self.settings.get("inDegrees", "").lower() if kind == "angle" else ""
        return delimited.unit_of(label) or below or named or IN_DEGREES.get(setting)

    def columns(self, wanted: Mapping[str, str | int], key: str) -> dict[str, int]:
        """Return quantity → column number, from quantity → label (with or without its unit) or
        column number from 0; RecordingError with the option's ``key`` unless one column fits.
        """
        columns, names = {}, [(label, delimited.bare(label)) for label in self.labels]
        for quantity, name in wanted.items():
            fits = [column for column, pair in enumerate(names) if name in pair]
            fits = (
                [name] * (0 <= name < len(self.last)) if isinstance(name, int) else fits
            )
            if len(fits) != 1:
                present = (
                    ", ".join(self.labels) or "; ".join(self.header)[:300] or "nothing"
                )
                message = f"{quantity}: {len(fits)} columns have the label or number (from 0) "
                message += f"{name!r}, one is required; the labels above the {self.width} columns "
                message += f"are {present}"
                raise RecordingError(
                    message, file=self.file, line=self.label_line, key=key
                )
            columns[quantity] = fits[0]
        return columns

    def values(self, columns: list[int], *, gaps: bool = False) -> np.ndarray:
        """Return numbers (N, columns); a missing one is NaN if ``gaps``, else RecordingError."""
        form = {"separator": self.separator, "decimal": self.decimal, "gaps": gaps}
        return delimited.numbers_of(
            self.rows, self.lines, columns, file=self.file, **form
        )

    def samples(
        self, columns: list[int], clock: int | None = None, at: Collection[int] = ()
    ) -> Samples:
        """Return the rows with a number in one of the columns ``at`` (default all but ``clock``),
        between the first and the last number of each column. A missing cell is interpolated
        linearly over the column ``clock`` (default the row number). RecordingError with the line
        for a row without a time, a gap of more than LONGEST_GAP median steps of the column, and a
        column with fewer than two numbers or fewer than one number in SPARSEST rows.
        """

        def fault(problem: str, place: int, row: int) -> RecordingError:
            label = "".join(self.labels[columns[place] : columns[place] + 1])
            message = f"column {columns[place] + 1} {label} {problem}; fill it in, or leave the row"
            return RecordingError(
                f"{message} out", file=self.file, line=self.lines[row]
            )

        values = self.values(columns, gaps=True)
        rows, missing = np.arange(len(values)), np.isnan(values)
        if not missing.any():
            return Samples(values, rows, {})
        others = [place for place, column in enumerate(columns) if column != clock]
        leading = [place for place in others if columns[place] in at] or others
        rows = rows[~missing[:, others].all(axis=1)]
        filled, missing = values[rows], missing[rows]
        x = rows.astype(float) if clock is None else filled[:, columns.index(clock)]
        if np.isnan(x).any():
            raise fault(
                "has no number", columns.index(clock), rows[np.isnan(x).argmax()]
            )
        order, inside = (
            np.arange(len(rows)),
            (taken := ~missing[:, leading].all(axis=1)),
        )
        for place in others:
            known = np.flatnonzero(~missing[:, place])
            if len(known) < max(2, len(rows) / SPARSEST):
                problem = f"has {len(known)} numbers in {len(rows)} rows"
                raise fault(problem, place, min(rows, default=0))
            inside = inside & (order >= known[0]) & (order <= known[-1])
            after = np.searchsorted(known, order).clip(1, len(known) - 1)
            steps = np.diff(x[known])
            wide = (
                missing[:, place]
                & inside
                & (steps[after - 1] > LONGEST_GAP * np.median(steps))
            )
            if wide.any():
                problem = (
                    f"has no number in a gap of more than {LONGEST_GAP} of its steps"
                )
                raise fault(problem, place, rows[wide.argmax()])
            filled[:, place] = np.interp(x, x[known], filled[known, place])
        if not inside.any():
            raise fault(
                "has no number at the times of the other columns", leading[0], 0
            )
        counts = {"rows_without_numbers": len(values) - len(rows)}
        counts["rows_without_measured_angle"] = len(rows) - int(taken.sum())
        counts["incomplete_end_rows"] = int(np.sum(taken & ~inside))
        counts["interpolated_cells"] = int(missing[inside].sum())
        return Samples(
            filled[inside], rows[inside], {n: k for n, k in counts.items() if k}
        )


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
    known = separator in (None, *SEPARATORS) and decimal in (None, ".", ",")
    if not known or (decimal is not None and decimal == separator):
        message = f"separator {separator!r} must be a comma, semicolon, tab or blank, and decimal "
        message += f"{decimal!r} a point or comma other than the separator"
        raise ConfigError(message, key=key)
    return _sheet(delimited.read_text(file), Path(file), separator, decimal, key)


def _sheet(
    text: delimited.Text,
    file: Path,
    separator: str | None,
    decimal: str | None,
    key: str,
) -> Sheet:
    if other := delimited.foreign("\n".join(text.lines[:3]) + "\n"):
        raise RecordingError(
            f"this is a {other[0]}, which is not read; {other[1]}", file=file
        )
    places = [
        number
        for number, line in enumerate(text.lines, start=1)
        if line.strip(' \t,;"')
    ]
    if not places:
        raise RecordingError(
            "no samples: the file has no complete line; record again", file=file
        )
    lines = [text.lines[place - 1] for place in places]
    tail = [*map(delimited.is_rowlike, lines[: -REMARKS - 1 : -1])]
    below = tail.index(True) if any(tail) else 0  # remarks
    mark = separator or delimited.separator_of(lines[-1 - below])
    if mark == delimited.SPACE:
        lines = [mark.join(line.lstrip("#%").split()) for line in lines]
    if (
        separator is None
        and mark == ","
        and delimited.has_quoted_decimals(lines[-SAMPLED:])
    ):
        lines, mark = [";".join(split_line(line, ",")) for line in lines], ";"
    start, repeated = _sections(lines, places, mark)
    end = len(lines) - below
    # include earlier lines, since a column may be empty in the last lines
    body, step = lines[start:end], max((end - start) // SAMPLED, 1)
    split = [split_line(line, mark) for line in body[:-SAMPLED:step] + body[-SAMPLED:]]
    before = {len(cells) for cells in split[-3:-1]}
    if len(before) == 1 and len(split[-1]) < max(before) and count_numbers(split[-2]):
        end, split = end - 1, split[:-1]
    last, numeric = split[-1], _numeric_columns(split)
    top = _first_row(lines[:end], start, mark, numeric, last, file)
    labels, units, label_line = _header(lines[:top], places, mark, last, numeric, file)
    if start and labels[:1] == ["X_Value"]:
        stated = (split_line(line, mark) for line in lines[:start])
        units = next(
            (["s", *cells[1:]] for cells in stated if cells[0] == "Y_Unit_Label"), ["s"]
        )
    again = text.lines[label_line - 1] if labels else None
    rows = [n for n in range(top, end) if text.lines[places[n] - 1] != again]
    rows = [n for n in rows if text.lines[places[n] - 1][0] not in "#%"]
    cut = (text.cut is not None) + len(lines) - end
    counts = {"blank_rows": len(text.lines) - len(places) - repeated, "cut_rows": cut}
    if remarks := end - top - len(rows) + repeated:  # remarks and repeated headers
        counts["remark_rows"] = remarks
    above = lines[:top], labels, units, label_line
    lines, places = [lines[n] for n in rows], [places[n] for n in rows]
    _require_upright(len(lines), len(last), file, places[0])
    _require_no_split_lists(lines[-1], places[-1], mark, file)
    _require_plain_numbers(lines, places, mark, numeric, file)
    sign = decimal or _decimal_mark(lines, places, mark, numeric, file, key)
    if not sign and mark == "," and separator is None and len(last) > 1 and not labels:
        message = "the commas may separate whole numbers or be decimal commas: set separator and "
        message += "decimal, or save it with semicolons"
        raise RecordingError(message, file=file, line=places[0], key=key)
    lines = delimited.with_nanoseconds(lines, labels, mark, sign or ".")
    return Sheet(file, *above, lines, places, mark, sign or ".", numeric, counts)


def _require_upright(rows: int, columns: int, file: Path, line: int) -> None:
    """Raise RecordingError for a table of far more ``columns`` than ``rows``."""
    if columns >= WIDE and columns > WIDER * rows:
        message = f"the table of {rows} rows and {columns} columns lies on its side, one row per "
        message += "signal: transpose it, so that each row holds the values of one time"
        raise RecordingError(message, file=file, line=line)


def _require_plain_numbers(
    lines: list[str], places: list[int], mark: str, numeric: list[int], file: Path
) -> None:
    """Raise RecordingError for the first ``numeric`` cell with marks for thousands."""
    for line, place in zip(lines, places, strict=True):
        if not THOUSANDS.search(line):
            continue
        cells = split_line(line, mark)
        for column in numeric:
            cell = "".join(cells[column : column + 1])
            if match := THOUSANDS.fullmatch(cell):
                sign = {".": "point", ",": "comma"}.get(match[1] or match[2], "mark")
                message = f"column {column + 1} holds {cell!r} from this line on: a {sign} for "
                message += "thousands; write the numbers without it"
                raise RecordingError(message, file=file, line=place)


def _decimal_mark(
    lines: list[str],
    places: list[int],
    mark: str,
    numeric: list[int],
    file: Path,
    key: str,
) -> str:
    """Return the decimal mark in ``numeric`` cells, empty for whole numbers; RecordingError for
    both marks. Marks in columns without numbers do not count.
    """
    seen: dict[str, tuple[str, int]] = {}  # mark → first cell with it, line
    for line, place in zip(lines, places, strict=True):
        for sign in ".,":
            if sign == mark or sign in seen or sign not in line:
                continue
            cells = split_line(line, mark)
            marked = [cells[n] for n in numeric if n < len(cells) and sign in cells[n]]
            if marked:
                seen[sign] = marked[0], place
        if len(seen) == 2:
            (first, above), (second, line_number) = seen.values()
            raise RecordingError(
                f"decimal points and decimal commas in one table ({first!r} in line {above}, "
                f"{second!r} in line {line_number}), or marks for thousands: write all numbers "
                "with one decimal mark and without marks for thousands, or set decimal",
                file=file,
                key=key,
            )
    return "".join(seen)


def _require_no_split_lists(line: str, place: int, mark: str, file: Path) -> None:
    """Raise RecordingError where the commas of lists in brackets also separate the cells."""
    if mark == "," and '"' not in line and SPLIT_LIST.search(line):
        raise RecordingError(
            "lists of numbers in brackets, whose commas also separate the cells: write each number "
            "in a column of its own, or save the table as Parquet",
            file=file,
            line=place,
        )


def _sections(lines: list[str], places: list[int], mark: str) -> tuple[int, int]:
    """Return a LabVIEW file's label line (0 in others) and the number of deleted header lines."""
    ends = [n for n, line in enumerate(lines) if line.startswith(HEADER_END)]
    if not ends or ends[-1] + 1 >= len(lines):
        return 0, 0
    whole = len(lines)
    for end in reversed(ends[2:]):
        first = max(
            (n for n in range(end) if lines[n].startswith("Channels")), default=end
        )
        del lines[first : end + 2], places[first : end + 2]
    labels = split_line(lines[start := ends[:2][-1] + 1].rstrip(mark), mark)
    if labels[-1] == "Comment":
        for n in range(start + 1, len(lines)):
            lines[n] += mark * (lines[n].count(mark) == len(labels) - 2)
    return start, whole - len(lines)


def _numeric_columns(split: list[list[str]]) -> list[int]:
    """Return the columns with numbers in at least half of their filled cells."""
    alike = []
    for cells in reversed(split):
        if len(cells) == len(split[-1]):
            if not any(is_number(cell) or cell in MISSING[1:] for cell in cells):
                break
            alike.append(cells)
    filled = [
        [cell for cell in cells if cell not in MISSING]
        for cells in zip(*alike, strict=True)
    ]
    numeric = []
    for column, cells in enumerate(filled):
        numbers = sum(is_number(one) or is_thousands(one) for one in cells)
        if 2 * numbers >= len(cells) > 0:
            numeric.append(column)
    return numeric


def is_thousands(cell: str) -> bool:
    """Return whether a ``cell`` is a number with marks for thousands and a decimal mark."""
    return THOUSANDS.fullmatch(cell) is not None


def _first_row(
    lines: list[str],
    start: int,
    mark: str,
    numeric: list[int],
    last: list[str],
    file: Path,
) -> int:
    """Return the first line from ``start`` on with only numbers in ``numeric`` cells, or with no
    content above such a line; RecordingError for none.
    """
    for top in range(start, len(lines)):
        cells = split_line(lines[top], mark)
        values = (
            [cells[column] for column in numeric] if len(cells) == len(last) else []
        )
        if any(map(is_number, values)) and all(
            is_number(one) or one in MISSING for one in values
        ):
            break
    else:
        message = f"no samples: no row of numbers up to the line {lines[-1][:80]!r}; record it or "
        raise RecordingError(f"{message}export it again", file=file)
    if top + 1 < len(lines) and counts_on(cells):
        return top + 1
    blank = {*MISSING}.issuperset
    while (
        top > start
        and len(up := split_line(lines[top - 1], mark)) == len(last)
        and blank(up)
    ):
        top -= 1
    return top


def _header(
    lines: list[str],
    places: list[int],
    mark: str,
    last: list[str],
    numeric: list[int],
    file: Path,
) -> tuple[list[str], list[str], int]:
    """Return labels, units and the labels' line; RecordingError for a damaged row above rows."""
    for line, place in zip(lines, places, strict=False):
        for other in SEPARATORS:
            cells = (
                line.split() if other == delimited.SPACE else split_line(line, other)
            )
            filled = [cell for cell in cells if cell]
            if 2 < len(filled) == count_numbers(filled) and not counts_on(cells):
                message = (
                    f"numbers unlike the rows below, or damaged: {line[:80]!r}: {MEND}"
                )
                raise RecordingError(message, file=file, line=place)
    above = [split_line(line.lstrip("#% "), mark) for line in lines]
    cells = above[-1] if above else []
    numbers = count_numbers(
        [cells[column] for column in numeric if column < len(cells)]
    )
    if numbers and len(cells) in (len(last), numbers) and not counts_on(cells):
        message = f"words and numbers in one row: {lines[-1][:80]!r}: {MEND}"
        raise RecordingError(message, file=file, line=places[len(lines) - 1])
    if len(last) < len(labels := [cell for cell in cells if cell and "=" not in cell]):
        message = f"the row has {len(last)} cells under {len(labels)} labels up to {labels[-1]!r}: "
        raise RecordingError(message + MEND, file=file, line=places[len(lines)])
    units: list[str] = []
    for place, cells in reversed([*zip(places, above, strict=False)]):
        # cells of settings label no column
        cells = [cell for cell in cells if "=" not in cell]
        if not re.search(r"\w", "".join(cells)):
            continue
        filled, width = delimited.filled_width(cells), len(last)
        stated = len(cells) > 1 and all(map(delimited.is_unit, filter(None, cells)))
        if stated and not units and place > places[0]:
            units = cells
        elif numeric[-1] < filled <= width and (filled > 1 or width == 1):
            return (
                (cells + [""] * width)[: max(filled, delimited.filled_width(last))],
                units,
                place,
            )
    return [], units, places[len(lines)]


def _begins(head: Head) -> bool:
    """Return whether the reader finds rows, or an error that names an option or a line."""
    if (
        head.text is None
        or not head.lines
        or head.suffix in TREES
        or delimited.foreign(head.text)
    ):
        return False
    *lines, last = head.text.split("\n")
    try:
        sheet = _sheet(delimited.Text(lines or [last], None), head.file, None, None, "")
    except RecordingError as error:
        return bool({"key", "line"} & {*error.evidence})
    if len(sheet.rows) < 2:
        return bool(sheet.labels) and len(sheet.numeric) == sheet.width
    return bool(sheet.labels) or len(sheet.numeric) >= min(2, len(sheet.last))


FORMAT = Format("table of numbers", Kind.TABLE, read_sheet, _begins)
