"""Reader of ROS 1 and ROS 2 bags: topics, messages of one topic, and conversion of sensor_msgs to
depth images, point clouds and intrinsics (depth by REP 118, units by REP 103).

A separate process reads a bag, since compressed parts (bz2, lz4, zstd) can decompress to any size.
Topics whose definition or serialization makes rosbags refuse the whole bag are passed over.
"""

import json
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import lru_cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.interfaces import Connection, MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2 import storage_mcap
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from pipeline.core.bounds import Sandbox, read_whole
from pipeline.core.errors import RecordingError
from pipeline.core.typed_yaml import read_yaml
from pipeline.formats.depth.intrinsics import Intrinsics, pinhole
from pipeline.formats.format import (
    BAG_SUFFIXES,
    Format,
    Head,
    Kind,
    advised,
    compare_announced,
    read_alone,
)

MARKS = (b"#ROSBAG V", b"\x89MCAP0")
IMAGE = "sensor_msgs/msg/Image"
CLOUD = "sensor_msgs/msg/PointCloud2"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
# encoding of an Image → pixel
PIXELS = {encoding: np.dtype(np.uint16) for encoding in ("16UC1", "mono16")}
PIXELS["32FC1"] = np.dtype(np.float32)
# datatype of a PointField → number
DATATYPES = {7: np.dtype(np.float32), 8: np.dtype(np.float64)}
# suffix of a bag's files → command that writes its index again
MENDS = {".bag": "rosbag reindex", ".mcap": "mcap recover", ".db3": "ros2 bag reindex"}
PROFILE = re.compile(rb"\x89MCAP0\r\n\x01.{8}(.)\0{3}", re.DOTALL)
SERIALIZATION = re.compile(rb"serialization_format: *[\"']?(\w+)")
# serializations
ROS1 = "ros1"
ROS2 = "cdr"
# types of messages that may have commanded or measured angles, and are not read
OF_JOINTS = (
    "control_msgs/msg/JointControllerState",
    "control_msgs/msg/MultiDOFStateStamped",
    "control_msgs/msg/DynamicJointState",
    "trajectory_msgs/msg/JointTrajectory",
    "std_msgs/msg/Float64MultiArray",
    "std_msgs/msg/Float32MultiArray",
)
NOT_READ = (
    "{} is not read: if it has commanded angles (desired or reference) or measured ones (actual or "
    "feedback), publish them as JointState, or save a table of them"
)
FOREIGN = "{} is serialised as {!r}, where ROS 2 writes cdr"
_streams: list[Iterator] = []  # open message stream of the reading process


@dataclass(frozen=True)
class Summary:
    """Index of a bag."""

    version: str  # ROS version
    duration: float  # s, from the first to the last message
    topics: dict[str, tuple[str, int]]  # topic → type and number of messages
    # announced_messages in metadata.yaml, and found_messages in the files
    counts: dict[str, int] = field(default_factory=dict)
    # topic that is not read → reason
    passed_over: dict[str, str] = field(default_factory=dict)


def summary(file: Path) -> Summary:
    """Return the index of the bag ``file``; RecordingError as :func:`messages`."""
    return read_alone(_summary, Path(file), file=file, advice=_mend(Path(file)))


def _summary(file: Path) -> Summary:
    with _open_bag(file) as (reader, foreign):
        passed_over = dict(foreign)
        counts: Counter[tuple[str, str]] = Counter()
        for connection in reader.connections:
            topic = connection.topic
            kind = connection.msgtype
            counts[topic, kind] += connection.msgcount
            try:
                _decoder(connection)
            except RecordingError as error:
                passed_over[topic] = error.message
            if kind in OF_JOINTS:
                passed_over[topic] = NOT_READ.format(kind.rpartition("/")[2])
        topics = {topic: (kind, number) for (topic, kind), number in counts.items()}
        return Summary(
            "1" if isinstance(reader, rosbag1.Reader) else "2",
            reader.duration * 1e-9 if counts.total() else 0.0,
            topics,
            _compared_counts(reader, topics, counts.total()),
            passed_over,
        )


def _compared_counts(
    reader: Any,
    topics: Collection[str],
    announced: int,
) -> dict[str, int]:
    """Return the counts of messages of the ``topics``, if the bag's storages also state numbers."""
    storages = getattr(getattr(reader, "storage", None), "storages", ())
    stored = []
    for storage in storages:
        stored += storage.connections
    if not stored:
        return {}
    messages = 0
    for connection in stored:
        if connection.topic in topics:
            messages += connection.msgcount
    return compare_announced("messages", announced, messages)


def topics(file: Path) -> dict[str, str]:
    """Return topic → message type of a bag's topics with messages; errors as :func:`messages`."""
    present = summary(file).topics.items()
    return {topic: kind for topic, (kind, number) in present if number}


def choose_topic(file: Path, kinds: tuple[str, ...], topic: str | None = None) -> str:
    """Return ``topic``, by default the only topic whose message type is in ``kinds``, such as
    ``sensor_msgs/msg/Image``; RecordingError with all topics where no topic fits, or several.
    """
    present = topics(file)
    fitting = [name for name, kind in present.items() if kind in kinds]
    if topic is not None:
        fitting = [name for name in fitting if name == topic]
    if len(fitting) == 1:
        return fitting[0]
    wanted = " or ".join(kind.rpartition("/")[2] for kind in kinds)
    where = f"named {topic!r}" if topic else "in the bag"
    raise RecordingError(
        f"{len(fitting)} topics of {wanted} {where}, choose one by option; there are "
        f"{_topic_list(present)}",
        file=file,
        **({"topic": topic} if topic else {}),
    )


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
            with advised(_mend(Path(file)), file=file, topic=topic, **evidence):
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
    with _open_bag(file) as (reader, foreign):
        if topic in foreign:
            raise RecordingError(foreign[topic], file=file, topic=topic)
        types = {}
        connections = []
        for connection in reader.connections:
            types[connection.topic] = connection.msgtype
            if connection.topic == topic:
                connections.append(connection)
        if not connections:
            message = f"no topic {topic!r}; there are {_topic_list(types)}"
            raise RecordingError(message, file=file)
        announced = sum(connection.msgcount for connection in connections)
        number = 0
        yield announced
        for connection, _, raw in reader.messages(connections):
            number += 1
            if number <= announced:
                yield _decoder(connection)(raw)
        where = {"file": file, "topic": topic}
        compare_announced(
            "messages",
            announced,
            number,
            "truncated or damaged",
            **where,
        )


def seconds(message: object, **evidence: object) -> float:
    """Return the header's time in s to a quarter of a microsecond; RecordingError for none or 0."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None or (stamp.sec, stamp.nanosec) == (0, 0):
        message = "the message has no time in its header; record with a driver that writes one"
        raise RecordingError(message, **evidence)
    return stamp.sec + stamp.nanosec * 1e-9


def _topic_list(types: dict[str, str]) -> str:
    listed = []
    for topic, kind in sorted(types.items()):
        listed.append(f"{topic} ({kind.rpartition('/')[2]})")
    return ", ".join(listed) or "none"


def image_pixels(
    message: object,
    *,
    shape: tuple[int, int],
    **evidence: object,
) -> np.ndarray:
    """Return the pixels (H, W) of an Image of ``shape`` = (H, W): uint16 (16UC1) or float32
    (32FC1), either byte order, rows padded or not. RecordingError (with ``evidence``) for another
    encoding or size, and where the data do not have rows × step bytes.
    """
    pixel = PIXELS.get(message.encoding)
    size = (message.height, message.width)
    if pixel is None or size != tuple(shape):
        raise RecordingError(
            f"an image of {size[1]} × {size[0]} pixels encoded as {message.encoding!r}; depth "
            f"of the camera has {shape[1]} × {shape[0]} of {', '.join(PIXELS)}",
            **evidence,
        )
    return _records(message, message.step, pixel, "pixels", evidence).astype(pixel)


def _records(
    message: object,
    row: int,
    kind: np.dtype,
    items: str,
    evidence: dict,
) -> np.ndarray:
    """Return the items (height, width) of ``kind`` in a message whose rows have ``row`` bytes."""
    height = message.height
    width = message.width
    length = width * kind.itemsize
    data = np.asarray(message.data, np.uint8)
    if row < length or len(data) != height * row:
        raise RecordingError(
            f"{len(data)} bytes in {height} rows of {row} for {width} {items} of {kind.itemsize} "
            "bytes",
            **evidence,
        )
    rows = np.ascontiguousarray(data.reshape(height, row)[:, :length])
    return rows.view(kind.newbyteorder(">" if message.is_bigendian else "<"))


def cloud_points(message: object, **evidence: object) -> np.ndarray:
    """Return the points (N, 3) float64 of a PointCloud2, in m in the sensor's frame, NaN without a
    measurement. x, y and z may be float32 or float64 at any offset, of either byte order, rows
    padded or not. RecordingError (with ``evidence``) for other types of x, y and z, and for
    another size of the data than announced.
    """
    fields = {field.name: field for field in message.fields}
    step = message.point_step
    layout = {}
    for axis in "xyz":
        field = fields.get(axis)
        kind = DATATYPES.get(field.datatype) if field and field.count == 1 else None
        if kind and field.offset + kind.itemsize <= step:
            layout[axis] = kind, field.offset
    if len(layout) < 3:
        raise RecordingError(
            f"x, y and z must be single float32 or float64 within the {step} bytes of a point; "
            f"there are {', '.join(fields) or 'none'}",
            **evidence,
        )
    formats, offsets = zip(*layout.values(), strict=True)
    point = {"names": [*"xyz"], "formats": formats, "offsets": offsets}
    kind = np.dtype(point | {"itemsize": step})
    points = _records(message, message.row_step, kind, "points", evidence).ravel()
    return np.column_stack([points[name].astype(float) for name in "xyz"])


def camera_info(
    message: object,
    *,
    width: int,
    height: int,
    **evidence: object,
) -> Intrinsics:
    """Return the intrinsics from K and D of a CameraInfo of ``width`` × ``height`` pixels;
    RecordingError (with ``evidence``) for another size, a zero K and another distortion model.
    """
    # ROS 1 writes K and D, ROS 2 k and d
    by_ros_2 = hasattr(message, "k")
    matrix = np.array(message.k if by_ros_2 else message.K, dtype=float)
    distortion = np.array(message.d if by_ros_2 else message.D, dtype=float)
    return pinhole(
        matrix.reshape(3, 3),
        distortion if distortion.any() else np.zeros(0),
        (width, height),
        stated=(message.width, message.height),
        model=message.distortion_model or "of no name",
        **evidence,
    )


def _mend(file: Path) -> str:
    """Return what to do with a damaged bag, by its kind."""
    suffixes = {place.suffix for place in (file, *file.glob("*"))}
    commands = [command for suffix, command in MENDS.items() if suffix in suffixes]
    command = commands[0] if commands else MENDS[".db3"]
    return f"copy it again, or run `{command}` on it"


def _decoder(connection: Connection) -> Callable[[bytes], object]:
    """Return the decoder of a topic's messages; RecordingError for an unreadable definition."""
    form = getattr(connection.ext, "serialization_format", ROS1)
    types = _types(connection.msgtype, connection.msgdef, connection.digest, form)
    read = types.deserialize_ros1 if form == ROS1 else types.deserialize_cdr
    return partial(read, typename=connection.msgtype)


@contextmanager
def _open_bag(file: Path) -> Iterator[tuple[Any, dict[str, str]]]:
    """Yield a bag's reader, and topic → reason for topics of another serialization."""
    with ExitStack() as stack:
        folder = file
        foreign = {}
        metadata = file / "metadata.yaml"
        if metadata.is_file():
            text = read_whole(metadata)  # raises for a file beyond the bounds
            if {*SERIALIZATION.findall(text)} - {ROS2.encode()}:
                folder = Path(stack.enter_context(TemporaryDirectory()))
                foreign = _link_without_foreign(file, folder)
        for inside in (file, *file.glob("*")) if file.is_dir() else (file,):
            if inside.is_file():
                _require_sound(inside)
        read = rosbag1.Reader if file.suffix == ".bag" else rosbag2.Reader
        reader = stack.enter_context(read(folder))
        counts = [connection.msgcount for connection in reader.connections]
        if not all(isinstance(count, int) for count in counts):
            raise ValueError("the bag does not state its number of messages")
        yield reader, foreign


def _require_sound(file: Path) -> None:
    """Raise RecordingError for a pointer and a foreign MCAP, ValueError for a short database."""
    head = Head.read(file).content
    match = PROFILE.match(head)
    length = match[1][0] if match else 0
    if length:
        start = match.end()
        profile = head[start : start + length].decode("latin-1")
        if profile != "ros2":
            message = f"an MCAP of the profile {profile!r}, not ros2: record or convert it by ROS 2"
            raise RecordingError(message, file=file)
    if file.suffix == ".db3":
        size = int.from_bytes(head[16:18])
        pages = int.from_bytes(head[28:32])
        if file.stat().st_size < pages * (1 << 16 if size == 1 else size):
            raise ValueError(f"{file.name} is cut short")


def _link_without_foreign(file: Path, folder: Path) -> dict[str, str]:
    """Link the bag ``file`` into ``folder`` without foreign topics, and return topic → reason."""
    metadata = read_yaml(file / "metadata.yaml")
    information = metadata["rosbag2_bagfile_information"]
    foreign = {}
    readable = []
    for entry in information["topics_with_message_count"]:
        topic = entry["topic_metadata"]
        form = topic["serialization_format"]
        if form == ROS2:
            readable.append(entry)
        else:
            foreign[topic["name"]] = FOREIGN.format(topic["type"], form)
    information["topics_with_message_count"] = readable
    (folder / "metadata.yaml").write_text(json.dumps(metadata))  # JSON is YAML
    for inside in file.iterdir():
        if inside.name != "metadata.yaml":
            (folder / inside.name).symlink_to(inside.resolve())
    return foreign


@lru_cache(maxsize=64)
def _types(
    kind: str,
    definition: MessageDefinition,
    digest: str,
    form: str,
) -> Typestore:
    if form not in (ROS1, ROS2):
        raise RecordingError(FOREIGN.format(kind, form))
    if definition.format == MessageDefinitionFormat.NONE:
        store = get_typestore(Stores.ROS2_HUMBLE)
        if kind not in store.fielddefs:
            raise RecordingError(
                f"the bag has no definition of {kind}: `ros2 bag convert` it to an MCAP, which has "
                "the definitions of its types",
            )
        return store
    store = get_typestore(Stores.EMPTY)
    try:
        if definition.format != MessageDefinitionFormat.MSG:
            raise ValueError("it is in IDL")
        store.register(get_types_from_msg(definition.data, kind))
        if form == ROS1:
            stated = store.generate_msgdef(kind)[1]
        else:
            stated = store.hash_rihs01(kind)
    except Exception as error:  # of the parser, and of a type that is not defined
        words = " ".join(str(error).split())[:80]
        message = f"the definition of {kind} cannot be read ({words})"
        raise RecordingError(message) from None
    if digest not in ("", stated):
        raise RecordingError(f"the definition of {kind} has not the hash {digest}")
    return store


def _definition(definition_of: Callable, schema: Any) -> MessageDefinition:
    """Return the definition of an MCAP's ``schema``; none for a schema that is not of ROS."""
    with suppress(KeyError):
        return definition_of(schema)
    return MessageDefinition(MessageDefinitionFormat.NONE, "")


storage_mcap.get_msgdef = partial(_definition, storage_mcap.get_msgdef)
FORMAT = Format(
    "ROS bag",
    Kind.BAG,
    summary,
    lambda head: head.content.startswith(MARKS) or head.suffix in BAG_SUFFIXES,
)
