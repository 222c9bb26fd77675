"""The columnar grammar of OptiTrack Motive's CSV takes (format versions 1.2 to 1.25): one row of
keys and values, rows that label every column (Type, Name, ID, in later versions Parent, then the
quantity, then Frame, Time and the axes), and one row a frame. From 1.22 on column B names the rows
of labels; before, their order does.
"""

from __future__ import annotations

from collections import Counter
from itertools import pairwise, zip_longest
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.core.bounds import require
from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import Text, cells_of, is_blank, numbers_of
from pipeline.formats.motion.take import (
    FROM_TIMES,
    NO_ASSET,
    WHOLE,
    MotionTake,
    TakeBuilder,
    frame_numbers,
    keeps_time,
    rate_from_times,
    settle_unit,
)

RATES = ("Capture Frame Rate", "Export Frame Rate")
TEXTS = ("Take Name", "Take Notes")  # free text, in which a comma is not always quoted
KEYS = ("Format Version", *TEXTS, *RATES, "Capture Start Time", "Capture Start Frame")
KEYS += ("Total Frames in Take", "Total Exported Frames", "Rotation Type", "Length Units")
KEYS += ("Coordinate Space",)
RAW, SOLVED, BODY = "Marker", "Rigid Body Marker", "Rigid Body"
HEADER_LINES = 20  # with blank ones it is five to eight


class ColumnLabels(NamedTuple):
    """Rows above the frames."""

    time: int | None  # column
    # (type, name, ID): {(quantity, axis): column}
    groups: dict[tuple[str, str, str], dict[tuple[str, str], int]]
    bones: int  # bones and markers of bones, which are not read
    labels: list[str]  # of each column up to the last with one
    unused: int  # labelled columns that are none of the above
    line: int  # of the axis row


def _labels(lines: list[str], file: Path) -> ColumnLabels:
    """Return the rows above the frames; RecordingError where they do not label the columns."""
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
            raise fault(f"a row that starts with {cells[0]!r} is among the labels of the columns")
    if not rows or rows[-1][0] != "Frame":
        raise fault("no row starts with 'Frame': the header is truncated or damaged")
    if len(rows) < 4:
        raise fault("the rows that give each column's type, name, quantity and axis are incomplete")
    rows = [[*row] for row in zip(*zip_longest(*rows, fillvalue=""), strict=True)]
    named = {row[1]: row for row in rows[:-2] if row[1]}
    if named and not {"Type", "Name"} <= {*named}:
        raise fault(f"column B names the rows {', '.join(named)}, but not Type and Name")
    types, names = named.get("Type", rows[0]), named.get("Name", rows[1])
    identities = named.get("ID", rows[2] if len(rows) > 4 and not named else [""] * len(types))
    groups: dict[tuple[str, str, str], dict[tuple[str, str], int]] = {}
    for column, (kind, *asset, quantity, axis) in enumerate(
        zip(types, names, identities, *rows[-2:], strict=True)
    ):
        if kind in (RAW, SOLVED, BODY) and quantity in ("Position", "Rotation"):
            group = groups.setdefault((kind, *asset), {})
            if group.setdefault((quantity, axis), column) != column:
                raise fault(f"two columns claim {quantity} {axis} of {asset[0]!r}")
    for (kind, name, _), group in groups.items():
        if any(("Position", axis) not in group for axis in "XYZ"):
            raise fault(f"{kind} {name!r} lacks one of its columns X, Y, Z of Position")
    bones = {(kind, name) for kind, name in zip(types, names, strict=True) if "Bone" in kind}
    if not groups:
        lacking = "it holds bones alone" if bones else "no column but the frames' is labelled"
        raise fault(f"{NO_ASSET} ({lacking}); export it with them")
    time = next((n for n, axis in enumerate(rows[-1]) if axis in ("Time", "Time (Seconds)")), None)
    unused = sum(map(bool, types[2:])) - sum(map(len, groups.values()))
    labels = [" ".join(dict.fromkeys(filter(None, column))) for column in zip(*rows, strict=True)]
    while not labels[-1]:
        del labels[-1]
    return ColumnLabels(time, groups, len(bones), labels, unused, number)


def _fields(line: str, file: Path) -> dict[str, str]:
    """Return the keys and values of the first row; a text with a comma that nobody quoted ends at
    the next known key.
    """
    cells = cells_of(line, ",", file=file, number=1)
    starts = [place for place, cell in enumerate(cells) if cell in KEYS] + [len(cells)]
    fields: dict[str, str] = {}
    for i, j in pairwise(starts):
        held = cells[i + 1 : j]
        value = ",".join(held).strip(",") if cells[i] in TEXTS else "".join(held[:1])
        if fields.setdefault(cells[i], value) != value:
            message = f"the header gives {cells[i]} twice, and differently"
            raise RecordingError(message, file=file, line=1, key=cells[i])
    if fields.get("Coordinate Space", "Global") not in ("Global", ""):
        message = "the Coordinate Space is not Global; export the take in Global"
        raise RecordingError(message, file=file, line=1, key="Coordinate Space")
    return fields


def read_columns(text: Text, file: Path, unit: str | None) -> MotionTake:
    """Return the take in the columnar ``text``; see :func:`..motive.read_motive`."""
    header = _labels(text.lines, file)
    fields, groups = _fields(text.lines[0], file), header.groups
    require("markers", len(groups), "markers and bodies", file)
    rows, numbers, repeated = _rows(text, header, file)
    columns = [0] + [column for group in groups.values() for column in group.values()]
    columns += [] if header.time is None else [header.time]
    table = numbers_of(rows, numbers, columns, file=file, gaps=True)
    values = dict(zip(columns, table.T, strict=True))
    frame = frame_numbers(values[0], numbers, file)
    printed = None if header.time is None else values[header.time]
    counts = {"blank_rows": len(text.lines) - header.line - len(rows) - repeated}
    counts["cut_rows"] = int(text.cut is not None)
    if WHOLE.fullmatch(fields.get("Total Exported Frames", "")):
        counts["announced_frames"] = int(fields["Total Exported Frames"])
    rate = _rate(fields, frame, printed, file)
    unit = settle_unit(fields.get("Length Units", ""), unit, file, key="Length Units")
    take = TakeBuilder(unit, frame, rate, printed, counts)
    take.counts |= {"solved_replaced": 0, "solved_only": 0}
    solved = {}
    # a name that two assets share names neither of them: who asks for it has to say which
    named = Counter((kind, name) for kind, name, _ in groups)
    shared = {name for (_, name), number in named.items() if number > 1}
    for (kind, name, identity), group in groups.items():
        places = [group["Position", axis] for axis in "XYZ"]

        def place(k: int, axis: int | None = None, places: list[int] = places) -> dict[str, object]:
            at = {} if axis is None else {"column": places[axis] + 1}
            return {"file": file, "line": numbers[k]} | at

        position = np.stack([values[column] for column in places], axis=-1)
        key = f"{name} [{identity}]" if name in shared else name
        if kind == BODY:
            turn = {axis: values[group[what, axis]] for what, axis in group if what == "Rotation"}
            quaternion = _quaternion(turn, fields.get("Rotation Type", ""), file)
            take.bodies[key] = take.body(position, quaternion, name, place)
        else:
            held = take.markers if kind == RAW else solved
            held[key] = take.position(position, name, place)
    more = {"solved_replaced": len({*solved} & {*take.markers})}
    more["solved_only"] = len(solved) - more["solved_replaced"]
    take.markers = take.markers | {n: v for n, v in solved.items() if n not in take.markers}
    more["unused_columns"] = header.unused
    rare = {"repeated_rows": repeated, "skipped_bones": header.bones}
    more |= {name: count for name, count in rare.items() if count}
    stated = any(fields.get(key) for key in RATES)
    named = fields.get("Take Name") or Path(file).stem, fields["Format Version"]
    return take.take(*named, more, "" if stated else FROM_TIMES)


def _rows(text: Text, header: ColumnLabels, file: Path) -> tuple[list[str], list[int], int]:
    """Return the rows of frames, their lines, and the number of rows that repeated the one before
    to the letter, which are left out. RecordingError for a row with fewer cells than labels, and
    for content in a column without a label; spreadsheets pad rows with empty cells.
    """
    rows, numbers, repeated, labels = [], [], 0, header.labels

    def fault(message: str, line: int, **column: int) -> RecordingError:
        return RecordingError(f"{message}; export the take again", file=file, line=line, **column)

    unlabelled = [column for column, label in enumerate(labels) if not label]
    for number, line in enumerate(text.lines[header.line :], start=header.line + 1):
        if is_blank(line, ","):
            continue
        cells = line.split(",")
        if len(cells) < len(labels):
            message = f"the row has {len(cells)} cells where the header labels {len(labels)} "
            message += f"columns; the last one is {labels[-1]}"
            raise fault(message, number, column=len(cells) + 1)
        for column in [*unlabelled, *range(len(labels), len(cells))]:
            if cell := cells[column].strip():
                message = f"there is {cell!r} in a column without a label: of another take, or "
                raise fault(f"{message}with decimal commas", number, column=column + 1)
        row = ",".join(cells[: len(labels)])
        if rows and row == rows[-1]:
            repeated += 1
            continue
        rows.append(row)
        numbers.append(number)
    if text.cut is not None and text.cut.count(",") + 1 < len(labels):
        raise fault("the last row is cut short", len(text.lines) + 1)
    if not rows:
        raise fault("the header is followed by no frame", header.line)
    ends = [row.rsplit(",", 2)[-2:] for row in rows]
    if not any(last.strip() for _, last in ends) and any(before.strip() for before, _ in ends):
        message = f"no row has anything in the last labelled column, {labels[-1]}, though in the "
        message += "one before it: a column is missing, and the others are shifted"
        raise fault(message, numbers[0], column=len(labels))
    return rows, numbers, repeated


def _rate(
    fields: dict[str, str], frame: np.ndarray, printed: np.ndarray | None, file: Path
) -> float:
    # of the export, which older versions do not separate from the capture's
    key = RATES[1] if fields.get(RATES[1]) else RATES[0]
    stated = fields.get(key, "")
    timed = None if printed is None else rate_from_times(frame, printed)
    if not stated and timed is not None:
        return timed
    try:
        rate = float(stated)
    except ValueError:
        rate = np.nan
    message = ""
    if not 0 < rate < np.inf:
        found = f"must be > 0, got {stated!r}" if stated else "is missing"
        message = f"the frame rate {found}, and no times give it"
    elif printed is not None and not keeps_time(frame, printed, rate):
        message = f"frames are {rate:g} a second by the header and {timed or 0:.6g} by their times"
    if message:
        raise RecordingError(f"{message}; export the take again", file=file, line=1, key=key)
    return rate


def _quaternion(rotation: dict[str, np.ndarray], order: str, file: Path) -> np.ndarray:
    """Return (N, 4) of columns of quaternions, or of angles in degrees about the moving axes."""
    from scipy.spatial.transform import Rotation

    if {*rotation} == {*"XYZW"}:
        return np.stack([rotation[axis] for axis in "XYZW"], axis=-1)
    if {*rotation} != {*"XYZ"} or sorted(order) != ["X", "Y", "Z"]:
        columns = ", ".join(sorted(rotation)) or "none"
        message = f"Rotation Type is {order!r}" if order else "the header has no Rotation Type"
        message += f", and the Rotation columns are {columns}: angles need their order there, such "
        message += "as XYZ, quaternions X, Y, Z and W; export the take with quaternions, or write "
        message += "the order of the angles after Rotation Type in the first row"
        raise RecordingError(message, file=file, line=1, key="Rotation Type")
    angles = np.stack([rotation[axis] for axis in order], axis=-1)
    tracked = ~np.isnan(angles).any(axis=-1)
    quaternion = np.full((len(angles), 4), np.nan)
    if tracked.any():
        quaternion[tracked] = Rotation.from_euler(order, angles[tracked], degrees=True).as_quat()
    return quaternion
