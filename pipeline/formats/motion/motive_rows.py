"""The row-typed grammar of OptiTrack's CSV takes (format versions 1.0 of Tracking Tools and 1.1 of
Motive).

The first cell of a row says what it is. In this order: any number of ``comment`` rows;
``righthanded`` or ``lefthanded``; ``info,version|framecount|rigidbodycount,…`` (1.0 gives no
version); a definition of each rigid body; then, per frame, one ``frame`` row and one row of each
body. 1.0 writes ``trackable`` for ``rigidbody``. Bracketed cells are of 1.1 alone::

    rigidbody, name, ID, n, n × (x, y, z)                                              the
    definition, in the body's own frame
    frame, frame, time, m, m × (ID, x, y, z, qx, qy, qz, qw, yaw, pitch, roll), p, p × (x, y, z,
    ID[, name])
    rigidbody, frame, time, name, ID, frames since last tracked, n, n × (x, y, z[, ID]) solved, n ×
    (x, y, z) measured,
               n × tracked, n × quality, mean error (mm)

Positions are read from the frame row (poses of the m bodies tracked, all p markers seen) and,
measured, from the bodies' rows, in which a marker that was not seen is NAN. A body's marker is
called ``name-Marker i``, as 1.1 does. The solved places are not read: they repeat the pose, and
stay where they were while a body is lost. No row states a unit of length (the mean error's is its
own alone), nor a rate.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, isnan, nan
from pathlib import Path

import numpy as np

from pipeline.core.bounds import MIB, require
from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import MISSING, NUMBER, Text, cells_of, is_blank
from pipeline.formats.motion.take import (
    STRAY,
    WHOLE,
    MotionTake,
    RigidBody,
    checked_position,
    checked_rotation,
    clock_counts,
    frame_numbers,
    rate_from_times,
    sample_counts,
    settle_unit,
)

BODY_ROWS = ("rigidbody", "trackable")
ROW_TYPES = ("comment", "info", "righthanded", "lefthanded", "frame", *BODY_ROWS)
SAMPLE = 24  # bytes of x, y, z
POSE = slice(0, 7)  # of x, y, z, qx, qy, qz, qw, yaw, pitch, roll


class Row:
    """The cells of one row, taken from left to right; RecordingError with its line where they are
    not what should come.
    """

    def __init__(self, cells: list[str], file: Path, line: int) -> None:
        self.cells, self.file, self.line, self.place = cells, file, line, 1

    def take(self, count: int) -> list[str]:
        if self.place + count > len(self.cells):
            raise self.refusal(
                f"the row has {len(self.cells)} cells where its counts ask for "
                f"{self.place + count} or more: cut or damaged"
            )
        self.place += count
        return self.cells[self.place - count : self.place]

    def text(self) -> str:
        return self.take(1)[0]

    def count(self) -> int:
        cell = self.text()
        if not WHOLE.fullmatch(cell):
            raise self.refusal(
                f"cell {self.place} holds {cell!r} where a count or an ID should stand"
            )
        return int(cell)

    def numbers(self, count: int) -> list[float]:
        cells = self.take(count)
        for cell in cells:
            if cell not in MISSING and not NUMBER.fullmatch(cell):
                raise self.refusal(
                    f"there is {cell!r} before cell {self.place + 1}, not a finite number"
                )
        values = [nan if cell in MISSING else float(cell) for cell in cells]
        if inf in values or -inf in values:
            raise self.refusal(f"a number before cell {self.place + 1} is too large")
        return values

    def end(self) -> None:
        if any(self.cells[self.place :]):
            raise self.refusal(
                f"the row goes on after cell {self.place}, where its counts let it end"
            )

    def refusal(self, message: str) -> RecordingError:
        return RecordingError(message, file=self.file, line=self.line)


@dataclass
class Samples:
    """Samples by name: at which frames (counted from 0), and what; as sparse as the file, however
    many names come and go.
    """

    width: int
    rows: dict[str, tuple[list[int], list[list[float]]]] = field(default_factory=dict)

    def add(self, name: str, k: int, sample: list[float]) -> None:
        frames, samples = self.rows.setdefault(name, ([], []))
        frames.append(k)
        samples.append(sample)

    def has(self, name: str, k: int) -> bool:
        return name in self.rows and k in self.rows[name][0][-1:]

    def dense(self, frames: int) -> dict[str, np.ndarray]:
        """Return name → (frames, width), NaN where there is no sample."""
        tables = {name: np.full((frames, self.width), nan) for name in self.rows}
        for name, (at, samples) in self.rows.items():
            if at:
                tables[name][at] = samples
        return tables


@dataclass
class _Recording:
    """What the rows of a file said."""

    named: bool = False  # whether markers have IDs and names of their own (1.1)
    infos: dict[str, str] = field(default_factory=dict)
    names: dict[int, str] = field(default_factory=dict)  # of bodies by ID
    frame: list[float] = field(default_factory=list)
    time: list[float] = field(default_factory=list)
    line: list[int] = field(default_factory=list)
    poses: Samples = field(default_factory=lambda: Samples(7))
    markers: Samples = field(default_factory=lambda: Samples(3))
    strays: list[list[list[float]]] = field(default_factory=list)  # of each frame
    stray_ids: set[str] = field(default_factory=set)
    body_rows: int = 0

    def define(self, row: Row) -> None:
        name, identity, markers = row.text(), row.count(), row.count()
        row.numbers(3 * markers)
        row.end()
        if identity in self.names or name in self.names.values():
            raise row.refusal(f"rigid body {name!r} (ID {identity}) is defined twice")
        self.names[identity] = name
        for marker in range(1, markers + 1):  # a marker that is never seen is missing, not absent
            self.markers.rows[f"{name}-Marker {marker}"] = ([], [])
        self.poses.rows[name] = ([], [])

    def add_frame(self, row: Row) -> None:
        self.line.append(row.line)
        self.frame += row.numbers(1)
        self.time += row.numbers(1)
        k = len(self.frame) - 1
        for _ in range(row.count()):
            identity = row.count()
            if identity not in self.names:
                raise row.refusal(f"rigid body {identity} is not defined")
            if self.poses.has(self.names[identity], k):
                raise row.refusal(f"rigid body {identity} has two poses")
            self.poses.add(self.names[identity], k, row.numbers(10)[POSE])
        self.strays.append([])
        for _ in range(row.count()):
            sample, identity, name = row.numbers(3), row.text(), row.text() if self.named else ""
            if STRAY.fullmatch(name):
                self.strays[k].append(sample)
                self.stray_ids.add(identity)
            elif self.markers.has(name, k):
                raise row.refusal(f"two markers are named {name!r}")
            else:
                self.markers.add(name, k, sample)
        row.end()

    def add_body(self, row: Row) -> None:
        frame, time, name, identity = row.numbers(1), row.numbers(1), row.text(), row.count()
        if frame != self.frame[-1:] or time != self.time[-1:]:
            raise row.refusal(f"the row of rigid body {name!r} is not of the frame before it")
        if self.names.get(identity) != name:
            raise row.refusal(f"rigid body {name!r} (ID {identity}) is not defined")
        row.count()
        markers = row.count()
        row.take((4 if self.named else 3) * markers)
        strays = self.strays[-1]
        for marker in range(1, markers + 1):
            sample = row.numbers(3)
            if sample in strays:
                strays.remove(sample)
            if not all(map(isnan, sample)):
                self.markers.add(f"{name}-Marker {marker}", len(self.frame) - 1, sample)
        row.take(2 * markers + 1)
        row.end()
        self.body_rows += 1


def read_rows(text: Text, file: Path, unit: str | None) -> MotionTake:
    """Take in the row-typed ``text`` of ``file``; see
    :func:`pipeline.formats.motion.motive.read_motive` for what it holds and raises.
    """
    recording = _Recording()
    counts = {"blank_rows": 0, "cut_rows": int(text.cut is not None), "repeated_rows": 0}
    previous = None
    for number, line in enumerate(text.lines, start=1):
        if line.startswith("comment"):
            continue
        if is_blank(line, ",") or line == previous:
            counts["blank_rows" if is_blank(line, ",") else "repeated_rows"] += 1
            continue
        _add(recording, Row(cells_of(line, ",", file=file, number=number), file, number))
        previous = line
    if not recording.frame:
        raise RecordingError(
            "the file holds no frame; export the take again", file=file, line=len(text.lines)
        )
    unit = settle_unit("", unit, file, key="info")
    frame = frame_numbers(np.array(recording.frame), recording.line, file)
    printed = np.array(recording.time)
    rate = rate_from_times(frame, printed)
    if rate is None:
        raise RecordingError(
            "the times of the frames do not increase, so that they give no rate",
            file=file,
            line=recording.line[-1],
        )
    time = (frame - frame[0]) / rate
    if WHOLE.fullmatch(recording.infos.get("framecount", "")):
        counts["announced_frames"] = int(recording.infos["framecount"])
    counts |= clock_counts(frame, time, printed) | {"zero_samples": 0, "partial_samples": 0}

    names = len(recording.markers.rows) + len(recording.poses.rows)
    names += max(map(len, recording.strays))
    require("markers", names, "markers and bodies", file)
    # a name that few rows hold is a column of all frames
    require("memory_mib", names * len(frame) * SAMPLE / MIB, "MiB of samples", file)
    strays = Samples(3)
    for k, samples in enumerate(recording.strays):
        for i, sample in enumerate(samples, start=1):
            strays.add(f"Unlabeled {i}", k, sample)

    def place(k: int, *_: int) -> dict[str, object]:
        return {"file": file, "line": recording.line[k]}

    tracks = recording.markers.dense(len(frame)) | strays.dense(len(frame))
    markers = {
        name: checked_position(position, name, unit, place, counts)
        for name, position in tracks.items()
    }
    bodies = {
        name: RigidBody(
            checked_position(pose[:, :3], name, unit, place, counts),
            checked_rotation(pose[:, 3:], name, place, counts),
        )
        for name, pose in recording.poses.dense(len(frame)).items()
    }
    if not markers and not bodies:
        raise RecordingError(
            "the take holds no marker and no rigid body; export it with them",
            file=file,
            line=recording.line[0],
        )
    counts |= sample_counts(markers, bodies, len(frame))
    counts |= {
        "stray_ids": len(recording.stray_ids),
        "stray_samples": sum(map(len, recording.strays)),
    }
    counts["lacking_body_rows"] = (
        len(frame) * len(recording.names) - recording.body_rows if recording.body_rows else 0
    )
    version = recording.infos.get("version", "1.0")
    return MotionTake(Path(file).stem, version, rate, frame, time, markers, bodies, counts, unit)


def _add(recording: _Recording, row: Row) -> None:
    kind = row.cells[0]
    if kind == "info":
        key = row.text()
        recording.infos[key] = row.text()
        if key == "version":
            recording.named = row.cells[2] not in ("1", "1.0", "1.00")
    elif kind == "lefthanded":
        raise row.refusal("the take is left-handed; export it right-handed")
    elif kind == "frame":
        recording.add_frame(row)
    elif kind in BODY_ROWS:
        (recording.add_body if recording.frame else recording.define)(row)
    elif kind not in ("righthanded", "comment"):
        raise row.refusal(f"no row type {kind!r}; there are {', '.join(ROW_TYPES)}")
