"""Motion-capture takes as C3D (the format of c3d.org), read by ezc3d in a process of its own."""

from __future__ import annotations

import os
import re
import struct
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.core.bounds import require
from pipeline.core.errors import RecordingError
from pipeline.formats.format import Format, Head, Kind, read_alone
from pipeline.formats.motion.take import MotionTake, TakeBuilder, settle_unit

KEY = 0x50  # the second byte of every C3D file
INTEL, DEC, MIPS = 84, 85, 86
BLOCK = 512  # bytes
LONGEST = 0xFFFF  # the greatest frame number that fits the header's last word
AGAIN = "export or copy the take again"

# groups of POINT whose entries name points that a model computed: angles in degrees, moments in
# N·mm and others, of Vicon's Nexus and of Visual3D
OUTPUTS = re.compile(r"(ANGLES|FORCES|MOMENTS|POWERS|SCALARS|REACTIONS)\d*")


def read_c3d(file: Path, unit: str | None = None) -> MotionTake:
    """Return the markers of the C3D take in ``file``, in m and s; ``unit`` (m, cm or mm) is the
    unit of its lengths where POINT:UNITS is empty.

    A sample is missing where its residual is negative, a coordinate is no number or all three are
    exactly zero. Points of one label are each ``label [n]``, points without one are ``Point n``;
    the first frame has the number that the header gives it. Points that POINT:ANGLES, FORCES,
    MOMENTS, POWERS, REACTIONS or SCALARS name are outputs of a model, not markers: they are passed
    over, as are labels beyond the points, analog channels, force plates and segment rotations.
    ``counts``: ``announced_frames``, ``found_frames``, ``gaps``, ``skipped_frames``,
    ``time_mismatches`` (C3D has no times, hence 0), ``zero_samples``, ``partial_samples``,
    ``marker_samples``, ``missing_samples``, ``missing_poses`` (0) and ``unlabelled_points``; where
    there are any, ``skipped_model_outputs``, ``skipped_labels``, ``skipped_analog_channels`` and
    ``skipped_force_plates``.

    Raises RecordingError for a file that cannot be read, is no C3D, is of a big-endian MIPS
    processor, is shorter than its header says, makes the library fail, or has no marker, no rate or
    no unit.
    """
    header = _first_block(file)
    require("markers", header.points, "points", file)
    contents = read_alone(read_contents, str(file), file=file, advice=AGAIN)
    position, residual = contents["points"], contents["residuals"]
    _, points, frames = position.shape
    if (points, residual.shape) != (header.points, position.shape[1:]):
        message = f"the header announces {header.points} points and the parameters {points}: "
        raise RecordingError(f"{message}damaged; {AGAIN}", file=file, key="POINT:USED")
    if header.frames not in (None, frames):
        message = f"the header announces {header.frames} frames, the file holds {frames}: truncated"
        raise RecordingError(f"{message}; {AGAIN}", file=file)
    rate = contents["rate"]
    if rate.shape != (1,) or not 0 < rate[0] < np.inf:
        raise RecordingError("the file gives no frame rate", file=file, key="POINT:RATE")
    stated = {text.strip().lower() for text in contents["units"]} - {""}
    unit = settle_unit(" and ".join(sorted(stated)), unit, file, key="POINT:UNITS")
    frame = np.arange(frames) + _first_frame(header.first, contents["start"])
    labels = [label.strip() for label in contents["labels"].tolist()]
    outputs = {name.strip() for name in contents["outputs"].tolist()} - {""}
    counts = {"announced_frames": header.frames or frames}
    counts["unlabelled_points"] = points - sum(map(bool, labels[:points]))
    take = TakeBuilder(unit, frame, float(rate[0]), None, counts)

    def place(k: int, *_: int) -> dict[str, object]:
        return {"file": file, "frame": int(frame[k])}

    for number, name in enumerate(_names(labels, points)):
        # outputs name the label with its subject (Arm:HipAngles) or without
        if {*labels[number : number + 1], name.rpartition(":")[2]} & outputs:
            continue
        samples = position[:, number].T.copy()
        samples[~np.isfinite(samples) | (residual[number] < 0)[:, None]] = np.nan
        take.markers[name] = take.position(samples, name, place)
    if not take.markers:
        message = f"all {points} points are outputs of a model (angles, moments or others)"
        raise RecordingError(f"{message}; export the take with its markers", file=file)
    beside = {
        "skipped_model_outputs": points - len(take.markers),
        "skipped_labels": max(len(labels) - points, 0),
        "skipped_analog_channels": int(contents["analog"]),
        "skipped_force_plates": int(contents["plates"]),
    }
    return take.take(
        Path(file).stem, "C3D", {name: count for name, count in beside.items() if count}
    )


def _first_frame(header: int, start: np.ndarray) -> int:
    """Return the first frame's number: the header's, whose 16 bits the two words of
    TRIAL:ACTUAL_START_FIELD complete where they are of the same number.
    """
    if start.size != 2:
        return header
    number = int(start[0]) % 2**16 + int(start[1]) % 2**16 * 2**16
    return number if header in (number % 2**16, LONGEST) else header


def _names(labels: list[str], points: int) -> list[str]:
    """Return a name for each point; a label that several have names none of them."""
    labels = (labels + [""] * points)[:points]
    labels = [label or f"Point {number}" for number, label in enumerate(labels, start=1)]
    times, numbered = Counter(labels), Counter()
    names = []
    for label in labels:
        numbered[label] += 1
        names.append(label if times[label] == 1 else f"{label} [{numbered[label]}]")
    return names


class FirstBlock(NamedTuple):
    """Numbers of the file's first block."""

    points: int
    frames: int | None  # None where there are more than its words can tell
    first: int  # frame


def _first_block(file: Path) -> FirstBlock:
    """Return the numbers in the file's header; RecordingError where it is none, or the file is too
    short for them.
    """
    try:
        with Path(file).open("rb") as stream:
            content, size = stream.read(256 * BLOCK), stream.seek(0, os.SEEK_END)
    except OSError as error:
        raise RecordingError(f"the file cannot be read ({error.strerror})", file=file) from None
    at = (content[0] - 1) * BLOCK + 3 if content and content[0] else len(content)
    processor = content[at] if at < len(content) else 0
    message = ""
    if len(content) < BLOCK or content[1] != KEY or processor not in (INTEL, DEC, MIPS):
        message = f"this is no C3D file, or its header is cut short; {AGAIN}"
    elif processor == MIPS:
        message = "the numbers are in the order of an SGI computer (big-endian MIPS), which is not "
        message += "read; convert the file to Intel's order, as Mokka or C3Dserver do"
    if message:
        raise RecordingError(message, file=file)
    points, analog, first, last = struct.unpack_from("<4H", content, 2)
    start = struct.unpack_from("<H", content, 16)[0]
    # a negative scale means floating point; DEC has the word with its sign first
    width = 4 if content[15 if processor == INTEL else 13] & 0x80 else 2
    frames = last - first + 1
    needed = (max(start, 1) - 1) * BLOCK + frames * width * (4 * points + analog)
    if not points or frames < 1:
        message = "the take holds no point, or no frame; export it with markers"
    elif last != LONGEST and size < needed:
        message = f"the file has {size} bytes of the {needed} that its header announces: "
        message += f"truncated; {AGAIN}"
    if message:
        raise RecordingError(message, file=file)
    return FirstBlock(points, None if last == LONGEST else frames, first)


def read_contents(file: str) -> dict[str, np.ndarray]:
    """Return what ezc3d reads, which may crash or never return on a damaged file: call it in a
    process of its own.

    ``points`` (3, P, N) in the file's unit, ``residuals`` (P, N), ``labels`` (≥ or < P,),
    ``outputs`` (the labels of points that are no markers), ``units`` and ``rate`` as stated,
    ``start`` (TRIAL:ACTUAL_START_FIELD, two words or none); the numbers of ``analog`` channels and
    force ``plates``.
    """
    import ezc3d

    # by its descriptor, since the library takes no name that is not UTF-8
    descriptor = os.open(file, os.O_RDONLY)
    try:
        recording = ezc3d.c3d(f"/proc/self/fd/{descriptor}")
    finally:
        os.close(descriptor)
    parameters = recording["parameters"]
    point = parameters["POINT"]
    labels = sorted((name for name in point if re.fullmatch(r"LABELS\d*", name)), key=_numbered)
    outputs = [name for name in point if OUTPUTS.fullmatch(name)]
    return {
        "points": recording["data"]["points"][:3],
        "residuals": recording["data"]["meta_points"]["residuals"][0],
        "labels": np.array(_values(point, *labels), dtype=str),
        "outputs": np.array([str(name) for name in _values(point, *outputs)], dtype=str),
        "units": np.array(_values(point, "UNITS"), dtype=str),
        "rate": np.array(_values(point, "RATE"), dtype=float),
        "start": np.array(_values(parameters.get("TRIAL", {}), "ACTUAL_START_FIELD"), dtype=int),
        "analog": np.array(recording["data"]["analogs"].shape[1]),
        "plates": np.array(sum(_values(parameters.get("FORCE_PLATFORM", {}), "USED")[:1])),
    }


def _numbered(name: str) -> tuple[int, str]:
    """Sort LABELS2 before LABELS10."""
    return len(name), name


def _values(group: dict, *names: str) -> list:
    """All values that a group of parameters has under ``names``, in their order."""
    return [value for name in names if name in group for value in group[name]["value"]]


def _begins(head: Head) -> bool:
    if head.suffix == ".c3d":
        return True
    # the fourth byte of the parameters, whose block the first byte names, is the processor's
    content = head.content
    processor = (content[0] - 1) * BLOCK + 3 if len(content) >= BLOCK else len(content)
    return content[1:2] == bytes([KEY]) and content[processor : processor + 1] in (
        *map(bytes, ([INTEL], [DEC], [MIPS])),
    )


FORMAT = Format("C3D", Kind.MOTION, read_c3d, _begins)
