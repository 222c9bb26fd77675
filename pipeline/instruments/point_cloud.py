"""Point clouds: PCD (ascii, binary, binary_compressed) and PLY (ascii, binary of either byte order).

By hand, because Open3D fills up what a truncated file lacks, reads the float64 of a PCD as float32 and takes the coordinates of a PLY
to come before its other properties; where it reads rightly, the tests hold the two against each other.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.errors import RecordingError
from pipeline.instruments.delimited import numbers_of
from pipeline.instruments.lzf import decompress

MAX_BYTES = 2**30  # of the points of one frame; a header that announces more is damaged
PLY_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
PLY_FORMATS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
NO_POSITION = ("-nan", "+nan", "inf", "-inf", "+inf")  # as C++ prints it; nan itself is known to numbers_of
PCD_TYPES = {"f4", "f8", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8"}
PCD_FORMATS = ("ascii", "binary", "binary_compressed")


@dataclass(frozen=True)
class PointCloud:
    """One frame: ``points`` (N, 3) float64 in the file's unit, those that were measured; ``missing``, how many more it holds without a
    position (NaN or infinite)."""

    points: np.ndarray
    missing: int

    @classmethod
    def of(cls, points: np.ndarray) -> PointCloud:
        """The cloud of (N, 3) ``points``, those without a position left out and counted."""
        measured = points[np.isfinite(points).all(axis=1)]
        return cls(measured, len(points) - len(measured))


@dataclass(frozen=True)
class _Header:
    """What a header announces: ``count`` points, each a record of ``point`` (field 'x' among them), in ``form`` from byte ``start`` on."""

    count: int
    point: np.dtype
    form: str
    start: int


def is_cloud(file: Path) -> bool:
    """Whether the name of ``file`` is that of a point cloud."""
    return Path(file).suffix.lower() in (".pcd", ".ply")


def read_cloud(file: Path) -> PointCloud:
    """The points of the PCD or PLY in ``file``; those of a PCD are moved to where its VIEWPOINT (position and quaternion) puts them.

    Colours, normals and other fields are passed over, wherever they stand. Raises RecordingError for a file that is missing, truncated,
    of another format, without x, y, z, or that holds other data than its header announces.
    """
    file = Path(file)
    try:
        content = file.read_bytes()
    except OSError as error:
        raise RecordingError(f"the cloud cannot be read ({error.strerror}); copy it again, or take it out of the take", file=file) from None
    if re.match(rb"ply\r?\n", content):
        header, rotation, position = _ply_header(content, file), np.eye(3), np.zeros(3)
    else:
        header, rotation, position = _pcd_header(content, file)
    for axis in "xyz":
        if axis not in header.point.names or header.point[axis].shape or header.point[axis].kind != "f":
            names = ", ".join(header.point.names)
            raise RecordingError(f"the cloud has no single floating-point {axis}; there are {names}", file=file)
    if not 0 < header.count * header.point.itemsize <= MAX_BYTES:
        raise RecordingError(f"the header announces {header.count} points of {header.point.itemsize} bytes", file=file)
    with np.errstate(invalid="ignore", over="ignore"):  # points without a position stay without
        points = _rows(content, header, file) if header.form == "ascii" else _records(content, header, file)
        return PointCloud.of(points @ rotation.T + position)


def _records(content: bytes, header: _Header, file: Path) -> np.ndarray:
    data, size = content[header.start :], header.count * header.point.itemsize
    if header.form == "binary_compressed":
        packed, unpacked = np.frombuffer(data[:8].ljust(8, b"\0"), "<u4").tolist()
        if unpacked != size or len(data) < 8 + packed:
            raise RecordingError(f"{len(data)} bytes of data that should unfold to {size}: truncated or damaged", file=file)
        data = decompress(data[8 : 8 + packed], size)
        if data is None:
            raise RecordingError("the compressed data are damaged; copy the cloud again", file=file)
        # compressed clouds hold field after field instead of point after point
        starts = {name: header.count * header.point.fields[name][1] for name in "xyz"}
        columns = [np.frombuffer(data, header.point[name], header.count, starts[name]) for name in "xyz"]
    elif len(data) < size:
        raise RecordingError(f"{len(data)} bytes of data for {header.count} points of {header.point.itemsize}: truncated", file=file)
    else:
        records = np.frombuffer(data, header.point, header.count)
        columns = [records[name] for name in "xyz"]
    return np.stack(columns, axis=1).astype(float)


def _rows(content: bytes, header: _Header, file: Path) -> np.ndarray:
    # what follows the last line end may have lost digits
    lines = content[header.start :].decode("latin-1").lower().split("\n")[:-1]
    first = content.count(b"\n", 0, header.start) + 1
    filled = [(number, line.split()) for number, line in enumerate(lines, start=first) if line.strip()][: header.count]
    if len(filled) < header.count:
        raise RecordingError(f"{len(filled)} whole rows where the header announces {header.count} points: truncated or damaged", file=file)
    widths = [int(np.prod(header.point[name].shape)) for name in header.point.names]
    cells = [sum(widths[: header.point.names.index(axis)]) for axis in "xyz"]
    for number, row in filled:
        if len(row) != sum(widths):
            raise RecordingError(f"{len(row)} numbers in a row of {sum(widths)}: truncated or damaged", file=file, line=number)
        for cell in cells:
            row[cell] = "nan" if row[cell] in NO_POSITION else row[cell]
    return numbers_of([",".join(row) for _, row in filled], [number for number, _ in filled], cells, file=file, gaps=True)


def _pcd_header(content: bytes, file: Path) -> tuple[_Header, np.ndarray, np.ndarray]:
    """Header of a PCD, and the rotation (3, 3) and position (3,) of its viewpoint."""
    entries: dict[str, list[str]] = {}
    start = 0
    while "DATA" not in entries:
        end = content.find(b"\n", start, start + 10_000)
        if end < 0:
            raise RecordingError("this is no PCD or PLY point cloud, or it is truncated in its header", file=file)
        words = content[start:end].decode("latin-1").split()
        start = end + 1
        if words and not words[0].startswith("#"):
            entries[words[0]] = words[1:]
    try:
        names = entries["FIELDS"]
        counts = [int(count) for count in entries.get("COUNT", ["1"] * len(names))]
        types = [kind.lower() + size for kind, size in zip(entries["TYPE"], entries["SIZE"], strict=True)]
        if not set(types) <= PCD_TYPES:
            raise ValueError(f"TYPE and SIZE give {', '.join(types)}")
        # padding has the name _ as often as there is some
        unique = [name if names.count(name) == 1 else f"{name}{i}" for i, name in enumerate(names)]
        fields = [(name, "<" + kind, *([(count,)] if count != 1 else [])) for name, kind, count in zip(unique, types, counts, strict=True)]
        point = np.dtype(fields)
        width, height, count = (int(entries[name][0]) for name in ("WIDTH", "HEIGHT", "POINTS"))
        (form,) = entries["DATA"]
        *position, w, x, y, z = map(float, entries.get("VIEWPOINT", "0 0 0 1 0 0 0".split()))
    except (KeyError, ValueError, IndexError, TypeError) as error:
        raise RecordingError(f"the header of the PCD is damaged ({error})", file=file) from None
    if form not in PCD_FORMATS:
        raise RecordingError(f"DATA {form!r} is none of {', '.join(PCD_FORMATS)}", file=file)
    if width * height != count:
        raise RecordingError(f"{count} points in {height} rows of {width}", file=file)
    if len(position) != 3 or not np.isfinite(position).all() or not abs(np.linalg.norm([w, x, y, z]) - 1) < 1e-3:
        raise RecordingError("the VIEWPOINT is no position and unit quaternion (w, x, y, z)", file=file)
    return _Header(count, point, form, start), Rotation.from_quat([x, y, z, w]).as_matrix(), np.array(position)


def _ply_header(content: bytes, file: Path) -> _Header:
    end = re.search(rb"\nend_header\r?\n", content[:100_000])
    if end is None:
        raise RecordingError("the PLY is truncated in its header", file=file)
    lines = [line.split() for line in content[: end.start()].decode("latin-1").splitlines()[1:]]
    lines = [words for words in lines if words and words[0] not in ("comment", "obj_info")]
    elements = [number for number, words in enumerate(lines) if words[0] == "element"]
    try:
        _, form, _ = lines[0]
        _, element, count = lines[elements[0]]
        properties = lines[elements[0] + 1 : elements[1] if len(elements) > 1 else None]
        point = np.dtype([(name, PLY_FORMATS[form] + PLY_TYPES[kind]) for _, kind, name in properties])
        if lines[0][0] != "format" or element != "vertex":
            raise ValueError("it does not begin with a format and the element vertex")
        return _Header(int(count), point, "ascii" if form == "ascii" else "binary", end.end())
    except (KeyError, ValueError, IndexError, TypeError) as error:
        raise RecordingError(f"the header of the PLY is damaged, or a vertex has more than single numbers ({error})", file=file) from None
