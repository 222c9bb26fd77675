"""Depth images as PNG of 16 bits.

Decoded by OpenCV: Pillow takes rows that are not there for zeros, if the rest is sound.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
from PIL import UnidentifiedImageError

from pipeline.formats.depth.image import (
    DepthImage,
    damaged,
    damaged_header,
    header_by_pillow,
    no_depth,
)
from pipeline.formats.depth.opencv import decoder
from pipeline.formats.format import Format, Kind, begins

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
CHANNELS = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}  # by the header's type of colour; a palette is of RGB
# Run lengths of each row's differences. Naming the filter halves the time: without it OpenCV tries
# them all, row by row. Depth of 512 × 424 pixels: 77 kB either way, 2.1 ms instead of 4.2; level 6
# takes 31 ms for 1 % less.
PARAMETERS = (
    *(cv2.IMWRITE_PNG_COMPRESSION, 1),
    *(cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE),
    *(cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_SUB),
)


def open_png(content: bytes, *, file: Path) -> DepthImage:
    """The PNG in the ``content`` of ``file``; RecordingError where it is damaged or cut."""
    if not _whole(content):
        raise damaged(file)
    try:
        image = header_by_pillow(content, "PNG", file)
    except UnidentifiedImageError:
        raise damaged_header(file) from None
    bits, colour = content[len(PNG_SIGNATURE) + 16 : len(PNG_SIGNATURE) + 18]
    if (bits, colour) == (16, 0):
        return DepthImage((image.height, image.width), decoder(content, file))

    def refuse() -> np.ndarray:
        raise no_depth(CHANNELS[colour], f"channel(s) of {max(bits, 8)} bits", file)

    return DepthImage((image.height, image.width), refuse)


def _whole(content: bytes) -> bool:
    """Whether the chunks that a PNG announces lie in it undamaged, to its end; a decoder takes
    memory for whatever length they state.
    """
    place, name = len(PNG_SIGNATURE), b""
    while name != b"IEND" and place + 12 <= len(content):
        length, name = struct.unpack_from(">I4s", content, place)
        end = place + 8 + length
        if content[end : end + 4] != zlib.crc32(content[place + 4 : end]).to_bytes(4):
            return False
        place = end + 4
    return name == b"IEND"


def encode_depth(raw: np.ndarray) -> bytes:
    """(H, W) uint16 ``raw`` depth as PNG, without loss; the same frame gives the same bytes."""
    if raw.ndim != 2 or raw.dtype != np.uint16:
        raise TypeError(f"raw depth is (H, W) uint16, not {raw.shape} {raw.dtype}")
    return cv2.imencode(".png", raw, PARAMETERS)[1].tobytes()


def write_depth(file: Path, raw: np.ndarray) -> None:
    """Write (H, W) uint16 ``raw`` depth as PNG; see :func:`encode_depth`."""
    Path(file).write_bytes(encode_depth(raw))


FORMAT = Format("depth image", Kind.IMAGE, open_png, begins(PNG_SIGNATURE), endings=(".png",))
