"""LZF decompression (M. Lehmann's liblzf format), of which compressed PCDs are made."""

from __future__ import annotations

import numpy as np

from pipeline.core.compiled import compiled


def decompress(packed: bytes, size: int) -> bytes | None:
    """The ``size`` bytes that ``packed`` unfolds to, or None where it is damaged: it never writes
    or reads beyond them.
    """
    unpacked = np.empty(size, np.uint8)
    return unpacked.tobytes() if _unfold(np.frombuffer(packed, np.uint8), unpacked) else None


@compiled
def _unfold(packed: np.ndarray, unpacked: np.ndarray) -> bool:
    """Fill ``unpacked`` from control bytes c: below 32, c + 1 literal bytes follow; else a copy of
    what was written ``distance`` before.
    """
    i = o = 0
    while i < len(packed):
        control = np.int64(packed[i])
        i += 1
        if control < 32:
            length = control + 1
            if i + length > len(packed) or o + length > len(unpacked):
                return False
            unpacked[o : o + length] = packed[i : i + length]
            i += length
            o += length
            continue
        length = (control >> 5) + 2
        if length == 9:  # the three bits of the length are full: the next byte adds to them
            if i >= len(packed):
                return False
            length += np.int64(packed[i])
            i += 1
        if i >= len(packed):
            return False
        distance = ((control & 31) << 8) + np.int64(packed[i]) + 1
        i += 1
        if distance > o or o + length > len(unpacked):
            return False
        for _ in range(length):  # byte by byte: a copy may reach into itself
            unpacked[o] = unpacked[o - distance]
            o += 1
    return o == len(unpacked)
