"""Frames of a depth sequence and their times: by its index (TUM RGB-D layout), or by numbers in the
names of its files.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import NUMBER, read_text
from pipeline.formats.depth import cloud, image
from pipeline.formats.format import Format, Head, Kind, matching

# s between frames, at the median: between them lie the cameras, and not their stamps in ms, µs or
# ns (30 Hz: 33 ms)
SHORTEST_STEP, LONGEST_STEP = 1e-4, 10.0
NUMBERED = re.compile(r"(.*?)(\d+)(\D*)", re.ASCII)  # the last number in a name


@dataclass(frozen=True)
class DepthIndex:
    """N frames of a sequence: ``time`` (N,) in s on the sensor's clock, increasing; ``files``
    relative to the take's folder.
    """

    time: np.ndarray
    files: tuple[str, ...]
    counts: dict[str, int]  # see read_index


def read_index(file: Path) -> DepthIndex:
    """Return the index of a depth sequence: lines ``timestamp filename`` and comments from ``#``;
    ``cut_rows`` counts a last line without line end, which is dropped. RecordingError with the line
    for another form, a time that does not increase, times that cannot be in s, and no frame.
    """
    text = read_text(file)
    time, files = [-np.inf], []
    for number, line in enumerate(map(str.strip, text.lines), start=1):
        if not line or line.startswith("#"):
            continue
        stamp, name = [*line.split(maxsplit=1), ""][:2]
        seconds = float(stamp) if NUMBER.fullmatch(stamp) else np.nan
        pairs = len(words := name.split()) > 2 and NUMBER.fullmatch(words[1])
        if not name or pairs or not time[-1] < seconds < np.inf:
            message = f"{line[:80]!r} must be a time in s that increases, a blank and the name of "
            message += f"one depth frame{'; it pairs two images' if pairs else ''}"
            raise RecordingError(message, file=file, line=number)
        time.append(seconds)
        files.append(name)
    if not files:
        raise RecordingError("the index names no frame in a whole line", file=file)
    step = float(np.median(np.diff(time[1:]))) if len(files) > 1 else SHORTEST_STEP
    if not SHORTEST_STEP <= step <= LONGEST_STEP:
        message = f"frames {step:.6g} s apart come from no camera: write the times in s (ms, µs and"
        raise RecordingError(f"{message} ns are divided by 1e3, 1e6 and 1e9)", file=file)
    return DepthIndex(np.array(time[1:]), tuple(files), {"cut_rows": int(text.cut is not None)})


def dropped_frames(time: np.ndarray) -> int:
    """Return the number of frames that lack between those of ``time`` (F,) in s by median steps."""
    steps = np.diff(time)
    lost = np.rint(steps / np.median(steps)) - 1 if len(steps) else steps
    return int(np.sum(np.maximum(lost, 0)))


def write_index(file: Path, time: np.ndarray, files: tuple[str, ...]) -> None:
    """Write the index of N frames, ``time`` (N,) in s with the six decimals of TUM RGB-D."""
    rows = [f"{stamp:.6f} {name}" for stamp, name in zip(time, files, strict=True)]
    lines = ["# depth maps", "# timestamp filename", *rows]
    Path(file).write_bytes(("\n".join(lines) + "\n").encode())


def numbered_frames(folder: Path, pattern: str, *, rate: float) -> DepthIndex:
    """Return the frames of ``folder`` that match the glob ``pattern``, by the last number n in
    their names, each (n − first)/``rate`` s after the first. RecordingError where no file matches,
    names differ in more than one number or have none, or one comes twice.
    """
    numbers: dict[int, Path] = {}
    forms = set()
    for file in filter(Path.is_file, matching(folder, pattern, key="dataset.depth.frames")):
        parts = NUMBERED.fullmatch(file.stem)
        forms.add((file.parent, file.suffix, *(parts.group(1, 3) if parts else (file,))))
        other = numbers.setdefault(int(parts[2]), file) if parts else file
        if parts is None or len(forms) > 1 or other != file:
            message = f"the names that match {pattern!r} must differ in one number alone, each of "
            message += "which is there once; rename the frames, or write an index of their times"
            raise RecordingError(message, file=file)
    if not numbers:
        raise RecordingError(f"no depth frame matches {pattern!r}", file=folder)
    order = sorted(numbers)
    time = np.array([(number - order[0]) / rate for number in order])
    return DepthIndex(time, tuple(str(numbers[number].relative_to(folder)) for number in order), {})


def frame_endings() -> tuple[str, ...]:
    """Return the endings of the names of depth frames, images and clouds: ``.png`` and others."""
    return image.ENDINGS + cloud.ENDINGS


def _begins(head: Head) -> bool:
    held = [line.split(maxsplit=1) for line in head.lines if not line.lstrip().startswith("#")]
    if not held or len(held[0]) != 2:
        return False
    stamp, name = held[0]
    return bool(NUMBER.fullmatch(stamp)) and name.strip().lower().endswith(frame_endings())


FORMAT = Format("depth sequence with index", Kind.SEQUENCE, read_index, _begins, option="index")
