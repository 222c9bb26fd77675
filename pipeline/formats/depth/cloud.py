"""Point clouds of any format: read by their formats' own modules, in what they share here.

By hand, because Open3D fills up what a truncated file lacks, reads the float64 of a PCD as float32
and takes the coordinates of a PLY to come before its other properties; where it reads rightly, the
tests hold the two against each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.core.bounds import MIB, read_whole, require
from pipeline.core.errors import RecordingError
from pipeline.formats import depth
from pipeline.formats.delimited import numbers_of
from pipeline.formats.depth.lzf import decompress
from pipeline.formats.format import BYTES, Head, Kind, formats_in, recognised

# as C++ prints it; nan itself is known to numbers_of
NO_POSITION = ("-nan", "+nan", "inf", "-inf", "+inf")


@dataclass(frozen=True)
class PointCloud:
    """One frame: ``points`` (N, 3) float64 in the file's unit, those that were measured;
    ``missing``, how many more it holds without a position (NaN or infinite).
    """

    points: np.ndarray
    missing: int

    @classmethod
    def measured(cls, points: np.ndarray) -> PointCloud:
        """The cloud of (N, 3) ``points``, those without a position left out and counted."""
        measured = points[np.isfinite(points).all(axis=1)]
        return cls(measured, len(points) - len(measured))


@dataclass(frozen=True)
class Header:
    """What a header announces: ``count`` points, each a record of ``point`` (field 'x' among them),
    in ``form`` from byte ``start`` on; whether other elements than points follow them.
    """

    count: int
    point: np.dtype
    form: str
    start: int
    more: bool = False


def is_cloud(file: Path) -> bool:
    """Whether the name of ``file`` is that of a point cloud."""
    suffix = Path(file).suffix.lower()
    return any(suffix in one.endings for one in formats_in(depth, Kind.CLOUD))


def read_cloud(file: Path) -> PointCloud:
    """The points of the cloud in ``file``; those of a PCD are moved to where its VIEWPOINT
    (position and quaternion) puts them.

    Colours, normals and other fields are passed over, wherever they stand. Raises RecordingError
    for a file that is missing, truncated, of another format, without x, y, z, or that holds other
    data than its header announces.
    """
    file = Path(file)
    try:
        content = read_whole(file)
    except OSError as error:
        raise RecordingError(
            f"the cloud cannot be read ({error.strerror}); copy it again, or take it out of the "
            "take",
            file=file,
        ) from None
    chosen = recognised(Head(file, content[:BYTES]), formats_in(depth, Kind.CLOUD))
    if chosen is None:
        raise RecordingError("this is no PCD or PLY point cloud", file=file)
    return chosen.read(content, file=file)


def points_of(content: bytes, header: Header, file: Path) -> np.ndarray:
    """(N, 3) the points that the ``header`` announces; RecordingError where there are others."""
    for axis in "xyz":
        if (
            axis not in header.point.names
            or header.point[axis].shape
            or header.point[axis].kind != "f"
        ):
            names = ", ".join(header.point.names)
            raise RecordingError(
                f"the cloud has no single floating-point {axis}; there are {names}", file=file
            )
    size = header.count * header.point.itemsize
    require("part_mib", size / MIB, "MiB of points, which the header announces,", file)
    if size <= 0:
        raise RecordingError(
            f"the header announces {header.count} points of {header.point.itemsize} bytes",
            file=file,
        )
    with np.errstate(invalid="ignore", over="ignore"):  # points without a position stay without
        return (_rows if header.form == "ascii" else _records)(content, header, file)


def _records(content: bytes, header: Header, file: Path) -> np.ndarray:
    data, size = content[header.start :], header.count * header.point.itemsize
    if header.form == "binary_compressed":
        packed, unpacked = np.frombuffer(data[:8].ljust(8, b"\0"), "<u4").tolist()
        if unpacked != size or len(data) < 8 + packed:
            raise RecordingError(
                f"{len(data)} bytes of data that should unfold to {size}: truncated or damaged",
                file=file,
            )
        # PCL sets the size of the file before it has compressed, and leaves zeros
        _require_none(len(data[8 + packed :].rstrip(b"\0")), file)
        data = decompress(data[8 : 8 + packed], size)
        if data is None:
            raise RecordingError("the compressed data are damaged; copy the cloud again", file=file)
        # compressed clouds hold field after field instead of point after point
        starts = {name: header.count * header.point.fields[name][1] for name in "xyz"}
        columns = [
            np.frombuffer(data, header.point[name], header.count, starts[name]) for name in "xyz"
        ]
    elif len(data) < size:
        raise RecordingError(
            f"{len(data)} bytes of data for {header.count} points of {header.point.itemsize}: "
            "truncated",
            file=file,
        )
    else:
        _require_none(0 if header.more else len(data) - size, file)
        records = np.frombuffer(data, header.point, header.count)
        columns = [records[name] for name in "xyz"]
    return np.stack(columns, axis=1).astype(float)


def _require_none(surplus: int, file: Path) -> None:
    if surplus:
        raise RecordingError(
            f"{surplus} bytes follow the points that the header announces: the header is of "
            "another cloud, or the file is damaged; write the cloud again",
            file=file,
        )


def _rows(content: bytes, header: Header, file: Path) -> np.ndarray:
    # what follows the last line end may have lost digits
    lines = content[header.start :].decode("latin-1").lower().split("\n")[:-1]
    first = content.count(b"\n", 0, header.start) + 1
    filled = [
        (number, line.split()) for number, line in enumerate(lines, start=first) if line.strip()
    ]
    if len(filled) < header.count:
        raise RecordingError(
            f"{len(filled)} whole rows where the header announces {header.count} points: "
            "truncated or damaged",
            file=file,
        )
    if len(filled) > header.count and not header.more:
        raise RecordingError(
            f"{len(filled)} rows where the header announces {header.count} points: the header is "
            "of another cloud, or the file is damaged; write the cloud again",
            file=file,
            line=filled[header.count][0],
        )
    filled = filled[: header.count]
    widths = [int(np.prod(header.point[name].shape)) for name in header.point.names]
    cells = [sum(widths[: header.point.names.index(axis)]) for axis in "xyz"]
    for number, row in filled:
        if len(row) != sum(widths):
            raise RecordingError(
                f"{len(row)} numbers in a row of {sum(widths)}: truncated or damaged",
                file=file,
                line=number,
            )
        for cell in cells:
            row[cell] = "nan" if row[cell] in NO_POSITION else row[cell]
    return numbers_of(
        [",".join(row) for _, row in filled],
        [number for number, _ in filled],
        cells,
        file=file,
        gaps=True,
    )
