"""Depth sequences: 16-bit PNG frames, their index of time stamps (TUM RGB-D layout) and the camera's intrinsics (OpenCV's YAML)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from pipeline.errors import RecordingError
from pipeline.instruments.delimited import NUMBER, read_text

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
# run lengths on the filtered rows: on noisy 512 x 424 depth 250 kB in 6 ms, where level 6 takes 31 ms for 1 % less
PNG_PARAMETERS = (cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE)


@dataclass(frozen=True)
class Intrinsics:
    """Pinhole camera of ``width`` × ``height`` pixels: focal lengths and principal point in px, OpenCV's distortion k1, k2, p1, p2, k3 …"""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    distortion: tuple[float, ...] = ()


@dataclass(frozen=True)
class DepthIndex:
    """N frames of a sequence: ``time`` (N,) in s on the sensor's clock, increasing; ``files`` relative to the index."""

    time: np.ndarray
    files: tuple[str, ...]
    counts: dict[str, int]  # see read_index


def read_depth(file: Path, *, shape: tuple[int, int]) -> np.ndarray:
    """(H, W) uint16 raw depth of the PNG in ``file``, whose size must be ``shape`` = (H, W); 0 where there is no depth.

    Raises RecordingError for a file that is missing, truncated or no PNG, and for pixels that are not one channel of 16 bits.
    """
    try:
        content = Path(file).read_bytes()
    except OSError as error:
        raise RecordingError(f"the depth frame cannot be read ({error.strerror})", file=file) from None
    if not content.startswith(PNG_SIGNATURE):
        raise RecordingError("the depth frame is no PNG image; convert the sequence to 16-bit PNG", file=file)
    try:
        # unchanged, because every other mode hands 16 bits back as 8
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    if image is None:
        raise RecordingError("the depth frame is truncated or damaged; copy it again", file=file)
    if image.ndim != 2 or image.dtype != np.uint16:
        channels = 1 if image.ndim == 2 else image.shape[2]
        raise RecordingError(f"the image has {channels} channel(s) of {8 * image.itemsize} bits; depth is one of 16 bits", file=file)
    if image.shape != tuple(shape):
        found, wanted = (f"{width} × {height}" for height, width in (image.shape, shape))
        raise RecordingError(f"the image has {found} pixels where the camera has {wanted}; check the intrinsics", file=file)
    return image


def metres(raw: np.ndarray, *, units_per_metre: float) -> np.ndarray:
    """Depth along the optical axis in m, float32, NaN where ``raw`` is 0 (1000 units a metre for the Kinect, 5000 for TUM RGB-D)."""
    depth = raw / np.float32(units_per_metre)
    depth[raw == 0] = np.nan
    return depth


def write_depth(file: Path, raw: np.ndarray) -> None:
    """Write (H, W) uint16 ``raw`` depth as PNG, without loss; the same frame gives the same bytes."""
    if raw.ndim != 2 or raw.dtype != np.uint16:
        raise TypeError(f"raw depth is (H, W) uint16, not {raw.shape} {raw.dtype}")
    Path(file).write_bytes(cv2.imencode(".png", raw, PNG_PARAMETERS)[1].tobytes())


def read_index(file: Path) -> DepthIndex:
    """Index of a depth sequence: lines ``timestamp filename``, any number of blanks between and after, comments from ``#``.

    ``counts``: ``cut_rows``, a last line without line end, whose file name may be cut, so it is dropped. Raises RecordingError with the
    line for a line of another form, a time that does not increase, and an index without a frame.
    """
    text = read_text(file)
    time, files = [], []
    for number, line in enumerate(text.lines, start=1):
        line = line.strip()
        if not line or line.startswith("#"):
            continue
        stamp, *name = line.split(maxsplit=1)
        if not NUMBER.fullmatch(stamp) or not name:
            raise RecordingError(f"{line!r} is not 'timestamp filename'", file=file, line=number)
        time.append(float(stamp))
        files += name
        if len(time) > 1 and time[-1] <= time[-2]:
            raise RecordingError("the time does not increase", file=file, line=number)
    if not files:
        raise RecordingError("the index names no frame in a whole line", file=file)
    return DepthIndex(np.array(time), tuple(files), {"cut_rows": int(text.cut is not None)})


def write_index(file: Path, time: np.ndarray, files: tuple[str, ...]) -> None:
    """Write the index of N frames, ``time`` (N,) in s with the six decimals of TUM RGB-D, in the order given."""
    lines = ["# depth maps", "# timestamp filename", *(f"{stamp:.6f} {name}" for stamp, name in zip(time, files, strict=True))]
    Path(file).write_bytes(("\n".join(lines) + "\n").encode())


def read_intrinsics(file: Path, *, width: int, height: int) -> Intrinsics:
    """Intrinsics of a camera of ``width`` × ``height`` pixels from OpenCV's YAML: ``cameraMatrix`` (3 × 3), ``distortionCoefficients``.

    The calibration of iai_kinect2 has this form; it does not state the image's size. Raises RecordingError for a file that OpenCV cannot
    read, a camera matrix that is none, a number that is not finite and a principal point outside the image.
    """
    text = read_text(file)
    try:
        storage = cv2.FileStorage("\n".join(text.lines), cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        matrix, distortion = storage.getNode("cameraMatrix").mat(), storage.getNode("distortionCoefficients").mat()
        storage.release()
    except (cv2.error, SystemError):  # the constructor of FileStorage fails with the latter
        raise RecordingError("this is no calibration in OpenCV's YAML, or it is truncated; export it again", file=file) from None
    if matrix is None or matrix.shape != (3, 3):
        raise RecordingError("there is no 3 × 3 cameraMatrix; export the calibration again", file=file, key="cameraMatrix")
    if distortion is None:
        raise RecordingError("there are no distortionCoefficients; write zeros where there is no distortion", file=file)
    (fx, skew, cx), (low, fy, cy), bottom = matrix.tolist()
    if not np.isfinite(matrix).all() or fx <= 0 or fy <= 0 or (skew, low, *bottom) != (0, 0, 0, 0, 1):
        raise RecordingError("the cameraMatrix is not [fx 0 cx; 0 fy cy; 0 0 1]", file=file, key="cameraMatrix")
    if not np.isfinite(distortion).all():
        raise RecordingError("a coefficient is not finite", file=file, key="distortionCoefficients")
    if not (0 < cx < width and 0 < cy < height):
        raise RecordingError(f"the principal point {cx:.1f}, {cy:.1f} is outside {width} × {height} pixels", file=file, key="cameraMatrix")
    return Intrinsics(fx, fy, cx, cy, width, height, tuple(distortion.ravel().tolist()))


def write_intrinsics(file: Path, intrinsics: Intrinsics) -> None:
    """Write ``cameraMatrix`` and ``distortionCoefficients`` (zeros where there are none) as OpenCV's YAML; numbers read back exactly."""
    matrix = np.array([[intrinsics.fx, 0, intrinsics.cx], [0, intrinsics.fy, intrinsics.cy], [0, 0, 1]])
    storage = cv2.FileStorage("intrinsics.yaml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    storage.write("cameraMatrix", matrix)
    storage.write("distortionCoefficients", np.array([intrinsics.distortion or (0.0,) * 5]))
    # "%YAML:1.0" is how OpenCV 2 to 4 head the calibrations of depth cameras; version 5 writes another head, and reads both
    body = storage.releaseAndGetString().partition("\n")[2]
    Path(file).write_bytes(f"%YAML:1.0\n{body}".encode())
