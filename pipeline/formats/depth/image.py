"""Depth images as PNG, TIFF or PGM, conversion of pixels to m, and the times of the frames of a
sequence: by an index (TUM RGB-D layout), or by numbers or times in file names.

OpenCV decodes the pixels and keeps their type. Pillow reads the header first, to bound the size of
the pixels, and checks the checksums of a PNG and the length of a PGM, since OpenCV pads missing
bytes.
"""

import io
import re
import warnings
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from PIL import Image
from PIL.TiffImagePlugin import ImageFileDirectory_v2

from pipeline.core.bounds import MIB, require
from pipeline.core.errors import RecordingError
from pipeline.formats.delimited import NUMBER, read_text
from pipeline.formats.depth import cloud
from pipeline.formats.depth.frame_names import FrameSequence, frame_sequences
from pipeline.formats.format import Format, Head, Kind, begins, file_content, matching

PNG = b"\x89PNG\r\n\x1a\n"
TIFF = (b"II*\0", b"MM\0*")
PGM = b"P5"
ENDINGS = (".png", ".tif", ".tiff", ".pgm", *cloud.ENDINGS)  # suffixes of depth frames
# tags of TIFF 6.0, section 8
WIDTH = 256
LENGTH = 257
DESCRIPTION = 270
# s, limits of the median step; times in ms exceed them
SHORTEST_STEP = 1e-4
LONGEST_STEP = 10.0
PIXEL = 4  # bytes, size of the largest decoded pixel
NO_DISPARITY = 2047  # value of the Kinect's 11-bit disparity without a measurement
# run-length coded row differences: a fixed filter halves the time, level 6 would save 1 % of size
PARAMETERS = (
    *(cv2.IMWRITE_PNG_COMPRESSION, 1),
    *(cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_SUB),
    *(cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE),
)
# OpenCV prints no messages, since the RecordingError names the fault of an image
cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


class RawDepth(NamedTuple):
    """Image (H, W) uint16 or float32 of the sensor's software; ``description`` of a TIFF."""

    pixels: np.ndarray
    description: str = ""


class Encoding(NamedTuple):
    """Conversion of stored values to m (section ``dataset.depth``).

    ``kind`` is ``plain`` (the value is the depth), ``rotated_bits`` (depth, its bits rotated left
    by three; SUN RGB-D) or ``disparity`` (11-bit disparity δ of the Kinect with swapped bytes:
    depth = a/(b − δ); NYU Depth v2: a = 351.3, b = 1092.5).
    """

    kind: str
    units_per_metre: float  # 1000 for millimetres, 5000 for TUM RGB-D, 1 for metres
    saturation: float | None = None  # least stored value that is not a depth
    scale_key: str | None = None  # name of a factor in the description of a TIFF
    disparity: tuple[float, float] | None = None  # a, b


def metres(raw: RawDepth, encoding: Encoding, **evidence: object) -> np.ndarray:
    """Return the depth along the optical axis in m, (H, W) float32; NaN for stored values ≤ 0, NaN,
    saturation and no disparity. RecordingError (with ``evidence``) for a pixel type or value that
    the encoding does not have, and for a description without the factor.
    """
    if encoding.kind != "plain" and raw.pixels.dtype != np.uint16:
        message = f"pixels are {raw.pixels.dtype}; the encoding {encoding.kind} requires uint16"
        raise RecordingError(message, **evidence)
    values = raw.pixels
    invalid = ~(raw.pixels > 0)
    if encoding.saturation is not None:
        invalid |= raw.pixels >= encoding.saturation
    if encoding.kind == "rotated_bits":
        values = values >> 3 | values << 13
    elif encoding.kind == "disparity":
        disparity = values.byteswap()
        if disparity.max() > NO_DISPARITY:
            message = f"the greatest value {disparity.max()} is no 11-bit disparity with swapped "
            raise RecordingError(f"{message}bytes (at most {NO_DISPARITY})", **evidence)
        a, b = encoding.disparity
        invalid |= (disparity == NO_DISPARITY) | (disparity >= b)
        with np.errstate(divide="ignore"):
            values = (a / (b - disparity)).astype(np.float32)
    factor = 1.0
    if encoding.scale_key is not None:
        factor = _scale(raw.description, encoding.scale_key, evidence)
    depth = values / np.float32(encoding.units_per_metre / factor)
    invalid |= ~np.isfinite(depth)
    depth[invalid] = np.nan
    return depth


def _scale(description: str, key: str, evidence: dict[str, object]) -> float:
    """Return the factor that the ``description`` of an image states behind ``key``."""
    between = r"\"?(?:\s*[:=]\s*|\s+)\"?"
    number = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
    pattern = rf"(?<![\w.]){re.escape(key)}{between}({number})(?![\w.])"
    factors = [float(text) for text in re.findall(pattern, description)]
    if len(factors) != 1 or not 0 < factors[0] < np.inf:
        raise RecordingError(
            f"the image's description has no single positive number {key!r}: "
            f"{description[:120]!r}",
            **evidence,
        )
    return factors[0]


def read_depth(file: Path, *, shape: tuple[int, int] | None = None) -> RawDepth:
    """Return the image of ``shape`` = (H, W), by default any, in ``file``; RecordingError for
    truncated content, another format or size, and pixels that are not one channel of 16 bits or of
    floating point.
    """
    content = file_content(file)
    pixels = None
    reason = ""
    if not content.startswith((PNG, PGM, *TIFF)):
        message = (
            "the depth frame is no PNG, TIFF or PGM image; convert it to 16-bit PNG"
        )
        raise RecordingError(message, file=file)
    try:
        size, description = _header(content, file)
        if shape not in (None, size):
            height, width = size
            rows, columns = shape
            raise RecordingError(
                f"the image has {width} × {height} pixels where the camera has {columns} × {rows}; "
                "check the intrinsics",
                file=file,
            )
        # other modes convert 16 bits to 8
        pixels = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    except (RecordingError, MemoryError):
        raise
    except Exception as error:  # Pillow has no common class for damaged headers
        # without the address of the buffer
        reason = re.sub(" ?<.*>", "", f" ({error})")
    if pixels is None:
        raise RecordingError(
            f"the depth frame is truncated or damaged{reason}; copy it again, or take its line out "
            "of the index",
            file=file,
        )
    if pixels.dtype == np.float64:
        with np.errstate(over="ignore"):  # values beyond float32 are not depths
            pixels = pixels.astype(np.float32)
    if pixels.ndim != 2 or pixels.dtype not in (np.uint16, np.float32):
        channels = 1 if pixels.ndim == 2 else pixels.shape[2]
        raise RecordingError(
            f"the image has {channels} channel(s) of {pixels.dtype}; export depth as one channel, "
            "uint16 or floating point",
            file=file,
        )
    return RawDepth(pixels, description)


def _header(content: bytes, file: Path) -> tuple[tuple[int, int], str]:
    """Return (H, W) of an image, whose checksums or length are right, and a TIFF's description."""
    stream = io.BytesIO(content)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of Pillow, about odd tags and sizes
        if content.startswith(TIFF):
            tags = _tiff_tags(stream, file)
            height = int(tags[LENGTH])
            width = int(tags[WIDTH])
            _require_bounded(height, width, file)
            return (height, width), str(tags.get(DESCRIPTION, ""))
        with Image.open(stream, formats=("PNG", "PPM")) as image:
            _require_bounded(image.height, image.width, file)
            check = image.verify if content.startswith(PNG) else image.load
            check()
            return (image.height, image.width), ""


def _tiff_tags(stream: io.BytesIO, file: Path) -> ImageFileDirectory_v2:
    """Return the tags of a TIFF, of which Pillow does not open images of float64; RecordingError
    for several images.
    """
    tags = ImageFileDirectory_v2(stream.read(8))
    stream.seek(tags.next)
    tags.load(stream)
    if tags.next:
        message = "the file holds several images; write one depth frame to a file"
        raise RecordingError(message, file=file)
    return tags


def _require_bounded(height: int, width: int, file: Path) -> None:
    """Raise RecordingError for pixels that need more memory than allowed."""
    require("part_mib", height * width * PIXEL / MIB, "MiB of pixels", file)


def write_depth(file: Path, raw: np.ndarray) -> None:
    """Write ``raw`` depth (H, W) uint16 as PNG; equal frames have equal bytes."""
    if raw.ndim != 2 or raw.dtype != np.uint16:
        raise TypeError(f"raw depth must be (H, W) uint16, got {raw.shape} {raw.dtype}")
    Path(file).write_bytes(cv2.imencode(".png", raw, PARAMETERS)[1].tobytes())


class DepthIndex(NamedTuple):
    """N frames: increasing ``time`` (N,) in s by the sensor, and ``files`` in the take's folder."""

    time: np.ndarray
    files: tuple[str, ...]
    counts: dict[str, int]  # see read_index


def read_index(file: Path) -> DepthIndex:
    """Return the index of a depth sequence: lines ``timestamp filename``, comments behind ``#``;
    ``cut_rows`` counts a last line without line end, which is dropped. RecordingError with the line
    for another form, a time that does not increase, times that cannot be in s, and no frame.
    """
    text = read_text(file)
    time_of_file: dict[str, float] = {}
    last = -np.inf
    for number, line in enumerate(map(str.strip, text.lines), start=1):
        if not line or line.startswith("#"):
            continue
        stamp, name = [*line.split(maxsplit=1), ""][:2]
        seconds = float(stamp) if NUMBER.fullmatch(stamp) else np.nan
        words = name.split()
        reason = ""
        if len(words) > 2 and NUMBER.fullmatch(words[1]):
            reason = "; this line pairs two images"
        elif name in time_of_file:
            reason = "; a line above names this frame"
        if reason or not name or not last < seconds < np.inf:
            raise RecordingError(
                f"{line[:80]!r} must be an increasing time in s, a blank and the name of one depth "
                f"frame{reason}",
                file=file,
                line=number,
            )
        time_of_file[name] = last = seconds
    if not time_of_file:
        raise RecordingError("the index has no complete line with a frame", file=file)
    time = np.array([*time_of_file.values()])
    if len(time) > 1:
        require_step(np.diff(time), file)
    counts = {"cut_rows": int(text.cut is not None)}
    return DepthIndex(time, tuple(time_of_file), counts)


def dropped_frames(time: np.ndarray) -> int:
    """Return the number of missing frames between frames at ``time`` (F,) s, by the median step."""
    if len(time) < 2:
        return 0
    steps = np.rint(np.diff(time) / median_step(time))
    return int(np.sum(np.maximum(steps - 1, 0)))


def median_step(time: np.ndarray) -> float:
    """Return the median step of ``time`` (F,), the lower one of two for whole numbers."""
    method = "lower" if np.issubdtype(time.dtype, np.integer) else "linear"
    return float(np.quantile(np.diff(time), 0.5, method=method))


def write_index(file: Path, time: np.ndarray, files: tuple[str, ...]) -> None:
    """Write the index of N frames in the layout of TUM RGB-D, ``time`` (N,) s with six decimals."""
    lines = ["# depth maps", "# timestamp filename"]
    for stamp, name in zip(time, files, strict=True):
        lines.append(f"{stamp:.6f} {name}")
    Path(file).write_bytes(("\n".join(lines) + "\n").encode())


def named_frames(folder: Path, pattern: str) -> FrameSequence:
    """Return the frames of ``folder`` that match the glob ``pattern``, in the order of the numbers
    or times in their names. RecordingError where no file matches, a name has no number, names form
    several sequences, a number occurs twice, or times are of no camera.
    """
    files = filter(Path.is_file, matching(folder, pattern, key="dataset.depth.frames"))
    sequences = frame_sequences(files)
    if not sequences:
        raise RecordingError(f"no depth frame matches {pattern!r}", file=folder)
    frames = sequences[0]
    if len(sequences) > 1 or len({*frames.values}) < len(frames.files):
        names = ", ".join(sequence.pattern.name for sequence in sequences[:3])
        raise RecordingError(
            f"the names that match {pattern!r} must differ only in one number, or in a time, which "
            f"occurs once, found {names}; rename the frames, narrow the pattern or write an index "
            "of their times",
            file=frames.files[-1],
        )
    if frames.timed and len(frames.files) > 1:
        require_step(np.diff(frames.values) * 1e-9, folder)
    return frames


def require_step(steps: np.ndarray, file: Path) -> None:
    """Raise RecordingError where the median of ``steps`` between frames, in s, is of no camera."""
    step = float(np.median(steps))
    if not SHORTEST_STEP <= step <= LONGEST_STEP:
        raise RecordingError(
            f"the median time between frames is {step:.6g} s, of no camera: write the times in s "
            "(divide ms by 1e3, µs by 1e6, ns by 1e9)",
            file=file,
        )


def numbered_frames(folder: Path, pattern: str, *, rate: float) -> DepthIndex:
    """Return the index of :func:`named_frames`, by times in names or numbers over ``rate``."""
    frames = named_frames(folder, pattern)
    scale = 1e-9 if frames.timed else 1 / rate
    first = frames.values[0]
    seconds = [(value - first) * scale for value in frames.values]
    files = [str(file.relative_to(folder)) for file in frames.files]
    return DepthIndex(time=np.array(seconds), files=tuple(files), counts={})


def _begins(head: Head) -> bool:
    for line in head.lines:
        if not line.lstrip().startswith("#"):
            stamp, name = [*line.split(maxsplit=1), ""][:2]
            is_frame = name.strip().lower().endswith(ENDINGS)
            return is_frame and NUMBER.fullmatch(stamp) is not None
    return False


IMAGE = Format("depth image", Kind.IMAGE, read_depth, begins(PNG, *TIFF, PGM))
INDEX = Format(
    "depth sequence with index",
    Kind.SEQUENCE,
    read_index,
    _begins,
    option="index",
)
FORMAT = (IMAGE, INDEX)
