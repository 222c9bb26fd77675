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
INTEL = 84
DEC = 85
MIPS = 86
BLOCK = 512  # bytes
LONGEST = 0xFFFF  # greatest frame number that the header can hold
AGAIN = "export or copy the take again"

# parameters of POINT, in Nexus and Visual3D, with the labels of points that a model computed
OUTPUTS = re.compile(r"(ANGLES|FORCES|MOMENTS|POWERS|SCALARS|REACTIONS)\d*")


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


class C3dContents(NamedTuple):
    """Contents of P points in N frames; a parameter that the file lacks is empty."""

    points: np.ndarray  # (3, P, N) in the file's unit
    residuals: np.ndarray  # (P, N), negative without a measurement
    labels: list[str]
    outputs: list[str]  # labels of points that are not markers
    units: list[str]
    rate: list[float]
    channels: list[str]  # labels of the analog channels
    start: list[float]
    end: list[float]
    long_frames: list[float]


def read_c3d(file: Path, unit: str | None = None) -> MotionTake:
    """Return the markers of the C3D take in ``file``, in m and s; ``unit`` (m, cm or mm) is the
    unit of lengths where POINT:UNITS is empty.

    A sample is missing if its residual is negative, if all coordinates are exactly zero, or if a
    coordinate is NaN or beyond GREATEST, as NDI's -3.7e28 (counted as ``invalid_samples``). Points
    that share a label are called ``label [n]``, points without a label ``Point n``. Points listed
    in POINT:ANGLES, FORCES, MOMENTS, POWERS, REACTIONS or SCALARS are outputs of a model: they are
    left out and counted, and so are surplus labels. Where the header's 16 bits cannot hold the
    number of frames, TRIAL or POINT:LONG_FRAMES states it, else the length of the file. Raises
    RecordingError for an unreadable or damaged file, another format, the byte order of MIPS and
    fewer frames than stated, and for no points, no marker, no rate or no unit.
    """
    header = _first_block(file)
    points = header.points
    require("markers", points, "points", file)
    contents, announced = _contents_of(file, header)
    frames = contents.points.shape[2]
    again = f"truncated? {AGAIN}"
    counts = compare_announced("frames", announced, frames, again, file=file)
    rate = _frame_rate(contents, file)
    stated = sorted({text.lower() for text in contents.units if text})
    unit = settle_unit(" and ".join(stated), unit, file, key="POINT:UNITS")
    samples = contents.points.transpose(1, 2, 0).copy()
    with np.errstate(invalid="ignore"):
        invalid = ~(np.abs(samples) < GREATEST)
    samples[invalid] = np.nan
    samples[contents.residuals < 0] = np.nan

    labels = [*contents.labels, *[""] * points]
    labels = labels[:points]
    surplus = max(len(contents.labels) - points, 0)
    names = _marker_names(labels, contents.outputs)
    if not names:
        raise RecordingError(
            f"all {points} points are outputs of a model (angles, moments or others); export the "
            "take with its markers",
            file=file,
        )
    more = {"unlabelled_points": labels.count("")}
    rare = {
        "skipped_model_outputs": points - len(names),
        "invalid_samples": int(invalid[[*names]].any(axis=-1).sum()),
        "skipped_labels": surplus,
    }
    more |= {name: count for name, count in rare.items() if count}
    raw = MotionTake(
        name=Path(file).stem,
        version="C3D",
        rate=rate,
        frame=np.arange(frames) + _first_frame(header, contents),
        time=np.zeros(0),
        markers={name: samples[point] for point, name in names.items()},
        bodies={},
        counts=counts,
        unit=unit,
    )
    return checked_take(raw, file, more=more)


def _contents_of(file: Path, header: C3dHeader) -> tuple[C3dContents, int]:
    """Return the contents with all frames, and the number of announced frames; RecordingError for
    no points, and for other points than the ``header`` announces.
    """
    contents = read_alone(read_contents, str(file), file=file, advice=AGAIN)
    if not header.points:
        channels = contents.channels
        message = "the file has no points: no take"
        if channels:
            message = (
                f"the file has no points, only {len(channels)} analog channels "
                f"({', '.join(channels)}) of {header.samples} samples: export the markers"
            )
        raise RecordingError(message, file=file)
    announced = _announced_frames(header, contents)
    if announced > header.frames:
        require("memory_mib", announced * header.row / MIB, "MiB of frames", file)
        stored = str(file), header, min(announced, header.held)
        points, residuals = read_alone(read_pieces, *stored, file=file, advice=AGAIN)
        contents = contents._replace(points=points, residuals=residuals)
    _, points, frames = contents.points.shape
    if points != header.points or contents.residuals.shape != (points, frames):
        message = f"the header announces {header.points} points, the file holds {points}; {AGAIN}"
        raise RecordingError(message, file=file, key="POINT:USED")
    return contents, announced


def _frame_rate(contents: C3dContents, file: Path) -> float:
    """Return the frame rate in Hz; RecordingError for no rate > 0, and several."""
    if len(contents.rate) == 1 and 0 < contents.rate[0] < np.inf:
        return contents.rate[0]
    message = f"the file has no frame rate; {AGAIN}"
    raise RecordingError(message, file=file, key="POINT:RATE")


def _first_frame(header: C3dHeader, contents: C3dContents) -> int:
    """Return the number of the first frame, by TRIAL where it agrees with the header's 16 bits."""
    stated = _long(contents.start)
    if stated is not None and header.first in (stated % 2**16, LONGEST):
        return stated
    return header.first


def _marker_names(labels: list[str], outputs: list[str]) -> dict[int, str]:
    """Return number → name of the points with ``labels`` that are markers, and not ``outputs`` of a
    model.
    """
    labels = [label or f"Point {n}" for n, label in enumerate(labels, start=1)]
    names = {}
    for point, label in enumerate(labels):
        # the list of outputs has the label with its subject (Arm:HipAngles) or without
        if label in outputs or label.rpartition(":")[2] in outputs:
            continue
        names[point] = label
        if labels.count(label) > 1:
            number = labels[: point + 1].count(label)
            names[point] = f"{label} [{number}]"
    return names


def _first_block(file: Path) -> C3dHeader:
    """Return the header; RecordingError for no C3D, and a file shorter than its header states."""
    with readable(file), Path(file).open("rb") as stream:
        content = stream.read(256 * BLOCK)
        size = stream.seek(0, os.SEEK_END)
    processor = _processor(require_content(content, file))
    if processor not in (INTEL, DEC):
        message = f"this is no C3D file, or its header is cut short; {AGAIN}"
        if processor == MIPS:
            message = (
                "the numbers are big-endian (SGI, MIPS), which is not read; convert the file to "
                "Intel's byte order with Mokka or C3Dserver"
            )
        raise RecordingError(message, file=file)
    points, analog, first, last = struct.unpack_from("<4H", content, 2)
    start, ratio = struct.unpack_from("<2H", content, 16)
    # a negative scale means floating point; DEC stores the word with the sign first
    width = 4 if content[15 if processor == INTEL else 13] & 0x80 else 2
    start = (max(start, 1) - 1) * BLOCK
    row = width * (4 * points + analog)
    frames = last - first + 1
    stored = frames if last != LONGEST else 1  # at LONGEST the length decides
    needed = start + stored * row
    if frames < 1 or size < needed:
        raise RecordingError(
            f"the header announces {points} points in {frames} frames, which need {needed} bytes "
            f"or more; the file has {size}: empty or truncated; {AGAIN}",
            file=file,
        )
    held = max(size - start, 0) // max(row, 1)
    return C3dHeader(points, frames, first, last, frames * ratio, start, row, held)


def _announced_frames(header: C3dHeader, contents: C3dContents) -> int:
    """Return the frames by the header, TRIAL, POINT:LONG_FRAMES or the file's length."""
    start = _long(contents.start)
    end = _long(contents.end)
    stated = _long(contents.long_frames)
    if start is not None and end is not None:
        stated = max(end - start + 1, stated or 0)
    capped = header.last == LONGEST
    agreeing = stated and stated % 2**16 == header.frames % 2**16
    if agreeing or (stated and capped):
        return max(stated, header.frames)
    surplus = (header.held - header.frames) * header.row
    if capped and (surplus >= BLOCK or surplus < 0):  # more than padding
        return header.held
    return header.frames


def _long(words: list[float]) -> int | None:
    """Return the number of one or two ``words``, the low one first; None for no number."""
    if len(words) not in (1, 2) or not np.isfinite(words).all():
        return None
    if len(words) == 1:
        return int(words[0])
    low, high = (int(word) % 2**16 for word in words)
    return low + high * 2**16


def read_contents(file: str) -> C3dContents:
    """Return the contents by ezc3d, which may crash or hang on a damaged file."""
    # open by descriptor, since the library refuses names that are not UTF-8
    with Path(file).open("rb") as stream:
        return _contents(stream.fileno())


def read_pieces(
    file: str,
    header: C3dHeader,
    frames: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Return points and residuals of ``frames``, which the library reads in pieces, since it only
    reads the frames of the header.
    """
    content = Path(file).read_bytes()
    points = []
    residuals = []
    for first in range(0, frames, LONGEST - 1):
        count = min(LONGEST - 1, frames - first)
        piece = bytearray(content[: header.start])
        struct.pack_into("<2H", piece, 6, 1, count)
        place = header.start + first * header.row
        piece += content[place : place + count * header.row]
        with os.fdopen(os.memfd_create("piece"), "wb") as stream:
            stream.write(piece)
            stream.flush()
            contents = _contents(stream.fileno())
        points.append(contents.points)
        residuals.append(contents.residuals)
    return np.concatenate(points, axis=2), np.concatenate(residuals, axis=1)


def _contents(descriptor: int) -> C3dContents:
    import ezc3d

    recording = ezc3d.c3d(f"/proc/self/fd/{descriptor}")

    def values(kind: type, group: str, *names: str) -> list:
        """Return all values of the parameters ``names``, none if there are none."""
        collected = []
        parameters = recording["parameters"].get(group, {})
        for name in names:
            if name in parameters:
                collected += [kind(value) for value in parameters[name]["value"]]
        return [value.strip() if kind is str else value for value in collected]

    point = recording["parameters"]["POINT"]
    labels = [name for name in point if re.fullmatch(r"LABELS\d*", name)]
    labels = sorted(sorted(labels), key=len)  # LABELS2 before LABELS10
    return C3dContents(
        points=recording["data"]["points"][:3],
        residuals=recording["data"]["meta_points"]["residuals"][0],
        labels=values(str, "POINT", *labels),
        outputs=values(str, "POINT", *filter(OUTPUTS.fullmatch, point)),
        units=values(str, "POINT", "UNITS"),
        rate=values(float, "POINT", "RATE"),
        channels=values(str, "ANALOG", "LABELS"),
        start=values(float, "TRIAL", "ACTUAL_START_FIELD"),
        end=values(float, "TRIAL", "ACTUAL_END_FIELD"),
        long_frames=values(float, "POINT", "LONG_FRAMES"),
    )


def _processor(content: bytes) -> int:
    """Return the processor, byte 4 of the parameter block; 0 where ``content`` is not a C3D."""
    if len(content) < BLOCK or content[1] != KEY or not content[0]:
        return 0
    place = (content[0] - 1) * BLOCK + 3
    processor = content[place] if place < len(content) else 0
    return processor if processor in (INTEL, DEC, MIPS) else 0


def _begins(head: Head) -> bool:
    return head.suffix == ".c3d" or _processor(head.content) > 0


FORMAT = Format("C3D", Kind.MOTION, read_c3d, _begins)
