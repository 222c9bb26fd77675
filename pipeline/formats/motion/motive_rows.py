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
    numbers = []
    for cell in cells:
        number = float(cell) if NUMBER.fullmatch(cell) else nan
        if cell not in MISSING and not isfinite(number):
            raise ValueError(f"a cell holds {cell!r} where a finite number is required")
        numbers.append(number)
    return numbers


def _blocks(cells: list[str], *widths: int) -> Iterator[list[list[str]]]:
    """Yield one list per width: the groups of so many cells behind the number of groups."""
    place = 0
    for width in widths:
        count = _whole("".join(cells[place : place + 1]))
        first = place + 1
        place = place + 1 + count * width
        if place > len(cells):
            raise ValueError(
                f"the row lacks {place - len(cells)} cells that its counts require",
            )
        yield [cells[n : n + width] for n in range(first, place, width)]
    if any(cells[place:]):
        raise ValueError("the row has more cells than its counts state")


class _Rows:
    """Content of the rows of a take."""

    def __init__(self) -> None:
        self.infos = {"version": "1.0"}
        self.bodies: dict[int, str] = {}  # ID → name
        # markers without any measured position are in the take, with NaN in all frames
        self.defined: list[str] = []
        self.times: list[list[float]] = []  # of each frame: number and time in s
        self.lines: list[int] = []  # of the frames
        self.poses: list[tuple] = []  # frame from 0, name, position and quaternion
        self.markers: list[tuple] = []  # frame from 0, ID, name, position

    @property
    def named(self) -> bool:
        """Return True if markers have IDs and names."""
        return self.infos["version"] not in ("1", "1.0", "1.00")

    def add(self, kind: str, cells: list[str], line: int) -> None:
        """Add the row of the type ``kind``; ValueError for a malformed one."""
        first, second = [*cells, "", ""][:2]
        if kind == "info":
            self.infos[first] = second
        elif kind == "frame":
            self.lines.append(line)
            self.times.append(_numbers([first, second]))
            self._add_samples(cells[2:])
        elif kind in BODY_ROWS and not self.times:
            self._add_body(first, _whole(second), cells[2:])
        elif kind not in ("righthanded", *BODY_ROWS):
            raise ValueError(
                f"the row type is {kind!r}; a right-handed take has the row types "
                f"{', '.join(ROW_TYPES)}",
            )

    def _add_body(self, name: str, identity: int, cells: list[str]) -> None:
        (markers,) = _blocks(cells, 3)
        if name in self.bodies.values() or identity in self.bodies:
            raise ValueError(f"rigid body {name!r} (ID {identity}) is defined twice")
        self.bodies[identity] = name
        if self.named:
            numbers = range(1, len(markers) + 1)
            self.defined += [f"{name}-Marker {number}" for number in numbers]

    def _add_samples(self, cells: list[str]) -> None:
        bodies, markers = _blocks(cells, 11, 5 if self.named else 4)
        frame = len(self.times) - 1
        unknown = {_whole(body[0]) for body in bodies} - {*self.bodies}
        if unknown:
            raise ValueError(f"rigid body {min(unknown)} is not defined")
        names = []
        for identity, *numbers in bodies:
            name = self.bodies[int(identity)]
            # position and quaternion; the angles are redundant
            self.poses.append((frame, name, *_numbers(numbers)[:7]))
            names.append(name)
        for marker in markers:
            x, y, z, identity, name = [*marker, ""][:5]
            self.markers.append((frame, identity, name, *_numbers([x, y, z])))
            if not STRAY.fullmatch(name):
                names.append(f"{MARKER}{name}")
        repeated = [name for name in names if names.count(name) > 1]
        if repeated:
            name = repeated[0].removeprefix(MARKER)
            raise ValueError(f"two assets are named {name!r}")


def read_rows(text: Text, file: Path, unit: str | None) -> MotionTake:
    """Return the take in ``text`` of version 1.0 or 1.1; see :func:`..motive.read_motive`."""
    rows, counts = _rows_of(text, file)
    numbers, printed = np.array(rows.times).reshape(-1, 2).T
    frame = capture.frame_numbers(numbers, rows.lines, file)
    last = [len(text.lines), *rows.lines][-1]
    rate, source = capture.settle_rate("", frame, printed, file, line=last)
    unit = capture.settle_unit("", unit, file, key="info")
    counts |= capture.compare_frames(rows.infos.get("framecount", ""), len(frame))
    samples, more = _marker_samples(rows)
    bodies = [*rows.bodies.values()]
    _require_bounded({*rows.defined, *samples["name"], *bodies}, len(frame), file)
    markers = _dense(samples, rows.defined, POSE[:3], len(frame))
    poses = pd.DataFrame(rows.poses, columns=["k", "name", *POSE])
    rigid = {}
    for name, pose in _dense(poses, bodies, POSE, len(frame)).items():
        rigid[name] = RigidBody(pose[:, :3], pose[:, 3:])
    raw = MotionTake(
        name=file.stem,
        version=rows.infos["version"],
        rate=rate,
        frame=frame,
        time=printed,
        markers=markers,
        bodies=rigid,
        counts=counts,
        unit=unit,
        rate_from=source,
    )
    return capture.checked_take(raw, file, rows.lines, more=more)


def _marker_samples(rows: _Rows) -> tuple[pd.DataFrame, dict[str, int]]:
    """Return the rows k, id, name, x, y, z of the markers, those without a name last and numbered
    in each frame, and their counts.
    """
    samples = pd.DataFrame(rows.markers, columns=["k", "id", "name", *"xyz"])
    stray = samples["name"].str.fullmatch(STRAY).astype(bool)
    counts = {
        "stray_ids": samples["id"][stray].nunique(),
        "stray_samples": int(stray.sum()),
    }
    numbers = samples[stray].groupby("k").cumcount() + 1
    samples.loc[stray, "name"] = [f"Unlabeled {number}" for number in numbers]
    return pd.concat([samples[~stray], samples[stray]]), counts


def _rows_of(text: Text, file: Path) -> tuple[_Rows, dict[str, int]]:
    """Return the content of the rows, and counts of blank, cut and repeated rows."""
    counts = {
        "blank_rows": 0,
        "cut_rows": int(text.cut is not None),
        "repeated_rows": 0,
    }
    rows = _Rows()
    previous = None
    for number, line in enumerate(text.lines, start=1):
        if line.startswith("comment"):
            continue
        if not line.strip(", \t"):
            counts["blank_rows"] += 1
        elif line == previous:
            counts["repeated_rows"] += 1
        else:
            kind, *cells = cells_of(line, ",", file=file, number=number)
            try:
                rows.add(kind, cells, number)
            except ValueError as error:
                message = f"{error}; export it again"
                raise RecordingError(message, file=file, line=number) from None
            previous = line
    return rows, counts


def _require_bounded(names: set[str], frames: int, file: Path) -> None:
    """Raise RecordingError for no asset, too many, and too many samples of all."""
    require("markers", len(names), "markers and bodies", file)
    if not names:
        raise RecordingError(f"{capture.NO_ASSET}; export it with them", file=file)
    # a name in a few frames needs memory for all frames
    size = len(names) * frames * SAMPLE / MIB
    require("memory_mib", size, "MiB of samples", file)


def _dense(
    table: pd.DataFrame,
    names: list[str],
    columns: list[str],
    frames: int,
) -> dict[str, np.ndarray]:
    """Return name → ``columns`` (``frames``, …) of the rows ``k``, NaN elsewhere; the ``names``
    are there without rows, too.
    """
    samples = dict.fromkeys(names, np.full((frames, len(columns)), nan))
    numbers = np.arange(frames)
    by_frame = table.set_index("k")
    for name, rows in by_frame.groupby("name", sort=False)[columns]:
        samples[name] = rows.reindex(numbers).to_numpy()
    return samples
