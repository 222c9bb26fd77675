"""The row-typed grammar of OptiTrack's CSV takes (format versions 1.0 of Tracking Tools and 1.1 of
Motive).

The first cell of a row says what it is. In this order: any number of ``comment`` rows;
``righthanded`` or ``lefthanded``; ``info,version|framecount|rigidbodycount,…`` (1.0 gives no
version); a definition of each rigid body; then, per frame, one ``frame`` row and one row of each
body. 1.0 writes ``trackable`` for ``rigidbody``. Bracketed cells are of 1.1 alone::

    rigidbody, name, ID, n, n × (x, y, z)                      the definition, in the body's frame
    frame, frame, time, m, m × (ID, x, y, z, qx, qy, qz, qw, yaw, pitch, roll),
           p, p × (x, y, z, ID[, name])
    rigidbody, frame, time, name, ID, frames since last tracked, n, n × (x, y, z[, ID]) solved,
               n × (x, y, z) measured, n × tracked, n × quality, mean error (mm)

Positions are read from the frame row (poses of the m bodies tracked, all p markers seen) and,
measured, from the bodies' rows (``name-Marker i``, as 1.1 calls them), not from the solved places,
which stay where they were while a body is lost. No row states a unit of length, nor a rate.
"""

from __future__ import annotations

from collections import defaultdict
from math import inf, isnan, nan
from pathlib import Path

import numpy as np

from pipeline.core.bounds import MIB, require
from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import MISSING, NUMBER, Text, cells_of, is_blank
from pipeline.formats.motion.take import (
    FROM_TIMES,
    NO_ASSET,
    STRAY,
    WHOLE,
    MotionTake,
    TakeBuilder,
    frame_numbers,
    rate_from_times,
    settle_unit,
)

BODY_ROWS = ("rigidbody", "trackable")
ROW_TYPES = ("comment", "info", "righthanded", "lefthanded", "frame", *BODY_ROWS)
SAMPLE = 24  # bytes of x, y, z
Samples = dict[str, dict[int, list[float]]]  # name → index of the frame → numbers


class RowCells:
    """Cells of one row, taken from left to right; ValueError for a cell that should not come."""

    def __init__(self, cells: list[str]) -> None:
        self.cells, self.place = cells, 1

    def take(self, count: int) -> list[str]:
        """Return the next ``count`` cells."""
        self.place += count
        if (held := len(self.cells)) < self.place:
            raise ValueError(f"the row has {held} cells where its counts require {self.place}")
        return self.cells[self.place - count : self.place]

    def count(self) -> int:
        """Return the next cell, a count or an ID."""
        (cell,) = self.take(1)
        if not WHOLE.fullmatch(cell):
            raise ValueError(f"cell {self.place} holds {cell!r} where a count or an ID should be")
        return int(cell)

    def numbers(self, count: int) -> list[float]:
        """Return the next ``count`` cells, NaN where one is missing."""
        cells = self.take(count)
        if wrong := [cell for cell in cells if cell not in MISSING and not NUMBER.fullmatch(cell)]:
            raise ValueError(f"there is {wrong[0]!r} before cell {self.place + 1}, not a number")
        values = [nan if cell in MISSING else float(cell) for cell in cells]
        if inf in values or -inf in values:
            raise ValueError(f"a number is too large before cell {self.place + 1}")
        return values

    def end(self) -> None:
        """Raise ValueError where a cell with content follows."""
        if any(self.cells[self.place :]):
            raise ValueError(f"the row goes on after cell {self.place}, where its counts end it")


class RowsSoFar:
    """Content of the rows that were added; ValueError for a row that cannot come."""

    def __init__(self) -> None:
        self.named = False  # whether markers have IDs and names of their own (1.1)
        self.infos: dict[str, str] = {}
        self.names: dict[int, str] = {}  # of bodies by ID
        self.frame, self.time, self.line = [], [], []
        self.poses: Samples = {}
        self.markers: Samples = {}
        self.strays: list[list[list[float]]] = []  # of each frame
        self.stray_ids: set[str] = set()
        self.body_rows = 0

    def add(self, row: RowCells, line: int) -> None:
        """Add the row at ``line``."""
        kind = row.cells[0]
        if kind == "info":
            key, value = row.take(2)
            self.infos[key] = value
            self.named |= key == "version" and value not in ("1", "1.0", "1.00")
        elif kind == "frame":
            self.line.append(line)
            self._add_frame(row)
            row.end()
        elif kind in BODY_ROWS:
            (self._add_body if self.frame else self._define)(row)
            row.end()
        elif kind == "lefthanded":
            raise ValueError("the take is left-handed; export it right-handed")
        elif kind != "righthanded":
            raise ValueError(f"no row type {kind!r}; there are {', '.join(ROW_TYPES)}")

    def _define(self, row: RowCells) -> None:
        (name,), identity, markers = row.take(1), row.count(), row.count()
        row.numbers(3 * markers)
        if identity in self.names or name in self.poses:
            raise ValueError(f"rigid body {name!r} (ID {identity}) is defined twice")
        self.names[identity], self.poses[name] = name, {}
        # a marker that is never seen is missing, not absent
        self.markers |= {f"{name}-Marker {marker}": {} for marker in range(1, markers + 1)}

    def _add_frame(self, row: RowCells) -> None:
        k, strays = len(self.frame), []
        self.frame += row.numbers(1)
        self.time += row.numbers(1)
        for _ in range(row.count()):
            identity = row.count()
            pose = self.poses.get(self.names.get(identity, ""))
            if pose is None or k in pose:
                fault = "is not defined" if pose is None else "has two poses"
                raise ValueError(f"rigid body {identity} {fault}")
            pose[k] = row.numbers(10)[:7]  # position, quaternion, and angles that repeat it
        for _ in range(row.count()):
            sample, (identity, *name) = row.numbers(3), row.take(2 if self.named else 1)
            if STRAY.fullmatch(name := "".join(name)):
                strays.append(sample)
                self.stray_ids.add(identity)
            elif self.markers.setdefault(name, {}).setdefault(k, sample) is not sample:
                raise ValueError(f"two markers are named {name!r}")
        self.strays.append(strays)

    def _add_body(self, row: RowCells) -> None:
        at, (name,), identity = row.numbers(2), row.take(1), row.count()
        if at != [self.frame[-1], self.time[-1]]:
            raise ValueError(f"the row of rigid body {name!r} is not of the frame before it")
        if self.names.get(identity) != name:
            raise ValueError(f"rigid body {name!r} (ID {identity}) is not defined")
        row.count()
        markers, strays = row.count(), self.strays[-1]
        row.take((4 if self.named else 3) * markers)
        for marker in range(1, markers + 1):
            sample = row.numbers(3)
            if sample in strays:
                strays.remove(sample)
            if not all(map(isnan, sample)):
                held = self.markers.setdefault(f"{name}-Marker {marker}", {})
                held[len(self.frame) - 1] = sample
        row.take(2 * markers + 1)
        self.body_rows += 1


def _dense(samples: Samples, frames: int, width: int) -> dict[str, np.ndarray]:
    tables = {name: np.full((frames, width), nan) for name in samples}
    for name, held in samples.items():
        if held:
            tables[name][[*held]] = [*held.values()]
    return tables


def read_rows(text: Text, file: Path, unit: str | None) -> MotionTake:
    """Return the take in the row-typed ``text``; see :func:`..motive.read_motive`."""
    held, previous = RowsSoFar(), None
    counts = {"blank_rows": 0, "cut_rows": int(text.cut is not None), "repeated_rows": 0}
    for number, line in enumerate(text.lines, start=1):
        if line.startswith("comment"):
            continue
        if (blank := is_blank(line, ",")) or line == previous:
            counts["blank_rows" if blank else "repeated_rows"] += 1
            continue
        cells = cells_of(line, ",", file=file, number=number)
        try:
            held.add(RowCells(cells), number)
        except ValueError as error:
            raise RecordingError(f"{error}; export it again", file=file, line=number) from None
        previous = line

    if not held.frame:
        message = "the file holds no frame; export the take again"
        raise RecordingError(message, file=file, line=len(text.lines))
    unit = settle_unit("", unit, file, key="info")
    frame, printed = frame_numbers(np.array(held.frame), held.line, file), np.array(held.time)
    rate = rate_from_times(frame, printed)
    if rate is None:
        message = "the times of the frames do not increase, so that they give no rate"
        raise RecordingError(message, file=file, line=held.line[-1])
    if WHOLE.fullmatch(announced := held.infos.get("framecount", "")):
        counts["announced_frames"] = int(announced)
    names = len(held.markers) + len(held.poses) + max(map(len, held.strays))
    require("markers", names, "markers and bodies", file)
    if not names:
        raise RecordingError(f"{NO_ASSET}; export it with them", file=file, line=held.line[0])
    # a name that few rows hold is a column of all frames
    require("memory_mib", names * len(frame) * SAMPLE / MIB, "MiB of samples", file)
    strays: Samples = defaultdict(dict)
    for k, samples in enumerate(held.strays):
        for i, sample in enumerate(samples, start=1):
            strays[f"Unlabeled {i}"][k] = sample

    def place(k: int, *_: int) -> dict[str, object]:
        return {"file": file, "line": held.line[k]}

    take = TakeBuilder(unit, frame, rate, printed, counts)
    for name, position in _dense(held.markers | strays, len(frame), 3).items():
        take.markers[name] = take.position(position, name, place)
    for name, pose in _dense(held.poses, len(frame), 7).items():
        take.bodies[name] = take.body(pose[:, :3], pose[:, 3:], name, place)
    more = {"stray_ids": len(held.stray_ids), "stray_samples": sum(map(len, held.strays))}
    lacking = len(frame) * len(held.names) - held.body_rows if held.body_rows else 0
    more["lacking_body_rows"] = lacking
    return take.take(Path(file).stem, held.infos.get("version", "1.0"), more, FROM_TIMES)
