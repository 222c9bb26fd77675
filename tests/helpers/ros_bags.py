"""Bags made for the tests, in the forms that ROS 1 and ROS 2 write."""

from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

STORES = {
    "ros1": get_typestore(Stores.ROS1_NOETIC),
    "ros2": get_typestore(Stores.ROS2_HUMBLE),
}
POINT_FIELDS = ("positions", "velocities", "accelerations", "effort")
POINT = "trajectory_msgs/msg/JointTrajectoryPoint"
CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"
# the fields of earlier and of newer versions of control_msgs, as of ROS 2 Humble
POINTS = ("desired", "actual", "reference", "feedback")
DEFINITION = "std_msgs/Header header\nstring[] joint_names\n"
for name in POINTS:
    DEFINITION += f"trajectory_msgs/JointTrajectoryPoint {name}\n"
for store in STORES.values():
    store.register(get_types_from_msg(DEFINITION, CONTROLLER_STATE))


class Message:
    """Type, time and fields of a message, to be made for either ROS version."""

    def __init__(self, kind: str, stamp: float, **fields: object) -> None:
        self.kind, self.stamp, self.fields = kind, stamp, fields

    def for_version(self, version: str) -> object:
        """The message of a ROS version, with a header and with messages in its fields."""
        types = STORES[version].types
        fields = dict(self.fields)
        if "fields" in fields:
            point = types["sensor_msgs/msg/PointField"]
            fields["fields"] = [point(*field) for field in fields["fields"]]
        if "wrench" in fields:
            vector = types["geometry_msgs/msg/Vector3"]
            force, torque = fields["wrench"].tolist()
            wrench = types["geometry_msgs/msg/Wrench"]
            fields["wrench"] = wrench(vector(*force), vector(*torque))
        if self.kind == CONTROLLER_STATE:
            for name in POINTS:
                fields[name] = trajectory_point(types, fields.get(name, {}))

        if "distortion_model" in fields:
            fields["roi"] = types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
            if version == "ros2":
                for name in "DKRP":
                    fields[name.lower()] = fields.pop(name)
        return types[self.kind](header=self.header(version), **fields)

    def header(self, version: str) -> object:
        """The header of a ROS version; of ROS 1 it has a number."""
        types = STORES[version].types
        seconds, nanoseconds = divmod(round(self.stamp * 1e9), 10**9)
        time = types["builtin_interfaces/msg/Time"](seconds, nanoseconds)
        number = [0] if version == "ros1" else []
        return types["std_msgs/msg/Header"](*number, time, "depth_camera")


def trajectory_point(types, values: dict[str, np.ndarray]) -> object:
    """A point of a trajectory with these ``values``, and empty ones in their place."""
    duration = types["builtin_interfaces/msg/Duration"](0, 0)
    fields = [values.get(name, np.zeros(0)) for name in POINT_FIELDS]
    return types[POINT](*fields, duration)


def image(pixels: np.ndarray, stamp: float, *, big=False, padding: int = 0) -> Message:
    """An Image of (H, W) uint16 or float32 ``pixels``, with ``padding`` bytes after each row."""
    rows = pixels.astype(pixels.dtype.newbyteorder(">" if big else "<")).view(np.uint8)
    rows = rows.reshape(len(pixels), -1)
    data = np.pad(rows, ((0, 0), (0, padding)), constant_values=255)

    return Message(
        "sensor_msgs/msg/Image",
        stamp,
        encoding={"u": "16UC1", "f": "32FC1"}[pixels.dtype.kind],
        height=pixels.shape[0],
        width=pixels.shape[1],
        is_bigendian=int(big),
        step=data.shape[1],
        data=data.ravel(),
    )


def cloud(
    points: np.ndarray,
    stamp: float,
    fields: list[tuple[str, int, int, int]],
    step: int,
    *,
    big: bool = False,
    rows: int = 1,
) -> Message:
    """A PointCloud2 of (N, 3) ``points``: ``fields`` (name, offset, datatype, count) in ``step``
    bytes each, in ``rows`` padded rows.
    """
    data = np.full((len(points), step), 7, np.uint8)
    order = ">" if big else "<"
    for name, offset, datatype, _ in fields:
        if name in "xyz":
            kind = np.dtype({7: "f4", 8: "f8"}[datatype]).newbyteorder(order)
            column = np.ascontiguousarray(points[:, "xyz".index(name)]).astype(kind)
            place = slice(offset, offset + kind.itemsize)
            data[:, place] = column.view(np.uint8).reshape(len(points), -1)
    padded = np.pad(data.reshape(rows, -1), ((0, 0), (0, 5)))
    return Message(
        "sensor_msgs/msg/PointCloud2",
        stamp,
        height=rows,
        width=len(points) // rows,
        fields=fields,
        is_bigendian=big,
        point_step=step,
        row_step=padded.shape[1],
        data=padded.ravel(),
        is_dense=False,
    )


def camera_info(
    matrix: list[float],
    distortion: list[float],
    size: tuple[int, int],
    *,
    model: str = "plumb_bob",
) -> Message:
    """A CameraInfo of the matrix K (9,) and D of an image of ``size`` (width, height)."""
    width, height = size
    return Message(
        "sensor_msgs/msg/CameraInfo",
        1.0,
        height=height,
        width=width,
        distortion_model=model,
        D=np.array(distortion, float),
        K=np.array(matrix, float),
        R=np.eye(3).ravel(),
        P=np.zeros(12),
        binning_x=0,
        binning_y=0,
    )


def ros1_writer(folder: Path, form: str) -> Writer1:
    """The writer of a bag of ROS 1, whose chunks are compressed as ``form`` says."""
    writer = Writer1(folder / "take.bag")
    if form != "ros1":
        compression = form.removeprefix("ros1_").upper()
        writer.set_compression(Writer1.CompressionFormat[compression])
    return writer


def ros2_writer(folder: Path, form: str) -> Writer2:
    """The writer of a bag of ROS 2, stored and compressed as ``form`` says."""
    storage = StoragePlugin.MCAP if form.startswith("mcap") else StoragePlugin.SQLITE3
    writer = Writer2(folder / "take", version=9, storage_plugin=storage)
    modes = {"zstd": "MESSAGE", "zstd_file": "FILE", "mcap_zstd": "STORAGE"}
    if form in modes:
        writer.set_compression(CompressionMode[modes[form]], CompressionFormat.ZSTD)
    return writer


def write_bag(
    folder: Path,
    form: str,
    recorded: dict[str, list],
    *,
    kinds: dict[str, str] | None = None,
) -> Path:
    """Write the messages of each topic, at their times of recording, into a new bag in ``folder``,
    named take; ``kinds`` of empty topics.

    ``form``: ros1, ros1_lz4, ros1_bz2, sqlite3, mcap, mcap_zstd (each chunk compressed), zstd (each
    message) or zstd_file (the whole file).
    """
    if form.startswith("ros1"):
        version = "ros1"
        writer = ros1_writer(folder, form)
        serialise = STORES[version].serialize_ros1
    else:
        version = "ros2"
        writer = ros2_writer(folder, form)
        serialise = STORES[version].serialize_cdr

    with writer:
        connections = {}
        messages = []
        for topic, entries in recorded.items():
            kind = entries[0][1].kind if entries else kinds[topic]
            connection = writer.add_connection(topic, kind, typestore=STORES[version])
            connections[topic] = connection
            messages += [(time, topic, message) for time, message in entries]
        for time, topic, message in sorted(messages, key=lambda entry: entry[:2]):
            data = serialise(message.for_version(version), message.kind)
            writer.write(connections[topic], round(time * 1e9), data)
    return writer.path
