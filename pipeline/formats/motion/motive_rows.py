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
measured, from the bodies' rows (``name-Marker i``). Solved places are not read: they do not move
while a body is lost. No row states a unit of length or a rate.
"""

from collections import defaultdict
from itertools import islice
from math import isfinite, isnan, nan
from pathlib import Path

import numpy as np

from pipeline.core.bounds import MIB, require
from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import MISSING, NUMBER, Text, cells_of
from pipeline.formats.motion import take as capture
from pipeline.formats.motion.take import MotionTake, RigidBody

BODY_ROWS = ("rigidbody", "trackable")
ROW_TYPES = ("comment", "info", "righthanded", "lefthanded", "frame", *BODY_ROWS)
SAMPLE = 24  # bytes of x, y, z
Samples = dict[str, dict[int, list[float]]]  # name → index of the frame → numbers


class TypedRows:
    """Content of the rows that were added, whose cells are taken from left to right; ValueError for
    a cell or a row that cannot come.
    """

    def __init__(self) -> None:
        self.cells = iter(())  # of the row, that are not taken yet
        self.named = False  # whether markers have IDs and names (1.1)
        self.infos: dict[str, str] = {}
        self.names: dict[int, str] = {}  # of bodies by ID
        self.frame, self.time, self.line = [], [], []
        self.poses: Samples = {}
        self.markers: Samples = {}
        self.strays: list[list[list[float]]] = []  # of each frame
        self.stray_ids: set[str] = set()
        self.body_rows = 0

    def take(self, count: int) -> list[str]:
        """Return the next ``count`` cells."""
        if len(cells := [*islice(self.cells, count)]) < count:
            raise ValueError(f"the row has fewer cells than the {count} more its counts require")
        return cells

    def count(self) -> int:
        """Return the next cell, a count or an ID."""
        (cell,) = self.take(1)
        if not capture.WHOLE.fullmatch(cell):
            raise ValueError(f"a cell holds {cell!r} where a count or an ID is required")
        return int(cell)

    def numbers(self, count: int) -> list[float]:
        """Return the next ``count`` cells, NaN where one is missing."""
        cells = self.take(count)
        values = [float(cell) if NUMBER.fullmatch(cell) else nan for cell in cells]
        for cell, value in zip(cells, values, strict=True):
            if cell not in MISSING and not isfinite(value):
                raise ValueError(f"a cell holds {cell!r} where a finite number is required")
        return values

    def add(self, kind: str, cells: list[str], line: int) -> None:
        """Add the row of a ``kind`` at ``line``, of more ``cells``."""
        self.cells = iter(cells)
        if kind == "info":
            key, value = self.take(2)
            self.infos[key] = value
            self.named |= key == "version" and value not in ("1", "1.0", "1.00")
        elif kind == "frame" or kind in BODY_ROWS:
            self.line += [line] if kind == "frame" else []
            add_body = self._add_body if self.frame else self._define
            (self._add_frame if kind == "frame" else add_body)()
            if any(self.cells):
                raise ValueError("the row goes on where its counts end it")
        elif kind != "righthanded":
            message = f"the row is of the type {kind!r}, where a right-handed take has "
            raise ValueError(f"{message}{', '.join(ROW_TYPES)}")

    def _define(self) -> None:
        (name,), identity, markers = self.take(1), self.count(), self.count()
        self.numbers(3 * markers)
        if identity in self.names or name in self.poses:
            raise ValueError(f"rigid body {name!r} (ID {identity}) is defined twice")
        self.names[identity], self.poses[name] = name, {}
        # a marker that is never seen is missing, not absent
        self.markers |= {f"{name}-Marker {marker}": {} for marker in range(1, markers + 1)}

    def _add_frame(self) -> None:
        k, strays = len(self.frame), []
        self.frame += self.numbers(1)
        self.time += self.numbers(1)
        for _ in range(self.count()):
            pose = self.poses.get(self.names.get(identity := self.count(), ""), {k: []})
            if k in pose:
                raise ValueError(f"rigid body {identity} is not defined, or has two poses")
            pose[k] = self.numbers(10)[:7]  # position, quaternion, and angles that repeat it
        for _ in range(self.count()):
            sample, (identity, *name) = self.numbers(3), self.take(2 if self.named else 1)
            if capture.STRAY.fullmatch(name := "".join(name)):
                strays.append(sample)
                self.stray_ids.add(identity)
            elif self.markers.setdefault(name, {}).setdefault(k, sample) is not sample:
                raise ValueError(f"two markers are named {name!r}")
        self.strays.append(strays)

    def _add_body(self) -> None:
        at, (name,), identity = self.numbers(2), self.take(1), self.count()
        if at != [self.frame[-1], self.time[-1]] or self.names.get(identity) != name:
            raise ValueError(f"rigid body {name!r} is not defined, or not of the frame before it")
        self.count()
        markers, strays = self.count(), self.strays[-1]
        self.take((4 if self.named else 3) * markers)
        for marker in range(1, markers + 1):
            sample = self.numbers(3)
            if sample in strays:
                strays.remove(sample)
            if not all(map(isnan, sample)):
                held = self.markers.setdefault(f"{name}-Marker {marker}", {})
                held[len(self.frame) - 1] = sample
        self.take(2 * markers + 1)
        self.body_rows += 1


def read_rows(text: Text, file: Path, unit: str | None) -> MotionTake:
    """Return the take in the row-typed ``text``; see :func:`..motive.read_motive`."""
    held, previous = TypedRows(), None
    counts = {"blank_rows": 0, "cut_rows": int(text.cut is not None), "repeated_rows": 0}
    for number, line in enumerate(text.lines, start=1):
        if line.startswith("comment"):
            continue
        if (blank := not line.strip(", \t")) or line == previous:
            counts["blank_rows" if blank else "repeated_rows"] += 1
            continue
        kind, *cells = cells_of(line, ",", file=file, number=number)
        try:
            held.add(kind, cells, number)
        except ValueError as error:
            raise RecordingError(f"{error}; export it again", file=file, line=number) from None
        previous = line
    frame = capture.frame_numbers(np.array(held.frame), held.line, file)
    printed = np.array(held.time)
    if (rate := capture.rate_from_times(frame, printed)) is None:
        message = "the file holds no frame, or the times of its frames do not increase, so that "
        message += "they give no rate; export the take again"
        raise RecordingError(message, file=file, line=[len(text.lines), *held.line][-1])
    unit = capture.settle_unit("", unit, file, key="info")
    if capture.WHOLE.fullmatch(announced := held.infos.get("framecount", "")):
        counts["announced_frames"] = int(announced)
    names = len(held.markers) + len(held.poses) + max(map(len, held.strays))
    require("markers", names, "markers and bodies", file)
    if not names:
        raise RecordingError(f"{capture.NO_ASSET}; export it with them", file=file)
    # a name that few rows hold is a column of all frames
    require("memory_mib", names * len(frame) * SAMPLE / MIB, "MiB of samples", file)
    strays: Samples = defaultdict(dict)
    for k, samples in enumerate(held.strays):
        for i, sample in enumerate(samples, start=1):
            strays[f"Unlabeled {i}"][k] = sample

    def dense(samples: dict[int, list[float]], width: int) -> np.ndarray:
        table = np.full((len(frame), width), nan)
        table[[*samples]] = np.array([*samples.values()]).reshape(-1, width)
        return table

    markers = {name: dense(samples, 3) for name, samples in (held.markers | strays).items()}
    poses = {name: dense(samples, 7) for name, samples in held.poses.items()}
    bodies = {name: RigidBody(pose[:, :3], pose[:, 3:]) for name, pose in poses.items()}
    lacking = len(frame) * len(held.names) - held.body_rows if held.body_rows else 0
    more = {"stray_ids": len(held.stray_ids), "stray_samples": sum(map(len, held.strays))}
    about = file.stem, held.infos.get("version", "1.0"), rate, frame, printed, markers, bodies
    raw = MotionTake(*about, counts, unit, rate_from=capture.FROM_TIMES)
    return capture.checked_take(raw, file, held.line, more=more | {"lacking_body_rows": lacking})
