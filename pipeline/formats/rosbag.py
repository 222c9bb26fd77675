"""ROS 1 and ROS 2 bags: their topics, and the messages of one of them, one at a time, read in a
process of its own, since what is compressed (bz2, lz4, zstd) may unfold to any size.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from pipeline.core.bounds import Sandbox, read_whole
from pipeline.core.errors import RecordingError
from pipeline.formats.format import BAG_SUFFIXES, Format, Kind, advised, read_alone

MARKS = (b"#ROSBAG V", b"\x89MCAP0")
MEND = "copy it again, or run `rosbag reindex` on it"
_streams: list[Iterator] = []  # of the process that reads


@dataclass(frozen=True)
class Summary:
    """Index of a bag."""

    version: str  # of ROS
    duration: float  # s, from the first to the last message
    topics: dict[str, tuple[str, int]]  # topic → type and number of messages


def summary(file: Path) -> Summary:
    """Return the index of the bag ``file``; RecordingError as :func:`messages`."""
    return read_alone(_summary, Path(file), file=file, advice=MEND)


def _summary(file: Path) -> Summary:
    with _opened(file) as reader:
        held: Counter[tuple[str, str]] = Counter()
        for connection in reader.connections:
            held[connection.topic, connection.msgtype] += connection.msgcount
        duration = reader.duration * 1e-9 if held.total() else 0.0
        topics = {topic: (kind, number) for (topic, kind), number in held.items()}
        return Summary("2" if reader.is2 else "1", duration, topics)


def topics(file: Path) -> dict[str, str]:
    """Return topic → type (``sensor_msgs/msg/Image``, of both ROS versions) of the topics with a
    message in the bag ``file``; RecordingError as :func:`messages`.
    """
    return {topic: kind for topic, (kind, number) in summary(file).topics.items() if number}


def choose_topic(file: Path, kinds: tuple[str, ...], topic: str | None = None) -> str:
    """Return the ``topic``, or the only one in the bag of one of the ``kinds`` of messages
    (``sensor_msgs/msg/Image``); RecordingError with the topics where there is none, or several.
    """
    held = topics(file)
    fitting = [name for name, kind in held.items() if kind in kinds and topic in (None, name)]
    if len(fitting) == 1:
        return fitting[0]
    wanted = " or ".join(kind.rpartition("/")[2] for kind in kinds)
    message = f"{len(fitting)} topics of {wanted} {f'named {topic!r}' if topic else 'in the bag'}, "
    message += f"choose one by option; there are {_named(held)}"
    raise RecordingError(message, file=file, **({"topic": topic} if topic else {}))


def messages(
    file: Path, topic: str, pick: Callable[[Any], Any], numbers: Collection[int] | None = None
) -> Iterator[Any]:
    """Yield ``pick(message)`` (pickled, called in the process that reads) of the messages of
    ``topic`` in the bag ``file``, of all or those of the ``numbers``, in the order of their
    recording.

    Memory holds one message, which has the attributes of its ROS definition. Raises RecordingError
    for a bag that is missing, truncated, damaged or unindexed, for fewer messages than it
    announces, and, with the message's number from 0, as ``pick`` does.
    """
    where = {"file": file, "topic": topic}
    with Sandbox() as sandbox:
        with advised(MEND, **where, number=0):
            held = sandbox.call(_start, Path(file), topic)
        for number in range(held):
            wanted = numbers is None or number in numbers
            with advised(MEND, **where, number=number):
                picked = sandbox.call(_next, pick if wanted else None)
            if wanted:
                yield picked


def _start(file: Path, topic: str) -> int:
    _streams[:] = [_stream(file, topic)]
    return next(_streams[0])


def _next(pick: Callable[[Any], Any] | None) -> Any:
    message = next(_streams[0])
    return pick and pick(message)


def _stream(file: Path, topic: str) -> Iterator[Any]:
    """Yield the number of messages, and then each of them."""
    with _opened(file) as reader:
        connections = [connection for connection in reader.connections if connection.topic == topic]
        if not connections:
            held = _named({one.topic: one.msgtype for one in reader.connections})
            raise RecordingError(f"no topic {topic!r}; there are {held}", file=file)
        announced, found = sum(connection.msgcount for connection in connections), 0
        yield announced
        for connection, _, raw in reader.messages(connections):
            yield reader.deserialize(raw, connection.msgtype)
            found += 1
        message = f"{found} messages where the bag announces {announced}: truncated or damaged"
        raise RecordingError(message, file=file, topic=topic)


def seconds(message: object, **evidence: object) -> float:
    """Return the time in s of the ``header`` of a message, to a quarter of a microsecond;
    RecordingError where it has none or was never set.
    """
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None or (stamp.sec, stamp.nanosec) == (0, 0):
        problem = "the message has no time in its header; record with a driver that stamps its"
        raise RecordingError(f"{problem} messages", **evidence)
    return stamp.sec + stamp.nanosec * 1e-9


@contextmanager
def _opened(file: Path) -> Iterator[AnyReader]:
    if (metadata := file / "metadata.yaml").is_file():
        read_whole(metadata)  # refused beyond the bounds
    for database in (file, *file.glob("*.db3")):
        if database.suffix == ".db3":  # SQLite may fill up what a file lacks
            with database.open("rb") as stream:
                head = stream.read(32)
            size, pages = int.from_bytes(head[16:18]), int.from_bytes(head[28:32])
            if database.stat().st_size < pages * (1 << 16 if size == 1 else size):
                raise ValueError(f"{database.name} is cut short")
    reader = AnyReader([file], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
    with reader:
        if not all(isinstance(connection.msgcount, int) for connection in reader.connections):
            raise ValueError("it does not say how many messages it holds")
        yield reader


def _named(held: dict[str, str]) -> str:
    named = [f"{topic} ({kind.rpartition('/')[2]})" for topic, kind in sorted(held.items())]
    return ", ".join(named) or "none"


FORMAT = Format(
    "ROS bag",
    Kind.BAG,
    summary,
    lambda head: head.content.startswith(MARKS) or head.suffix in BAG_SUFFIXES,
)
