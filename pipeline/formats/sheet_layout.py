"""Layout of a table of numbers in a text file: settings, labels, units, rows and remarks.

The last line with numbers defines the number of cells per row. Rows begin at the first line with
numbers in the numeric columns of the last lines, below the header.
"""

import re
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


class Layout(NamedTuple):
    """Parts of a table, as in :class:`pipeline.formats.number_sheet.Sheet`."""

    header: list[str]  # lines of settings, title, labels and units
    labels: list[str]
    units: list[str]
    label_line: int
    rows: list[str]
    lines: list[int]  # line numbers of the rows
    separator: str
    numeric: list[int]  # columns of numbers
    width: int  # cells of the last row
    counts: dict[str, int]


def layout_of(text: delimited.Text, file: Path, separator: str | None) -> Layout:
    """Return the layout of the ``text`` of ``file``, by the ``separator`` or a detected one;
    RecordingError for no rows, and for a line that is neither header nor row.
    """
    places = [n for n, line in enumerate(text.lines, start=1) if line.strip(' \t,;"')]
    if not places:
        message = "no samples: the file has no complete line; record again"
        raise RecordingError(message, file=file)
    lines = [text.lines[place - 1] for place in places]
    remarks = _remarks_below(lines)
    mark = separator or delimited.separator_of(lines[-1 - remarks])
    if mark == delimited.SPACE:
        lines = [mark.join(line.lstrip("#%").split()) for line in lines]
    detected = separator is None and mark == ","
    if detected and delimited.has_quoted_decimals(lines[-SAMPLED:]):
        lines = [";".join(split_line(line, ",")) for line in lines]
        mark = ";"

    start, deleted = _sections(lines, places, mark)
    end = len(lines) - remarks
    sampled = _sampled_cells(lines[start:end], mark)
    if _is_cut(sampled):
        end -= 1
        sampled.pop()
    last, numeric = sampled[-1], _numeric_columns(sampled)
    top = _first_row(lines[:end], start, mark, numeric, len(last), file)
    _require_no_rows(lines[:top], places, file)
    labels, units, label_line = _header(lines[:top], places, mark, last, numeric, file)
    if start and labels[:1] == ["X_Value"]:
        units = _units_of_labview(lines[:start], mark)

    repeated_labels = text.lines[label_line - 1] if labels else None
    rows, row_places = [], []
    for line, place in zip(lines[top:end], places[top:end], strict=True):
        original = text.lines[place - 1]
        if original != repeated_labels and original[0] not in "#%":
            rows.append(line)
            row_places.append(place)
    counts = {
        "blank_rows": len(text.lines) - len(places) - deleted,
        "cut_rows": (text.cut is not None) + len(lines) - end,
    }
    remark_rows = end - top - len(rows) + deleted  # remarks and repeated headers
    if remark_rows:
        counts["remark_rows"] = remark_rows
    return Layout(
        lines[:top],
        labels,
        units,
        label_line,
        rows,
        row_places,
        mark,
        numeric,
        len(last),
        counts,
    )


def _remarks_below(lines: list[str]) -> int:
    """Return the number of lines of words below the rows, at most REMARKS."""
    for remarks, line in enumerate(lines[: -REMARKS - 1 : -1]):
        if delimited.is_rowlike(line):
            return remarks
    return 0


def _sections(lines: list[str], places: list[int], mark: str) -> tuple[int, int]:
    """Return a LabVIEW file's label line (0 in others) and the number of deleted header lines."""
    ends = _lines_with(HEADER_END, lines)
    if not ends or ends[-1] + 1 >= len(lines):
        return 0, 0
    before = len(lines)
    for end in reversed(ends[2:]):
        channels = _lines_with("Channels", lines[:end])
        header = slice(max(channels, default=end), end + 2)
        del lines[header], places[header]
    start = ends[:2][-1] + 1
    labels = split_line(lines[start].rstrip(mark), mark)
    if labels[-1] == "Comment":  # rows may lack the cell of the comment
        for n, line in enumerate(lines):
            if n > start and line.count(mark) == len(labels) - 2:
                lines[n] = line + mark
    return start, before - len(lines)


def _lines_with(word: str, lines: list[str]) -> list[int]:
    """Return the numbers from 0 of the ``lines`` that start with the ``word``."""
    return [n for n, line in enumerate(lines) if line.startswith(word)]


def _units_of_labview(lines: list[str], mark: str) -> list[str]:
    """Return the units that LabVIEW's header ``lines`` state, after s of the times."""
    for line in lines:
        cells = split_line(line, mark)
        if cells[0] == "Y_Unit_Label":
            return ["s", *cells[1:]]
    return ["s"]


def _sampled_cells(body: list[str], mark: str) -> list[list[str]]:
    """Return the cells of the last SAMPLED lines, and of earlier ones, since a column may be empty
    in the last lines.
    """
    step = max(len(body) // SAMPLED, 1)
    sampled = body[:-SAMPLED:step] + body[-SAMPLED:]
    return [split_line(line, mark) for line in sampled]


def _is_cut(sampled: list[list[str]]) -> bool:
    """Return whether the last row has fewer cells than the two rows before it."""
    widths = {len(cells) for cells in sampled[-3:-1]}
    if len(widths) != 1 or len(sampled[-1]) >= max(widths):
        return False
    return count_numbers(sampled[-2]) > 0


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
    lines: list[str],
    start: int,
    mark: str,
    numeric: list[int],
    width: int,
    file: Path,
) -> int:
    """Return the first line from ``start`` on with only numbers in ``numeric`` cells, or with no
    content above such a line; RecordingError for none.
    """
    top, cells = start, []
    for top in range(start, len(lines)):
        cells = split_line(lines[top], mark)
        if len(cells) == width and _has_numbers([cells[n] for n in numeric]):
            break
    else:
        message = f"no samples: no row of numbers up to the line {lines[-1][:80]!r}; record it or "
        raise RecordingError(f"{message}export it again", file=file)
    if top + 1 < len(lines) and counts_on(cells):
        return top + 1
    while top > start:
        above = split_line(lines[top - 1], mark)
        if len(above) != width or not {*MISSING}.issuperset(above):
            break
        top -= 1
    return top


def _has_numbers(cells: list[str]) -> bool:
    """Return whether the ``cells`` are numbers, at least one, and missing numbers."""
    numbers = [cell for cell in cells if is_number(cell)]
    missing = [cell for cell in cells if cell in MISSING]
    return len(numbers) > 0 and len(numbers) + len(missing) == len(cells)


def _require_no_rows(lines: list[str], places: list[int], file: Path) -> None:
    """Raise RecordingError for a row of numbers, by any separator, in the header ``lines``."""
    for line, place in zip(lines, places, strict=False):
        for mark in SEPARATORS:
            cells = line.split() if mark == delimited.SPACE else split_line(line, mark)
            filled = [cell for cell in cells if cell]
            numbers = count_numbers(filled)
            if 2 < len(filled) == numbers and not counts_on(cells):
                text = line[:80]
                message = f"numbers unlike the rows below, or damaged: {text!r}: {MEND}"
                raise RecordingError(message, file=file, line=place)


def _header(
    lines: list[str],
    places: list[int],
    mark: str,
    last: list[str],
    numeric: list[int],
    file: Path,
) -> tuple[list[str], list[str], int]:
    """Return labels, units and the labels' line; RecordingError for a damaged row above rows."""
    above = [split_line(line.lstrip("#% "), mark) for line in lines]
    width, lowest = len(last), above[-1] if above else []
    numbers = count_numbers([lowest[n] for n in numeric if n < len(lowest)])
    if numbers and len(lowest) in (width, numbers) and not counts_on(lowest):
        message = f"words and numbers in one row: {lines[-1][:80]!r}: {MEND}"
        raise RecordingError(message, file=file, line=places[len(lines) - 1])
    words = [cell for cell in lowest if cell and "=" not in cell]
    if width < len(words):
        message = (
            f"the row has {width} cells under {len(words)} labels up to {words[-1]!r}"
        )
        raise RecordingError(f"{message}: {MEND}", file=file, line=places[len(lines)])

    units: list[str] = []
    for place, line_cells in reversed([*zip(places, above, strict=False)]):
        # cells of settings label no column
        cells = [cell for cell in line_cells if "=" not in cell]
        if not re.search(r"\w", "".join(cells)):
            continue
        filled = delimited.filled_width(cells)
        are_units = all(delimited.is_unit(cell) for cell in cells if cell)
        if len(cells) > 1 and are_units and not units and place > places[0]:
            units = cells
        elif numeric[-1] < filled <= width and (filled > 1 or width == 1):
            labelled = max(filled, delimited.filled_width(last))
            return (cells + [""] * width)[:labelled], units, place
    return [], units, places[len(lines)]
