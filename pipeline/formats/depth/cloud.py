"""Reader of point clouds: PCD (ascii, binary, binary_compressed), PLY (ascii, binary).

Open3D only decompresses, behind a header that this module writes. Open3D by itself pads truncated
files, reads damaged text as zeros and fails on two fields of one name.
"""

import ctypes
import os
import re
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from pipeline.core.bounds import MIB, require
from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import GREATEST, numbers_of
from pipeline.formats.format import Format, Head, Kind, compare_announced, file_content

ENDINGS = (".pcd", ".ply")
PCD_FORMATS = ("ascii", "binary", "binary_compressed")
PCD_TYPES = {"f4", "f8", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8"}
PLY_FORMATS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
PLY_TYPES = dict(zip("char uchar short ushort int uint float double".split(),
                     "i1 u1 i2 u2 i4 u4 f4 f8".split(), strict=True))  # fmt: skip
PLY_TYPES |= {np.dtype(kind).name: kind for kind in PLY_TYPES.values()}  # int8, …
UNTURNED = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)  # x, y, z, and a quaternion w, x, y, z
# as C++ prints it, in addition to MISSING
NO_POSITION = ("+nan", "inf", "-inf", "+inf")
# byte-order mark and blank lines of an editor do not belong to the header
PLY_MARK = re.compile(rb"(\xef\xbb\xbf)?\s*ply[ \t]*[\r\n]")
AGAIN = "copy the cloud again, or take it out of the take"


@dataclass(frozen=True)
class PointCloud:
    """One frame in the sensor's frame."""

    points: np.ndarray  # (N, 3) float64 measured points in the file's unit
    missing: int  # number of points without a position (NaN, infinite or all 0)
    # a PCD's position (file's unit) and quaternion (w, x, y, z) of the sensor; not applied
    viewpoint: tuple[float, ...] = UNTURNED
    # surplus_bytes behind the points
    counts: dict[str, int] = field(default_factory=dict)
    format: str = ""  # name and version
    organised: str = ""  # columns × rows

    @classmethod
    def measured(cls, points: np.ndarray, **details: Any) -> "PointCloud":
        """Return the cloud of ``points`` (N, 3); points without a position (not finite, or at the
        sensor) are only counted.
        """
        measured = np.isfinite(points).all(axis=1) & points.any(axis=1)
        return cls(points[measured], missing=int(np.sum(~measured)), **details)


class CloudHeader(NamedTuple):
    """Content of a cloud's header."""

    count: int  # number of points
    point: np.dtype  # record of one point
    form: str  # one of PCD_FORMATS or PLY_FORMATS
    start: int  # first byte of the points
    version: str
    more: bool = False  # whether other elements follow the points
    viewpoint: tuple[float, ...] = UNTURNED
    organised: str = ""


def is_cloud(file: Path) -> bool:
    """Return whether ``file`` has a suffix of point clouds."""
    return Path(file).suffix.lower() in ENDINGS


def read_cloud(file: Path) -> PointCloud:
    """Return the points of the cloud in ``file``, in the sensor's frame, without other fields.
    Bytes behind the announced points are counted, since PCL pads files to whole pages by zeros.
    Raises RecordingError for content that is truncated or of another format, has no x, y and z, or
    contradicts the header, for other bytes behind binary points, and as :func:`require_near`.
    """
    content = file_content(file)
    read_header = _ply_header if _is_ply(content) else _pcd_header
    try:
        header = read_header(content)
        size = header.count * header.point.itemsize
        kinds = {header.point[axis].str[1:] for axis in "xyz"}
        if kinds not in ({"f4"}, {"f8"}) or size <= 0:
            names = ", ".join(header.point.names)
            raise ValueError(
                f"{header.count} points of the fields {names}: x, y and z of one floating-point "
                "type are required",
            )
    except (KeyError, ValueError, IndexError, TypeError) as error:
        message = f"no header of a PCD or PLY, or a damaged one ({error}); {AGAIN}"
        raise RecordingError(message, file=file) from None
    require("part_mib", size / MIB, "MiB of points, which the header announces,", file)
    read_points = _text_points if header.form == "ascii" else _binary_points
    try:
        points, surplus = read_points(content, header, file)
    except ValueError as error:
        raise RecordingError(
            f"truncated or damaged: {error}; {AGAIN}",
            file=file,
        ) from None
    require_near(points, file=file)
    counts = {}
    if surplus and not header.more:
        counts["surplus_bytes"] = surplus
    return PointCloud.measured(
        points,
        viewpoint=header.viewpoint,
        counts=counts,
        format=header.version,
        organised=header.organised,
    )


def require_near(points: np.ndarray, **evidence: object) -> None:
    """Raise RecordingError where a coordinate of ``points`` (N, 3) is beyond GREATEST."""
    sizes = np.where(np.isfinite(points), np.abs(points), 0.0)
    greatest = sizes.max(axis=1, initial=0.0)
    beyond = np.flatnonzero(greatest > GREATEST)
    if not len(beyond):
        return
    first = int(beyond[0])
    raise RecordingError(
        f"{len(beyond)} of {len(points)} points have coordinates beyond {GREATEST:g}, the first "
        f"is point {first + 1} ({greatest[first]:.2g}): bytes were inserted or lost before it; "
        f"{AGAIN}",
        **evidence,
    )


def _require_padding(surplus: bytes, header: CloudHeader) -> None:
    """Raise ValueError where the bytes behind the points are not zeros, nor other elements."""
    if surplus.strip(b"\0") and not header.more:
        raise ValueError(
            f"{len(surplus)} bytes behind the {header.count} points, which are not zeros as a "
            "padding: bytes were inserted, or points are not announced",
        )


def _is_ply(content: bytes) -> bool:
    return PLY_MARK.match(content) is not None


def _pcd_header(content: bytes) -> CloudHeader:
    data = re.search(rb"(?m)^DATA[^\S\n].*\n", content[:100_000])
    if data is None:
        raise ValueError("no line DATA")
    entries = {}
    for line in content[: data.end()].decode("latin-1").split("\n"):
        key, *values = line.split() or [""]
        entries[key] = values
    record = _pcd_record(entries)
    width = int(entries["WIDTH"][0])
    height = int(entries["HEIGHT"][0])
    points = int(entries["POINTS"][0])
    (form,) = entries["DATA"]
    if form not in PCD_FORMATS or width * height != points:
        raise ValueError(
            f"{points} POINTS in {height} rows of {width} as {form}: POINTS must be WIDTH × "
            f"HEIGHT, DATA one of {', '.join(PCD_FORMATS)}",
        )
    viewpoint = tuple(map(float, entries.get("VIEWPOINT", UNTURNED)))
    length = np.linalg.norm(viewpoint[3:])
    if len(viewpoint) != 7 or not abs(length - 1) < 1e-3:
        raise ValueError(
            f"VIEWPOINT is {viewpoint}, which must be a position and a unit quaternion; 0 0 0 1 0 "
            "0 0 is the sensor's frame",
        )
    return CloudHeader(
        count=points,
        point=record,
        form=form,
        start=data.end(),
        version=" ".join(["PCD", *entries.get("VERSION", [])]),
        viewpoint=viewpoint,
        organised=f"{width} × {height}" if height > 1 else "",
    )


def _pcd_record(entries: dict[str, list[str]]) -> np.dtype:
    """Return the record of one point by the ``entries`` of the header."""
    names = entries.get("FIELDS") or entries["COLUMNS"]  # before version 0.6
    ones = ["1"] * len(names)
    counts = [int(count) for count in entries.get("COUNT", ones)]
    pairs = zip(entries["TYPE"], entries["SIZE"], strict=True)
    types = [kind.lower() + size for kind, size in pairs]
    are_known = PCD_TYPES.issuperset(types)
    if not are_known or min(counts) < 1:
        raise ValueError(f"TYPE, SIZE and COUNT give {', '.join(types)} of {counts}")
    fields = []
    for name, kind, count in zip(names, types, counts, strict=True):
        # all padding fields have the name _
        unique = name if names.count(name) == 1 else f"{name}{len(fields)}"
        shape = () if count == 1 else (count,)
        fields.append((unique, f"<{kind}", shape))
    return np.dtype(fields)


def _ply_header(content: bytes) -> CloudHeader:
    mark = PLY_MARK.match(content)
    end = re.search(rb"\n\s*end_header[ \t]*\r?\n", content[:100_000])
    if end is None:
        raise ValueError("no line end_header")
    lines = []
    for line in content[mark.end() : end.start()].decode("latin-1").splitlines():
        words = line.split()
        if words and words[0] not in ("comment", "obj_info"):
            lines.append(words)
    elements = [number for number, words in enumerate(lines) if words[0] == "element"]
    if not elements:
        raise ValueError("no line element")
    first, *further = elements
    mark, form, version = lines[0]
    _, element, count = lines[first]
    properties = lines[first + 1 : further[0] if further else None]
    single = all(len(words) == 3 for words in properties)
    if (mark, element) != ("format", "vertex") or not single:
        raise ValueError(
            "a format, then the element vertex of single numbers are required",
        )
    order = PLY_FORMATS[form]
    fields = [(name, order + PLY_TYPES[kind]) for _, kind, name in properties]
    return CloudHeader(
        count=int(count),
        point=np.dtype(fields),
        form=form,
        start=end.end(),
        version=f"PLY {form} {version}",
        more=len(further) > 0,
    )


@cache
def load_open3d() -> ModuleType:
    """Return the module ``open3d``, set to print only errors; its import takes two seconds."""
    import libusb_package  # the CPU build of Open3D needs libusb and does not contain it

    ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
    import open3d

    open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
    return open3d


def _binary_points(
    content: bytes,
    header: CloudHeader,
    file: Path,
) -> tuple[np.ndarray, int]:
    """Return the points (N, 3) float64, and the number of bytes behind the points."""
    data = content[header.start :]
    size = header.count * header.point.itemsize
    if header.form == "binary_compressed":
        return _unpacked_points(data, header, size)
    if len(data) < size:
        raise ValueError(_lacking(data, size, size, header))
    _require_padding(data[size:], header)
    records = np.frombuffer(data[:size], header.point)
    # damaged numbers may be huge or NaN
    with np.errstate(invalid="ignore", over="ignore"):
        columns = [records[axis].astype(float) for axis in "xyz"]
    return np.column_stack(columns), len(data) - size


def _unpacked_points(
    data: bytes,
    header: CloudHeader,
    size: int,
) -> tuple[np.ndarray, int]:
    """Return the points (N, 3) of compressed ``data``, which unpack to ``size`` bytes, and the
    number of bytes behind them.
    """
    sizes = data[:8].ljust(8, b"\0")
    packed, unpacked = np.frombuffer(sizes, "<u4").tolist()
    end = 8 + packed
    if len(data) < end or unpacked != size:
        raise ValueError(_lacking(data, end, unpacked, header))
    _require_padding(data[end:], header)
    # rename fields: Open3D reads some as colours or normals, and fails on two of one name
    names = [
        n if n in ("x", "y", "z") else f"f{i}" for i, n in enumerate(header.point.names)
    ]
    kinds = [header.point[name] for name in header.point.names]
    rows = {
        "VERSION": [0.7],
        "FIELDS": names,
        "SIZE": [kind.base.itemsize for kind in kinds],
        "TYPE": [kind.base.kind.upper() for kind in kinds],
        "COUNT": [int(np.prod(kind.shape)) for kind in kinds],
        "WIDTH": [header.count],
        "HEIGHT": [1],
        "POINTS": [header.count],
        "DATA": [header.form],
    }
    text = ""
    for key, values in rows.items():
        text += f"{key} {' '.join(map(str, values))}\n"
    with os.fdopen(os.memfd_create("cloud"), "wb") as stream:
        stream.write(text.encode() + data[:end])
        stream.flush()
        path = f"/proc/self/fd/{stream.fileno()}"
        cloud = load_open3d().t.io.read_point_cloud(path, format="pcd")
    if "positions" not in cloud.point or len(cloud.point.positions) != header.count:
        raise ValueError("the data cannot be decompressed")
    # damaged numbers may be huge or NaN
    with np.errstate(invalid="ignore", over="ignore"):
        points = cloud.point.positions.numpy().astype(float)
    return points, len(data) - end


def _lacking(data: bytes, size: int, unpacked: int, header: CloudHeader) -> str:
    return (
        f"{len(data)} bytes of {size}, which decompress to {unpacked}, where the header announces "
        f"{header.count} points of {header.point.itemsize} bytes"
    )


def _text_points(
    content: bytes,
    header: CloudHeader,
    file: Path,
) -> tuple[np.ndarray, int]:
    """Return the points (N, 3), and the number of bytes behind the points."""
    lines = content[header.start :].decode("latin-1").split("\n")
    first = content.count(b"\n", 0, header.start) + 1
    widths = [int(np.prod(header.point[name].shape)) for name in header.point.names]
    axes = [sum(widths[: header.point.names.index(axis)]) for axis in "xyz"]
    rows = []
    numbers = []
    for number, line in enumerate(lines, first):
        words = line.lower().split()
        if not words or len(rows) == header.count:
            continue
        if len(words) != sum(widths):
            raise RecordingError(
                f"the row has {len(words)} numbers where a point has {sum(widths)}; {AGAIN}",
                file=file,
                line=number,
            )
        cells = ["nan" if word in NO_POSITION else word for word in words]
        rows.append(",".join(cells))
        numbers.append(number)
    where = {"file": file, "line": first + len(lines) - 1}
    compare_announced("points", header.count, len(rows), AGAIN, **where)
    end = numbers[-1] - first + 1
    behind = "\n".join(lines[end:])
    points = numbers_of(rows, numbers, axes, file=file, gaps=True)
    return points, len(behind) if behind.strip() else 0


def _begins(head: Head) -> bool:
    is_pcd = re.match(rb"# \.PCD|VERSION +\S+\s+FIELDS ", head.content) is not None
    return _is_ply(head.content) or is_pcd or head.suffix == ".pcd"


FORMAT = Format("point cloud", Kind.CLOUD, read_cloud, _begins)
