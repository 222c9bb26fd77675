"""Point clouds as PLY: ascii, or binary of either byte order."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.depth.cloud import Header, PointCloud, points_of
from pipeline.formats.format import Format, Head, Kind, Stated, begins

PLY_TYPES = {
    "char": "i1",
    "int8": "i1",
    "uchar": "u1",
    "uint8": "u1",
    "short": "i2",
    "int16": "i2",
    "ushort": "u2",
    "uint16": "u2",
    "int": "i4",
    "int32": "i4",
    "uint": "u4",
    "uint32": "u4",
    "float": "f4",
    "float32": "f4",
    "double": "f8",
    "float64": "f8",
}
PLY_FORMATS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}


def read_ply(content: bytes, *, file: Path) -> PointCloud:
    """The points in the ``content`` of ``file``; RecordingError as
    :func:`pipeline.formats.depth.cloud.read_cloud`.
    """
    return PointCloud.measured(points_of(content, _header(content, file), file))


def _header(content: bytes, file: Path) -> Header:
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
        point = np.dtype(
            [(name, PLY_FORMATS[form] + PLY_TYPES[kind]) for _, kind, name in properties]
        )
        if lines[0][0] != "format" or element != "vertex":
            raise ValueError("it does not begin with a format and the element vertex")
        text = "ascii" if form == "ascii" else "binary"
        return Header(int(count), point, text, end.end(), more=len(elements) > 1)
    except (KeyError, ValueError, IndexError, TypeError) as error:
        raise RecordingError(
            f"the header of the PLY is damaged, or a vertex has more than single numbers ({error})",
            file=file,
        ) from None


def _states(file: Path) -> Stated:
    rows = [line.split() for line in Head.read(file).content.decode("latin-1").splitlines()]
    return Stated(next((" ".join(row[1:]) for row in rows if row[:1] == ["format"]), None))


FORMAT = Format(
    "point cloud, PLY",
    Kind.CLOUD,
    read_ply,
    begins(b"ply\n", b"ply\r\n"),
    _states,
    endings=(".ply",),
)
