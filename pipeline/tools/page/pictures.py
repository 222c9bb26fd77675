"""Pictures that stand in the page itself: WebP without loss, as addresses with all their data."""

from __future__ import annotations

import io
from base64 import b64encode
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from pipeline.core.errors import ContractError

COLOURS = 8  # of a figure: lines and letters look the same, at a seventh of the bytes


@dataclass(frozen=True)
class Picture:
    """A picture's ``address`` with all its data, its size in px, and its ``file``."""

    address: str
    width: int
    height: int
    file: Path


def picture(file: Path) -> Picture:
    """The PNG ``file`` in at most ``COLOURS`` colours. Raises ContractError where it is missing."""
    if not file.is_file():
        raise ContractError("there is no such figure; run the stage that draws it", file=file)
    with Image.open(file) as image:
        few = image.convert("RGB").quantize(
            COLOURS, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE
        )
    return Picture(address(few.convert("RGB")), few.width, few.height, file)


def address(image: Image.Image | np.ndarray) -> str:
    """The address of an ``image``, colours (rows, columns, 3) of 8 bits where it is an array."""
    written = io.BytesIO()
    image = Image.fromarray(image) if isinstance(image, np.ndarray) else image
    image.save(written, "WEBP", lossless=True, method=5, quality=100)
    return f"data:image/webp;base64,{b64encode(written.getvalue()).decode('ascii')}"
