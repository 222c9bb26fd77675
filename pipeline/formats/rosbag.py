"""ROS 1 and ROS 2 bags: their topics, and the messages of one of them, one at a time."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import apsw
from backports.zstd import ZstdError
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.interfaces import Connection
from rosbags.rosbag1 import ReaderError as BagError
from rosbags.rosbag2 import ReaderError as FolderError
from rosbags.typesys import Stores, TypesysError, get_typestore

from pipeline.core.bounds import read_whole
from pipeline.core.errors import RecordingError
from pipeline.formats.bag_path import SUFFIXES
from pipeline.formats.format import Format, Head, Kind

MARKS = (b"#ROSBAG V", b"\x89MCAP0")
# what rosbags and the storages under it raise for bytes that are not what they should be
DAMAGE = (AnyReaderError, BagError, FolderError, TypesysError, ZstdError, apsw.Error, struct.error)
DAMAGE += (OSError, EOFError, ValueError, LookupError, TypeError, AttributeError, AssertionError)
DAMAGE += (RuntimeError, MemoryError, OverflowError)


def topics(file: Path) -> dict[str, str]:
    """Topic → type (``sensor_msgs/msg/Image``, of both ROS versions) of what the bag ``file`` holds
    at least one message of.

    Raises RecordingError as :func:`messages` does.
    """
    with _opened(file) as reader:
        return {
            connection.topic: connection.msgtype
            for connection in reader.connections
            if connection.msgcount
        }


@dataclass(frozen=True)
class Summary:
    """What a bag's index says: the version of ROS, the time from the first to the last message (s),
    topic → type and messages.
    """

    version: str
    duration: float
    topics: dict[str, tuple[str, int]]


def summary(file: Path) -> Summary:
    """The index of the bag ``file``, no message being read; RecordingError as :func:`messages`
    does.
    """
    with _opened(file) as reader:
        held = {connection.topic: (connection.msgtype, 0) for connection in reader.connections}
        for connection in reader.connections:
            held[connection.topic] = (
                connection.msgtype,
                held[connection.topic][1] + connection.msgcount,
            )
        return Summary(
            "2" if reader.is2 else "1",
            reader.duration * 1e-9 if any(n for _, n in held.values()) else 0.0,
            held,
        )


def choose_topic(file: Path, kinds: tuple[str, ...], topic: str | None = None) -> str:
    """The ``topic``, or the only one in the bag of one of the ``kinds`` of messages
    (``sensor_msgs/msg/Image``).

    Raises RecordingError naming the topics where there is none, or more than one and none is
    chosen.
    """
    held = topics(file)
    fitting = [name for name, kind in held.items() if kind in kinds]
    wanted = " or ".join(kind.rpartition("/")[2] for kind in kinds)
    if topic is not None:
        if topic not in fitting:
            raise RecordingError(
                f"no topic {topic!r} of {wanted}; there are {_named(held)}", file=file, topic=topic
            )
        return topic
    if len(fitting) != 1:
        problem = (
            f"{len(fitting)} topics of {wanted}, choose one by option"
            if fitting
            else f"no topic of {wanted}"
        )
        raise RecordingError(f"{problem}; there are {_named(held)}", file=file)
    return fitting[0]


def messages(file: Path, topic: str) -> Iterator[object]:
    """The messages of ``topic`` in the bag ``file`` in the order of their recording; memory holds
    one (and its compressed chunk).

    A message has the attributes of its ROS definition; ``seconds(message)`` is its time. Raises
    RecordingError for a bag that is missing, truncated, damaged or unindexed, and for fewer
    messages than it announces. Chunks, messages and files that are compressed (bz2, lz4, zstd) are
    read as others; :mod:`pipeline.core.bounds` bounds the time and memory it takes.
    """
    with _opened(file) as reader:
        connections = [connection for connection in reader.connections if connection.topic == topic]
        if not connections:
            raise RecordingError(
                f"no topic {topic!r}; there are "
                f"{_named({c.topic: c.msgtype for c in reader.connections})}",
                file=file,
            )
        count = 0
        for message in _deserialised(reader, connections, file):
            yield message
            count += 1
        announced = sum(connection.msgcount for connection in connections)
        if count != announced:
            raise RecordingError(
                f"{count} messages where the bag announces {announced}: truncated or damaged",
                file=file,
                topic=topic,
            )


def seconds(message: object, **evidence: object) -> float:
    """Time in s of the ``header`` of a message, to a quarter of a microsecond; RecordingError where
    it has none or was never set.
    """
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None or (stamp.sec, stamp.nanosec) == (0, 0):
        raise RecordingError(
            "the message has no time in its header; record with a driver that stamps its messages",
            **evidence,
        )
    return stamp.sec + stamp.nanosec * 1e-9


def _deserialised(reader: AnyReader, connections: list[Connection], file: Path) -> Iterator[object]:
    number, stream = 0, reader.messages(connections)
    while True:
        try:
            connection, _, raw = next(stream)
            message = reader.deserialize(raw, connection.msgtype)
        except StopIteration:
            return
        except DAMAGE as error:
            raise _damaged(error, file, number=number, topic=connections[0].topic) from None
        yield message
        number += 1


@contextmanager
def _opened(file: Path) -> Iterator[AnyReader]:
    file = Path(file)
    metadata = file / "metadata.yaml"
    try:
        if metadata.is_file():
            read_whole(metadata)  # refused beyond the bounds
        # SQLite may fill up what a file lacks
        if cut := [each.name for each in file.glob("*.db3") if _is_cut(each)]:
            raise ValueError(f"{', '.join(cut)} is cut short")
        reader = AnyReader([file], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
        reader.open()
        if any(connection.msgcount is None for connection in reader.connections):
            raise ValueError("it does not say how many messages it holds")
    except DAMAGE as error:
        raise _damaged(error, file) from None
    try:
        yield reader
    finally:
        reader.close()


def _is_cut(database: Path) -> bool:
    """Whether an SQLite database is shorter than the pages that its header counts."""
    with database.open("rb") as stream:
        head = stream.read(32)
    size, pages = int.from_bytes(head[16:18]), int.from_bytes(head[28:32])
    return database.stat().st_size < pages * (1 << 16 if size == 1 else size)


def _damaged(error: BaseException, file: Path, **evidence: object) -> RecordingError:
    said = " ".join(str(error).split()) or type(error).__name__
    return RecordingError(
        f"the bag cannot be read ({said[:200]}); copy it again, or run `rosbag reindex` on it",
        file=file,
        **evidence,
    )


def _named(held: dict[str, str]) -> str:
    return (
        ", ".join(f"{topic} ({kind.rpartition('/')[2]})" for topic, kind in sorted(held.items()))
        or "none"
    )


def _begins(head: Head) -> bool:
    return head.content.startswith(MARKS) or head.suffix in SUFFIXES


FORMAT = Format("ROS bag", Kind.BAG, summary, _begins)
