"""Labels of columns: their units in brackets, and which column is the one of a label."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from pipeline.core.errors import RecordingError

UNIT = re.compile(r"(.*)[(\[]([^()\[\]]*)[)\]]")  # a label and, in brackets, its unit


def bare(label: str) -> str:
    """The label without a unit in brackets behind it."""
    match = UNIT.fullmatch(label)
    return match[1].rstrip() if match else label


def unit_of(label: str) -> str | None:
    """The unit in brackets behind a label, where there is one."""
    match = UNIT.fullmatch(label)
    return match[2] if match else None


def columns_of(
    labels: list[str],
    wanted: Mapping[str, str | int],
    width: int,
    *,
    file: Path,
    line: int,
    key: str,
) -> dict[str, int]:
    """The column of each quantity that ``wanted`` names by a label, with or without the unit behind
    it, or by a number from 0.

    Raises RecordingError for a label that is not there or there twice, and a number beyond the
    ``width`` of the rows.
    """
    columns = {}
    for quantity, name in wanted.items():
        if isinstance(name, int):
            if not 0 <= name < width:
                raise RecordingError(
                    f"{quantity} is column {name} (from 0) of rows of {width} cells",
                    file=file,
                    line=line,
                    key=key,
                )
            columns[quantity] = name
            continue
        places = [column for column, label in enumerate(labels) if name in (label, bare(label))]
        if len(places) != 1:
            shown = ", ".join(labels) or "nothing"
            message = (
                f"{len(places)} columns are labelled {name!r} for {quantity}; there "
                f"is {shown}. A number from 0 names a column too"
            )
            raise RecordingError(message, file=file, line=line, key=key)
        columns[quantity] = places[0]
    return columns
