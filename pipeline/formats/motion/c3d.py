"""Motion-capture takes as C3D (c3d.org), read by ezc3d in a separate process."""

import os
import re
import struct
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.core.bounds import MIB, require, require_content
from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import GREATEST
from pipeline.formats.format import (
    Format,
    Head,
    Kind,
    compare_announced,
    read_alone,
    readable,
)
from pipeline.formats.motion.take import MotionTake, checked_take, settle_unit

KEY = 0x50  # the second byte of every C3D file
INTEL, DEC, MIPS = 84, 85, 86
BLOCK = 512  # bytes
LONGEST = 0xFFFF  # greatest frame number that the header can hold
AGAIN = "export or copy the take again"

# parameters of POINT, in Nexus and Visual3D, with the labels of points that a model computed
OUTPUTS = re.compile(r"(ANGLES|FORCES|MOMENTS|POWERS|SCALARS|REACTIONS)\d*")


def read_c3d(file: Path, unit: str | None = None) -> MotionTake:
    """Return the markers of the C3D take in ``file``, in m and s; ``unit`` (m, cm or mm) is the
    unit of lengths where POINT:UNITS is empty.

    A sample is missing if its residual is negative, if all coordinates are exactly zero, or if a
    coordinate is NaN or beyond GREATEST, as NDI's -3.7e28 (counted as ``invalid_samples``). Points
    that share a label are called ``label [n]``, points without a label ``Point n``. Points listed
    in POINT:ANGLES, FORCES, MOMENTS, POWERS, REACTIONS or SCALARS are outputs of a model: they are
    left out and counted, and so are surplus labels. Where the header's 16 bits cannot hold the
    number of frames, TRIAL or POINT:LONG_FRAMES states it, else the length of the file. Raises
    RecordingError for an unreadable or damaged file, a file that is no C3D, has the byte order of
    MIPS or fewer frames than it states, and for no points, no marker, no rate or no unit.
    """
    header = _first_block(file)
    points, first = header.points, header.first
    require("markers", points, "points", file)
    contents = read_alone(read_contents, str(file), file=file, advice=AGAIN)
    if not points:
        channels = contents["channels"]
        message = f"the file has no points, only {len(channels)} analog channels "
        message += (
            f"({', '.join(channels)}) of {header.samples} samples: export the markers"
        )
        raise RecordingError(
            message if channels else "the file has no points: no take", file=file
        )
    announced = _announced_frames(header, contents)
    if announced > header.frames:
        require("memory_mib", announced * header.row / MIB, "MiB of frames", file)
        pieces = str(file), header, min(announced, header.held)
        contents |= read_alone(read_contents, *pieces, file=file, advice=AGAIN)
    position, residual, rate = (
        contents[name] for name in ("points", "residuals", "rate")
    )
    _, found, frames = position.shape
    if (found, residual.shape) != (points, (found, frames)):
        message = (
            f"the header announces {points} points, the file holds {found}; {AGAIN}"
        )
        raise RecordingError(message, file=file, key="POINT:USED")
    counts = compare_announced(
        "frames", announced, frames, f"truncated? {AGAIN}", file=file
    )
    if len(rate) != 1 or not 0 < rate[0] < np.inf:
        message = f"the file has no frame rate; {AGAIN}"
        raise RecordingError(message, file=file, key="POINT:RATE")
    stated = sorted({text.lower() for text in contents["units"]} - {""})
    unit = settle_unit(" and ".join(stated), unit, file, key="POINT:UNITS")
    if (number := _long(contents["start"])) is not None:
        first = number if first in (number % 2**16, LONGEST) else first
    labels, outputs = contents["labels"], {*contents["outputs"]} - {""}
    names = [*labels[:points], *[""] * (points - len(labels))]
    names = [name or f"Point {number}" for number, name in enumerate(names, start=1)]
    samples = position.transpose(1, 2, 0).copy()
    with np.errstate(invalid="ignore"):
        invalid = ~(np.abs(samples) < GREATEST)
    samples[invalid | (residual < 0)[..., None]] = np.nan
    # the list of outputs has the label with its subject (Arm:HipAngles) or without
    own = [
        n
        for n, name in enumerate(names)
        if not {name, name.rpartition(":")[2]} & outputs
    ]
    markers = {}
    for n in own:
        several, number = names.count(names[n]) > 1, names[: n + 1].count(names[n])
        markers[f"{names[n]} [{number}]" if several else names[n]] = samples[n]
    if not markers:
        message = (
            f"all {points} points are outputs of a model (angles, moments or others)"
        )
        raise RecordingError(f"{message}; export the take with its markers", file=file)
    more = {"unlabelled_points": points - sum(map(bool, labels[:points]))}
    rare = {"skipped_model_outputs": points - len(markers)}
    rare["invalid_samples"] = int(invalid[own].any(axis=-1).sum())
    rare["skipped_labels"] = max(len(labels) - points, 0)
    more |= {name: count for name, count in rare.items() if count}
    frame = np.arange(frames) + first
    about = (
        Path(file).stem,
        "C3D",
        rate[0],
        frame,
        np.zeros(0),
        markers,
        {},
        counts,
        unit,
    )
    return checked_take(MotionTake(*about), file, more=more)


class C3dHeader(NamedTuple):
    """The header's statements about the data, and the ``held`` frames by the file's length."""

    points: int
    frames: int
    first: int  # number of the first frame
    last: int
    samples: int  # per analog channel
    start: int  # first byte of the data
    row: int  # bytes of a frame
    held: int


def _first_block(file: Path) -> C3dHeader:
    """Return the header; RecordingError for no C3D, and a file shorter than its header states."""
    with readable(file), Path(file).open("rb") as stream:
        content, size = stream.read(256 * BLOCK), stream.seek(0, os.SEEK_END)
    if (processor := _processor(require_content(content, file))) not in (INTEL, DEC):
        message = f"this is no C3D file, or its header is cut short; {AGAIN}"
        if processor == MIPS:
            message = "the numbers are big-endian (SGI, MIPS), which is not read; convert the file "
            message += "to Intel's byte order with Mokka or C3Dserver"
        raise RecordingError(message, file=file)
    points, analog, first, last = struct.unpack_from("<4H", content, 2)
    start, ratio = struct.unpack_from("<2H", content, 16)
    # a negative scale means floating point; DEC stores the word with the sign first
    width = 4 if content[15 if processor == INTEL else 13] & 0x80 else 2
    start, row = (max(start, 1) - 1) * BLOCK, width * (4 * points + analog)
    frames = last - first + 1
    needed = (
        start + (frames if last != LONGEST else 1) * row
    )  # at LONGEST the length decides
    if frames < 1 or size < needed:
        message = f"the header announces {points} points in {frames} frames, which need {needed} "
        message += f"bytes or more; the file has {size}: empty or truncated; {AGAIN}"
        raise RecordingError(message, file=file)
    held = max(size - start, 0) // max(row, 1)
    return C3dHeader(points, frames, first, last, frames * ratio, start, row, held)


def _announced_frames(header: C3dHeader, contents: dict) -> int:
    """Return the frames by the header, TRIAL, POINT:LONG_FRAMES or the file's length."""
    start, end, stated = (
        _long(contents[name]) for name in ("start", "end", "long_frames")
    )
    if None not in (start, end):
        stated = max(end - start + 1, stated or 0)
    capped = header.last == LONGEST
    if stated and (capped or stated % 2**16 == header.frames % 2**16):
        return max(stated, header.frames)
    behind = (header.held - header.frames) * header.row >= BLOCK  # more than padding
    return (
        header.held
        if capped and (behind or header.held < header.frames)
        else header.frames
    )


def _long(words: list[float]) -> int | None:
    """Return the number of one or two ``words``, the low one first; None for no number."""
    if len(words) not in (1, 2) or not np.isfinite(words).all():
        return None
    low, *high = map(int, words)
    return low % 2**16 + high[0] % 2**16 * 2**16 if high else low


def read_contents(file: str, header: C3dHeader | None = None, frames: int = 0) -> dict:
    """Return the contents by ezc3d, which may crash or hang on a damaged file: ``points`` (3, P, N)
    in the file's unit, ``residuals`` (P, N), ``labels``, ``outputs`` (labels of points that are no
    markers), ``channels``, ``units``, ``rate``, ``start``, ``end`` and ``long_frames``. With a
    ``header``, return points and residuals of ``frames`` that the library reads in pieces, since it
    reads the frames of the header alone.
    """
    if header is None:
        # open by descriptor, since the library refuses names that are not UTF-8
        with Path(file).open("rb") as stream:
            return _contents(stream.fileno())
    content, parts = Path(file).read_bytes(), []
    for first in range(0, frames, LONGEST - 1):
        count, above = (
            min(LONGEST - 1, frames - first),
            bytearray(content[: header.start]),
        )
        struct.pack_into("<2H", above, 6, 1, count)
        at = header.start + first * header.row
        with os.fdopen(os.memfd_create("piece"), "wb") as stream:
            stream.write(above + content[at : at + count * header.row])
            stream.flush()
            parts.append(_contents(stream.fileno()))
    joined = {"points": 2, "residuals": 1}
    return {
        name: np.concatenate([one[name] for one in parts], n)
        for name, n in joined.items()
    }


def _contents(descriptor: int) -> dict:
    import ezc3d

    recording = ezc3d.c3d(f"/proc/self/fd/{descriptor}")
    parameters = recording["parameters"]
    point, trial = parameters["POINT"], parameters.get("TRIAL", {})

    def values(kind: type, group: dict, *names: str) -> list:
        """Return all values of the parameters ``names`` in a group, in the order of ``names``."""
        found = [
            value for name in names if name in group for value in group[name]["value"]
        ]
        return [value.strip() if kind is str else value for value in map(kind, found)]

    # LABELS2 before LABELS10
    labels = sorted(
        sorted(name for name in point if re.fullmatch(r"LABELS\d*", name)), key=len
    )
    return {
        "points": recording["data"]["points"][:3],
        "residuals": recording["data"]["meta_points"]["residuals"][0],
        "labels": values(str, point, *labels),
        "outputs": values(str, point, *filter(OUTPUTS.fullmatch, point)),
        "units": values(str, point, "UNITS"),
        "rate": values(float, point, "RATE"),
        "channels": values(str, parameters.get("ANALOG", {}), "LABELS"),
        "start": values(float, trial, "ACTUAL_START_FIELD"),
        "end": values(float, trial, "ACTUAL_END_FIELD"),
        "long_frames": values(float, point, "LONG_FRAMES"),
    }


def _processor(content: bytes) -> int:
    """Return the processor, byte 4 of the parameter block; 0 where ``content`` is no C3D."""
    at = (content[0] - 1) * BLOCK + 3 if content and content[0] else len(content)
    is_c3d = len(content) >= BLOCK and content[1] == KEY and at < len(content)
    return content[at] if is_c3d and content[at] in (INTEL, DEC, MIPS) else 0


def _begins(head: Head) -> bool:
    return head.suffix == ".c3d" or _processor(head.content) > 0


FORMAT = Format("C3D", Kind.MOTION, read_c3d, _begins)
