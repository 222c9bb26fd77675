"""Decompression of LZF, as point clouds have it."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.formats.depth.lzf import decompress


def test_lzf_copies_what_was_written_before_and_reaches_into_the_copy():
    # "ab", then seven bytes from two back: a copy that overlaps itself
    assert decompress(bytes([1]) + b"ab" + bytes([5 << 5, 1]), 9) == b"ababababa"
    # the long form: the length goes on in the next byte
    assert decompress(bytes([0]) + b"x" + bytes([7 << 5, 91, 0]), 101) == b"x" * 101


@settings(max_examples=100, deadline=None)
@given(st.binary(max_size=60), st.integers(1, 400))
def test_lzf_never_writes_beyond_what_was_announced(packed, size):
    unpacked = decompress(packed, size)
    assert unpacked is None or len(unpacked) == size
