"""Pictures of the page: figures as the files that lie beside it, and images of the player as
addresses with all their data.
"""

from __future__ import annotations

import io
from base64 import b64encode
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from pipeline.core.errors import ContractError


@dataclass(frozen=True)
class Picture:
    """A picture's ``file`` and its size in px."""

    file: Path
    width: int
    height: int


def picture(file: Path) -> Picture:
    """The PNG ``file``. Raises ContractError where it is missing."""
    if not file.is_file():
        raise ContractError("there is no such figure; run the stage that draws it", file=file)
    with Image.open(file) as image:
        return Picture(file, image.width, image.height)


def address(image: np.ndarray) -> str:
    """The address of an ``image``, colours (rows, columns, 3) of 8 bits: WebP without loss."""
    written = io.BytesIO()
    Image.fromarray(image).save(written, "WEBP", lossless=True, method=5, quality=100)
    return f"data:image/webp;base64,{b64encode(written.getvalue()).decode('ascii')}"
