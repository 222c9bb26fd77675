"""What happens to the frames of a depth camera: images are lost, damaged, frozen or mis-scaled, and
its clock runs as it likes.

Damage to the images keeps the container whole, with check sums as they should be, where a checksum
would give it away too easily.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pipeline.formats.depth.image import PNG, decode_depth, encode_depth
from pipeline.studies.faults.fault import Files, chosen
from pipeline.studies.faults.text import lines_of

FRAMES = "*.png"


def lost_files(files: Files, number: float, rng: np.random.Generator) -> Files:
    """``number`` frames that the index names are not there."""
    lost = chosen(files, FRAMES, number, rng)
    return {name: content for name, content in files.items() if name not in lost}


def frozen_camera(files: Files, number: float, rng: np.random.Generator) -> Files:
    """``number`` frames in a row are the image before them, while their times go on."""
    names = sorted(chosen(files, FRAMES, len(files), rng))
    first = int(rng.integers(max(1, len(names) - int(number))))
    return {
        **files,
        **dict.fromkeys(names[first + 1 : first + 1 + int(number)], files[names[first]]),
    }


def lost_pixels(files: Files, share: float, rng: np.random.Generator) -> Files:
    """A ``share`` of the pixels of every frame, each on its own, has no depth."""
    return _pixelwise(files, lambda image: np.where(rng.random(image.shape) < share, 0, image))


def other_unit(files: Files, factor: float, rng: np.random.Generator) -> Files:
    """Every stored depth times ``factor``: 5 of 5000 units a metre for millimetres; beyond 16 bits
    there is no depth.
    """
    return _pixelwise(files, lambda image: np.where(image * factor < 2**16, image * factor, 0))


def _pixelwise(files: Files, change: Callable[[np.ndarray], np.ndarray]) -> Files:
    names = [name for name in files if name.endswith(".png")]
    images = (
        decode_depth(files[name], shape=_shape(files[name]), file=Path(name)).pixels
        for name in names
    )
    return {
        **files,
        **{
            name: encode_depth(change(image).astype(np.uint16))
            for name, image in zip(names, images, strict=True)
        },
    }


def flipped_bits(content: bytes, number: float, rng: np.random.Generator) -> bytes:
    """``number`` bits are another: a failing memory or cable."""
    damaged = bytearray(content)
    for place in rng.integers(len(content), size=int(number)):
        damaged[place] ^= 1 << int(rng.integers(8))
    return bytes(damaged)


def shortened_pixels(content: bytes, share: float, rng: np.random.Generator) -> bytes:
    """The last ``share`` of the rows of an image is not in it, though the header announces them."""
    kinds = _chunks(content)
    rows = zlib.decompress(b"".join(data for kind, data in kinds if kind == b"IDAT"))
    return _png(
        [kinds[0], (b"IDAT", zlib.compress(rows[: int(len(rows) * (1 - share))])), (b"IEND", b"")]
    )


def other_size(content: bytes, rows: float, rng: np.random.Generator) -> bytes:
    """The header announces that many rows more than there are."""
    (kind, header), *others = _chunks(content)
    width, height = struct.unpack_from(">II", header)
    return _png([(kind, struct.pack(">II", width, height + int(rows)) + header[8:]), *others])


def image_bomb(content: bytes, megabytes: float, rng: np.random.Generator) -> bytes:
    """An image of that many megabytes of zeros, which a thousandth of them holds."""
    side = int(np.sqrt(megabytes * 1e6 / 2))
    rows = zlib.compress(bytes(side * (1 + 2 * side)))
    return _png(
        [
            (b"IHDR", struct.pack(">IIBBBBB", side, side, 16, 0, 0, 0, 0)),
            (b"IDAT", rows),
            (b"IEND", b""),
        ]
    )


def text_bomb(content: bytes, megabytes: float, rng: np.random.Generator) -> bytes:
    """A comment in the image unfolds into that many megabytes."""
    first, *others = _chunks(content)
    return _png(
        [first, (b"zTXt", b"Comment\0\0" + zlib.compress(bytes(int(megabytes * 1e6)))), *others]
    )


def drifting_clock(content: bytes, share: float, rng: np.random.Generator) -> bytes:
    """The times of an index run faster by that share."""
    return _retimed(content, lambda time: time * (1 + share))


def other_clock(content: bytes, seconds: float, rng: np.random.Generator) -> bytes:
    """The times of an index are later by ``seconds``."""
    return _retimed(content, lambda time: time + seconds)


def jumping_clock(content: bytes, seconds: float, rng: np.random.Generator) -> bytes:
    """From a random frame on the times of an index are later by ``seconds``."""
    _, rows = lines_of(content)
    jump = int(rng.integers(len(rows) // 4, 3 * len(rows) // 4))
    shifts = iter(np.where(np.arange(len(rows)) < jump, 0.0, seconds))
    return _retimed(content, lambda time: time + next(shifts))


def _retimed(content: bytes, change: Callable[[float], float]) -> bytes:
    lines, rows = lines_of(content)
    for i in rows:
        stamp, rest = lines[i].split(b" ", 1)
        lines[i] = b"%.6f %s" % (change(float(stamp)), rest)
    return b"".join(lines)


def _shape(content: bytes) -> tuple[int, int]:
    width, height = struct.unpack_from(">II", content, len(PNG) + 8)
    return height, width


def _chunks(content: bytes) -> list[tuple[bytes, bytes]]:
    """Name and data of each chunk of a whole PNG."""
    place, chunks = len(PNG), []
    while place < len(content):
        length, kind = struct.unpack_from(">I4s", content, place)
        chunks.append((kind, content[place + 8 : place + 8 + length]))
        place += 12 + length
    return chunks


def _png(chunks: list[tuple[bytes, bytes]]) -> bytes:
    packed = (
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )
    return PNG + b"".join(packed)
