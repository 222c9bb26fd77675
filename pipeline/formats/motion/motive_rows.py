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

from collections import defaultdict
from itertools import islice
from math import isfinite, nan
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
    """Parser that collects the content of rows; ValueError for an invalid cell or row."""

    def __init__(self) -> None:
        self.cells = iter(())  # remaining cells of the current row
        self.named = False  # whether markers have IDs and names (1.1)
        self.infos: dict[str, str] = {}
        self.names: dict[int, str] = {}  # body ID → name
        self.frame, self.time, self.line = [], [], []  # one entry per frame row
        self.poses: Samples = {}
        self.markers: Samples = {}
        self.strays: list[list[list[float]]] = []  # positions of unnamed markers, per frame
        self.stray_ids: set[str] = set()

    def take(self, count: int) -> list[str]:
        """Return the next ``count`` cells of the row."""
        if len(cells := [*islice(self.cells, count)]) < count:
            raise ValueError(f"the row ends where its counts require {count} more cells")
        return cells

    def count(self) -> int:
        """Return the integer in the next cell, a count or an ID."""
        (cell,) = self.take(1)
        if not capture.WHOLE.fullmatch(cell):
            raise ValueError(f"a cell holds {cell!r} where a count or an ID is required")
        return int(cell)

    def numbers(self, count: int) -> list[float]:
        """Return the numbers in the next ``count`` cells, NaN for a missing number."""
        cells = self.take(count)
        values = [float(cell) if NUMBER.fullmatch(cell) else nan for cell in cells]
        for cell, value in zip(cells, values, strict=True):
            if cell not in MISSING and not isfinite(value):
                raise ValueError(f"a cell holds {cell!r} where a finite number is required")
        return values

    def add(self, kind: str, cells: list[str], line: int) -> None:
        """Add the row in ``line``: the row type ``kind`` and the ``cells`` behind it."""
        self.cells = iter(cells)
        if kind == "info":
            key, value = self.take(2)
            self.infos[key] = value
            self.named |= key == "version" and value not in ("1", "1.0", "1.00")
        elif kind == "frame" or (kind in BODY_ROWS and not self.frame):
            self.line += [line] if kind == "frame" else []
            (self._add_frame if kind == "frame" else self._define)()
            if any(self.cells):
                raise ValueError("the row has more cells than its counts state")
        elif kind not in ("righthanded", *BODY_ROWS):
            message = f"the row type is {kind!r}; a right-handed take has the row types "
            raise ValueError(f"{message}{', '.join(ROW_TYPES)}")

    def _define(self) -> None:
        (name,), identity, markers = self.take(1), self.count(), self.count()
        self.numbers(3 * markers)
        if identity in self.names or name in self.poses:
            raise ValueError(f"rigid body {name!r} (ID {identity}) is defined twice")
        self.names[identity], self.poses[name] = name, {}
        # a marker without any measured position is in the take, with NaN in all frames
        if self.named:
            self.markers |= {f"{name}-Marker {marker}": {} for marker in range(1, markers + 1)}

    def _add_frame(self) -> None:
        k, strays = len(self.frame), []
        self.frame += self.numbers(1)
        self.time += self.numbers(1)
        for _ in range(self.count()):
            pose = self.poses.get(self.names.get(identity := self.count(), ""), {k: []})
            if k in pose:
                raise ValueError(f"rigid body {identity} is not defined, or has two poses")
            pose[k] = self.numbers(10)[:7]  # position and quaternion; the angles are redundant
        for _ in range(self.count()):
            sample, (identity, *name) = self.numbers(3), self.take(2 if self.named else 1)
            if capture.STRAY.fullmatch(name := "".join(name)):
                strays.append(sample)
                self.stray_ids.add(identity)
            elif self.markers.setdefault(name, {}).setdefault(k, sample) is not sample:
                raise ValueError(f"two markers are named {name!r}")
        self.strays.append(strays)


def read_rows(text: Text, file: Path, unit: str | None) -> MotionTake:
    """Return the take in ``text`` of version 1.0 or 1.1; see :func:`..motive.read_motive`."""
    parser, previous = TypedRows(), None
    counts = {"blank_rows": 0, "cut_rows": int(text.cut is not None), "repeated_rows": 0}
    for number, line in enumerate(text.lines, start=1):
        if line.startswith("comment"):
            continue
        if (blank := not line.strip(", \t")) or line == previous:
            counts["blank_rows" if blank else "repeated_rows"] += 1
            continue
        kind, *cells = cells_of(line, ",", file=file, number=number)
        try:
            parser.add(kind, cells, number)
        except ValueError as error:
            raise RecordingError(f"{error}; export it again", file=file, line=number) from None
        previous = line
    frame = capture.frame_numbers(np.array(parser.frame), parser.line, file)
    printed = np.array(parser.time)
    if (rate := capture.rate_from_times(frame, printed)) is None:
        message = "no rate: the file has no frame, or the times of its frames do not increase; "
        message += "export the take again"
        raise RecordingError(message, file=file, line=[len(text.lines), *parser.line][-1])
    unit = capture.settle_unit("", unit, file, key="info")
    counts |= capture.compare_frames(parser.infos.get("framecount", ""), len(frame))
    names = len(parser.markers) + len(parser.poses) + max(map(len, parser.strays))
    require("markers", names, "markers and bodies", file)
    if not names:
        raise RecordingError(f"{capture.NO_ASSET}; export it with them", file=file)
    # a name in a few frames needs memory for all frames
    require("memory_mib", names * len(frame) * SAMPLE / MIB, "MiB of samples", file)
    strays: Samples = defaultdict(dict)
    for k, samples in enumerate(parser.strays):
        for i, sample in enumerate(samples, start=1):
            strays[f"Unlabeled {i}"][k] = sample

    def dense(samples: dict[int, list[float]], width: int) -> np.ndarray:
        table = np.full((len(frame), width), nan)
        table[[*samples]] = np.array([*samples.values()]).reshape(-1, width)
        return table

    markers = {name: dense(samples, 3) for name, samples in (parser.markers | strays).items()}
    poses = {name: dense(samples, 7) for name, samples in parser.poses.items()}
    bodies = {name: RigidBody(pose[:, :3], pose[:, 3:]) for name, pose in poses.items()}
    more = {"stray_ids": len(parser.stray_ids), "stray_samples": sum(map(len, parser.strays))}
    about = file.stem, parser.infos.get("version", "1.0"), rate, frame, printed, markers, bodies
    raw = MotionTake(*about, counts, unit, rate_from=capture.FROM_TIMES)
    return capture.checked_take(raw, file, parser.line, more=more)
