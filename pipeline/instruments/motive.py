"""OptiTrack Motive takes as CSV, columnar grammar (format versions 1.2 to 1.25): read by labels, written as Motive 1.23 writes them.

A file has one row of keys and values, a blank row, rows that label every column (Type, Name, ID, in later versions Parent, then the
quantity, then Frame, Time and the axes), and one row a frame. The row-typed grammar of 1.0 and 1.1 is refused.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.errors import RecordingError
from pipeline.instruments.delimited import cells_of, is_blank, numbers_of, read_text

KEYS = (
    "Format Version",
    "Take Name",
    "Take Notes",
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
UNITS_PER_METRE = {"Meters": 1.0, "Centimeters": 100.0, "Millimeters": 1000.0}
RAW, SOLVED, BODY = "Marker", "Rigid Body Marker", "Rigid Body"
FRAME = 0  # the axis row is the one that starts with "Frame"
HEADER_LINES = 20  # with blank ones it is five to eight
# Time is printed with at least two decimals: two rounded times differ from the frames' by at most this, s
TIME_ROUNDING = 0.0101


@dataclass(frozen=True)
class RigidBody:
    """Pose of a rigid body's pivot in Motive's world frame: position (N, 3) in m, quaternion (N, 4) as x, y, z, w; NaN where it was lost.

    q and −q are one rotation: signs are as recorded and flip between frames.
    """

    position: np.ndarray
    quaternion: np.ndarray


@dataclass(frozen=True)
class MotiveTake:
    """One take of N frames in Motive's world frame (right-handed, y up unless exported otherwise)."""

    name: str
    version: str
    rate: float  # Hz, of the frame numbers
    frame: np.ndarray  # (N,) int64, increasing; gaps are frames that were not exported
    time: np.ndarray  # (N,) s since the first exported frame, from frame numbers and rate
    markers: dict[str, np.ndarray]  # name: (N, 3) m, NaN where occluded
    bodies: dict[str, RigidBody]
    counts: dict[str, int]  # what was skipped, lost or contradicted; see read_motive


@dataclass(frozen=True)
class _Header:
    fields: dict[str, str]
    time: int | None  # column
    groups: dict[tuple[str, str, str], dict[tuple[str, str], int]]  # (type, name, ID): {(quantity, axis): column}
    columns: int
    unused: int  # labelled columns that are neither of the above
    line: int  # of the axis row


def read_motive(file: Path) -> MotiveTake:
    """Take in ``file``, in m and s.

    A raw marker is preferred to the rigid body's solved marker of the same name: the solved one is drawn where the body model expects
    it, occluded or not. A marker of equal name but another ID is kept as ``name [ID]``. Missing samples are blank, NAN or exactly zero
    in all three coordinates (a quaternion of zeros, likewise, is no rotation). Euler angles are degrees about the moving axes.

    ``counts``: ``announced_frames`` and ``found_frames`` (headers lie), ``gaps`` in the frame numbers and the ``skipped_frames`` in them,
    ``blank_rows``, ``cut_rows`` (a last row without line end: it may have lost digits, so it is dropped), ``time_mismatches`` (rows whose
    Time is not that of their frame), ``marker_samples``, the ``missing_samples`` among them, ``missing_poses`` of bodies, ``zero_samples``
    and ``partial_samples`` that were taken for missing, ``solved_replaced`` and ``solved_only`` markers, and ``unused_columns``.

    Raises RecordingError, with the line where there is one, for the row-typed grammar, a header without unit, rate or marker, and
    for truncated, malformed or disordered rows.
    """
    text = read_text(file)
    header = _header(text.lines, file)
    rows, numbers = [], []
    for number, line in enumerate(text.lines[header.line :], start=header.line + 1):
        if not is_blank(line, ","):
            rows.append(_labelled(line, header, file, number))
            numbers.append(number)
    counts = {"blank_rows": len(text.lines) - header.line - len(rows), "cut_rows": int(text.cut is not None)}
    width = rows[0].count(",") + 1 if rows else header.columns
    if text.cut is not None and text.cut.count(",") + 1 < width:
        raise RecordingError("the last row is cut short; export or copy the take again", file=file, line=len(text.lines) + 1)
    if not rows:
        raise RecordingError("the header is followed by no frame; export the take again", file=file, line=header.line)
    if not header.groups:
        raise RecordingError("the take holds no marker and no rigid body; export it with markers", file=file, line=header.line)

    columns = [FRAME] + [column for group in header.groups.values() for column in group.values()]
    columns += [] if header.time is None else [header.time]
    if max(columns) >= width:
        raise RecordingError(f"the row has {width} cells where the header labels {max(columns) + 1} columns", file=file, line=numbers[0])
    values = dict(zip(columns, numbers_of(rows, numbers, columns, file=file, gaps=True).T, strict=True))
    frame = _frames(values[FRAME], numbers, file)
    rate = _rate(header.fields, file)
    time = (frame - frame[0]) / rate
    step = np.diff(frame)
    if header.fields.get("Total Exported Frames", "").isdigit():
        counts["announced_frames"] = int(header.fields["Total Exported Frames"])
    counts |= {"found_frames": len(frame), "gaps": int(np.sum(step > 1)), "skipped_frames": int(np.sum(step - 1))}
    counts["time_mismatches"] = 0
    if header.time is not None:
        printed = values[header.time] - values[header.time][0]
        counts["time_mismatches"] = int(np.sum(np.abs(printed - time) > TIME_ROUNDING))
    counts |= {"zero_samples": 0, "partial_samples": 0, "solved_replaced": 0, "solved_only": 0}

    unit = UNITS_PER_METRE[header.fields["Length Units"]]
    raw, solved, bodies = {}, {}, {}
    for (kind, name, identity), group in header.groups.items():
        position = np.stack([values[group["Position", axis]] for axis in "XYZ"], axis=-1) / unit
        _blank_samples(position, counts)
        owner = {RAW: raw, SOLVED: solved, BODY: bodies}[kind]
        key = f"{name} [{identity}]" if name in owner else name
        if kind == BODY:
            rotation = {axis: values[column] for (quantity, axis), column in group.items() if quantity == "Rotation"}
            owner[key] = RigidBody(position, _quaternion(rotation, header.fields.get("Rotation Type", ""), counts, file))
        else:
            owner[key] = position
    for name, position in solved.items():
        counts["solved_replaced" if name in raw else "solved_only"] += 1
        raw.setdefault(name, position)
    counts["marker_samples"] = len(raw) * len(frame)
    counts["missing_samples"] = int(sum(np.isnan(position[:, 0]).sum() for position in raw.values()))
    counts["missing_poses"] = int(sum(np.isnan(body.position + body.quaternion[:, :3]).any(axis=-1).sum() for body in bodies.values()))
    counts["unused_columns"] = header.unused
    name, version = header.fields.get("Take Name") or Path(file).stem, header.fields["Format Version"]
    return MotiveTake(name, version, rate, frame, time, raw, bodies, counts)


def _header(lines: list[str], file: Path) -> _Header:
    first = cells_of(lines[0], ",", file=file, number=1) if lines else []
    if first[:1] in (["comment"], ["info"]):
        raise RecordingError("this is the row-typed grammar of 1.0 and 1.1; export the take in format 1.2 or later", file=file, line=1)
    if first[:1] != ["Format Version"]:
        raise RecordingError("this is no Motive export with a header: it does not start with 'Format Version'", file=file, line=1)
    rows = []
    for number, line in enumerate(lines[1:HEADER_LINES], start=2):
        cells = cells_of(line, ",", file=file, number=number)
        if any(cells):
            rows.append(cells)
        if cells[:1] == ["Frame"]:
            break
    if not rows or rows[-1][0] != "Frame":
        line = min(len(lines), HEADER_LINES)
        raise RecordingError("no row starts with 'Frame': the header is truncated or damaged", file=file, line=line)
    if len(rows) < 4:
        raise RecordingError("the rows that give each column's type, name, quantity and axis are incomplete", file=file, line=number)
    columns = max(map(len, rows))
    rows = [row + [""] * (columns - len(row)) for row in rows]
    # column B names the rows in 1.23; in 1.21 it is blank and the order alone tells
    named = {row[1]: row for row in rows[:-2]}
    types, names = named.get("Type", rows[0]), named.get("Name", rows[1])
    identities = named.get("ID", rows[2] if len(rows) > 4 else [""] * columns)
    quantities, axes = rows[-2:]
    groups: dict[tuple[str, str, str], dict[tuple[str, str], int]] = {}
    for column, label in enumerate(zip(quantities, axes, strict=True)):
        if types[column] in (RAW, SOLVED, BODY) and label[0] in ("Position", "Rotation"):
            group = groups.setdefault((types[column], names[column], identities[column]), {})
            if label in group:
                raise RecordingError(f"two columns claim {' '.join(label)} of {names[column]!r}", file=file, line=number)
            group[label] = column
    for (kind, name, _), group in groups.items():
        if any(("Position", axis) not in group for axis in "XYZ"):
            raise RecordingError(f"{kind} {name!r} lacks one of its columns X, Y, Z of Position", file=file, line=number)
    time = next((column for column, axis in enumerate(axes) if axis in ("Time", "Time (Seconds)")), None)
    unused = sum(map(bool, types[2:])) - sum(map(len, groups.values()))
    return _Header(_fields(first, file), time, groups, columns, unused, number)


def _labelled(line: str, header: _Header, file: Path, number: int) -> str:
    # spreadsheets pad rows with empty cells; a number there has no label, so the row is shifted or of another take
    cells = line.split(",")
    if any(cell.strip() for cell in cells[header.columns :]):
        raise RecordingError(f"the row has more cells than the {header.columns} labelled columns", file=file, line=number)
    return ",".join(cells[: header.columns])


def _fields(cells: list[str], file: Path) -> dict[str, str]:
    # from one known key to the next: a value may be missing, or hold a comma that nobody quoted
    starts = [place for place, cell in enumerate(cells) if cell in KEYS] + [len(cells)]
    fields = {cells[i]: ",".join(cells[i + 1 : j]).strip(",") for i, j in pairwise(starts)}
    if fields.get("Length Units") not in UNITS_PER_METRE:
        unit = fields.get("Length Units", "nothing")
        raise RecordingError(f"Length Units are {unit!r}; export in {', '.join(UNITS_PER_METRE)}", file=file, line=1, key="Length Units")
    if fields.get("Coordinate Space", "Global") != "Global":
        raise RecordingError("the Coordinate Space is not Global; export the take in Global", file=file, line=1, key="Coordinate Space")
    return fields


def _rate(fields: dict[str, str], file: Path) -> float:
    # frames are numbered at the rate of the export, which older versions do not tell apart from the capture's
    key = "Export Frame Rate" if fields.get("Export Frame Rate") else "Capture Frame Rate"
    try:
        rate = float(fields[key])
    except (KeyError, ValueError):
        raise RecordingError("the header gives no frame rate, so frames have no time", file=file, line=1, key=key) from None
    if not 0 < rate < np.inf:
        raise RecordingError(f"a frame rate of {rate} is none", file=file, line=1, key=key)
    return rate


def _frames(values: np.ndarray, numbers: list[int], file: Path) -> np.ndarray:
    whole = np.isfinite(values) & (values == np.round(values))
    if not whole.all():
        raise RecordingError("the frame number is missing or not whole", file=file, line=numbers[int(np.argmin(whole))])
    frame = values.astype(np.int64)
    if (np.diff(frame) <= 0).any():
        raise RecordingError("the frame number does not increase", file=file, line=numbers[int(np.argmax(np.diff(frame) <= 0)) + 1])
    return frame


def _blank_samples(position: np.ndarray, counts: dict[str, int]) -> None:
    # exact zeros in all coordinates are a lost sample (a marker is never within half a micrometre of the origin)
    zero = (position == 0).all(axis=-1)
    missing = np.isnan(position).any(axis=-1)
    counts["zero_samples"] += int(zero.sum())
    counts["partial_samples"] += int(missing.sum() - np.isnan(position).all(axis=-1).sum())
    position[zero | missing] = np.nan


def _quaternion(rotation: dict[str, np.ndarray], order: str, counts: dict[str, int], file: Path) -> np.ndarray:
    if set(rotation) == set("XYZW"):
        quaternion = np.stack([rotation[axis] for axis in "XYZW"], axis=-1)
        zero = (quaternion == 0).all(axis=-1)
        counts["zero_samples"] += int(zero.sum())
        quaternion[zero | np.isnan(quaternion).any(axis=-1)] = np.nan
        return quaternion
    if set(rotation) != set("XYZ") or sorted(order) != ["X", "Y", "Z"]:
        found = ", ".join(sorted(rotation)) or "none"
        raise RecordingError(f"Rotation Type {order!r} does not fit the Rotation columns ({found})", file=file, line=1, key="Rotation Type")
    angles = np.stack([rotation[axis] for axis in order], axis=-1)
    tracked = ~np.isnan(angles).any(axis=-1)
    quaternion = np.full((len(angles), 4), np.nan)
    if tracked.any():
        quaternion[tracked] = Rotation.from_euler(order, angles[tracked], degrees=True).as_quat()
    return quaternion


def write_motive(file: Path, take: MotiveTake, *, start: str) -> None:
    """Write ``take`` as Motive's 1.23 export in metres: six decimals, CRLF, a missing sample as blank cells, rigid bodies before markers.

    ``start`` is the capture's start as Motive prints it, such as ``2024-03-05 10.15.00.000 AM``. IDs count the assets. Frame, rate and
    the samples rounded to 1e-6 come back from :func:`read_motive`; ``take.version`` and ``take.counts`` are not written.
    """
    span = int(take.frame[-1] - take.frame[0]) + 1
    rate = f"{take.rate:.6f}"
    values = dict.fromkeys(KEYS, "") | {
        "Format Version": "1.23",
        "Take Name": _quoted(take.name),
        "Capture Frame Rate": rate,
        "Export Frame Rate": rate,
        "Capture Start Time": start,
        "Total Frames in Take": str(span),
        "Total Exported Frames": str(len(take.frame)),
        "Rotation Type": "Quaternion",
        "Length Units": "Meters",
        "Coordinate Space": "Global",
    }
    del values["Capture Start Frame"]  # 1.23 writes it for some takes only
    pose = [("Rotation", axis) for axis in "XYZW"] + [("Position", axis) for axis in "XYZ"]
    labels = [(BODY, name, *label) for name in take.bodies for label in pose]
    labels += [(RAW, name, "Position", axis) for name in take.markers for axis in "XYZ"]
    identities = {key: f'"{number:X}"' for number, key in enumerate(dict.fromkeys(label[:2] for label in labels), start=0xA10)}
    header = [
        ",".join(f"{key},{value}" for key, value in values.items()),
        "",
        ",".join([",Type", *(kind for kind, *_ in labels)]),
        ",".join([",Name", *(_quoted(name) for _, name, *_ in labels)]),
        ",".join([",ID", *(identities[label[:2]] for label in labels)]),
        ",".join([",", *(quantity for *_, quantity, _ in labels)]),
        ",".join(["Frame,Time (Seconds)", *(axis for *_, axis in labels)]),
    ]
    blocks = [block for body in take.bodies.values() for block in (body.quaternion, body.position)] + list(take.markers.values())
    table = np.column_stack([take.frame, take.frame / take.rate, *blocks])
    row = ",".join(["%d", *["%.6f"] * (table.shape[1] - 1)]) + "\r\n"
    rows = (row * len(table) % tuple(table.ravel().tolist())).replace("nan", "")
    Path(file).write_bytes(("\r\n".join(header) + "\r\n" + rows).encode())


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"' if any(mark in name for mark in ',"') else name
