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
measured, from the bodies' rows, in which a marker that was not seen is NAN. A body's marker is
called ``name-Marker i``, as 1.1 does. The solved places are not read: they repeat the pose, and
stay where they were while a body is lost. No row states a unit of length (the mean error's is its
own alone), nor a rate.
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
    """Cells of one row, taken from left to right; RecordingError with its line where they are not
    what should come.
    """

    def __init__(self, cells: list[str], file: Path, line: int) -> None:
        self.cells, self.file, self.line, self.place = cells, file, line, 1

    def take(self, count: int) -> list[str]:
        """Return the next ``count`` cells."""
        end = self.place + count
        if end > len(self.cells):
            message = f"the row has {len(self.cells)} cells where its counts ask for {end} or more"
            raise self.fault(f"{message}: cut or damaged")
        self.place = end
        return self.cells[end - count : end]

    def text(self) -> str:
        """Return the next cell."""
        return self.take(1)[0]

    def count(self) -> int:
        """Return the next cell, a count or an ID."""
        if not WHOLE.fullmatch(cell := self.text()):
            raise self.fault(f"cell {self.place} holds {cell!r} where a count or an ID should be")
        return int(cell)

    def numbers(self, count: int) -> list[float]:
        """Return the next ``count`` cells, NaN where one is missing."""
        cells = self.take(count)
        wrong = [cell for cell in cells if cell not in MISSING and not NUMBER.fullmatch(cell)]
        values = [] if wrong else [nan if cell in MISSING else float(cell) for cell in cells]
        if wrong or inf in values or -inf in values:
            what = f"there is {wrong[0]!r}" if wrong else "a number is too large"
            raise self.fault(f"{what} before cell {self.place + 1}, not a finite number")
        return values

    def end(self) -> None:
        """Raise RecordingError where a cell with content follows."""
        if any(self.cells[self.place :]):
            raise self.fault(
                f"the row goes on after cell {self.place}, where its counts let it end"
            )

    def fault(self, message: str) -> RecordingError:
        """Return the refusal of this row."""
        return RecordingError(message, file=self.file, line=self.line)


class RowsSoFar:
    """Content of the rows that were added."""

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

    def add(self, row: RowCells) -> None:
        """Add one row; RecordingError where it is none that can come."""
        kind = row.cells[0]
        if kind == "info":
            key = row.text()
            self.infos[key] = row.text()
            self.named |= key == "version" and row.cells[2] not in ("1", "1.0", "1.00")
        elif kind == "frame":
            self._add_frame(row)
        elif kind in BODY_ROWS:
            (self._add_body if self.frame else self._define)(row)
        elif kind == "lefthanded":
            raise row.fault("the take is left-handed; export it right-handed")
        elif kind != "righthanded":
            raise row.fault(f"no row type {kind!r}; there are {', '.join(ROW_TYPES)}")

    def _define(self, row: RowCells) -> None:
        name, identity, markers = row.text(), row.count(), row.count()
        row.numbers(3 * markers)
        row.end()
        if identity in self.names or name in self.poses:
            raise row.fault(f"rigid body {name!r} (ID {identity}) is defined twice")
        self.names[identity], self.poses[name] = name, {}
        # a marker that is never seen is missing, not absent
        self.markers |= {f"{name}-Marker {marker}": {} for marker in range(1, markers + 1)}

    def _add_frame(self, row: RowCells) -> None:
        k, strays = len(self.frame), []
        self.line.append(row.line)
        self.frame += row.numbers(1)
        self.time += row.numbers(1)
        for _ in range(row.count()):
            identity = row.count()
            pose = self.poses.get(self.names.get(identity, ""))
            if pose is None or k in pose:
                fault = "is not defined" if pose is None else "has two poses"
                raise row.fault(f"rigid body {identity} {fault}")
            pose[k] = row.numbers(10)[:7]  # position, quaternion, and angles that repeat it
        for _ in range(row.count()):
            sample, identity, name = row.numbers(3), row.text(), row.text() if self.named else ""
            if STRAY.fullmatch(name):
                strays.append(sample)
                self.stray_ids.add(identity)
            elif self.markers.setdefault(name, {}).setdefault(k, sample) is not sample:
                raise row.fault(f"two markers are named {name!r}")
        self.strays.append(strays)
        row.end()

    def _add_body(self, row: RowCells) -> None:
        frame, time, name, identity = row.numbers(1), row.numbers(1), row.text(), row.count()
        if frame != self.frame[-1:] or time != self.time[-1:]:
            raise row.fault(f"the row of rigid body {name!r} is not of the frame before it")
        if self.names.get(identity) != name:
            raise row.fault(f"rigid body {name!r} (ID {identity}) is not defined")
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
        row.end()
        self.body_rows += 1


def _dense(samples: Samples, frames: int, width: int) -> dict[str, np.ndarray]:
    """Return name → (frames, width), NaN where there is no sample."""
    tables = {name: np.full((frames, width), nan) for name in samples}
    for name, held in samples.items():
        if held:
            tables[name][[*held]] = [*held.values()]
    return tables


def read_rows(text: Text, file: Path, unit: str | None) -> MotionTake:
    """Return the take in the row-typed ``text`` of ``file``; see
    :func:`pipeline.formats.motion.motive.read_motive`.
    """
    held, previous = RowsSoFar(), None
    counts = {"blank_rows": 0, "cut_rows": int(text.cut is not None), "repeated_rows": 0}
    for number, line in enumerate(text.lines, start=1):
        if line.startswith("comment"):
            continue
        if (blank := is_blank(line, ",")) or line == previous:
            counts["blank_rows" if blank else "repeated_rows"] += 1
            continue
        held.add(RowCells(cells_of(line, ",", file=file, number=number), file, number))
        previous = line

    def fault(message: str, line: int) -> RecordingError:
        return RecordingError(message, file=file, line=line)

    if not held.frame:
        raise fault("the file holds no frame; export the take again", len(text.lines))
    unit = settle_unit("", unit, file, key="info")
    frame, printed = frame_numbers(np.array(held.frame), held.line, file), np.array(held.time)
    rate = rate_from_times(frame, printed)
    if rate is None:
        message = "the times of the frames do not increase, so that they give no rate"
        raise fault(message, held.line[-1])
    if WHOLE.fullmatch(held.infos.get("framecount", "")):
        counts["announced_frames"] = int(held.infos["framecount"])
    names = len(held.markers) + len(held.poses) + max(map(len, held.strays))
    require("markers", names, "markers and bodies", file)
    if not names:
        raise fault(f"{NO_ASSET}; export it with them", held.line[0])
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
    return take.take(Path(file).stem, held.infos.get("version", "1.0"), more)
