"""What a damaged PNG is refused for, and that no library says more of it on standard error."""

from __future__ import annotations

import io
import os
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.core.errors import RecordingError
from pipeline.formats.depth.image import decode_depth
from pipeline.formats.depth.png import PNG_SIGNATURE, encode_depth

IMAGE = np.arange(24 * 32, dtype=np.uint16).reshape(24, 32)
ROWS = b"".join(b"\0" + row.astype(">u2").tobytes() for row in IMAGE)


def png(data: bytes, *, bits: int = 16, colour: int = 0, extra: bytes = b"") -> bytes:
    """A PNG of 32 × 24 pixels whose check sums are right, whatever its compressed ``data``."""
    header = struct.pack(">IIBBBBB", 32, 24, bits, colour, 0, 0, 0)
    chunks = [(b"IHDR", header), (b"IDAT", data), *([(b"tEXt", extra)] if extra else [])]
    return PNG_SIGNATURE + b"".join(
        struct.pack(">I", len(content)) + name + content
        + struct.pack(">I", zlib.crc32(name + content))
        for name, content in (*chunks, (b"IEND", b""))
    )  # fmt: skip


def decoded(content: bytes) -> np.ndarray:
    return decode_depth(content, shape=(24, 32), file=Path("frame.png")).pixels


def test_a_whole_png_of_another_program_is_decoded():
    np.testing.assert_array_equal(decoded(png(zlib.compress(ROWS))), IMAGE)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (
            png(zlib.compress(ROWS[: len(ROWS) // 2])),
            r"truncated or damaged \(Not enough image data\)",
        ),
        (png(zlib.compress(ROWS)[:-30]), "truncated or damaged"),
        (png(b"no zlib at all"), r"truncated or damaged \(\w+"),
        (png(zlib.compress(b"\7" + ROWS[1:])), "truncated or damaged"),
        (png(b""), "truncated or damaged"),
        (encode_depth(IMAGE)[:-60], "truncated or damaged; copy it again"),
        (png(zlib.compress(ROWS), bits=8), r"1 channel\(s\) of 8 bits"),
        (png(zlib.compress(ROWS), colour=2), r"3 channel\(s\) of 16 bits"),
        (png(zlib.compress(ROWS), colour=9), "truncated or damaged"),
    ],
)
def test_a_damaged_png_is_refused_for_what_is_wrong_and_nothing_else_is_printed(
    capfd, content, words
):
    with pytest.raises(RecordingError, match=words):
        decoded(content)
    assert capfd.readouterr() == ("", "")


def test_a_damaged_tiff_prints_nothing_either(capfd):
    stream = io.BytesIO()
    Image.fromarray(IMAGE).save(stream, "TIFF", compression="tiff_lzw")
    content = bytearray(stream.getvalue())
    content[60:90] = b"\xff" * 30
    with pytest.raises(RecordingError, match=r"truncated or damaged \(\w+"):
        decode_depth(bytes(content), shape=(24, 32), file=Path("frame.tif"))
    assert capfd.readouterr() == ("", "")


def test_what_others_write_on_standard_error_is_not_lost(capfd):
    decoded(encode_depth(IMAGE))
    os.write(2, b"mine")
    assert capfd.readouterr().err == "mine"


def test_the_pixels_are_all_bits_of_every_value_whatever_its_neighbours():
    extremes = np.random.default_rng(1).choice([0, 1, 255, 256, 65534, 65535], (24, 32))
    np.testing.assert_array_equal(decoded(encode_depth(extremes.astype(np.uint16))), extremes)
