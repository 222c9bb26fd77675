"""Reader of ROS 1 and ROS 2 bags: topics, messages of one topic, and conversion of sensor_msgs to
depth images, point clouds and intrinsics (depth by REP 118, units by REP 103).

A separate process reads a bag, since compressed parts (bz2, lz4, zstd) can decompress to any size.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.core.bounds import Sandbox
from pipeline.core.errors import RecordingError
from pipeline.formats.bag_reader import decoder, mend, open_bag, ros_version
from pipeline.formats.depth.intrinsics import Intrinsics, pinhole
from pipeline.formats.format import (
    BAG_SUFFIXES,
    Format,
    Kind,
    advised,
    compare_announced,
    read_alone,
)

MARKS = (b"#ROSBAG V", b"\x89MCAP0")
IMAGE, CLOUD, CAMERA_INFO = (
    f"sensor_msgs/msg/{name}" for name in ("Image", "PointCloud2", "CameraInfo")
)
PIXELS = dict.fromkeys(("16UC1", "mono16"), np.dtype(np.uint16))
PIXELS["32FC1"] = np.dtype(np.float32)
DATATYPES = {7: np.dtype(np.float32), 8: np.dtype(np.float64)}  # datatype of a PointField
_streams: list[Iterator] = []  # open message stream of the reading process


@dataclass(frozen=True)
class Summary:
    """Index of a bag."""

    version: str  # ROS version
    duration: float  # s, from the first to the last message
    topics: dict[str, tuple[str, int]]  # topic → type and number of messages
    # announced_messages in metadata.yaml, and found_messages in the files
    counts: dict[str, int] = field(default_factory=dict)
    passed_over: dict[str, str] = field(default_factory=dict)  # topic that is not read → reason


def summary(file: Path) -> Summary:
    """Return the index of the bag ``file``; RecordingError as :func:`messages`."""
    return read_alone(_summary, Path(file), file=file, advice=mend(Path(file)))


def _summary(file: Path) -> Summary:
    with open_bag(file) as (reader, foreign):
        counts: Counter[tuple[str, str]] = Counter()
        for connection in reader.connections:
            counts[connection.topic, connection.msgtype] += connection.msgcount
            try:
                decoder(connection)
            except RecordingError as error:
                foreign = foreign | {connection.topic: error.message}
        duration = reader.duration * 1e-9 if counts.total() else 0.0
        topics = {topic: (kind, number) for (topic, kind), number in counts.items()}
        storages = getattr(getattr(reader, "storage", None), "storages", ())
        stored = [c for one in storages for c in one.connections]
        held = sum(one.msgcount for one in stored if one.topic in topics)
        compared = compare_announced("messages", counts.total(), held) if stored else {}
        version = max(map(ros_version, reader.connections), default="2")
        return Summary(version, duration, topics, compared, foreign)


def topics(file: Path) -> dict[str, str]:
    """Return topic → message type of a bag's topics with messages; errors as :func:`messages`."""
    return {topic: kind for topic, (kind, number) in summary(file).topics.items() if number}


def choose_topic(file: Path, kinds: tuple[str, ...], topic: str | None = None) -> str:
    """Return ``topic``, by default the only topic whose message type is in ``kinds``, such as
    ``sensor_msgs/msg/Image``; RecordingError with all topics where no topic fits, or several.
    """
    present = topics(file)
    fitting = [name for name, kind in present.items() if kind in kinds and topic in (None, name)]
    if len(fitting) == 1:
        return fitting[0]
    wanted = " or ".join(kind.rpartition("/")[2] for kind in kinds)
    message = f"{len(fitting)} topics of {wanted} {f'named {topic!r}' if topic else 'in the bag'}, "
    message += f"choose one by option; there are {_topic_list(present)}"
    raise RecordingError(message, file=file, **({"topic": topic} if topic else {}))


def messages(file: Path, topic: str, pick: Callable[[Any], Any]) -> Iterator[Any]:
    """Yield ``pick(message)`` for every message of ``topic`` in the bag ``file``, in the order of
    recording. ``pick`` is pickled and called in the reading process, which keeps one message in
    memory; a message has the attributes of its ROS definition. Raises RecordingError for a missing,
    truncated, damaged or unindexed bag, for a ``topic`` of another serialization or definition, for
    another number of messages than the bag announces, and, with the message's number, where
    ``pick`` does.
    """
    with Sandbox() as sandbox:

        def call(function: Callable, *arguments: object, **evidence: int) -> Any:
            with advised(mend(Path(file)), file=file, topic=topic, **evidence):
                return sandbox.call(function, *arguments)

        for number in range(call(_start, Path(file), topic, number=0)):
            yield call(_next, pick, number=number)
        call(_next, None)  # the end of the bag, where messages may be surplus


def _start(file: Path, topic: str) -> int:
    _streams[:] = [_stream(file, topic)]
    return next(_streams[0])


def _next(pick: Callable[[Any], Any] | None) -> Any:
    message = next(_streams[0], None)
    return pick and pick(message)


def _stream(file: Path, topic: str) -> Iterator[Any]:
    """Yield the number of messages, then the messages."""
    with open_bag(file) as (reader, foreign):
        if topic in foreign:
            raise RecordingError(foreign[topic], file=file, topic=topic)
        connections = [connection for connection in reader.connections if connection.topic == topic]
        if not connections:
            present = _topic_list({one.topic: one.msgtype for one in reader.connections})
            raise RecordingError(f"no topic {topic!r}; there are {present}", file=file)
        announced, found = sum(connection.msgcount for connection in connections), 0
        yield announced
        for connection, _, raw in reader.messages(connections):
            found += 1
            if found <= announced:
                yield decoder(connection)(raw)
        where = {"file": file, "topic": topic}
        compare_announced("messages", announced, found, "truncated or damaged", **where)


def seconds(message: object, **evidence: object) -> float:
    """Return the header's time in s to a quarter of a microsecond; RecordingError for none or 0."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None or (stamp.sec, stamp.nanosec) == (0, 0):
        message = "the message has no time in its header; record with a driver that writes one"
        raise RecordingError(message, **evidence)
    return stamp.sec + stamp.nanosec * 1e-9


def _topic_list(types: dict[str, str]) -> str:
    listed = [f"{topic} ({kind.rpartition('/')[2]})" for topic, kind in sorted(types.items())]
    return ", ".join(listed) or "none"


def image_pixels(message: object, *, shape: tuple[int, int], **evidence: object) -> np.ndarray:
    """Return the pixels (H, W) of an Image of ``shape`` = (H, W): uint16 (16UC1) or float32
    (32FC1), either byte order, rows padded or not. RecordingError (with ``evidence``) for another
    encoding or size, and where the data do not have rows × step bytes.
    """
    pixel, size = PIXELS.get(message.encoding), (message.height, message.width)
    if pixel is None or size != tuple(shape):
        found = f"an image of {size[1]} × {size[0]} pixels encoded as {message.encoding!r}; depth "
        wanted = f"of the camera has {shape[1]} × {shape[0]} of {', '.join(PIXELS)}"
        raise RecordingError(found + wanted, **evidence)
    return _records(message, message.step, pixel, "pixels", evidence).astype(pixel)


def _records(message: object, row: int, kind: np.dtype, items: str, evidence: dict) -> np.ndarray:
    """Return the items (height, width) of ``kind`` in a message whose rows have ``row`` bytes."""
    height, width, size = message.height, message.width, kind.itemsize
    data = np.asarray(message.data, np.uint8)
    if row < width * size or len(data) != height * row:
        found = f"{len(data)} bytes in {height} rows of {row} for {width} {items} of {size} bytes"
        raise RecordingError(found, **evidence)
    rows = np.ascontiguousarray(data.reshape(height, row)[:, : width * size])
    return rows.view(kind.newbyteorder(">" if message.is_bigendian else "<"))


def cloud_points(message: object, **evidence: object) -> np.ndarray:
    """Return the points (N, 3) float64 of a PointCloud2, in m in the sensor's frame, NaN without a
    measurement. x, y and z may be float32 or float64 at any offset, of either byte order, rows
    padded or not. RecordingError (with ``evidence``) for other types of x, y and z, and for
    another size of the data than announced.
    """
    fields, step = {field.name: field for field in message.fields}, message.point_step
    axes = [fields[name] for name in "xyz" if name in fields]
    formats = [DATATYPES.get(field.datatype) for field in axes if field.count == 1]
    ends = [f.offset + kind.itemsize for f, kind in zip(axes, formats, strict=False) if kind]
    if len(ends) < 3 or max(ends) > step:
        need = f"x, y and z must be single float32 or float64 within the {step} bytes of a point; "
        raise RecordingError(f"{need}there are {', '.join(fields) or 'none'}", **evidence)
    layout = {"names": [*"xyz"], "formats": formats, "offsets": [field.offset for field in axes]}
    kind = np.dtype(layout | {"itemsize": step})
    points = _records(message, message.row_step, kind, "points", evidence).ravel()
    return np.column_stack([points[name].astype(float) for name in "xyz"])


def camera_info(message: object, *, width: int, height: int, **evidence: object) -> Intrinsics:
    """Return the intrinsics from K and D of a CameraInfo of ``width`` × ``height`` pixels;
    RecordingError (with ``evidence``) for another size, a zero K and another distortion model.
    """
    # ROS 1 writes K and D, ROS 2 k and d
    matrix, distortion = (
        np.array(getattr(message, name, getattr(message, name.lower(), None)), dtype=float)
        for name in "KD"
    )
    own = {"stated": (message.width, message.height)}
    own |= {"model": message.distortion_model or "of no name"}
    distortion = distortion if distortion.any() else np.zeros(0)
    return pinhole(matrix.reshape(3, 3), distortion, (width, height), **own, **evidence)


FORMAT = Format(
    "ROS bag",
    Kind.BAG,
    summary,
    lambda head: head.content.startswith(MARKS) or head.suffix in BAG_SUFFIXES,
)
