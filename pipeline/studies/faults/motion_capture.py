"""What happens in optical motion capture, done to a take as Motive's columnar CSV: markers are
hidden, confused, frozen or mis-scaled.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.studies.faults.fault import Files
from pipeline.studies.faults.text import lines_of

STRAY = b"Unlabeled 9000"


@dataclass
class _Take:
    """Cells of the labels' rows and of the frames' rows, which may be changed, and the lines above
    them.
    """

    top: list[bytes]
    labels: list[list[bytes]]
    rows: list[list[bytes]]

    @classmethod
    def parsed(cls, content: bytes) -> _Take:
        lines, rows = lines_of(content)
        first = next(i for i, line in enumerate(lines) if line.startswith(b",Type"))
        cells = [line.rstrip(b"\r\n").split(b",") for line in lines]
        return cls(lines[:first], cells[first : rows[0]], [cells[i] for i in rows])

    @property
    def content(self) -> bytes:
        return b"".join(self.top) + b"".join(
            b",".join(cells) + b"\r\n" for cells in self.labels + self.rows
        )

    @property
    def markers(self) -> list[int]:
        """First column of each labelled marker, in the order of the file: three a link."""
        names = self.labels[1]
        return [i for i in range(2, len(names), 3) if not names[i].startswith(b"Unlabeled")]

    def burst(self, length: float, rng: np.random.Generator) -> range:
        """Rows of a burst of ``length`` frames at a random place, neither first nor last."""
        length = min(int(length), len(self.rows) - 2)
        start = int(rng.integers(1, len(self.rows) - length))
        return range(start, start + length)

    def link(self, rng: np.random.Generator) -> list[int]:
        """The columns of the three markers of a random link."""
        first = 3 * int(rng.integers(len(self.markers) // 3))
        return self.markers[first : first + 3]


def hidden_link(content: bytes, frames: float, rng: np.random.Generator) -> bytes:
    """All markers of one link are occluded for a burst of ``frames``."""
    take = _Take.parsed(content)
    columns = take.link(rng)
    for i in take.burst(frames, rng):
        for column in columns:
            take.rows[i][column : column + 3] = [b""] * 3
    return take.content


def hidden_samples(content: bytes, share: float, rng: np.random.Generator) -> bytes:
    """A ``share`` of all labelled samples, each on its own, is not there."""
    take = _Take.parsed(content)
    markers = take.markers
    for i, j in np.argwhere(rng.random((len(take.rows), len(markers))) < share):
        take.rows[i][markers[j] : markers[j] + 3] = [b""] * 3
    return take.content


def swapped_labels(content: bytes, frames: float, rng: np.random.Generator) -> bytes:
    """Two markers of one link carry each other's label for a burst of ``frames``."""
    take = _Take.parsed(content)
    return _exchanged(take, *rng.choice(take.link(rng), 2, replace=False).tolist(), frames, rng)


def swapped_links(content: bytes, frames: float, rng: np.random.Generator) -> bytes:
    """A marker of one link and one of the next carry each other's label for a burst of
    ``frames``.
    """
    take = _Take.parsed(content)
    link, one, other = rng.integers([2, 3, 3])
    return _exchanged(
        take, take.markers[3 * link + one], take.markers[3 * link + 3 + other], frames, rng
    )


def _exchanged(take: _Take, one: int, other: int, frames: float, rng: np.random.Generator) -> bytes:
    for i in take.burst(frames, rng):
        row = take.rows[i]
        row[one : one + 3], row[other : other + 3] = row[other : other + 3], row[one : one + 3]
    return take.content


def lost_label(content: bytes, frames: float, rng: np.random.Generator) -> bytes:
    """A marker is seen for a burst of ``frames``, but as a new one without a label."""
    take = _Take.parsed(content)
    column = int(rng.choice(take.markers))
    for cells, word in zip(take.labels, (b"Marker", STRAY, b'"9000"', b"Position"), strict=False):
        cells += [word] * 3
    take.labels[-1] += [b"X", b"Y", b"Z"]
    burst = take.burst(frames, rng)
    for i, row in enumerate(take.rows):
        row += row[column : column + 3] if i in burst else [b""] * 3
        if i in burst:
            row[column : column + 3] = [b""] * 3
    return take.content


def frozen_tracker(content: bytes, frames: float, rng: np.random.Generator) -> bytes:
    """For a burst of ``frames`` the positions are those of the frame before it, while frames and
    time go on.
    """
    take = _Take.parsed(content)
    for i in take.burst(frames, rng):
        take.rows[i][2:] = take.rows[i - 1][2:]
    return take.content


def other_lengths(content: bytes, factor: float, rng: np.random.Generator) -> bytes:
    """Every position times ``factor`` while the header states metres: 1000 of millimetres, 39.37 of
    inches.
    """
    take = _Take.parsed(content)
    for row in take.rows:
        row[2:] = [b"%.6f" % (float(cell) * factor) if cell else cell for cell in row[2:]]
    return take.content


def renamed_marker(content: bytes, severity: float, rng: np.random.Generator) -> bytes:
    """The name of a labelled marker has a letter that is no UTF-8."""
    take = _Take.parsed(content)
    column = int(rng.choice(take.markers))
    take.labels[1][column : column + 3] = [take.labels[1][column] + b"\xe9"] * 3
    return take.content


def renamed_file(files: Files, severity: float, rng: np.random.Generator) -> Files:
    """The take's file has a letter in its name that is no UTF-8."""
    return {name.replace(".csv", "\udce9.csv"): content for name, content in files.items()}
