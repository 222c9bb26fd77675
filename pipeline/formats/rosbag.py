"""ROS 1 and ROS 2 bags: their topics, the messages of one topic, one at a time, and messages of
depth cameras as images, clouds and intrinsics (sensor_msgs; REP 118 for depth, REP 103 for units).

A process of its own reads a bag, since compressed parts (bz2, lz4, zstd) may unfold to any size.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from pipeline.core.bounds import Sandbox, read_whole
from pipeline.core.errors import RecordingError
from pipeline.formats.depth.intrinsics import Intrinsics, pinhole
from pipeline.formats.format import BAG_SUFFIXES, Format, Kind, advised, read_alone

MARKS = (b"#ROSBAG V", b"\x89MCAP0")
MEND = "copy it again, or run `rosbag reindex` on it"
IMAGE, CLOUD, CAMERA_INFO = (
    f"sensor_msgs/msg/{name}" for name in ("Image", "PointCloud2", "CameraInfo")
)
PIXELS = dict.fromkeys(("16UC1", "mono16"), np.dtype(np.uint16))
PIXELS["32FC1"] = np.dtype(np.float32)
DATATYPES = {7: np.dtype(np.float32), 8: np.dtype(np.float64)}  # of a PointField
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
    """Yield ``pick(message)`` of the messages of ``topic`` in the bag ``file``, or those with the
    ``numbers`` (from 0), in the order of recording. ``pick`` is pickled and called in the process
    that reads; a message has the attributes of its ROS definition, and memory holds one. Raises
    RecordingError for a bag that is missing, truncated, damaged or unindexed, for fewer messages
    than it announces, and, with the message's number, as ``pick`` does.
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
    """Return the time in s in the ``header`` of a message, to a quarter of a microsecond;
    RecordingError where there is none or it was never set.
    """
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None or (stamp.sec, stamp.nanosec) == (0, 0):
        message = "the message has no time in its header; record with a driver that writes it"
        raise RecordingError(message, **evidence)
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


def image_pixels(message: object, *, shape: tuple[int, int], **evidence: object) -> np.ndarray:
    """Return (H, W) uint16 (16UC1) or float32 (32FC1) of an Image of ``shape`` = (H, W), of either
    byte order, its rows padded or not; RecordingError (with ``evidence``) for another encoding or
    size, and for other data than rows × step.
    """
    pixel, size = PIXELS.get(message.encoding), (message.height, message.width)
    if pixel is None or size != tuple(shape):
        found = f"an image of {size[1]} × {size[0]} pixels encoded as {message.encoding!r}; depth "
        wanted = f"of the camera has {shape[1]} × {shape[0]} of {', '.join(PIXELS)}"
        raise RecordingError(found + wanted, **evidence)
    return _records(message, message.step, pixel, "pixels", evidence).astype(pixel)


def _records(message: object, row: int, kind: np.dtype, what: str, evidence: dict) -> np.ndarray:
    """Return (height, width) of ``kind`` in a message whose rows have ``row`` bytes."""
    height, width, size = message.height, message.width, kind.itemsize
    data = np.asarray(message.data, np.uint8)
    if row < width * size or len(data) != height * row:
        said = f"{len(data)} bytes in {height} rows of {row} for {width} {what} of {size} bytes"
        raise RecordingError(said, **evidence)
    rows = np.ascontiguousarray(data.reshape(height, row)[:, : width * size])
    return rows.view(kind.newbyteorder(">" if message.is_bigendian else "<"))


def cloud_points(message: object, **evidence: object) -> np.ndarray:
    """Return (N, 3) float64 points of a PointCloud2 in m in its own frame, NaN where the sensor saw
    nothing: float32 or float64 at any offset, of either byte order, rows padded or not.
    RecordingError (with ``evidence``) for another field, and for other data than announced.
    """
    fields, step = {field.name: field for field in message.fields}, message.point_step
    held = [fields[name] for name in "xyz" if name in fields]
    formats = [DATATYPES.get(field.datatype) for field in held if field.count == 1]
    ends = [f.offset + kind.itemsize for f, kind in zip(held, formats, strict=False) if kind]
    if len(ends) < 3 or max(ends) > step:
        said = f"x, y and z must be single float32 or float64 within the {step} bytes of a point; "
        raise RecordingError(f"{said}there are {', '.join(fields) or 'none'}", **evidence)
    layout = {"names": [*"xyz"], "formats": formats, "offsets": [field.offset for field in held]}
    kind = np.dtype(layout | {"itemsize": step})
    points = _records(message, message.row_step, kind, "points", evidence).ravel()
    return np.column_stack([points[name].astype(float) for name in "xyz"])


def camera_info(message: object, *, width: int, height: int, **evidence: object) -> Intrinsics:
    """Return the intrinsics from the K and D of a CameraInfo of ``width`` × ``height`` pixels;
    RecordingError (with ``evidence``) for another size, K of zeros and another distortion model.
    """
    # ROS 1 writes K and D, ROS 2 k and d
    matrix, distortion = (
        np.array(getattr(message, name, getattr(message, name.lower(), None)), dtype=float)
        for name in "KD"
    )
    own = {
        "stated": (message.width, message.height),
        "model": message.distortion_model or "of no name",
    }
    distortion = distortion if distortion.any() else np.zeros(0)
    return pinhole(matrix.reshape(3, 3), distortion, (width, height), **own, **evidence)


FORMAT = Format(
    "ROS bag",
    Kind.BAG,
    summary,
    lambda head: head.content.startswith(MARKS) or head.suffix in BAG_SUFFIXES,
)
