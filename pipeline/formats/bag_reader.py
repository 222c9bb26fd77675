"""Opened bags of both ROS versions, and decoders of their messages. Topics whose definition or
serialization makes rosbags refuse the whole bag are passed over.
"""

import json
import re
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import lru_cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rosbags import rosbag1, rosbag2
from rosbags.interfaces import Connection, MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2 import storage_mcap
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from pipeline.core.bounds import read_whole
from pipeline.core.errors import RecordingError
from pipeline.core.typed_yaml import read_yaml
from pipeline.formats.format import Head

# suffix of a bag's files → command that writes its index again
MENDS = {".bag": "rosbag reindex", ".mcap": "mcap recover", ".db3": "ros2 bag reindex"}
PROFILE = re.compile(rb"\x89MCAP0\r\n\x01.{8}(.)\0{3}", re.DOTALL)
SERIALIZATION = re.compile(rb"serialization_format: *[\"']?(\w+)")
ROS1, ROS2 = "ros1", "cdr"  # serializations
FOREIGN = "{} is serialised as {!r}, where ROS 2 writes cdr"


def mend(file: Path) -> str:
    """Return what to do with a damaged bag, by its kind."""
    suffixes = {place.suffix for place in (file, *file.glob("*"))}
    command = next((known for end, known in MENDS.items() if end in suffixes), MENDS[".db3"])
    return f"copy it again, or run `{command}` on it"


def ros_version(connection: Connection) -> str:
    """Return the ROS version, 1 or 2, of a ``connection``."""
    return "2" if hasattr(connection.ext, "serialization_format") else "1"


def decoder(connection: Connection) -> Callable[[bytes], object]:
    """Return the decoder of a topic's messages; RecordingError for an unreadable definition."""
    form = getattr(connection.ext, "serialization_format", ROS1)
    types = _types(connection.msgtype, connection.msgdef, connection.digest, form)
    read = types.deserialize_ros1 if form == ROS1 else types.deserialize_cdr
    return partial(read, typename=connection.msgtype)


@contextmanager
def open_bag(file: Path) -> Iterator[tuple[Any, dict[str, str]]]:
    """Yield a bag's reader, and topic → reason for topics of another serialization."""
    with ExitStack() as stack:
        folder, foreign = file, {}
        if (metadata := file / "metadata.yaml").is_file():
            text = read_whole(metadata)  # raises for a file beyond the bounds
            if {*SERIALIZATION.findall(text)} - {ROS2.encode()}:
                folder = Path(stack.enter_context(TemporaryDirectory()))
                foreign = _link_without_foreign(file, folder)
        for part in (file, *file.glob("*")) if file.is_dir() else (file,):
            if part.is_file():
                _require_sound(part)
        reader = (rosbag1.Reader if file.suffix == ".bag" else rosbag2.Reader)(folder)
        stack.enter_context(reader)
        if not all(isinstance(connection.msgcount, int) for connection in reader.connections):
            raise ValueError("the bag does not state its number of messages")
        yield reader, foreign


def _require_sound(file: Path) -> None:
    """Raise RecordingError for a pointer and a foreign MCAP, ValueError for a short database."""
    head = Head.read(file).content
    if (match := PROFILE.match(head)) and (length := match[1][0]):
        profile = head[match.end() :][:length].decode("latin-1")
        if profile != "ros2":
            message = f"an MCAP of the profile {profile!r}, not ros2: record or convert it by ROS 2"
            raise RecordingError(message, file=file)
    size, pages = int.from_bytes(head[16:18]), int.from_bytes(head[28:32])
    if file.suffix == ".db3" and file.stat().st_size < pages * (1 << 16 if size == 1 else size):
        raise ValueError(f"{file.name} is cut short")


def _link_without_foreign(file: Path, folder: Path) -> dict[str, str]:
    """Link the bag ``file`` into ``folder`` without foreign topics, and return topic → reason."""
    metadata, foreign = read_yaml(file / "metadata.yaml"), {}
    information, kept = metadata["rosbag2_bagfile_information"], []
    for entry in information["topics_with_message_count"]:
        topic = entry["topic_metadata"]
        if (form := topic["serialization_format"]) == ROS2:
            kept.append(entry)
        else:
            foreign[topic["name"]] = FOREIGN.format(topic["type"], form)
    information["topics_with_message_count"] = kept
    (folder / "metadata.yaml").write_text(json.dumps(metadata))  # JSON is YAML
    for part in file.iterdir():
        if part.name != "metadata.yaml":
            (folder / part.name).symlink_to(part.resolve())
    return foreign


@lru_cache(maxsize=64)
def _types(kind: str, definition: MessageDefinition, digest: str, form: str) -> Typestore:
    if form not in (ROS1, ROS2):
        raise RecordingError(FOREIGN.format(kind, form))
    if definition.format == MessageDefinitionFormat.NONE:
        store = get_typestore(Stores.ROS2_HUMBLE)
        if kind not in store.fielddefs:
            raise RecordingError(f"the bag has no definition of {kind}")
        return store
    store = get_typestore(Stores.EMPTY)
    try:
        if definition.format != MessageDefinitionFormat.MSG:
            raise ValueError("it is in IDL")
        store.register(get_types_from_msg(definition.data, kind))
        own = store.generate_msgdef(kind)[1] if form == ROS1 else store.hash_rihs01(kind)
    except Exception as error:  # the parser's own, and those of a type that is not defined
        words = " ".join(str(error).split())[:80]
        raise RecordingError(f"the definition of {kind} cannot be read ({words})") from None
    if digest not in ("", own):
        raise RecordingError(f"the definition of {kind} has not the hash {digest}")
    return store


def _definition(known: Callable, schema: Any) -> MessageDefinition:
    """Return the definition of an MCAP's ``schema``; none for a schema that is not of ROS."""
    with suppress(KeyError):
        return known(schema)
    return MessageDefinition(MessageDefinitionFormat.NONE, "")


storage_mcap.get_msgdef = partial(_definition, storage_mcap.get_msgdef)
