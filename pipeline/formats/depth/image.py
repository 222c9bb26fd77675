"""Depth images of any format, read as they are; what their values mean is :mod:`encoding`'s.

An image's header is read before its pixels, so a small file that unfolds into gigabytes is refused.
"""

from __future__ import annotations

import io
import struct
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, UnidentifiedImageError

from pipeline.core.bounds import MIB, read_whole, require
from pipeline.core.errors import RecordingError
from pipeline.formats import depth
from pipeline.formats.format import BYTES, Head, Kind, formats_in, recognised

# what Pillow raises for a header whose bytes are not what they should be
HEADER_DAMAGE = (
    OSError,
    EOFError,
    ValueError,
    SyntaxError,
    TypeError,
    LookupError,
    OverflowError,
    RuntimeError,
    struct.error,
)


PIXEL = 4  # bytes, the largest that is kept


@dataclass(frozen=True)
class RawDepth:
    """One image as the sensor's software wrote it: ``pixels`` (H, W) uint16 or float32 (to which
    float64 is rounded); a TIFF's ``description``, else ''.
    """

    pixels: np.ndarray
    description: str = ""


@dataclass(frozen=True)
class DepthImage:
    """An image whose header has been read: its ``shape`` (H, W), its ``description`` ('' where
    there is none), and what decodes its pixels, or raises RecordingError.
    """

    shape: tuple[int, int]
    decode: Callable[[], np.ndarray]
    description: str = ""


def read_depth(file: Path, *, shape: tuple[int, int]) -> RawDepth:
    """The image in ``file``, whose size must be ``shape`` = (H, W); RecordingError where it is
    missing, else as :func:`decode_depth`.
    """
    try:
        content = read_whole(file)
    except OSError as error:
        raise RecordingError(
            f"the depth frame cannot be read ({error.strerror}); copy it again, or take its line "
            "out of the index",
            file=file,
        ) from None
    return decode_depth(content, shape=shape, file=file)


def decode_depth(content: bytes, *, shape: tuple[int, int], file: Path) -> RawDepth:
    """The image in the ``content`` of ``file``, whose size must be ``shape`` = (H, W).

    Raises RecordingError for content that is truncated or of none of the formats, and for pixels
    that are not one channel of 16 bits or of floating point.
    """
    image = _opened(content, file)
    if image.shape != tuple(shape):
        stated, wanted = (f"{width} × {height}" for height, width in (image.shape, shape))
        raise RecordingError(
            f"the image has {stated} pixels where the camera has {wanted}; check the intrinsics",
            file=file,
        )
    pixels = image.decode()
    if pixels.dtype == np.float64:
        with np.errstate(over="ignore"):  # beyond float32 there is no depth
            pixels = pixels.astype(np.float32)
    if pixels.ndim != 2 or pixels.dtype not in (np.uint16, np.float32):
        channels = 1 if pixels.ndim == 2 else pixels.shape[2]
        kind = {"u": "", "i": "signed "}.get(pixels.dtype.kind, "floating-point ")
        raise no_depth(channels, f"{kind}channel(s) of {8 * pixels.itemsize} bits", file)
    return RawDepth(pixels, image.description)


def depth_size(content: bytes, *, file: Path) -> tuple[int, int]:
    """(H, W) that the image in the ``content`` of ``file`` announces; RecordingError where it is no
    image, or cut.
    """
    return _opened(content, file).shape


def _opened(content: bytes, file: Path) -> DepthImage:
    chosen = recognised(Head(Path(file), content[:BYTES]), formats_in(depth, Kind.IMAGE))
    if chosen is None:
        raise no_image(file)
    image = chosen.read(content, file=file)
    height, width = image.shape
    require("part_mib", height * width * PIXEL / MIB, "MiB of pixels", file)
    return image


def header_by_pillow(content: bytes, form: str, file: Path) -> Image.Image:
    """The image in ``content`` of Pillow's format ``form`` (PNG, TIFF, PPM), its pixels not yet
    decoded.

    Raises RecordingError for a damaged header and a file of several images, and
    UnidentifiedImageError for a kind of image that Pillow does not know.
    """
    try:
        with warnings.catch_warnings():
            # damage shows when the pixels are decoded; the size is held against the camera, a
            # closer limit than the library has
            warnings.simplefilter("ignore")
            image = Image.open(io.BytesIO(content), formats=(form,))
            if (images := getattr(image, "n_frames", 1)) > 1:
                raise RecordingError(
                    f"the file holds {images} images; write one depth frame to a file", file=file
                )
            return image
    except Image.DecompressionBombError as error:
        raise RecordingError(
            f"the image is larger than any depth camera's ({error})", file=file
        ) from None
    except UnidentifiedImageError:
        raise
    except HEADER_DAMAGE:
        raise damaged_header(file) from None


def damaged(file: Path, reason: str = "") -> RecordingError:
    """The refusal of an image that is not whole, for the ``reason`` where one is known."""
    why = f" ({reason})" if reason else ""
    return RecordingError(
        f"the depth frame is truncated or damaged{why}; copy it again, or take its line out of the "
        "index",
        file=file,
    )


def damaged_header(file: Path) -> RecordingError:
    """The refusal of an image whose header cannot be read."""
    return RecordingError(
        "the header of the depth frame is truncated or damaged; copy it again", file=file
    )


def no_image(file: Path) -> RecordingError:
    """The refusal of what is none of the formats."""
    return RecordingError(
        "the depth frame is no PNG, TIFF or PGM image of 16 or 32 bits; convert it to 16-bit PNG",
        file=file,
    )


def no_depth(channels: int, kind: str, file: Path) -> RecordingError:
    """The refusal of an image whose pixels are no depth."""
    return RecordingError(
        f"the image has {channels} {kind}; depth is one of 16 bits or of floating point", file=file
    )
