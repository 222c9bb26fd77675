"""Delimited text of instruments: lines, cells, numbers, and the units in column labels."""

import csv
import io
import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.core.errors import RecordingError
from pipeline.formats.format import decoded, file_content

# alternatives begin with different characters, so that no text takes long to match
NUMBER = re.compile(r"\s*[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?\s*")
GREATEST = 1e20  # greatest measured number: above any time in ns, and its square is finite
# blank cell, and words of C runtimes, Python, MATLAB and spreadsheets for a missing number
MISSING = ("", "NaN", "nan", "NAN", "-nan", "-nan(ind)", "1.#QNAN", "-1.#IND", "None", "none")
MISSING += ("null", "NULL", "Null", "N/A", "n/a", "NA", "#N/A")

LONGEST_GAP = 10  # longest interpolated gap, in median steps of the column
SPARSEST = 50  # greatest number of rows per number in a column
SPACE = " "  # separator that stands for any number of blanks
# formats that resemble tables: pattern of the beginning, name, remedy
NEXUS = r'"?(Trajectories|Joints|Segments|Model Outputs?|Devices|Events|Analog EMG)"?[\s,;]*\n'
FOREIGN = (
    (r"PathFileType\b", "TRC (OpenSim, Cortex)", "export C3D from the same program"),
    (r"NO_OF_(FRAMES|CAMERAS)\b", "TSV of Qualisys Track Manager", "export C3D from QTM"),
    (rf"(?i:{NEXUS}[\s,;]*[\d.]+(,Hz)?[\s,;]*\n)", "ASCII export of Vicon", "export C3D there"),
    (r"HIERARCHY\b", "BVH file of motion capture", "export C3D from the same program"),
    (r"# oST version", "INI file of a camera calibration by ROS", "take ost.yaml, saved beside it"),
    (r"P[123]\s", "image whose pixels are text (PBM, PGM, PPM)", "save it as PNG of 16 bits"),
    (r"(?:<\?xml[^>]*>\s*)?<(?:sdf|mujoco)\b", "robot in SDF or MJCF", "convert it to URDF"),
    (r"(?s:.{0,99}?<.{0,4000}?)\bxacro\b", "xacro", "expand it with xacro FILE > arm.urdf"),
)

_LBF, _KGF, _INCH = 4.4482216152605, 9.80665, 0.0254
# unit → N; ATI's programs write forces in lb, klb, kg and g
FORCE_UNITS = {"N": 1.0, "kN": 1e3, "lbf": _LBF, "klbf": 1e3 * _LBF, "kgf": _KGF, "gf": 1e-3 * _KGF}
FORCE_UNITS |= {"lb": _LBF, "klb": 1e3 * _LBF, "kg": _KGF, "g": 1e-3 * _KGF}
# unit → N·m
TORQUE_UNITS = {"Nm": 1.0, "Nmm": 1e-3, "Ncm": 1e-2, "kNm": 1e3}
TORQUE_UNITS |= dict.fromkeys(("lbfin", "lbin", "inlb", "inlbf"), _LBF * _INCH)
TORQUE_UNITS |= dict.fromkeys(("lbfft", "lbft", "ftlb", "ftlbf"), _LBF * 12 * _INCH)
TORQUE_UNITS |= dict.fromkeys(("kgfcm", "kgcm"), 1e-2 * _KGF)
LENGTH_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": _INCH, "ft": 12 * _INCH}  # m
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}  # s
ANGLE_UNITS = {"rad": 1.0, "deg": np.pi / 180}
_WORDS = {
    "rad": "radian radians",
    "deg": "degree degrees °",
    "s": "sec secs second seconds [s]",
    "ms": "millisecond milliseconds msec",
    "us": "µs μs usec microsecond microseconds",
    "ns": "nsec nanosecond nanoseconds",
    "m": "meter meters metre metres",
    "cm": "centimeter centimeters centimetre centimetres",
    "mm": "millimeter millimeters millimetre millimetres",
}
SPELLINGS = {word: unit for unit, words in _WORDS.items() for word in words.split()}
UNIT = re.compile(r"(.*?)\s*[(\[]([^()\[\]]*)[)\]]")  # label and its unit in brackets
KNOWN = {*FORCE_UNITS, *TORQUE_UNITS, *LENGTH_UNITS, *TIME_UNITS, *ANGLE_UNITS, "A", "V", "Hz", "-"}


class Samples(NamedTuple):
    """Complete rows of chosen columns: every cell has a number."""

    values: np.ndarray  # (M, columns)
    rows: np.ndarray  # (M,) row numbers in the table, from 0
    # rows_without_numbers, rows_without_measured_angle (numbers in other columns alone) and
    # incomplete_end_rows (all left out), interpolated_cells
    counts: dict[str, int]


@dataclass(frozen=True)
class Text:
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
        message = "this is not plain text (the file has zero bytes); export it as UTF-8 text"
        raise RecordingError(message, file=file)
    *lines, last = text.split("\n")
    return Text(lines, last or None)


def foreign(text: str) -> tuple[str, str] | None:
    """Return name and remedy of the first format in FOREIGN that matches ``text``, or None."""
    fits = (known for mark, *known in FOREIGN if re.match(rf"\s*(?:FILE_VERSION.*\n)?{mark}", text))
    return next(map(tuple, fits), None)


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
    ``columns``, for a cell that is no number or beyond GREATEST, and a missing one unless ``gaps``.
    """

    def cells_at(row: int) -> list[str]:
        return cells_of(rows[row], separator, file=file, number=line_numbers[row])

    marks = [row.count(separator) for row in rows]
    for row in (row for row, count in enumerate(marks) if count != marks[0]):
        # quoted separators do not separate cells, so count the cells
        if (width := len(cells_at(row))) != (first := len(cells_at(0))):
            message = f"the row has {width} cells where the first has {first}: truncated or damaged"
            raise RecordingError(message, file=file, line=line_numbers[row])
    form = {"sep": separator, "decimal": decimal, "header": None, "dtype": "float64"}
    form |= {"usecols": sorted({*columns}), "keep_default_na": False, "na_values": [*MISSING]}
    form |= {"skipinitialspace": True, "skip_blank_lines": False}
    try:
        values = pd.read_csv(io.StringIO("\n".join(rows)), **form)[columns].to_numpy()
    except ValueError:
        values = np.empty((0, 0))
    sound = len(values) == len(rows) and not (np.abs(values) > GREATEST).any()
    if sound and (gaps or not np.isnan(values).any()):
        return values
    for row, line in enumerate(line_numbers):
        cells = dict(enumerate(cells_at(row)))
        for column in columns:
            cell = cells.get(column, "")
            plain = cell if decimal == "." else cell.replace(".", "?").replace(decimal, ".")
            is_number = NUMBER.fullmatch(plain) and abs(float(plain)) <= GREATEST
            if not (is_number or (gaps and cell in MISSING)):
                message = f"column {column + 1} has no number; fill it in, or leave the row out"
                if cell not in MISSING:
                    message = f"column {column + 1} holds {cell[:80]!r}, not a finite number"
                    message += f" up to {GREATEST:g}" if NUMBER.fullmatch(plain) else ""
                raise RecordingError(message, file=file, line=line)
    raise RecordingError(f"cannot split the lines at {separator!r}", file=file)


def complete_rows(
    values: np.ndarray, clock: int | None, leading: list[int]
) -> tuple[Samples | None, tuple[str, int, int] | None]:
    """Return the rows of ``values`` (N, columns) with a number in a ``leading`` column, and None;
    or None, and the first fault as problem, column and row. A missing cell between two numbers of
    its column is interpolated linearly over the column ``clock`` (default the row number). Rows
    before the first or after the last number of a column are left out. Faults are a row without a
    time, a gap of more than LONGEST_GAP median steps of the column, and a column with fewer than
    two numbers or fewer than one number in SPARSEST rows.
    """
    rows, missing = np.arange(len(values)), np.isnan(values)
    if not missing.any():
        return Samples(values, rows, {}), None
    others = [column for column in range(values.shape[1]) if column != clock]
    rows = rows[~missing[:, others].all(axis=1)]
    filled, missing = values[rows], missing[rows]
    x = rows.astype(float) if clock is None else filled[:, clock]
    if np.isnan(x).any():
        return None, ("has no number", clock, rows[np.isnan(x).argmax()])
    taken = ~missing[:, leading].all(axis=1)
    inside = taken.copy()
    for column in others:
        known = np.flatnonzero(~missing[:, column])
        if len(known) < max(2, len(rows) / SPARSEST):
            problem = f"has {len(known)} numbers in {len(rows)} rows"
            return None, (problem, column, min(rows, default=0))
        inside[: known[0]] = inside[known[-1] + 1 :] = False
        after = np.searchsorted(known, np.arange(len(x))).clip(1, len(known) - 1)
        steps = np.diff(x[known])
        wide = missing[:, column] & inside & (steps[after - 1] > LONGEST_GAP * np.median(steps))
        if wide.any():
            problem = f"has no number in a gap of more than {LONGEST_GAP} of its steps"
            return None, (problem, column, rows[wide.argmax()])
        filled[:, column] = np.interp(x, x[known], filled[known, column])
    if not inside.any():
        return None, ("has no number at the times of the other columns", leading[0], 0)
    counts = {"rows_without_numbers": len(values) - len(rows)}
    counts["rows_without_measured_angle"] = len(rows) - int(taken.sum())
    counts["incomplete_end_rows"] = int(np.sum(taken & ~inside))
    counts["interpolated_cells"] = int(missing[inside].sum())
    counts = {name: count for name, count in counts.items() if count}
    return Samples(filled[inside], rows[inside], counts), None


def split_line(line: str, mark: str) -> list[str]:
    """Return the cells of a line; a quote that does not close stays in its cell."""
    if '"' in line:
        with suppress(RecordingError):
            return cells_of(line, mark, file=Path(), number=0)
    return [cell.strip().strip('"') for cell in line.split(mark)]


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
    numbers = [int(cell) for cell in cells[1:] if re.fullmatch(r"\d{1,4}", cell)]
    return bool(numbers) and numbers == [*range(numbers[0], numbers[0] + len(cells) - 1)]


def is_rowlike(line: str) -> bool:
    """Return whether a line has a number, and at most as many words as numbers."""
    pieces = re.split(r'[,;\s"]+', line)
    words = [piece for piece in pieces if piece not in MISSING and re.search(r"^[^\W\d]", piece)]
    return len(words) <= count_numbers(pieces) > 0


def separator_of(line: str) -> str:
    """Return the separator of the cells in a line of numbers."""
    if mark := next((mark for mark in ";\t" if mark in line), ""):
        return mark
    pieces = line.split()
    # if no comma touches a blank, blanks separate the cells and commas are decimal marks
    spaced = len(pieces) > 1 and not any("," in (piece[0], piece[-1]) for piece in pieces)
    # a blank may also be between a date and a time
    numbers = 2 * count_numbers(pieces) >= len(pieces) or "," not in line
    return SPACE if spaced and numbers and '"' not in line else ","


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
