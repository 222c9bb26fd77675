"""Layout of a table of numbers in a text file: settings, labels, units, rows and remarks.

The last line with numbers defines the number of cells per row. Rows begin at the first line with
numbers in the numeric columns of the last lines, below the header.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from pipeline.core.errors import RecordingError
from pipeline.formats import delimited
from pipeline.formats.delimited import (
    MISSING,
    count_numbers,
    counts_on,
    is_number,
    split_line,
)

SEPARATORS = (",", ";", "\t", delimited.SPACE)
SAMPLED = 40  # last lines, by which numeric columns are recognised
REMARKS = 5  # greatest number of lines of words below the rows
# line of LabVIEW's measurement files, after each section
HEADER_END = "***End_of_Header***"
MEND = "export it again, or mend the line"
# number with a mark for thousands and a decimal mark, or with two marks for thousands
THOUSANDS = re.compile(
    r"[+-]?\d{1,3}(?:([.'\u2019 ])\d{3}(?:\1\d{3})*,\d+|([,'\u2019 ])\d{3}(?:\2\d{3})*\.\d+)",
)


class Line(NamedTuple):
    """Line that is not blank."""

    number: int  # in the file, from 1
    text: str


@dataclass(frozen=True)
class Layout:
    """Header and rows of a table."""

    header: list[str]  # lines of settings, title, labels and units
    labels: list[str]  # (width,) column labels; empty if the table has none
    units: list[str]  # cells of a line of units below the labels
    label_line: int  # line number of the labels, else of the first row
    rows: list[str]
    lines: list[int]  # (N,) line numbers of the rows in the file, from 1
    separator: str
    numeric: list[int]  # columns of numbers, from 0
    # blank_rows, remark_rows (with repeated headers), cut_rows (short last row or no line end)
    counts: dict[str, int]

    @property
    def last(self) -> list[str]:
        """Cells of the last row."""
        return split_line(self.rows[-1], self.separator)


def layout_of(text: delimited.Text, file: Path, separator: str | None) -> Layout:
    """Return the layout of the ``text`` of ``file``, by the ``separator`` or a detected one;
    RecordingError for no rows, and for a line that is neither header nor row.
    """
    lines = []
    for number, line in enumerate(text.lines, start=1):
        if line.strip(' \t,;"'):
            lines.append(Line(number, line))
    if not lines:
        message = "no samples: the file has no complete line; record again"
        raise RecordingError(message, file=file)
    blank_rows = len(text.lines) - len(lines)
    remarks = _remarks_below(lines)
    mark = separator or delimited.separator_of(lines[-1 - remarks].text)
    lines, mark = _plain_cells(lines, mark, detected=separator is None)

    start, deleted = _sections(lines, mark)
    end = len(lines) - remarks
    sampled = _sampled_cells(lines[start:end], mark)
    if _is_cut(sampled):
        end -= 1
        sampled.pop()
    last = sampled[-1]
    numeric = _numeric_columns(sampled)
    top = _first_row(lines[:end], start, mark, numeric, len(last), file)
    header = lines[:top]
    body = lines[top:end]
    _require_no_rows(header, file)
    labels, units, label_line = _header(lines, top, mark, last, numeric, file)
    if start and labels[:1] == ["X_Value"]:
        units = _units_of_labview(lines[:start], mark)

    repeated_labels = text.lines[label_line - 1] if labels else None
    rows = []
    for line in body:
        original = text.lines[line.number - 1]
        if original != repeated_labels and original[0] not in "#%":
            rows.append(line)
    cut_rows = len(lines) - end
    if text.cut is not None:
        cut_rows += 1
    counts = {"blank_rows": blank_rows, "cut_rows": cut_rows}
    remark_rows = len(body) - len(rows) + deleted  # remarks and repeated headers
    if remark_rows:
        counts["remark_rows"] = remark_rows
    return Layout(
        header=[line.text for line in header],
        labels=labels,
        units=units,
        label_line=label_line,
        rows=[line.text for line in rows],
        lines=[line.number for line in rows],
        separator=mark,
        numeric=numeric,
        counts=counts,
    )


def _plain_cells(
    lines: list[Line],
    mark: str,
    *,
    detected: bool,
) -> tuple[list[Line], str]:
    """Return the ``lines`` with one blank between cells if blanks separate them, and with
    semicolons in place of ``detected`` commas between quoted decimals; and the separator.
    """
    sampled = [line.text for line in lines[-SAMPLED:]]
    quoted = detected and mark == "," and delimited.has_quoted_decimals(sampled)
    if mark != delimited.SPACE and not quoted:
        return lines, mark
    separated = []
    for number, text in lines:
        if mark == delimited.SPACE:
            text = mark.join(text.lstrip("#%").split())
        else:
            text = ";".join(split_line(text, mark))
        separated.append(Line(number, text))
    return separated, ";" if quoted else mark


def _remarks_below(lines: list[Line]) -> int:
    """Return the number of lines of words below the rows, at most REMARKS."""
    for remarks, line in enumerate(lines[: -REMARKS - 1 : -1]):
        if delimited.is_rowlike(line.text):
            return remarks
    return 0


def _sections(lines: list[Line], mark: str) -> tuple[int, int]:
    """Return a LabVIEW file's label line (0 in others) and the number of deleted header lines."""
    ends = _places_of(HEADER_END, lines)
    if not ends or ends[-1] + 1 >= len(lines):
        return 0, 0
    before = len(lines)
    for end in reversed(ends[2:]):
        channels = _places_of("Channels", lines[:end])
        del lines[max(channels, default=end) : end + 2]
    start = ends[:2][-1] + 1
    labels = split_line(lines[start].text.rstrip(mark), mark)
    if labels[-1] == "Comment":  # rows may lack the cell of the comment
        for place, (number, text) in enumerate(lines):
            if place > start and text.count(mark) == len(labels) - 2:
                lines[place] = Line(number, text + mark)
    return start, before - len(lines)


def _places_of(word: str, lines: list[Line]) -> list[int]:
    """Return the places in ``lines``, from 0, of the lines that start with the ``word``."""
    return [n for n, line in enumerate(lines) if line.text.startswith(word)]


def _units_of_labview(lines: list[Line], mark: str) -> list[str]:
    """Return the units that LabVIEW's header ``lines`` state, after s of the times."""
    for line in lines:
        name, *units = split_line(line.text, mark)
        if name == "Y_Unit_Label":
            return ["s", *units]
    return ["s"]


def _sampled_cells(body: list[Line], mark: str) -> list[list[str]]:
    """Return the cells of the last SAMPLED lines, and of earlier ones, since a column may be empty
    in the last lines.
    """
    step = max(len(body) // SAMPLED, 1)
    sampled = body[:-SAMPLED:step] + body[-SAMPLED:]
    return [split_line(line.text, mark) for line in sampled]


def _is_cut(sampled: list[list[str]]) -> bool:
    """Return whether the last row has fewer cells than the two rows before it."""
    *before, last = sampled[-3:]
    widths = {len(cells) for cells in before}
    if len(widths) != 1 or len(last) >= max(widths):
        return False
    return count_numbers(before[-1]) > 0


def _numeric_columns(sampled: list[list[str]]) -> list[int]:
    """Return the columns with numbers in at least half of their filled cells."""
    rows = []
    for cells in reversed(sampled):
        if len(cells) == len(sampled[-1]):
            if not any(is_number(cell) or cell in MISSING[1:] for cell in cells):
                break
            rows.append(cells)
    numeric = []
    for column, cells in enumerate(zip(*rows, strict=True)):
        filled = [cell for cell in cells if cell not in MISSING]
        numbers = [cell for cell in filled if is_number(cell) or is_thousands(cell)]
        if 2 * len(numbers) >= len(filled) > 0:
            numeric.append(column)
    return numeric


def is_thousands(cell: str) -> bool:
    """Return whether a ``cell`` is a number with marks for thousands and a decimal mark."""
    return THOUSANDS.fullmatch(cell) is not None


def _first_row(
    lines: list[Line],
    start: int,
    mark: str,
    numeric: list[int],
    width: int,
    file: Path,
) -> int:
    """Return the first line from ``start`` on with only numbers in ``numeric`` cells, or with no
    content above such a line; RecordingError for none.
    """
    top = start
    cells = []
    for top in range(start, len(lines)):
        cells = split_line(lines[top].text, mark)
        if len(cells) == width and _has_numbers([cells[n] for n in numeric]):
            break
    else:
        raise RecordingError(
            f"no samples: no row of numbers up to the line {lines[-1].text[:80]!r}; record it or "
            "export it again",
            file=file,
        )
    if top + 1 < len(lines) and counts_on(cells):
        return top + 1
    while top > start:
        above = split_line(lines[top - 1].text, mark)
        if len(above) != width or not {*MISSING}.issuperset(above):
            break
        top -= 1
    return top


def _has_numbers(cells: list[str]) -> bool:
    """Return whether the ``cells`` are numbers, at least one, and missing numbers."""
    numbers = [cell for cell in cells if is_number(cell)]
    missing = [cell for cell in cells if cell in MISSING]
    return len(numbers) > 0 and len(numbers) + len(missing) == len(cells)


def _require_no_rows(header: list[Line], file: Path) -> None:
    """Raise RecordingError for a row of numbers, by any separator, in the ``header``."""
    for number, text in header:
        for mark in SEPARATORS:
            cells = text.split() if mark == delimited.SPACE else split_line(text, mark)
            filled = [cell for cell in cells if cell]
            only_numbers = len(filled) > 2 and all(map(is_number, filled))
            if only_numbers and not counts_on(cells):
                message = (
                    f"numbers unlike the rows below, or damaged: {text[:80]!r}: {MEND}"
                )
                raise RecordingError(message, file=file, line=number)


def _header(
    lines: list[Line],
    top: int,
    mark: str,
    last: list[str],
    numeric: list[int],
    file: Path,
) -> tuple[list[str], list[str], int]:
    """Return labels, units and the labels' line above the row ``top``; RecordingError for a damaged
    row above it.
    """
    first_row = lines[top]
    width = len(last)
    rows_above = [split_line(line.text.lstrip("#% "), mark) for line in lines[:top]]
    if rows_above:
        _require_labels(rows_above[-1], lines[top - 1], width, numeric, file)
        words = [cell for cell in rows_above[-1] if cell and "=" not in cell]
        if width < len(words):
            raise RecordingError(
                f"the row has {width} cells under {len(words)} labels up to {words[-1]!r}: {MEND}",
                file=file,
                line=first_row.number,
            )

    units: list[str] = []
    for line, row in zip(lines[:top][::-1], rows_above[::-1], strict=True):
        # cells of settings label no column
        cells = [cell for cell in row if "=" not in cell]
        if not re.search(r"\w", "".join(cells)):
            continue
        filled = delimited.filled_width(cells)
        are_units = all(delimited.is_unit(cell) for cell in cells if cell)
        if len(cells) > 1 and are_units and not units and line is not lines[0]:
            units = cells
        elif numeric[-1] < filled <= width and (filled > 1 or width == 1):
            labelled = max(filled, delimited.filled_width(last))
            padded = cells + [""] * width
            return padded[:labelled], units, line.number
    return [], units, first_row.number


def _require_labels(
    cells: list[str],
    line: Line,
    width: int,
    numeric: list[int],
    file: Path,
) -> None:
    """Raise RecordingError where the ``cells`` of the last header ``line`` are a damaged row."""
    numbers = count_numbers([cells[n] for n in numeric if n < len(cells)])
    if numbers and len(cells) in (width, numbers) and not counts_on(cells):
        message = f"words and numbers in one row: {line.text[:80]!r}: {MEND}"
        raise RecordingError(message, file=file, line=line.number)
