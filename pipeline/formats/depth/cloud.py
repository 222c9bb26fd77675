"""Point clouds as PCD (ascii, binary, binary_compressed) or PLY (ascii, binary of either order).

Open3D reads the binary data, under a header of its own: it fills up what a truncated file lacks,
takes damaged text for zeros and fails on fields that share a name (PCL's padding ``_``).
"""

from __future__ import annotations

import ctypes
import os
import re
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import numpy as np

from pipeline.core.bounds import MIB, require
from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import numbers_of
from pipeline.formats.format import Format, Head, Kind, file_content

PCD_FORMATS = ("ascii", "binary", "binary_compressed")
PCD_TYPES = {"f4", "f8", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8"}
PLY_FORMATS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
PLY_TYPES = {
    **{"char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2"},
    **{"ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4"},
    **{"float": "f4", "float32": "f4", "double": "f8", "float64": "f8"},
}
FLOATS = {order + kind for order in "<>" for kind in ("f4", "f8")}
UNTURNED = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)  # x, y, z, and a quaternion w, x, y, z
# as C++ prints it; nan itself is known to numbers_of
NO_POSITION = ("-nan", "+nan", "inf", "-inf", "+inf")
AGAIN = "copy the cloud again"


@dataclass(frozen=True)
class PointCloud:
    """One frame in the sensor's frame."""

    points: np.ndarray  # (N, 3) float64 that were measured, in the file's unit
    missing: int  # more points, without a position (NaN or infinite)
    # of a PCD: position in the file's unit and quaternion (w, x, y, z) of the sensor, not applied
    viewpoint: tuple[float, ...] = UNTURNED
    # surplus_bytes behind the points that the header announces
    counts: dict[str, int] = field(default_factory=dict)
    format: str = ""  # with its version
    organised: str = ""  # columns × rows

    @classmethod
    def measured(cls, points: np.ndarray, *beside: object) -> PointCloud:
        """Return the cloud of (N, 3) ``points``, those without a position left out and counted."""
        held = np.isfinite(points).all(axis=1)
        return cls(points[held], int(np.sum(~held)), *beside)


class CloudHeader(NamedTuple):
    """Content of a cloud's header; ``point`` is the record of a point, ``form`` one of PCD_FORMATS
    or PLY_FORMATS, ``start`` the first byte of the points, ``more`` True where others follow them.
    """

    count: int
    point: np.dtype
    form: str
    start: int
    version: str
    more: bool = False
    viewpoint: tuple[float, ...] = UNTURNED
    organised: str = ""


def is_cloud(file: Path) -> bool:
    """Return whether the name of ``file`` is the name of a point cloud."""
    return Path(file).suffix.lower() in FORMAT.endings


def read_cloud(file: Path) -> PointCloud:
    """Return the points of the cloud in ``file``; see :func:`decode_cloud`."""
    advice = "; copy it again, or take it out of the take"
    return decode_cloud(file_content(file, "cloud", advice), file=Path(file))


def decode_cloud(content: bytes, *, file: Path) -> PointCloud:
    """Return the points of the cloud in ``content`` of ``file``, in the sensor's frame, as in PCL
    and Open3D; other fields than x, y, z are passed over, as are bytes behind the announced points,
    which are counted: PCL pads files to whole pages.

    Raises RecordingError for content that is truncated, of another format, without x, y and z, or
    with data other than the header announces.
    """
    is_ply = _is_ply(content)
    if not (is_ply or _is_pcd(content) or Path(file).suffix.lower() == ".pcd"):
        raise RecordingError("this is no PCD or PLY point cloud; export it as one", file=file)
    try:
        header = (_ply_header if is_ply else _pcd_header)(content)
    except (KeyError, ValueError, IndexError, TypeError) as error:
        message = f"the header of the cloud is damaged ({error}); {AGAIN}, or export x, y, z alone"
        raise RecordingError(message, file=file) from None
    names, size = header.point.names, header.count * header.point.itemsize
    kinds = {header.point[axis].str for axis in "xyz" if axis in names}
    require("part_mib", size / MIB, "MiB of points, which the header announces,", file)
    message = ""
    if not {*"xyz"} <= {*names} or kinds.isdisjoint(FLOATS) or len(kinds) > 1:
        message = "the cloud has no single x, y and z of one floating-point type; its fields are "
        message += f"{', '.join(names)}: export it with them"
    elif size <= 0:
        message = f"the header announces {header.count} points; {AGAIN}, or take it out of the take"
    if message:
        raise RecordingError(message, file=file)
    read = _text_points if header.form == "ascii" else _binary_points
    points, surplus = read(content, header, file)
    counts = {"surplus_bytes": surplus} if surplus and not header.more else {}
    stated = header.viewpoint, counts, header.version, header.organised
    return PointCloud.measured(points, *stated)


def _is_ply(content: bytes) -> bool:
    return content.startswith((b"ply\n", b"ply\r\n"))


def _is_pcd(content: bytes) -> bool:
    return re.match(rb"# \.PCD|VERSION +\S+\s+FIELDS ", content) is not None


def _pcd_header(content: bytes) -> CloudHeader:
    if (data := re.search(rb"(?m)^DATA[^\S\n].*\n", content[:100_000])) is None:
        raise ValueError("no line DATA: truncated")
    lines = [line.split() for line in content[: data.end()].decode("latin-1").split("\n")]
    entries = {words[0]: words[1:] for words in lines if words}
    names = entries["FIELDS"]
    counts = [int(count) for count in entries.get("COUNT", ["1"] * len(names))]
    types = [a.lower() + b for a, b in zip(entries["TYPE"], entries["SIZE"], strict=True)]
    if not {*types} <= PCD_TYPES or min(counts) < 1:
        raise ValueError(f"TYPE, SIZE and COUNT give {', '.join(types)} of {counts}")
    # padding has the name _ as often as there is some
    unique = [name if names.count(name) == 1 else f"{name}{i}" for i, name in enumerate(names)]
    shapes = [() if count == 1 else (count,) for count in counts]
    point = np.dtype([*zip(unique, [f"<{kind}" for kind in types], shapes, strict=True)])
    width, height, count = (int(entries[name][0]) for name in ("WIDTH", "HEIGHT", "POINTS"))
    (form,) = entries["DATA"]
    if form not in PCD_FORMATS:
        raise ValueError(f"DATA {form!r} is none of {', '.join(PCD_FORMATS)}")
    if width * height != count:
        raise ValueError(f"POINTS is {count}, and {height} rows of {width} are another number")
    viewpoint = tuple(map(float, entries.get("VIEWPOINT", UNTURNED)))
    if len(viewpoint) != 7 or not abs(np.linalg.norm(viewpoint[3:]) - 1) < 1e-3:
        need = "a position and a unit quaternion; 0 0 0 1 0 0 0 is the sensor's own frame"
        raise ValueError(f"VIEWPOINT is {viewpoint}, which must be {need}")
    version = " ".join(["PCD", *entries.get("VERSION", [])])
    organised = f"{width} × {height}" if height > 1 else ""
    return CloudHeader(count, point, form, data.end(), version, False, viewpoint, organised)


def _ply_header(content: bytes) -> CloudHeader:
    if (end := re.search(rb"\nend_header\r?\n", content[:100_000])) is None:
        raise ValueError("no line end_header: truncated")
    lines = [line.split() for line in content[: end.start()].decode("latin-1").splitlines()[1:]]
    lines = [words for words in lines if words and words[0] not in ("comment", "obj_info")]
    elements = [number for number, words in enumerate(lines) if words[0] == "element"]
    (first, form, version), (_, element, count) = lines[0], lines[elements[0]]
    if first != "format" or element != "vertex":
        raise ValueError("it does not begin with a format and the element vertex")
    properties = lines[elements[0] + 1 : [*elements, None][1]]
    if any(len(words) != 3 for words in properties):
        raise ValueError("a vertex has more than single numbers")
    point = np.dtype([(name, PLY_FORMATS[form] + PLY_TYPES[kind]) for _, kind, name in properties])
    version = f"PLY {form} {version}"
    return CloudHeader(int(count), point, form, end.end(), version, len(elements) > 1)


def _binary_points(content: bytes, header: CloudHeader, file: Path) -> tuple[np.ndarray, int]:
    """Return (N, 3) the points, and the number of bytes behind them."""
    data, size, message = content[header.start :], header.count * header.point.itemsize, ""
    if header.form == "binary_compressed":
        packed, unpacked = np.frombuffer(data[:8].ljust(8, b"\0"), "<u4").tolist()
        if unpacked != size:
            message = f"the compressed data unfold to {unpacked} bytes where the header announces "
            message += f"{size}: truncated or damaged"
        size = 8 + packed
    if len(data) < size and not message:
        message = f"{len(data)} bytes of data where {header.count} points have {size}: truncated"
    points = None if message else _by_open3d(header, data[:size])
    if points is None:
        message = message or "the compressed data are damaged"
        raise RecordingError(f"{message}; {AGAIN}", file=file)
    return points, len(data) - size


@cache
def load_open3d() -> ModuleType:
    """Return the module ``open3d``, which takes two seconds to import, quiet but for errors."""
    import libusb_package

    # the CPU build links libusb without bringing it along
    ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
    import open3d

    open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
    return open3d


def _by_open3d(header: CloudHeader, data: bytes) -> np.ndarray | None:
    """Return (N, 3) float64 of ``data`` as ``header`` describes them, None where damaged; Open3D
    is given them as PCD, a PLY's in the order of bytes that PCD has.
    """
    form, point = header.form, header.point
    if form in PLY_FORMATS:
        form, data = "binary", np.frombuffer(data, point).astype(point.newbyteorder("<")).tobytes()
    # under other names Open3D would make colours and normals of fields, or fail on two of one name
    names = [name if name in ("x", "y", "z") else f"f{i}" for i, name in enumerate(point.names)]
    kinds = [point[name] for name in point.names]
    sizes, types = (
        [kind.base.itemsize for kind in kinds],
        [kind.base.kind.upper() for kind in kinds],
    )
    counts, count = [int(np.prod(kind.shape)) for kind in kinds], [header.count]
    rows = {"FIELDS": names, "SIZE": sizes, "TYPE": types, "COUNT": counts, "WIDTH": count}
    rows |= {"HEIGHT": [1], "VIEWPOINT": [*map(int, UNTURNED)], "POINTS": count, "DATA": [form]}
    text = "".join(f"{key} {' '.join(map(str, values))}\n" for key, values in rows.items())
    with os.fdopen(os.memfd_create("cloud"), "wb") as stream:
        stream.write(f"# .PCD v0.7\nVERSION 0.7\n{text}".encode() + data)
        stream.flush()
        path = f"/proc/self/fd/{stream.fileno()}"
        cloud = load_open3d().t.io.read_point_cloud(path, format="pcd")
    if "positions" not in cloud.point or len(cloud.point.positions) != header.count:
        return None
    with np.errstate(invalid="ignore", over="ignore"):  # damaged numbers are no positions
        return cloud.point.positions.numpy().astype(float)


def _text_points(content: bytes, header: CloudHeader, file: Path) -> tuple[np.ndarray, int]:
    """Return (N, 3) the points, and the number of bytes behind them."""
    lines = content[header.start :].decode("latin-1").split("\n")
    first = content.count(b"\n", 0, header.start) + 1
    numbered = [(number, line.lower().split()) for number, line in enumerate(lines, first)]
    filled = [(number, row) for number, row in numbered if row][: header.count]
    widths = [int(np.prod(header.point[name].shape)) for name in header.point.names]
    cells = [sum(widths[: header.point.names.index(axis)]) for axis in "xyz"]
    for number, row in filled:
        if len(row) != sum(widths):
            message = f"the row has {len(row)} numbers where a point has {sum(widths)}: truncated "
            raise RecordingError(f"{message}or damaged; {AGAIN}", file=file, line=number)
        for cell in cells:
            row[cell] = "nan" if row[cell] in NO_POSITION else row[cell]
    if len(filled) < header.count:
        message = f"there are {len(filled)} rows where the header announces {header.count} points"
        raise RecordingError(f"{message}: truncated or damaged; {AGAIN}", file=file)
    rows, numbers = [",".join(row) for _, row in filled], [number for number, _ in filled]
    behind = "\n".join(lines[numbers[-1] - first + 1 :])
    points = numbers_of(rows, numbers, cells, file=file, gaps=True)
    return points, len(behind) if behind.strip() else 0


def _begins(head: Head) -> bool:
    return _is_ply(head.content) or _is_pcd(head.content) or head.suffix == ".pcd"


FORMAT = Format("point cloud", Kind.CLOUD, decode_cloud, _begins, endings=(".pcd", ".ply"))
