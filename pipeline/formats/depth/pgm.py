"""Depth images as PGM of 16 bits.

Decoders fill up what a file lacks and pass over what it has beyond its pixels, so that the bytes
are counted.
"""

from __future__ import annotations

import re
from pathlib import Path

from PIL import UnidentifiedImageError

from pipeline.formats.depth.image import (
    DepthImage,
    damaged,
    damaged_header,
    header_by_pillow,
    no_image,
)
from pipeline.formats.depth.opencv import decoder
from pipeline.formats.format import Format, Kind, begins

GAP = rb"(?:\s|#[^\n\r]*[\n\r])+"  # blanks and comments
# P5, width, height and greatest value, one blank, the pixels
HEADER = re.compile(rb"P5" + GAP + rb"\d+" + GAP + rb"\d+" + GAP + rb"(\d{1,5})\s")


def open_pgm(content: bytes, *, file: Path) -> DepthImage:
    """The PGM in the ``content`` of ``file``; RecordingError where its header is damaged, or it
    holds other than the pixels that the header announces.
    """
    try:
        image = header_by_pillow(content, "PPM", file)
    except UnidentifiedImageError:
        raise no_image(file) from None
    header = HEADER.match(content)
    if header is None:
        raise damaged_header(file)
    size = image.width * image.height * (1 if int(header[1]) < 256 else 2)
    if surplus := len(content) - header.end() - size:
        what = f"{abs(surplus)} bytes {'lack' if surplus < 0 else 'are left'}"
        raise damaged(file, f"{what} of the {size} of {image.width} × {image.height} pixels")
    # Pillow would scale values whose greatest is not 65535
    return DepthImage((image.height, image.width), decoder(content, file))


FORMAT = Format("depth image", Kind.IMAGE, open_pgm, begins(b"P5"), endings=(".pgm",))
