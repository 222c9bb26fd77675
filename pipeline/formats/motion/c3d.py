"""Motion-capture takes as C3D (the format of c3d.org), read by ezc3d in a process of its own."""

from __future__ import annotations

import os
import re
import struct
from collections import Counter
from pathlib import Path

import numpy as np

from pipeline.core.bounds import require
from pipeline.core.errors import RecordingError
from pipeline.formats.format import Format, Head, Kind, read_alone, readable
from pipeline.formats.motion.take import MotionTake, TakeBuilder, settle_unit

KEY = 0x50  # the second byte of every C3D file
INTEL, DEC, MIPS = 84, 85, 86
BLOCK = 512  # bytes
LONGEST = 0xFFFF  # the greatest frame number that fits the header's last word
AGAIN = "export or copy the take again"

# groups of POINT whose entries name points that a model computed, in Nexus and Visual3D
OUTPUTS = re.compile(r"(ANGLES|FORCES|MOMENTS|POWERS|SCALARS|REACTIONS)\d*")


def read_c3d(file: Path, unit: str | None = None) -> MotionTake:
    """Return the markers of the C3D take in ``file``, in m and s; ``unit`` (m, cm or mm) is the
    unit of its lengths where POINT:UNITS is empty.

    A sample is missing where its residual is negative, a coordinate is no number or all three are
    exactly zero. Points of one label are each ``label [n]``, points without one are ``Point n``.
    Points that POINT:ANGLES, FORCES, MOMENTS, POWERS, REACTIONS or SCALARS name are outputs of a
    model, not markers: they are passed over and counted, as are labels beyond the points, analog
    channels and force plates.

    Raises RecordingError for a file that cannot be read, is no C3D, is of a big-endian MIPS
    processor, is shorter than its header says, makes the library fail, or has no marker, no rate or
    no unit.
    """
    points, announced, first = _first_block(file)
    require("markers", points, "points", file)
    contents = read_alone(read_contents, str(file), file=file, advice=AGAIN)
    position, residual, rate = (contents[name] for name in ("points", "residuals", "rate"))
    _, held, frames = position.shape
    if (held, residual.shape) != (points, position.shape[1:]):
        message = f"the header announces {points} points and the parameters {held}: damaged"
        raise RecordingError(f"{message}; {AGAIN}", file=file, key="POINT:USED")
    if announced not in (None, frames):
        message = f"the header announces {announced} frames, the file holds {frames}: truncated"
        raise RecordingError(f"{message}; {AGAIN}", file=file)
    if rate.shape != (1,) or not 0 < rate[0] < np.inf:
        raise RecordingError("the file gives no frame rate", file=file, key="POINT:RATE")
    stated = {text.strip().lower() for text in contents["units"]} - {""}
    unit = settle_unit(" and ".join(sorted(stated)), unit, file, key="POINT:UNITS")
    if (start := contents["start"]).size == 2:  # words of 16 bits that complete the header's
        number = int(start[0]) % 2**16 + int(start[1]) % 2**16 * 2**16
        first = number if first in (number % 2**16, LONGEST) else first
    frame = np.arange(frames) + first
    labels = [label.strip() for label in contents["labels"].tolist()]
    outputs = {name.strip() for name in contents["outputs"].tolist()} - {""}
    counts = {"announced_frames": announced or frames}
    take = TakeBuilder(unit, frame, float(rate[0]), None, counts)
    take.counts["unlabelled_points"] = points - sum(map(bool, labels[:points]))

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


def _first_block(file: Path) -> tuple[int, int | None, int]:
    """Return points, frames (None where there are more than its words can tell) and first frame of
    the header; RecordingError where it is none, or the file is too short for them.
    """
    with readable(file), Path(file).open("rb") as stream:
        content, size = stream.read(256 * BLOCK), stream.seek(0, os.SEEK_END)
    processor, message = _processor(content), ""
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
    return points, None if last == LONGEST else frames, first


def read_contents(file: str) -> dict[str, np.ndarray]:
    """Return what ezc3d reads, which may crash or never return on a damaged file: ``points``
    (3, P, N) in the file's unit, ``residuals`` (P, N), ``labels``, ``outputs`` (labels of points
    that are no markers), ``units``, ``rate`` and ``start`` as stated; the numbers of ``analog``
    channels and force ``plates``.
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
    # LABELS2 before LABELS10
    labels = sorted(sorted(name for name in point if re.fullmatch(r"LABELS\d*", name)), key=len)
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


def _values(group: dict, *names: str) -> list:
    """All values that a group of parameters has under ``names``, in their order."""
    return [value for name in names if name in group for value in group[name]["value"]]


def _begins(head: Head) -> bool:
    content = head.content
    key = len(content) >= BLOCK and content[1] == KEY
    return head.suffix == ".c3d" or (key and _processor(content) in (INTEL, DEC, MIPS))


def _processor(content: bytes) -> int:
    """Return the fourth byte of the parameters, whose block the first byte names; 0 if absent."""
    at = (content[0] - 1) * BLOCK + 3 if content and content[0] else len(content)
    return content[at] if at < len(content) else 0


FORMAT = Format("C3D", Kind.MOTION, read_c3d, _begins)
