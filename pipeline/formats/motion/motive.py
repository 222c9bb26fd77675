"""Reader and writer of CSV takes of OptiTrack Motive: versions 1.0 to 1.25 are read, 1.23 written.

Format versions 1.2 to 1.25 are columnar: one row of keys and values, label rows (Type, Name, ID,
Parent in later versions, quantity, and Frame, Time and axes), then one row per frame. From 1.22 on,
column B names the label rows; before, their order is fixed. ``motive_rows`` reads 1.0 and 1.1.
"""

import re
from collections import Counter
from itertools import pairwise, zip_longest
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.core.bounds import require
from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import Text, cells_of, numbers_of, read_text
from pipeline.formats.format import Format, Head, Kind
from pipeline.formats.motion import take as capture
from pipeline.formats.motion.motive_rows import ROW_TYPES, read_rows
from pipeline.formats.motion.take import MotionTake

RATES = ("Capture Frame Rate", "Export Frame Rate")
TEXTS = ("Take Name", "Take Notes")  # free text, in which a comma is not always quoted
KEYS = (
    "Format Version",
    *TEXTS,
    *RATES,
    "Capture Start Time",
    "Capture Start Frame",
    "Total Frames in Take",
    "Total Exported Frames",
    "Rotation Type",
    "Length Units",
    "Coordinate Space",
)
TIMES = ("Time", "Time (Seconds)")
RAW = "Marker"
SOLVED = "Rigid Body Marker"
BODY = "Rigid Body"
PLACE = tuple(f"Position {axis}" for axis in "XYZ")
TURN = tuple(f"Rotation {axis}" for axis in "XYZW")
# upper limit; headers have five to eight lines, including blank lines
HEADER_LINES = 20


def read_motive(file: Path, unit: str | None = None) -> MotionTake:
    """Return the take in ``file``, in m and s; ``unit`` (m, cm or mm) is the unit of lengths if the
    file states no unit (versions 1.0 and 1.1).

    A raw marker replaces a solved marker of the same name. Assets that share a name but not an ID
    are called ``name [ID]``. In versions 1.0 and 1.1, markers without a name are called
    ``Unlabeled 1``, ``Unlabeled 2``, … in each frame. If the file states no rate, the printed times
    give the rate. ``counts`` adds to the counts of :func:`checked_take`: ``blank_rows``,
    ``cut_rows`` (last row without line end), ``repeated_rows``, ``solved_replaced`` and
    ``solved_only`` markers, ``unused_columns``, ``skipped_bones``; before 1.2 ``stray_ids`` and
    ``stray_samples``. Raises
    RecordingError, with the line if known, where the file has no unit, no rate or neither marker
    nor body; where its unit is not ``unit``; where times contradict the rate; for malformed rows.
    """
    text = read_text(file)
    cells = []
    if text.lines:
        cells = cells_of(text.lines[0], ",", file=file, number=1)
    first = cells[0] if cells else ""
    if first == "Format Version":
        return _read_columns(text, Path(file), unit)
    if first in ROW_TYPES:
        return read_rows(text, Path(file), unit)
    message = (
        "no Motive export: the file must begin with 'Format Version' or a row type, and a comma; "
        "export it with its header"
    )
    if re.match(r"(?:Format Version|comment|info)[;\t]", first):
        message = (
            "cells are separated by semicolons or tabs: another program saved the take; export it "
            "with commas"
        )
    raise RecordingError(message, file=file, line=1)


class Asset(NamedTuple):
    """Marker or rigid body of the header."""

    kind: str
    name: str
    identity: str  # ID, "" if the header has no IDs


# quantity with its axis → column
Columns = dict[str, int]


class Header(NamedTuple):
    """Column labels in the header rows."""

    line: int  # line number of the axis row, the last header row
    time: int | None  # column of the times
    assets: dict[Asset, Columns]
    labelled: list[bool]  # whether a column has a label, up to the last labelled column
    bones: int  # number of bones and bone markers, which are not read
    unused: int  # number of labelled columns outside ``assets``


def _header(lines: list[str], file: Path) -> Header:
    """Return the column labels; RecordingError where a label is missing or occurs twice."""
    rows, number = _label_rows(lines, file)
    by_label = {row[1]: row for row in rows[:-2] if row[1]}
    stated = not by_label or {"Type", "Name"} <= by_label.keys()
    if len(rows) < 4 or rows[-1][0] != "Frame" or not stated:
        raise RecordingError(
            "no row that starts with 'Frame' follows the rows Type, Name and quantity: the header "
            "is truncated or damaged; export the take again",
            file=file,
            line=number,
        )
    types = by_label.get("Type", rows[0])
    names = by_label.get("Name", rows[1])
    identities = by_label.get("ID", ("",) * len(types))
    if len(rows) > 4 and not by_label:
        identities = rows[2]
    quantities, axes = rows[-2:]
    labels = [*zip(types, names, identities, quantities, axes, strict=True)]
    assets = _assets_of(labels, file, number)
    bones = {asset for asset in zip(types, names, strict=True) if "Bone" in asset[0]}
    if not assets:
        only = ", only bones" if bones else ""
        raise _to_export_again(f"{capture.NO_ASSET}{only}", file, number)

    times = [column for column, axis in enumerate(axes) if axis in TIMES]
    labelled = [any(column) for column in zip(*rows, strict=True)]
    while not labelled[-1]:
        labelled.pop()
    read_columns = sum(len(columns) for columns in assets.values())
    return Header(
        line=number,
        time=times[0] if times else None,
        assets=assets,
        labelled=labelled,
        bones=len(bones),
        unused=len([kind for kind in types[2:] if kind]) - read_columns,
    )


def _assets_of(
    labels: list[tuple[str, ...]],
    file: Path,
    line: int,
) -> dict[Asset, Columns]:
    """Return the markers and bodies, from type, name, ID, quantity and axis of each column."""
    assets: dict[Asset, Columns] = {}
    for column, (kind, name, identity, quantity, axis) in enumerate(labels):
        if kind in (RAW, SOLVED, BODY) and quantity in ("Position", "Rotation"):
            columns = assets.setdefault(Asset(kind, name, identity), {})
            if columns.setdefault(f"{quantity} {axis}", column) != column:
                fault = f"{name!r} has two columns {quantity} {axis}"
                raise _to_export_again(fault, file, line)
    for asset, columns in assets.items():
        if not columns.keys() >= {*PLACE}:
            fault = f"{asset.kind} {asset.name!r} lacks one of its columns X, Y, Z of Position"
            raise _to_export_again(fault, file, line)
    return assets


def _label_rows(lines: list[str], file: Path) -> tuple[list[tuple[str, ...]], int]:
    """Return the label rows, of equal lengths, and the line number of the last one."""
    rows = []
    number = 1
    for number, line in enumerate(lines[1:HEADER_LINES], start=2):
        cells = cells_of(line, ",", file=file, number=number)
        if any(cells):
            rows.append(cells)
        if cells and cells[0]:
            break
    columns = zip_longest(*rows, fillvalue="")
    return [*zip(*columns, strict=True)], number


def _to_export_again(fault: str, file: Path, line: int) -> RecordingError:
    return RecordingError(f"{fault}; export the take again", file=file, line=line)


def _fields(line: str, file: Path) -> dict[str, str]:
    """Return key → value of the first row; an unquoted text with commas ends at the next key."""
    cells = cells_of(line, ",", file=file, number=1)
    starts = [place for place, cell in enumerate(cells) if cell in KEYS]
    fields: dict[str, str] = {}
    for start, end in pairwise([*starts, len(cells)]):
        key, *values = cells[start:end]
        value = "".join(values[:1])
        if key in TEXTS:
            value = ",".join(values).strip(",")
        if fields.setdefault(key, value) != value:
            message = f"the header has two different values of {key}"
            raise RecordingError(message, file=file, line=1, key=key)
    space = fields.get("Coordinate Space")
    if space not in (None, "", "Global"):
        message = f"the Coordinate Space is {space!r}; export the take in Global"
        raise RecordingError(message, file=file, line=1, key="Coordinate Space")
    return fields


def _read_columns(text: Text, file: Path, unit: str | None) -> MotionTake:
    header = _header(text.lines, file)
    fields = _fields(text.lines[0], file)
    require("markers", len(header.assets), "markers and bodies", file)
    rows, numbers, repeated = _rows(text, header, file)
    columns = [0]
    for columns_of_asset in header.assets.values():
        columns += columns_of_asset.values()
    if header.time is not None:
        columns.append(header.time)
    table = numbers_of(rows, numbers, columns, file=file, gaps=True)
    values = dict(zip(columns, table.T, strict=True))
    frame = capture.frame_numbers(values[0], numbers, file)
    printed = np.full(len(frame), np.nan)
    if header.time is not None:
        printed = values[header.time]
    # older versions have no export rate
    key = RATES[1] if fields.get(RATES[1]) else RATES[0]
    stated = fields.get(key, "")
    rate, source = capture.settle_rate(stated, frame, printed, file, line=1, key=key)
    key = "Length Units"
    unit = capture.settle_unit(fields.get(key, ""), unit, file, key=key)
    counts = {
        "blank_rows": len(text.lines) - header.line - len(rows) - repeated,
        "cut_rows": int(text.cut is not None),
    }
    stated = fields.get("Total Exported Frames", "")
    counts |= capture.compare_frames(stated, len(frame))

    tracks = _tracks(header.assets, values, fields.get("Rotation Type", ""), file)
    only_solved = tracks.solved.keys() - tracks.raw.keys()
    more = {
        "solved_replaced": len(tracks.solved) - len(only_solved),
        "unused_columns": header.unused,
        "solved_only": len(only_solved),
    }
    if repeated:
        more["repeated_rows"] = repeated
    if header.bones:
        more["skipped_bones"] = header.bones
    markers = dict(tracks.raw)
    for name, position in tracks.solved.items():
        markers.setdefault(name, position)
    take = MotionTake(
        name=fields.get("Take Name") or file.stem,
        version=fields["Format Version"],
        rate=rate,
        frame=frame,
        time=printed,
        markers=markers,
        bodies=tracks.bodies,
        counts=counts,
        unit=unit,
        rate_from=source,
    )
    return capture.checked_take(take, file, numbers, tracks.columns, more)


class Tracks(NamedTuple):
    """Markers and bodies by name, positions (N, 3) in the file's unit."""

    raw: dict[str, np.ndarray]
    solved: dict[str, np.ndarray]
    bodies: dict[str, capture.RigidBody]
    columns: dict[str, list[int]]  # columns of X, Y and Z


def _tracks(
    assets: dict[Asset, Columns],
    values: dict[int, np.ndarray],
    order: str,
    file: Path,
) -> Tracks:
    """Return the tracks of the ``assets``, with ``values`` (N,) by column, and Euler angles in
    ``order``.
    """
    tracks = Tracks({}, {}, {}, {})
    # a name that two assets share does not identify an asset: the ID is appended
    uses = Counter((asset.kind, asset.name) for asset in assets)
    shared = {name for (_, name), number in uses.items() if number > 1}
    for (kind, name, identity), columns in assets.items():
        key = f"{name} [{identity}]" if name in shared else name
        xyz = [columns[label] for label in PLACE]
        position = np.stack([values[column] for column in xyz], axis=-1)
        if kind != SOLVED or key not in tracks.columns:  # raw replaces solved
            tracks.columns[key] = xyz
        if kind == RAW:
            tracks.raw[key] = position
        elif kind == SOLVED:
            tracks.solved[key] = position
        else:
            rotation = {}
            for label, column in columns.items():
                quantity, axis = label.split(" ", 1)
                if quantity == "Rotation":
                    rotation[axis] = values[column]
            quaternion = _quaternion(rotation, order, file)
            tracks.bodies[key] = capture.RigidBody(position, quaternion)
    return tracks


def _rows(text: Text, header: Header, file: Path) -> tuple[list[str], list[int], int]:
    """Return frame rows, their lines, and repeated rows; RecordingError for a malformed row."""
    rows = []
    numbers = []
    repeated = 0
    width = len(header.labelled)
    for number, line in enumerate(text.lines[header.line :], start=header.line + 1):
        if not line.strip(", \t"):
            continue
        cells = line.split(",")
        unlabelled = []
        for cell, label in zip_longest(cells, header.labelled):
            if cell and cell.strip() and not label:
                unlabelled.append(cell.strip())
        if len(cells) < width or unlabelled:
            fault = "a cut row"
            if unlabelled:
                fault = f"{max(unlabelled)!r} in a column without a label"
            raise RecordingError(
                f"the row has {len(cells)} cells, the header labels {width} columns: {fault} (row "
                "of another take, or decimal commas?); export the take again",
                file=file,
                line=number,
            )
        row = ",".join(cells[:width])
        if row in rows[-1:]:
            repeated += 1
        else:
            rows.append(row)
            numbers.append(number)
    if not rows:
        raise _to_export_again("no frame follows the header", file, header.line)
    return rows, numbers, repeated


def _quaternion(rotation: dict[str, np.ndarray], order: str, file: Path) -> np.ndarray:
    """Return quaternions (N, 4) x, y, z, w from quaternions or Euler angles (°) in ``order``."""
    if {*rotation} == {*"XYZW"}:
        return np.stack([rotation[axis] for axis in "XYZW"], axis=-1)
    if {*rotation} != {*"XYZ"} or sorted(order) != ["X", "Y", "Z"]:
        raise RecordingError(
            f"the Rotation Type is {order!r} and the columns of Rotation are "
            f"{', '.join(sorted(rotation)) or 'none'}: export the take with quaternions (X, Y, Z, "
            "W), or write the order of the angles, such as XYZ, behind Rotation Type",
            file=file,
            line=1,
            key="Rotation Type",
        )
    angles = np.stack([rotation[axis] for axis in order], axis=-1)
    tracked = ~np.isnan(angles).any(axis=-1)
    quaternion = np.full((len(angles), 4), np.nan)
    if tracked.any():
        rotations = Rotation.from_euler(order, angles[tracked], degrees=True)
        quaternion[tracked] = rotations.as_quat()
    return quaternion


def write_motive(file: Path, take: MotionTake, *, start: str) -> None:
    """Write ``take`` in format version 1.23, in m: six decimals, CRLF, blank cells for a missing
    sample, bodies before markers. ``start`` is the start of the capture in Motive's format, such as
    ``2024-03-05 10.15.00.000 AM``. ``take.version`` and ``take.counts`` are not written.
    """
    values = dict.fromkeys(KEYS, "")
    del values["Capture Start Frame"]  # Motive 1.23 writes this key for some takes only
    values |= dict.fromkeys(RATES, f"{take.rate:.6f}")
    values |= {
        "Format Version": "1.23",
        "Take Name": _quoted(take.name),
        "Rotation Type": "Quaternion",
        "Length Units": "Meters",
        "Coordinate Space": "Global",
        "Capture Start Time": start,
        "Total Frames in Take": str(int(take.frame[-1] - take.frame[0]) + 1),
        "Total Exported Frames": str(len(take.frame)),
    }
    assets = [(BODY, name, TURN + PLACE) for name in take.bodies]
    assets += [(RAW, name, PLACE) for name in take.markers]
    label_rows = [["", "Type"], ["", "Name"], ["", "ID"], ["", ""]]
    label_rows.append(["Frame", "Time (Seconds)"])
    for number, (kind, name, quantities) in enumerate(assets, start=0xA10):
        for quantity in quantities:
            labels = kind, _quoted(name), f'"{number:X}"', *quantity.split()
            for row, label in zip(label_rows, labels, strict=True):
                row.append(label)
    first_row = ",".join(f"{key},{value}" for key, value in values.items())
    header = [first_row, "", *map(",".join, label_rows)]
    blocks = [take.frame, take.frame / take.rate]
    for body in take.bodies.values():
        blocks += [body.quaternion, body.position]
    table = np.column_stack([*blocks, *take.markers.values()])
    _, width = table.shape
    row = "%d" + ",%.6f" * (width - 1) + "\r\n"
    numbers = tuple(table.ravel().tolist())
    rows = (row * len(table) % numbers).replace("nan", "")
    text = "\r\n".join(header) + "\r\n" + rows
    Path(file).write_bytes(text.encode())


def _quoted(name: str) -> str:
    if '"' in name or "," in name:
        return '"' + name.replace('"', '""') + '"'
    return name


def _begins(head: Head) -> bool:
    # accept separators of other programs too, since the reader's error explains them
    rows = [re.split(r"[,;\t]", line) for line in head.lines[:2]]
    if not rows:
        return False
    first, *second = (row[0].strip().strip('"') for row in rows)
    several = max(len(row) for row in rows) > 1
    typed = first in ROW_TYPES and {*second} <= {*ROW_TYPES} and several
    return first == "Format Version" or typed


FORMAT = Format("Motive CSV", Kind.MOTION, read_motive, _begins)
