"""Depth images as TIFF of 16 bits or floating point, and what their description says."""

from __future__ import annotations

import io
import warnings
from pathlib import Path

from PIL import UnidentifiedImageError
from PIL.TiffImagePlugin import ImageFileDirectory_v2

from pipeline.core.errors import RecordingError
from pipeline.formats.depth.image import (
    HEADER_DAMAGE,
    DepthImage,
    damaged_header,
    header_by_pillow,
)
from pipeline.formats.depth.opencv import decoder
from pipeline.formats.format import Format, Kind, begins

IMAGE_WIDTH, IMAGE_LENGTH, IMAGE_DESCRIPTION = 256, 257, 270  # TIFF 6.0, section 8


def open_tiff(content: bytes, *, file: Path) -> DepthImage:
    """The TIFF in the ``content`` of ``file``; RecordingError where its header is damaged or it
    holds several images.
    """
    try:
        image = header_by_pillow(content, "TIFF", file)
        shape, tags = (image.height, image.width), image.tag_v2
    except UnidentifiedImageError:
        shape, tags = _header(content, file)
    return DepthImage(shape, decoder(content, file), str(tags.get(IMAGE_DESCRIPTION, "")))


def _header(content: bytes, file: Path) -> tuple[tuple[int, int], ImageFileDirectory_v2]:
    """(H, W) and the tags alone: of pixels that Pillow does not know, such as float64."""
    stream = io.BytesIO(content)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            tags = ImageFileDirectory_v2(stream.read(8))
            stream.seek(tags.next)
            tags.load(stream)
        shape, several = (int(tags[IMAGE_LENGTH]), int(tags[IMAGE_WIDTH])), bool(tags.next)
    except HEADER_DAMAGE:
        raise damaged_header(file) from None
    if several:
        raise RecordingError(
            "the file holds several images; write one depth frame to a file", file=file
        )
    return shape, tags


FORMAT = Format(
    "depth image", Kind.IMAGE, open_tiff, begins(b"II*\0", b"MM\0*"), endings=(".tif", ".tiff")
)
