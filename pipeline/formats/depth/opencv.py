"""Pixels of an image by OpenCV, which keeps every type as it is.

Its libraries write what they find wrong with an image to the standard error of the process, by its
number: there it would stand among the messages of a stage, so it is caught and told in the refusal.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from pipeline.formats.depth.image import damaged

STDERR = 2
# what stands before the words: "libpng error: ", "[ERROR:0@1.1] global grfmt_tiff.cpp:117 Error "
PREFIX = re.compile(r"libpng error: |\[.*?\] global \S+ \S+ ")


def decoder(content: bytes, file: Path) -> Callable[[], np.ndarray]:
    """What decodes the image in ``content`` of ``file``, or raises RecordingError with the reason
    that the library has.
    """

    def decode() -> np.ndarray:
        with _caught() as complaints:
            try:
                # unchanged, because every other mode hands 16 bits back as 8
                pixels = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
            except cv2.error:
                pixels = None
        if pixels is None:
            raise damaged(file, complaints[0] if complaints else "")
        return pixels

    return decode


@contextmanager
def _caught() -> Iterator[list[str]]:
    """The lines that the process writes to standard error meanwhile, without their prefix; they are
    there at the end. Not for several threads at once.
    """
    lines: list[str] = []
    before, catcher = os.dup(STDERR), os.memfd_create("stderr")
    os.dup2(catcher, STDERR)
    try:
        yield lines
    finally:
        os.dup2(before, STDERR)
        os.close(before)
        with os.fdopen(catcher, "rb") as stream:
            stream.seek(0)
            text = stream.read().decode(errors="replace")
        # OpenCV's own words hold the place of its source on the machine that built it
        lines += [
            PREFIX.sub("", line, count=1)[:200]
            for line in text.splitlines()
            if line and "OpenCV" not in line
        ]
