"""Compressed parts of ROS bags, unfolded up to a bound, and what damage raises.

rosbags unfolds a chunk of any size, by the functions in two tables: importing this module replaces
them.
"""

from __future__ import annotations

import struct
from bz2 import BZ2Decompressor
from collections.abc import Callable

import apsw
from backports.zstd import ZstdDecompressor, ZstdError
from lz4.frame import LZ4FrameDecompressor
from rosbags.highlevel import AnyReaderError
from rosbags.rosbag1 import ReaderError as BagError
from rosbags.rosbag1.reader import decompressors
from rosbags.rosbag2 import ReaderError as FolderError
from rosbags.rosbag2.storage_mcap import DECOMPRESSORS
from rosbags.typesys import TypesysError

from pipeline.core.bounds import MIB, bounds

# what rosbags and the storages under it raise for bytes that are not what they should be
DAMAGE = (
    AnyReaderError,
    BagError,
    FolderError,
    TypesysError,
    ZstdError,
    apsw.Error,
    struct.error,
    OSError,
    EOFError,
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    AssertionError,
    RuntimeError,
    MemoryError,
    OverflowError,
)


def _bounded(decompressor: Callable) -> Callable[..., bytes]:
    """What unfolds one compressed part of a bag, whatever size is announced; ValueError where it is
    cut or larger than the bound of a part.
    """

    def unfold(content: bytes, *_: object) -> bytes:
        stream = decompressor()
        most = bounds().part_mib  # recorders fill chunks of some MB
        unfolded = stream.decompress(content, most * MIB)
        if not stream.eof:
            raise ValueError(
                f"a compressed part is cut, or unfolds into more than {most} MiB, the bound "
                "dataset.reading.part_mib"
            )
        return unfolded

    return unfold


decompressors |= {"bz2": _bounded(BZ2Decompressor), "lz4": _bounded(LZ4FrameDecompressor)}
DECOMPRESSORS |= {"lz4": _bounded(LZ4FrameDecompressor), "zstd": _bounded(ZstdDecompressor)}
unfold_message = _bounded(ZstdDecompressor)
