"""The columnar grammar of OptiTrack Motive's CSV takes (format versions 1.2 to 1.25): read by
labels, whatever their order.

A file has one row of keys and values, a blank row, rows that label every column (Type, Name, ID, in
later versions Parent, then the quantity, then Frame, Time and the axes), and one row a frame. From
1.22 on column B names the rows of labels; before, their order does.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from pipeline.core.bounds import require
from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import Text, cells_of, is_blank, numbers_of
from pipeline.formats.motion.take import (
    WHOLE,
    MotionTake,
    RigidBody,
    checked_position,
    checked_rotation,
    clock_counts,
    frame_numbers,
    keeps_time,
    rate_from_times,
    sample_counts,
    settle_unit,
)

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
FRAME = 0  # the axis row is the one that starts with "Frame"


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
    """Return what the rows above the frames say; RecordingError, with the line, where they do not
    label the columns.
    """
    rows, number = [], 1

    def fault(message: str) -> RecordingError:
        return RecordingError(message, file=file, line=number)

    for number, line in enumerate(lines[1:HEADER_LINES], start=2):
        cells = cells_of(line, ",", file=file, number=number)
        if any(cells):
            rows.append(cells)
        if cells[:1] == ["Frame"]:
            break
        if any(cells[:1]):
            raise fault(
                f"a row that starts with {cells[0]!r} stands among the labels of the columns"
            )
    if not rows or rows[-1][0] != "Frame":
        raise fault("no row starts with 'Frame': the header is truncated or damaged")
    if len(rows) < 4:
        raise fault("the rows that give each column's type, name, quantity and axis are incomplete")
    columns = max(map(len, rows))
    rows = [row + [""] * (columns - len(row)) for row in rows]
    named = {row[1]: row for row in rows[:-2] if row[1]}
    if named and not {"Type", "Name"} <= set(named):
        raise fault(f"column B names the rows {', '.join(named)}, but not Type and Name")
    types, names = named.get("Type", rows[0]), named.get("Name", rows[1])
    identities = named.get("ID", rows[2] if len(rows) > 4 and not named else [""] * columns)
    quantities, axes = rows[-2:]
    groups: dict[tuple[str, str, str], dict[tuple[str, str], int]] = {}
    for column, label in enumerate(zip(quantities, axes, strict=True)):
        if types[column] in (RAW, SOLVED, BODY) and label[0] in ("Position", "Rotation"):
            group = groups.setdefault((types[column], names[column], identities[column]), {})
            if label in group:
                raise fault(f"two columns claim {' '.join(label)} of {names[column]!r}")
            group[label] = column
    for (kind, name, _), group in groups.items():
        if any(("Position", axis) not in group for axis in "XYZ"):
            raise fault(f"{kind} {name!r} lacks one of its columns X, Y, Z of Position")
    time = next(
        (column for column, axis in enumerate(axes) if axis in ("Time", "Time (Seconds)")), None
    )
    bones = {(kind, name) for kind, name in zip(types, names, strict=True) if "Bone" in kind}
    unused = sum(map(bool, types[2:])) - sum(map(len, groups.values()))
    fields = _fields(cells_of(lines[0], ",", file=file, number=1), file)
    return Header(fields, time, groups, len(bones), _labels(rows), unused, number)


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


def read_columns(text: Text, file: Path, unit: str | None) -> MotionTake:
    """Take in the columnar ``text`` of ``file``; see
    :func:`pipeline.formats.motion.motive.read_motive` for what it holds and raises.
    """
    header = read_header(text.lines, file)
    require("markers", len(header.groups), "markers and bodies", file)
    rows, numbers, repeated = _rows(text, header, file)
    counts = {
        "blank_rows": len(text.lines) - header.line - len(rows) - repeated,
        "cut_rows": int(text.cut is not None),
    }
    groups = header.groups
    columns = [FRAME] + [column for group in groups.values() for column in group.values()]
    columns += [] if header.time is None else [header.time]
    values = dict(
        zip(columns, numbers_of(rows, numbers, columns, file=file, gaps=True).T, strict=True)
    )
    frame = frame_numbers(values[FRAME], numbers, file)
    printed = None if header.time is None else values[header.time]
    rate = _rate(header.fields, frame, printed, file)
    time = (frame - frame[0]) / rate
    if WHOLE.fullmatch(header.fields.get("Total Exported Frames", "")):
        counts["announced_frames"] = int(header.fields["Total Exported Frames"])
    counts |= clock_counts(frame, time, printed)
    counts |= {"zero_samples": 0, "partial_samples": 0, "solved_replaced": 0, "solved_only": 0}

    unit = settle_unit(header.fields.get("Length Units", ""), unit, file, key="Length Units")
    raw, solved, bodies = {}, {}, {}
    # a name that two assets share names neither of them: who asks for it has to say which
    named = Counter((kind, name) for kind, name, _ in groups)
    shared = {name for (_, name), number in named.items() if number > 1}
    for (kind, name, identity), group in groups.items():
        places = [group["Position", axis] for axis in "XYZ"]

        def place(k: int, axis: int | None = None, places: list[int] = places) -> dict[str, object]:
            at = {} if axis is None else {"column": places[axis] + 1}
            return {"file": file, "line": numbers[k]} | at

        position = np.stack([values[column] for column in places], axis=-1)
        position = checked_position(position, name, unit, place, counts)
        key = f"{name} [{identity}]" if name in shared else name
        if kind != BODY:
            {RAW: raw, SOLVED: solved}[kind][key] = position
            continue
        rotation = {axis: values[group[what, axis]] for what, axis in group if what == "Rotation"}
        quaternion = _quaternion(rotation, header.fields.get("Rotation Type", ""), file)
        bodies[key] = RigidBody(position, checked_rotation(quaternion, name, place, counts))
    for name, position in solved.items():
        counts["solved_replaced" if name in raw else "solved_only"] += 1
        raw.setdefault(name, position)
    counts |= sample_counts(raw, bodies, len(frame)) | {"unused_columns": header.unused}
    rare = {"repeated_rows": repeated, "skipped_bones": header.bones}
    counts |= {name: count for name, count in rare.items() if count}
    name, version = (
        header.fields.get("Take Name") or Path(file).stem,
        header.fields["Format Version"],
    )
    timed = None if printed is None else rate_from_times(frame, printed)
    return MotionTake(name, version, rate, frame, time, raw, bodies, counts, unit, timed)


def _rows(text: Text, header: Header, file: Path) -> tuple[list[str], list[int], int]:
    """The rows of frames, their lines, and how many were left out for repeating the one before them
    to the letter.
    """
    rows, numbers, repeated = [], [], 0
    unlabelled = [column for column, label in enumerate(header.labels) if not label]
    for number, line in enumerate(text.lines[header.line :], start=header.line + 1):
        if is_blank(line, ","):
            continue
        row = _labelled(line, header.labels, unlabelled, file, number)
        if rows and row == rows[-1]:
            repeated += 1
        else:
            rows.append(row)
            numbers.append(number)
    if text.cut is not None and text.cut.count(",") + 1 < len(header.labels):
        raise RecordingError(
            "the last row is cut short; export or copy the take again",
            file=file,
            line=len(text.lines) + 1,
        )
    if not rows:
        raise RecordingError(
            "the header is followed by no frame; export the take again", file=file, line=header.line
        )
    if not any(row.rpartition(",")[2].strip() for row in rows) and any(
        row.split(",")[-2].strip() for row in rows
    ):
        raise RecordingError(
            f"no row has anything in the last labelled column, {header.labels[-1]}, though in the "
            "one before it: a column is missing, and the others are shifted; export the take again",
            **_place(file, numbers[0], len(header.labels) - 1),
        )
    if not header.groups:
        lacking = (
            "it holds bones alone" if header.bones else "no column but the frames' is labelled"
        )
        raise RecordingError(
            f"the take holds no marker and no rigid body ({lacking}); export it with them",
            file=file,
            line=header.line,
        )
    return rows, numbers, repeated


def _labelled(line: str, labels: list[str], unlabelled: list[int], file: Path, number: int) -> str:
    """The cells of a row that have a label; spreadsheets pad rows with empty ones.

    RecordingError for a row with fewer, and for one with content in a column without a label: it is
    shifted, or of another take.
    """
    cells = line.split(",")
    if len(cells) < len(labels):
        raise RecordingError(
            f"the row has {len(cells)} cells where the header labels {len(labels)} columns; the "
            f"last one is {labels[-1]}. Which column lacks? Export the take again",
            **_place(file, number, len(cells)),
        )
    for column in [*unlabelled, *range(len(labels), len(cells))]:
        if cells[column].strip():
            raise RecordingError(
                f"there is {cells[column].strip()!r} in a column without a label: of another take, "
                "or with decimal commas; export it again, with decimal points",
                **_place(file, number, column),
            )
    return ",".join(cells[: len(labels)])


def _place(file: Path, line: int, column: int) -> dict[str, object]:
    return {"file": file, "line": line, "column": column + 1}


def _rate(
    fields: dict[str, str], frame: np.ndarray, printed: np.ndarray | None, file: Path
) -> float:
    # frames are numbered at the rate of the export, which older versions do not tell apart from the
    # capture's
    key = "Export Frame Rate" if fields.get("Export Frame Rate") else "Capture Frame Rate"
    timed = None if printed is None else rate_from_times(frame, printed)
    if not fields.get(key):
        if timed is None:
            raise RecordingError(
                "the file gives no frame rate and no times to take it from",
                file=file,
                line=1,
                key=key,
            )
        return timed
    try:
        rate = float(fields[key])
    except ValueError:
        rate = np.nan
    if not 0 < rate < np.inf:
        raise RecordingError(f"a frame rate of {fields[key]!r} is none", file=file, line=1, key=key)
    if printed is not None and not keeps_time(frame, printed, rate):
        message = f"frames are {rate:g} a second by the header and {timed or 0:.6g} by their times"
        raise RecordingError(f"{message}; export the take again", file=file, line=1, key=key)
    return rate


def _quaternion(rotation: dict[str, np.ndarray], order: str, file: Path) -> np.ndarray:
    """Return (N, 4) of columns of quaternions, or of angles in degrees about the moving axes."""
    from scipy.spatial.transform import Rotation

    if set(rotation) == set("XYZW"):
        return np.stack([rotation[axis] for axis in "XYZW"], axis=-1)
    if set(rotation) != set("XYZ") or sorted(order) != ["X", "Y", "Z"]:
        columns = ", ".join(sorted(rotation)) or "none"
        found = f"Rotation Type is {order!r}" if order else "the header has no Rotation Type"
        raise RecordingError(
            f"{found}, and the Rotation columns are {columns}: angles need their order there, such "
            "as XYZ, quaternions X, Y, Z and W; export the take with quaternions, or write the "
            "order of the angles after Rotation Type in the first row",
            file=file,
            line=1,
            key="Rotation Type",
        )
    angles = np.stack([rotation[axis] for axis in order], axis=-1)
    tracked = ~np.isnan(angles).any(axis=-1)
    quaternion = np.full((len(angles), 4), np.nan)
    if tracked.any():
        quaternion[tracked] = Rotation.from_euler(order, angles[tracked], degrees=True).as_quat()
    return quaternion
