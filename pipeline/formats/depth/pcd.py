"""Point clouds as PCD: ascii, binary and binary_compressed."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.depth.cloud import Header, PointCloud, points_of
from pipeline.formats.format import Format, Head, Kind, Stated

PCD_TYPES = {"f4", "f8", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8"}
PCD_FORMATS = ("ascii", "binary", "binary_compressed")


def read_pcd(content: bytes, *, file: Path) -> PointCloud:
    """The points in the ``content`` of ``file``, where its viewpoint puts them; RecordingError as
    :func:`pipeline.formats.depth.cloud.read_cloud`.
    """
    header, rotation, position = _header(content, file)
    points = points_of(content, header, file)
    with np.errstate(invalid="ignore", over="ignore"):  # points without a position stay without
        return PointCloud.measured(points @ rotation.T + position)


def _header(content: bytes, file: Path) -> tuple[Header, np.ndarray, np.ndarray]:
    """Header of a PCD, and the rotation (3, 3) and position (3,) of its viewpoint."""
    from scipy.spatial.transform import Rotation

    entries: dict[str, list[str]] = {}
    start = 0
    while "DATA" not in entries:
        end = content.find(b"\n", start, start + 10_000)
        if end < 0:
            raise RecordingError(
                "this is no PCD point cloud, or it is truncated in its header", file=file
            )
        words = content[start:end].decode("latin-1").split()
        start = end + 1
        if words and not words[0].startswith("#"):
            entries[words[0]] = words[1:]
    try:
        names = entries["FIELDS"]
        counts = [int(count) for count in entries.get("COUNT", ["1"] * len(names))]
        types = [
            kind.lower() + size for kind, size in zip(entries["TYPE"], entries["SIZE"], strict=True)
        ]
        if not set(types) <= PCD_TYPES:
            raise ValueError(f"TYPE and SIZE give {', '.join(types)}")
        # padding has the name _ as often as there is some
        unique = [name if names.count(name) == 1 else f"{name}{i}" for i, name in enumerate(names)]
        fields = [
            (name, "<" + kind, *([(count,)] if count != 1 else []))
            for name, kind, count in zip(unique, types, counts, strict=True)
        ]
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
    if (
        len(position) != 3
        or not np.isfinite(position).all()
        or not abs(np.linalg.norm([w, x, y, z]) - 1) < 1e-3
    ):
        raise RecordingError(
            "the VIEWPOINT is no position and unit quaternion (w, x, y, z)", file=file
        )
    return (
        Header(count, point, form, start),
        Rotation.from_quat([x, y, z, w]).as_matrix(),
        np.array(position),
    )


def _begins(head: Head) -> bool:
    return head.content.startswith(b"# .PCD") or head.suffix == ".pcd"


def _states(file: Path) -> Stated:
    rows = [line.split() for line in Head.read(file).content.decode("latin-1").splitlines()]
    held = {row[0]: row[1:] for row in reversed(rows) if row}
    width, height = (" ".join(held.get(name, [])) for name in ("WIDTH", "HEIGHT"))
    organised = {"organised": f"{width} × {height}"} if height not in ("", "1") else {}
    return Stated(" ".join(held.get("VERSION", [])) or None, facts=organised)


FORMAT = Format("point cloud, PCD", Kind.CLOUD, read_pcd, _begins, _states, endings=(".pcd",))
