"""Delimited text of instruments: lines, cells, numbers, and the units in column labels."""

import csv
import io
import re
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.core.errors import RecordingError
from pipeline.core.typed_yaml import read_yaml
from pipeline.formats.format import decoded, file_content

# alternatives begin with different characters, so that no text takes long to match
NUMBER = re.compile(r"\s*[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?\s*")
# "1,250" may be a thousand
QUOTED_DECIMAL = re.compile(r'"[+-]?(\d+,(\d{1,2}|\d{4,})|0+,\d+)"')
# greatest measured number: above any time in ns, and its square is finite
GREATEST = 1e20
# blank cell, and words of C runtimes, Python, MATLAB and spreadsheets for a missing number
MISSING = (
    "",
    *("NaN", "nan", "NAN", "-nan", "-nan(ind)", "1.#QNAN", "-1.#IND"),
    *("None", "none", "null", "NULL", "Null", "N/A", "n/a", "NA", "#N/A"),
)

BLANKS = re.compile("[\xa0\u2009\u202f]")  # blanks that break no line
SPACE = " "  # separator that stands for any number of blanks

_STATED = read_yaml(Path(__file__).with_suffix(".yaml"))
# name → pattern of the beginning, remedy
FOREIGN: dict[str, list[str]] = _STATED.pop("foreign")
_WORDS = _STATED.pop("spellings").items()
SPELLINGS = {word: unit for unit, words in _WORDS for word in words.split()}
# quantity → unit → factor to N, N·m, s or rad
UNITS: dict[str, dict[str, float]] = _STATED
TIME_UNITS = UNITS["time"]
ANGLE_UNITS = UNITS["angle"]
KNOWN = {unit for units in UNITS.values() for unit in units}
UNIT = re.compile(r"(.*?)\s*[(\[]([^()\[\]]*)[)\]]")  # label and its unit in brackets


class Text(NamedTuple):
    """Complete lines of a file, and the text ``cut`` after the last line end, or None. No reader
    uses ``cut``, since a number in it may have lost digits.
    """

    lines: list[str]
    cut: str | None


def read_text(file: Path) -> Text:
    """Return the lines of ``file``; RecordingError if it is unreadable, empty or no text."""
    content = file_content(file)
    if not content.strip():
        raise RecordingError("the file is empty; export or copy it again", file=file)
    if (text := decoded(content)) is None:
        message = (
            "this is not plain text (the file has zero bytes); export it as UTF-8 text"
        )
        raise RecordingError(message, file=file)
    text = BLANKS.sub(" ", text).replace("\ufeff", "")
    *lines, last = text.split("\n")
    return Text(lines, last or "\0" * content.endswith(b"\0\0") or None)


def foreign(text: str) -> tuple[str, str] | None:
    """Return name and remedy of the first format in FOREIGN that matches ``text``, or None."""
    for name, (mark, remedy) in FOREIGN.items():
        if re.match(rf"\s*(?:FILE_VERSION.*\n)?{mark}", text):
            return name, remedy
    return None


def cells_of(line: str, separator: str, *, file: Path, number: int) -> list[str]:
    """Return the stripped cells of line ``number``; RecordingError if a quote does not close."""
    try:
        cells = next(csv.reader([line], delimiter=separator, strict=True), [])
    except csv.Error as error:
        message = f"cannot split this line at {separator!r} ({error})"
        raise RecordingError(message, file=file, line=number) from None
    return [cell.strip() for cell in cells]


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
    """Return the numbers (N, len(columns)) in the ``columns`` of N ``rows``, correctly rounded to
    float64; a missing number is NaN if ``gaps``. Raises RecordingError, with the line number from
    ``line_numbers`` (N,), for a row whose number of cells differs from the first row; in the
    ``columns``, for a cell that is not a number or beyond GREATEST, and a missing one unless
    ``gaps``.
    """
    values = _fast_numbers(rows, columns, separator, decimal)
    too_large = (np.abs(values) > GREATEST).any()
    incomplete = not gaps and np.isnan(values).any()
    sound = len(values) == len(rows) and not (too_large or incomplete)
    if sound and len({row.count(separator) for row in rows}) == 1:
        return values
    width = 0
    for row, line in zip(rows, line_numbers, strict=True):
        cells = cells_of(row, separator, file=file, number=line)
        width = width or len(cells)
        if len(cells) != width:
            raise RecordingError(
                f"the row has {len(cells)} cells where the first has {width}: truncated or damaged",
                file=file,
                line=line,
            )
        for column in columns:
            cell = "".join(cells[column : column + 1])
            fault = _fault_of(cell, decimal, gaps)
            if fault:
                message = f"column {column + 1} {fault}"
                raise RecordingError(message, file=file, line=line)
    if sound:  # quoted separators separate no cells
        return values
    raise RecordingError(f"cannot split the lines at {separator!r}", file=file)


def _fast_numbers(
    rows: list[str],
    columns: list[int],
    separator: str,
    decimal: str,
) -> np.ndarray:
    """Return the numbers (N, len(columns)), (0, 0) where a cell is not a number."""
    try:
        table = pd.read_csv(
            io.StringIO("\n".join(rows)),
            sep=separator,
            decimal=decimal,
            header=None,
            dtype="float64",
            usecols=sorted({*columns}),
            keep_default_na=False,
            na_values=[*MISSING],
            skipinitialspace=True,
            skip_blank_lines=False,
        )
    except ValueError:
        return np.empty((0, 0))
    return table[columns].to_numpy()


def _fault_of(cell: str, decimal: str, gaps: bool) -> str:
    """Return why a ``cell`` is neither a number nor, if ``gaps``, missing; "" if it is."""
    if cell in MISSING:
        return "" if gaps else "has no number; fill it in, or leave the row out"
    plain = cell
    if decimal != ".":
        plain = cell.replace(".", "?").replace(decimal, ".")
    if not NUMBER.fullmatch(plain):
        return f"holds {cell[:80]!r}, not a finite number"
    if abs(float(plain)) > GREATEST:
        return f"holds {cell[:80]!r}, not a finite number up to {GREATEST:g}"
    return ""


def split_line(line: str, mark: str) -> list[str]:
    """Return the cells of a line; a quote that does not close stays in its cell."""
    if '"' in line:
        with suppress(RecordingError):
            return cells_of(line, mark, file=Path(), number=0)
    return [cell.strip().strip('"') for cell in line.split(mark)]


def has_quoted_decimals(lines: list[str]) -> bool:
    """Return whether numbers in quotes have a decimal comma, and no number a point."""
    text = "\n".join(lines)
    return bool(QUOTED_DECIMAL.search(text)) and not re.search(r";|\d\.\d", text)


def is_number(cell: str) -> bool:
    """Return whether a cell is a number, with a decimal point or comma."""
    return NUMBER.fullmatch(cell.replace(",", ".")) is not None


def count_numbers(cells: list[str]) -> int:
    """Return how many cells are numbers."""
    return sum(map(is_number, cells))


def filled_width(cells: list[str]) -> int:
    """Return the number of cells up to the last one with content."""
    return max((n for n, cell in enumerate(cells, start=1) if cell), default=0)


def counts_on(cells: list[str]) -> bool:
    """Return whether ``cells`` are pandas' column numbers: empty or a word, then 0, 1, 2, …"""
    if len(cells) < 3 or is_number(cells[0]):
        return False
    if not all(re.fullmatch(r"\d{1,4}", cell) for cell in cells[1:]):
        return False
    first, *further = map(int, cells[1:])
    return further == [*range(first + 1, first + 1 + len(further))]


def is_rowlike(line: str) -> bool:
    """Return whether a line has a number, and at most as many words as numbers."""
    pieces = re.split(r'[,;\s"]+', line)
    words = 0
    for piece in pieces:
        if piece not in MISSING and re.search(r"^[^\W\d]", piece):
            words += 1
    return words <= count_numbers(pieces) > 0


def separator_of(line: str) -> str:
    """Return the separator of the cells in a line of numbers."""
    for mark in ";\t":
        if mark in line:
            return mark
    pieces = line.split()
    # if no comma touches a blank, blanks separate the cells and commas are decimal marks
    touched = any(piece[0] == "," or piece[-1] == "," for piece in pieces)
    # a blank may also be between a date and a time
    numbers = 2 * count_numbers(pieces) >= len(pieces) or "," not in line
    if len(pieces) > 1 and not touched and numbers and '"' not in line:
        return SPACE
    return ","


def with_nanoseconds(
    rows: list[str],
    labels: list[str],
    mark: str,
    sign: str,
) -> list[str]:
    """Return the ``rows`` with whole nanoseconds, of a column right of whole seconds by the
    ``labels``, as fraction of the seconds also: secs and nsecs, or sec and nanosec.
    """
    stems = []
    for label in labels:
        stems.append(re.fullmatch(r"(.*?)(n|nano|)sec(?:ond)?s?", label.lower()))
    for column, (seconds, fraction) in enumerate(pairwise(stems)):
        if not seconds or not fraction or seconds[1] != fraction[1]:
            continue
        if fraction[2] and not seconds[2]:
            before = rf"(?:[^{mark}]*{mark}){{{column}}}"
            cells = re.compile(rf"^({before}\s*\d+)(?={mark}\s*(\d{{1,9}})(?!\d))")
            return [
                cells.sub(lambda cell: f"{cell[1]}{sign}{cell[2]:0>9}", row)
                for row in rows
            ]
    return rows


def plain_unit(unit: str) -> str:
    """Return ``unit`` without the signs between its factors: N·m, N-m and N m become Nm."""
    return re.sub(r"[-·⋅*.\s]", "", unit)


def spelled(unit: str) -> str:
    """Return a unit of time, angle or length in the spelling of SPELLINGS, without ``/s``."""
    plain = unit.strip().lower().removesuffix("/s")
    return SPELLINGS.get(plain, plain)


def is_unit(word: str) -> bool:
    """Return whether a cell is a unit, with or without brackets."""
    plain = word.strip("()[] ")
    return plain in KNOWN or plain_unit(plain) in KNOWN or spelled(plain) in KNOWN


def bare(label: str) -> str:
    """Return the label without the unit in brackets behind it."""
    return UNIT.fullmatch(label)[1] if unit_of(label) else label


def unit_of(label: str) -> str | None:
    """Return the unit in brackets behind a label, or None; ``q[0]`` and ``q(1)`` have no unit."""
    match = UNIT.fullmatch(label)
    return match[2] if match and not re.fullmatch(r"\s*\d*\s*", match[2]) else None


def unit_in_name(name: str, kind: str) -> str:
    """Return the unit of the ``kind`` (angle or time) that is a word of ``name``, as in q_deg_0 and
    t_ms; "" for none, or two.
    """
    words = map(spelled, re.findall(r"[A-Za-zµ]{2,}", name))
    units = {*UNITS[kind], *UNITS[f"unread_{kind}"]}
    stated = units.intersection(words)
    return stated.pop() if len(stated) == 1 else ""
