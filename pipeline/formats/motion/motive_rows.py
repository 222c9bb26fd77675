"""Reader of OptiTrack's CSV takes in format version 1.0 (Tracking Tools) or 1.1 (Motive), in which
the first cell of a row is its type.

The rows have this order: any number of ``comment`` rows; ``righthanded`` or ``lefthanded``;
``info,version|framecount|rigidbodycount,…`` (1.0 has no version); one definition of every rigid
body; then, per frame, one ``frame`` row and one row per body. Version 1.0 writes ``trackable``
instead of ``rigidbody``. Only version 1.1 has the cell in brackets::

    rigidbody, name, ID, n, n × (x, y, z)                       definition in the body's frame
    frame, frame, time, m, m × (ID, x, y, z, qx, qy, qz, qw, yaw, pitch, roll),
           p, p × (x, y, z, ID[, name])

The reader takes the poses of the m tracked bodies and the positions of all p visible markers, which
have no names in version 1.0, from the frame rows. The rows per body in between repeat these
positions beside solved ones, which are constant while a body is lost; the reader ignores them. No
row has a unit or a rate.
"""

from collections.abc import Iterator
from math import isfinite, nan
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.core.bounds import MIB, require
from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import MISSING, NUMBER, Text, cells_of
from pipeline.formats.motion import take as capture
from pipeline.formats.motion.take import STRAY, MotionTake, RigidBody

BODY_ROWS = ("rigidbody", "trackable")
ROW_TYPES = ("comment", "info", "righthanded", "lefthanded", "frame", *BODY_ROWS)
SAMPLE = 24  # bytes of x, y, z
MARKER = "marker "  # prefix, since a body and a marker may share a name
POSE = [*"xyz", "qx", "qy", "qz", "qw"]


def _whole(cell: str) -> int:
    """Return the count or ID in a ``cell``; ValueError for another content."""
    if not capture.WHOLE.fullmatch(cell):
        raise ValueError(f"a cell holds {cell!r} where a count or an ID is required")
    return int(cell)


def _numbers(cells: list[str]) -> list[float]:
    """Return the numbers in ``cells``, NaN for a missing number; ValueError for words."""
    values = [float(cell) if NUMBER.fullmatch(cell) else nan for cell in cells]
    for cell, value in zip(cells, values, strict=True):
        if cell not in MISSING and not isfinite(value):
            raise ValueError(f"a cell holds {cell!r} where a finite number is required")
    return values


def _blocks(cells: list[str], *widths: int) -> Iterator[list[list[str]]]:
    """Yield one list per width: the groups of so many cells behind the number of groups."""
    place = 0
    for width in widths:
        count = _whole("".join(cells[place : place + 1]))
        first, place = place + 1, place + 1 + count * width
        if place > len(cells):
            raise ValueError(
                f"the row lacks {place - len(cells)} cells that its counts require"
            )
        yield [cells[n : n + width] for n in range(first, place, width)]
    if any(cells[place:]):
        raise ValueError("the row has more cells than its counts state")


def read_rows(text: Text, file: Path, unit: str | None) -> MotionTake:
    """Return the take in ``text`` of version 1.0 or 1.1; see :func:`..motive.read_motive`."""
    infos, bodies, defined, previous = (
        {"version": "1.0"},
        {},
        [],
        None,
    )  # bodies: ID → name
    times, lines, poses, seen = [], [], [], []
    counts = {
        "blank_rows": 0,
        "cut_rows": int(text.cut is not None),
        "repeated_rows": 0,
    }
    for number, line in enumerate(text.lines, start=1):
        if line.startswith("comment"):
            continue
        if (blank := not line.strip(", \t")) or line == previous:
            counts["blank_rows" if blank else "repeated_rows"] += 1
            continue
        kind, *cells = cells_of(line, ",", file=file, number=number)
        named = infos["version"] not in (
            "1",
            "1.0",
            "1.00",
        )  # whether markers have IDs and names
        (first, second), rest = [*cells, "", ""][:2], cells[2:]
        try:
            if kind == "info":
                infos[first] = second
            elif kind == "frame":
                tracked, markers = _blocks(rest, 11, 5 if named else 4)
                k, markers = len(times), [[*one, ""][:5] for one in markers]
                lines.append(number)
                times.append(_numbers([first, second]))
                if unknown := {_whole(one[0]) for one in tracked} - {*bodies}:
                    raise ValueError(f"rigid body {min(unknown)} is not defined")
                # position and quaternion; the angles are redundant
                poses += [
                    (k, bodies[int(one[0])], *_numbers(one[1:])[:7]) for one in tracked
                ]
                seen += [(k, one[3], one[-1], *_numbers(one[:3])) for one in markers]
                names = [bodies[int(one[0])] for one in tracked]
                names += [
                    f"{MARKER}{one[-1]}"
                    for one in markers
                    if not STRAY.fullmatch(one[-1])
                ]
                if twice := next((name for name in names if names.count(name) > 1), ""):
                    raise ValueError(
                        f"two assets are named {twice.removeprefix(MARKER)!r}"
                    )
            elif kind in BODY_ROWS and not times:
                (markers,) = _blocks(rest, 3)
                if first in bodies.values() or _whole(second) in bodies:
                    raise ValueError(
                        f"rigid body {first!r} (ID {second}) is defined twice"
                    )
                bodies[_whole(second)] = first
                # a marker without any measured position is in the take, with NaN in all frames
                defined += [
                    f"{first}-Marker {n + 1}" for n in range(len(markers)) if named
                ]
            elif kind not in ("righthanded", *BODY_ROWS):
                message = (
                    f"the row type is {kind!r}; a right-handed take has the row types "
                )
                raise ValueError(f"{message}{', '.join(ROW_TYPES)}")
        except ValueError as error:
            raise RecordingError(
                f"{error}; export it again", file=file, line=number
            ) from None
        previous = line
    numbers, printed = np.array(times).reshape(-1, 2).T
    frame = capture.frame_numbers(numbers, lines, file)
    last = [len(text.lines), *lines][-1]
    rate, source = capture.settle_rate("", frame, printed, file, line=last)
    unit = capture.settle_unit("", unit, file, key="info")
    counts |= capture.compare_frames(infos.get("framecount", ""), len(frame))
    poses = pd.DataFrame(poses, columns=["k", "name", *POSE])
    seen = pd.DataFrame(seen, columns=["k", "id", "name", *"xyz"])
    lost = seen["name"].str.fullmatch(STRAY).astype(bool)
    more = {"stray_ids": seen["id"][lost].nunique(), "stray_samples": int(lost.sum())}
    order = seen[lost].groupby("k").cumcount() + 1
    seen.loc[lost, "name"] = [f"Unlabeled {n}" for n in order]
    seen = seen.sort_values("name", key=lambda _: lost, kind="stable")
    names = {*defined, *seen["name"], *bodies.values()}
    require("markers", len(names), "markers and bodies", file)
    if not names:
        raise RecordingError(f"{capture.NO_ASSET}; export it with them", file=file)
    # a name in a few frames needs memory for all frames
    require(
        "memory_mib", len(names) * len(frame) * SAMPLE / MIB, "MiB of samples", file
    )

    def dense(
        table: pd.DataFrame, known: list[str], columns: list[str]
    ) -> dict[str, np.ndarray]:
        lost = dict.fromkeys(known, np.full((len(frame), len(columns)), nan))
        tables = table.set_index("k").groupby("name", sort=False)[columns]
        return lost | {
            n: one.reindex(np.arange(len(frame))).to_numpy() for n, one in tables
        }

    markers, poses = (
        dense(seen, defined, POSE[:3]),
        dense(poses, [*bodies.values()], POSE),
    )
    rigid = {name: RigidBody(pose[:, :3], pose[:, 3:]) for name, pose in poses.items()}
    about = file.stem, infos["version"], rate, frame, printed, markers, rigid
    raw = MotionTake(*about, counts, unit, rate_from=source)
    return capture.checked_take(raw, file, lines, more=more)
