"""Cells of the lines of a table: separators, labels with units, numbers, and exports of other
programs that look like tables.
"""

from __future__ import annotations

import re
from pathlib import Path

from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import MISSING, NUMBER, cells_of

SPACE = " "  # as a separator: any number of blanks
SEPARATORS = (",", ";", "\t", SPACE)
SAMPLED = 40  # last lines that tell columns of numbers from others
HALF = 0.5  # of these lines hold a number in a column of numbers
DATE = re.compile(r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}|\d{1,2}:\d{2}(:\d{2})?")
UNIT = re.compile(r"(.*?)\s*[(\[]([^()\[\]]*)[)\]]")  # a label and, in brackets, its unit

# exports of motion capture that look like tables: how they begin, their name, what to export
NEXUS = r'\s*"?(Trajectories|Joints|Segments|Model Outputs?|Devices|Events|Analog EMG)"?[\s,;]*\n'
FOREIGN = (
    (re.compile(r"PathFileType\b"), "TRC (OpenSim, Cortex)", "export C3D from the same program"),
    (re.compile(r"NO_OF_FRAMES\b"), "TSV of Qualisys Track Manager", "export C3D from QTM"),
    (
        re.compile(NEXUS + r"[\s,;]*\d+(\.\d+)?[\s,;]*\n", re.IGNORECASE),
        "ASCII export of Vicon Nexus",
        "export C3D from Nexus",
    ),
)


def bare(label: str) -> str:
    """Return the label without a unit in brackets behind it."""
    return UNIT.fullmatch(label)[1] if unit_of(label) else label


def unit_of(label: str) -> str | None:
    """Return the unit in brackets behind a label, None where there is none; an index, as in
    ``q[0]`` or ``q(1)``, is no unit.
    """
    match = UNIT.fullmatch(label)
    return match[2] if match and not re.fullmatch(r"\s*\d*\s*", match[2]) else None


def foreign(text: str) -> tuple[str, str] | None:
    """Return the name of the known format that ``text`` begins like and that is no table, and what
    to export instead.
    """
    return next(((name, advice) for mark, name, advice in FOREIGN if mark.match(text)), None)


def separator_of(line: str) -> str:
    for mark in ";\t":
        if mark in line:
            return mark
    pieces = line.split()
    # commas that never touch a blank are decimal marks of cells that blanks keep apart
    spaced = len(pieces) > 1 and not any(
        piece.startswith(",") or piece.endswith(",") for piece in pieces
    )
    # a date and a time have a blank between them too
    numbers = count_numbers(pieces) >= HALF * len(pieces) or "," not in line
    return SPACE if spaced and numbers and '"' not in line else ","


def split_cells(line: str, mark: str) -> list[str]:
    """The cells of a line, roughly: quotes that do not close are the reader's to refuse."""
    if '"' not in line:
        return [cell.strip() for cell in line.split(mark)]
    try:
        return cells_of(line, mark, file=Path(), number=0)
    except RecordingError:
        return [cell.strip().strip('"') for cell in line.split(mark)]


def stripped(cells: list[str]) -> list[str]:
    """The cells up to the last one with content."""
    return cells[: max((n for n, cell in enumerate(cells, start=1) if cell), default=0)]


def is_number(cell: str) -> bool:
    return NUMBER.fullmatch(cell.replace(",", ".")) is not None


def count_numbers(cells: list[str]) -> int:
    return sum(map(is_number, cells))


def numeric_columns(split: list[list[str]]) -> list[int]:
    """The columns that hold numbers in at least half of the last lines that are as wide as the last
    one, from the last line up to one that holds none.
    """
    alike = []
    for cells in reversed(split):
        if len(cells) == len(split[-1]):
            if not any(is_number(cell) or cell in MISSING[1:] for cell in cells):
                break
            alike.append(cells)
    shares = [sum(map(is_number, column)) / len(alike) for column in zip(*alike, strict=True)]
    return [column for column, share in enumerate(shares) if share >= HALF]


def is_row(line: str, mark: str, width: int, numeric: list[int]) -> bool:
    cells = split_cells(line, mark)
    held = [cells[column] for column in numeric] if len(cells) == width else []
    return count_numbers(held) > 0 and all(is_number(cell) or cell in MISSING for cell in held)


def counts_on(cells: list[str]) -> bool:
    """Whether cells are labels that are numbers: nothing or a word, then whole numbers by one."""
    if len(cells) < 3 or is_number(cells[0]):
        return False
    numbers = [int(cell) for cell in cells[1:] if re.fullmatch(r"\d{1,4}", cell)]
    return numbers == [*range(numbers[0], numbers[0] + len(cells) - 1)] if numbers else False
