"""Depth images as PGM of 16 bits."""

from __future__ import annotations

from pathlib import Path

from PIL import UnidentifiedImageError

from pipeline.formats.depth.image import DepthImage, header_by_pillow, no_image
from pipeline.formats.depth.opencv import decoder
from pipeline.formats.format import Format, Kind, begins


def open_pgm(content: bytes, *, file: Path) -> DepthImage:
    """The PGM in the ``content`` of ``file``; RecordingError where its header is damaged."""
    try:
        image = header_by_pillow(content, "PPM", file)
    except UnidentifiedImageError:
        raise no_image(file) from None
    # Pillow would scale values whose greatest is not 65535
    return DepthImage((image.height, image.width), decoder(content, file))


FORMAT = Format("depth image", Kind.IMAGE, open_pgm, begins(b"P5"), endings=(".pgm",))
