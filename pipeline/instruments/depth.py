"""Depth images: 16-bit or floating-point PNG, TIFF and PGM, read as they are; what their values mean is :mod:`depth_encoding`'s."""

from __future__ import annotations

import io
import struct
import warnings
import zlib
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, UnidentifiedImageError
from PIL.TiffImagePlugin import ImageFileDirectory_v2

from pipeline.errors import RecordingError

# what Pillow raises for a header whose bytes are not what they should be
HEADER_DAMAGE = (OSError, EOFError, ValueError, SyntaxError, TypeError, LookupError, OverflowError, RuntimeError, struct.error)
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
TIFF_SIGNATURES = (b"II*\0", b"MM\0*")
IMAGE_WIDTH, IMAGE_LENGTH, IMAGE_DESCRIPTION = 256, 257, 270  # TIFF 6.0, section 8
# run lengths on the filtered rows: on noisy 512 x 424 depth 250 kB in 6 ms, where level 6 takes 31 ms for 1 % less
PNG_PARAMETERS = (cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE)


@dataclass(frozen=True)
class RawDepth:
    """One image as the sensor's software wrote it: ``pixels`` (H, W) uint16 or float32 (to which float64 is rounded); a TIFF's
    ``description``, else ''."""

    pixels: np.ndarray
    description: str = ""


def read_depth(file: Path, *, shape: tuple[int, int]) -> RawDepth:
    """The image in ``file``, whose size must be ``shape`` = (H, W); RecordingError where it is missing, else as :func:`decode_depth`."""
    try:
        content = Path(file).read_bytes()
    except OSError as error:
        raise RecordingError(
            f"the depth frame cannot be read ({error.strerror}); copy it again, or take its line out of the index", file=file
        ) from None
    return decode_depth(content, shape=shape, file=file)


def decode_depth(content: bytes, *, shape: tuple[int, int], file: Path) -> RawDepth:
    """The image in the ``content`` of ``file``, whose size must be ``shape`` = (H, W).

    Its header is held against ``shape`` before a pixel is decoded, so a small file that unfolds into gigabytes is refused. Raises
    RecordingError for content that is truncated or no PNG, TIFF or PGM, and for pixels that are not one channel of 16 bits or of
    floating point.
    """
    size, description = _header(content, file)
    if size != tuple(shape):
        found, wanted = (f"{width} × {height}" for height, width in (size, shape))
        raise RecordingError(f"the image has {found} pixels where the camera has {wanted}; check the intrinsics", file=file)
    try:
        # unchanged, because every other mode hands 16 bits back as 8
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    if image is None:
        raise RecordingError("the depth frame is truncated or damaged; copy it again, or take its line out of the index", file=file)
    if image.dtype == np.float64:
        with np.errstate(over="ignore"):  # beyond float32 there is no depth
            image = image.astype(np.float32)
    check_depth(image, file=file)
    return RawDepth(image, description)


def depth_size(content: bytes, *, file: Path) -> tuple[int, int]:
    """(H, W) that the image in the ``content`` of ``file`` announces; RecordingError where it is no image, or cut."""
    return _header(content, file)[0]


def check_depth(image: np.ndarray, **evidence: object) -> None:
    """Raises RecordingError (with ``evidence``) for an image that is not one channel of 16 bits or of floating point."""
    if image.ndim != 2 or image.dtype not in (np.uint16, np.float32):
        channels = 1 if image.ndim == 2 else image.shape[2]
        kind = {"u": "", "i": "signed "}.get(image.dtype.kind, "floating-point ")
        raise RecordingError(
            f"the image has {channels} {kind}channel(s) of {8 * image.itemsize} bits; depth is one of 16 bits or of floating point",
            **evidence,
        )


def _whole_png(content: bytes) -> bool:
    """Whether the chunks that a PNG announces lie in it undamaged, to its end; OpenCV takes memory for whatever length they state."""
    place, name = len(PNG_SIGNATURE), b""
    while name != b"IEND" and place + 12 <= len(content):
        length, name = struct.unpack_from(">I4s", content, place)
        end = place + 8 + length
        if content[end : end + 4] != zlib.crc32(content[place + 4 : end]).to_bytes(4):
            return False
        place = end + 4
    return name == b"IEND"


def _header(content: bytes, file: Path) -> tuple[tuple[int, int], str]:
    """(H, W) and the TIFF's description ('' where there is none), without decoding a pixel."""
    if content.startswith(PNG_SIGNATURE) and not _whole_png(content):
        raise RecordingError("the depth frame is truncated or damaged; copy it again, or take its line out of the index", file=file)
    try:
        with warnings.catch_warnings():
            # damage shows when the pixels are decoded; the size is held against the camera, a closer limit than the library has
            warnings.simplefilter("ignore")
            with Image.open(io.BytesIO(content), formats=("PNG", "TIFF", "PPM")) as image:
                if getattr(image, "n_frames", 1) > 1:
                    raise RecordingError(f"the file holds {image.n_frames} images; write one depth frame to a file", file=file)
                return (image.height, image.width), str(getattr(image, "tag_v2", {}).get(IMAGE_DESCRIPTION, ""))
    except Image.DecompressionBombError as error:
        raise RecordingError(f"the image is larger than any depth camera's ({error})", file=file) from None
    except UnidentifiedImageError:
        if content.startswith(TIFF_SIGNATURES):
            return _tiff_header(content, file)
        raise RecordingError("the depth frame is no PNG, TIFF or PGM image of 16 or 32 bits; convert it to 16-bit PNG", file=file) from None
    except HEADER_DAMAGE:
        raise RecordingError("the header of the depth frame is truncated or damaged; copy it again", file=file) from None


def _tiff_header(content: bytes, file: Path) -> tuple[tuple[int, int], str]:
    """(H, W) and description of a TIFF by its tags alone: of pixels that Pillow does not know, such as float64."""
    stream = io.BytesIO(content)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            tags = ImageFileDirectory_v2(stream.read(8))
            stream.seek(tags.next)
            tags.load(stream)
        size, several = (int(tags[IMAGE_LENGTH]), int(tags[IMAGE_WIDTH])), bool(tags.next)
    except HEADER_DAMAGE:
        raise RecordingError("the header of the depth frame is truncated or damaged; copy it again", file=file) from None
    if several:
        raise RecordingError("the file holds several images; write one depth frame to a file", file=file)
    return size, str(tags.get(IMAGE_DESCRIPTION, ""))


def encode_depth(raw: np.ndarray) -> bytes:
    """(H, W) uint16 ``raw`` depth as PNG, without loss; the same frame gives the same bytes."""
    if raw.ndim != 2 or raw.dtype != np.uint16:
        raise TypeError(f"raw depth is (H, W) uint16, not {raw.shape} {raw.dtype}")
    return cv2.imencode(".png", raw, PNG_PARAMETERS)[1].tobytes()


def write_depth(file: Path, raw: np.ndarray) -> None:
    """Write (H, W) uint16 ``raw`` depth as PNG; see :func:`encode_depth`."""
    Path(file).write_bytes(encode_depth(raw))
