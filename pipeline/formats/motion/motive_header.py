"""The header of a columnar Motive take: keys with their values, and what each column holds."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import cells_of

TEXTS = ("Take Name", "Take Notes")  # free text, in which a comma is not always quoted
KEYS = (
    "Format Version",
    *TEXTS,
    "Capture Frame Rate",
    "Export Frame Rate",
    "Capture Start Time",
    "Capture Start Frame",
    "Total Frames in Take",
    "Total Exported Frames",
    "Rotation Type",
    "Length Units",
    "Coordinate Space",
)
RAW, SOLVED, BODY = "Marker", "Rigid Body Marker", "Rigid Body"
HEADER_LINES = 20  # with blank ones it is five to eight


@dataclass(frozen=True)
class Header:
    """What the rows above the frames say."""

    fields: dict[str, str]
    time: int | None  # column
    # (type, name, ID): {(quantity, axis): column}
    groups: dict[tuple[str, str, str], dict[tuple[str, str], int]]
    bones: int  # bones and markers of bones, which are not read
    # of each column up to the last with a label, what the header calls it; empty where it does not
    labels: list[str]
    unused: int  # labelled columns that are none of the above
    line: int  # of the axis row


def read_header(lines: list[str], file: Path) -> Header:
    rows = []
    for number, line in enumerate(lines[1:HEADER_LINES], start=2):
        cells = cells_of(line, ",", file=file, number=number)
        if any(cells):
            rows.append(cells)
        if cells[:1] == ["Frame"]:
            break
        if any(cells[:1]):
            raise RecordingError(
                f"a row that starts with {cells[0]!r} stands among the labels of the columns",
                file=file,
                line=number,
            )
    if not rows or rows[-1][0] != "Frame":
        line = min(len(lines), HEADER_LINES)
        raise RecordingError(
            "no row starts with 'Frame': the header is truncated or damaged", file=file, line=line
        )
    if len(rows) < 4:
        raise RecordingError(
            "the rows that give each column's type, name, quantity and axis are incomplete",
            file=file,
            line=number,
        )
    columns = max(map(len, rows))
    rows = [row + [""] * (columns - len(row)) for row in rows]
    named = {row[1]: row for row in rows[:-2] if row[1]}
    if named and not {"Type", "Name"} <= set(named):
        raise RecordingError(
            f"column B names the rows {', '.join(named)}, but not Type and Name",
            file=file,
            line=number,
        )
    types, names = named.get("Type", rows[0]), named.get("Name", rows[1])
    identities = named.get("ID", rows[2] if len(rows) > 4 and not named else [""] * columns)
    quantities, axes = rows[-2:]
    groups: dict[tuple[str, str, str], dict[tuple[str, str], int]] = {}
    for column, label in enumerate(zip(quantities, axes, strict=True)):
        if types[column] in (RAW, SOLVED, BODY) and label[0] in ("Position", "Rotation"):
            group = groups.setdefault((types[column], names[column], identities[column]), {})
            if label in group:
                raise RecordingError(
                    f"two columns claim {' '.join(label)} of {names[column]!r}",
                    file=file,
                    line=number,
                )
            group[label] = column
    for (kind, name, _), group in groups.items():
        if any(("Position", axis) not in group for axis in "XYZ"):
            raise RecordingError(
                f"{kind} {name!r} lacks one of its columns X, Y, Z of Position",
                file=file,
                line=number,
            )
    time = next(
        (column for column, axis in enumerate(axes) if axis in ("Time", "Time (Seconds)")), None
    )
    bones = {(kind, name) for kind, name in zip(types, names, strict=True) if "Bone" in kind}
    unused = sum(map(bool, types[2:])) - sum(map(len, groups.values()))
    return Header(
        _fields(cells_of(lines[0], ",", file=file, number=1), file),
        time,
        groups,
        len(bones),
        _labels(rows),
        unused,
        number,
    )


def _labels(rows: list[list[str]]) -> list[str]:
    labels = [" ".join(dict.fromkeys(filter(None, column))) for column in zip(*rows, strict=True)]
    while not labels[-1]:
        del labels[-1]
    return labels


def _fields(cells: list[str], file: Path) -> dict[str, str]:
    # a value may be missing, and a text hold a comma that nobody quoted: it ends at the next known
    # key
    starts = [place for place, cell in enumerate(cells) if cell in KEYS] + [len(cells)]
    fields: dict[str, str] = {}
    for i, j in pairwise(starts):
        value = (
            ",".join(cells[i + 1 : j]).strip(",")
            if cells[i] in TEXTS
            else next(iter(cells[i + 1 : j]), "")
        )
        if fields.setdefault(cells[i], value) != value:
            raise RecordingError(
                f"the header gives {cells[i]} twice, and differently",
                file=file,
                line=1,
                key=cells[i],
            )
    if fields.get("Coordinate Space", "Global") not in ("Global", ""):
        raise RecordingError(
            "the Coordinate Space is not Global; export the take in Global",
            file=file,
            line=1,
            key="Coordinate Space",
        )
    return fields
