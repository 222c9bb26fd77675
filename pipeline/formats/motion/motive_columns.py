"""The columnar grammar of OptiTrack Motive's CSV takes (format versions 1.2 to 1.25): read by
labels, whatever their order.

A file has one row of keys and values, a blank row, rows that label every column (Type, Name, ID, in
later versions Parent, then the quantity, then Frame, Time and the axes), and one row a frame. From
1.22 on column B names the rows of labels; before, their order does.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from pipeline.core.bounds import require
from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import Text, is_blank, numbers_of
from pipeline.formats.motion.motive_header import BODY, RAW, SOLVED, Header, read_header
from pipeline.formats.motion.take import (
    UNITS_PER_METRE,
    WHOLE,
    MotionTake,
    RigidBody,
    blank_samples,
    clock_counts,
    frame_numbers,
    keeps_time,
    rate_from_times,
    require_position,
    require_rotation,
    sample_counts,
    settle_unit,
)

FRAME = 0  # the axis row is the one that starts with "Frame"


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
    shared = {
        name
        for (_, name), number in Counter((kind, name) for kind, name, _ in groups).items()
        if number > 1
    }
    for (kind, name, identity), group in groups.items():
        places = [group["Position", axis] for axis in "XYZ"]
        position = np.stack([values[place] for place in places], axis=-1) / UNITS_PER_METRE[unit]
        require_position(
            position, name, unit, lambda k, axis, at=places: _place(file, numbers[k], at[axis])
        )
        blank_samples(position, counts)
        owner = {RAW: raw, SOLVED: solved, BODY: bodies}[kind]
        key = f"{name} [{identity}]" if name in shared else name
        if kind == BODY:
            rotation = {
                axis: values[column]
                for (quantity, axis), column in group.items()
                if quantity == "Rotation"
            }
            owner[key] = RigidBody(
                position,
                _quaternion(rotation, header.fields.get("Rotation Type", ""), counts, file),
            )
            require_rotation(
                owner[key].quaternion, name, lambda k: {"file": file, "line": numbers[k]}
            )
        else:
            owner[key] = position
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


def _quaternion(
    rotation: dict[str, np.ndarray], order: str, counts: dict[str, int], file: Path
) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    if set(rotation) == set("XYZW"):
        quaternion = np.stack([rotation[axis] for axis in "XYZW"], axis=-1)
        zero = (quaternion == 0).all(axis=-1)
        counts["zero_samples"] += int(zero.sum())
        quaternion[zero | np.isnan(quaternion).any(axis=-1)] = np.nan
        return quaternion
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
