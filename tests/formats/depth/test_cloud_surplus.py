"""What a cloud holds beyond the points that its header announces is refused with its size."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from pipeline.core.errors import RecordingError
from pipeline.formats.depth.cloud import read_cloud

HEADER = (
    "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 1\nHEIGHT 1\n"
    "POINTS 1\nDATA {}\n"
)
BINARY = np.array([1, 2, 3], "<f4").tobytes()
PACKED = struct.pack("<IIB", 13, 12, 11) + BINARY  # one literal run of LZF
FILES = {"ascii": b"1 2 3\n", "binary": BINARY, "binary_compressed": PACKED}


@pytest.mark.parametrize("form", FILES)
def test_what_follows_the_announced_points_is_refused_with_its_size(tmp_path, form):
    file, content = tmp_path / "c.pcd", HEADER.format(form).encode() + FILES[form]
    file.write_bytes(content)
    assert read_cloud(file).points.tolist() == [[1, 2, 3]]
    file.write_bytes(content + (b"4 5 6\n" if form == "ascii" else b"\1" * 7))
    with pytest.raises(RecordingError) as refused:
        read_cloud(file)
    words = "2 rows where the header announces 1" if form == "ascii" else "7 bytes follow"
    assert words in refused.value.message and refused.value.evidence["file"] == file


def test_zeros_behind_a_compressed_cloud_are_pcls_own(tmp_path):
    file = tmp_path / "c.pcd"
    file.write_bytes(HEADER.format("binary_compressed").encode() + PACKED + bytes(100))
    assert read_cloud(file).points.tolist() == [[1, 2, 3]]
