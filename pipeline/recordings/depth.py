"""Tables of depth takes: times of the frames on the camera's clock, and points on the arm."""

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from pipeline.arm.model import Arm
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.dataset import Depth
from pipeline.formats import rosbag
from pipeline.formats.depth import cloud, image
from pipeline.formats.depth.intrinsics import Intrinsics, read_intrinsics
from pipeline.formats.format import is_bag
from pipeline.perception.segment import ArmSegmenter, cut_cloud
from pipeline.recordings.inventory import named_takes
from pipeline.recordings.quality import DEPTH_CAMERA, quality_rows

KEY = "dataset.depth"
# frames, each with the evidence for an error in it
Frames = Iterator[tuple[image.RawDepth | cloud.PointCloud, dict[str, object]]]


class DepthTake(NamedTuple):
    """F frames of a depth take, which are read one at a time."""

    time: np.ndarray  # (F,) s on the camera's clock
    references: Sequence[str]  # (F,) file, or bag#message
    camera: Intrinsics | None  # None for point clouds
    frames: Frames
    counts: Counter[str]  # of lost items, updated by reading ``frames``


def depth_paths(raw: Path, depth: Depth) -> dict[str, Path]:
    """Return take → folder or bag; RecordingError where none matches or two share a name."""
    return named_takes(
        raw,
        depth.takes,
        key=f"{KEY}.takes",
        what="folder of depth frames and no bag",
        wanted=lambda path: path.is_dir() or is_bag(path),
    )


def frame_rows(
    named: tuple[str, Path],
    depth: Depth,
    arm: Arm,
    raw: Path,
    folder: Path,
) -> tuple[pd.DataFrame, list[dict]]:
    """Return the rows of the table ``frames`` of a take (name, and folder or bag) and the quality
    rows; write the arm's points in m below ``folder``. Times are in s since the start of the motion
    capture, on the camera's clock.

    ``frozen_frames``, whose points equal the points of the frame before, are left out and counted.
    Raises RecordingError for unreadable or contradictory files, ConfigError for missing options.
    """
    name, path = named
    read = _take_of_bag if is_bag(path) else _take_of_folder
    recorded = read(path, depth, raw)
    start = recorded.time[0] if depth.start is None else depth.start
    points_and_shares = _points(recorded, depth, arm)
    clouds, valid = zip(*points_and_shares, strict=True)
    frozen = _frozen_clouds(clouds)
    thawed = [points for points, still in zip(clouds, frozen, strict=True) if not still]
    np.save(folder / f"{name}.npy", np.concatenate(thawed))

    identity = {"take": name, "part": "test", "frame": np.arange(len(clouds))}
    identity |= {"t": recorded.time - start, "file": recorded.references}
    columns = identity | {"valid": valid}
    rows = pd.DataFrame(columns)[~frozen]

    empty = np.full(2, np.nan)
    centroid = [points.mean(axis=0) if len(points) else empty for points in thawed]
    rows["points"] = [len(points) for points in thawed]
    rows[["x", "z"]] = np.array(centroid)

    dropped = image.dropped_frames(recorded.time - start)
    share = dropped / (dropped + len(clouds))
    counts = {"dropped_frames": dropped, "frozen_frames": frozen.sum()}
    counts |= recorded.counts
    notes = [*counts.items(), ("dropped_share", share, "share")]
    return rows, quality_rows(name, "test", DEPTH_CAMERA, notes)


def _frozen_clouds(clouds: Sequence[np.ndarray]) -> np.ndarray:
    """Return the mask (F,) of the frames whose points equal the points of the frame before."""
    frozen = np.zeros(len(clouds), bool)
    for i, (before, after) in enumerate(pairwise(clouds), 1):
        frozen[i] = len(after) > 0 and np.array_equal(before, after)
    return frozen


def _points(
    recorded: DepthTake,
    depth: Depth,
    arm: Arm,
) -> Iterator[tuple[np.ndarray, float]]:
    """Yield the arm's points (I, 2), m in the arm's plane, and the measured share per frame."""
    rotation = Rotation.from_euler("xyz", depth.camera.rpy).as_matrix()
    pose = rotation, np.array(depth.camera.position)
    encoding = image.Encoding(
        depth.encoding,
        depth.units_per_metre,
        depth.saturation,
        depth.scale_key,
        depth.disparity and tuple(depth.disparity),
    )
    segment = partial(cut_cloud, arm, *pose, depth.workspace)
    if recorded.camera is not None:
        segment = ArmSegmenter(arm, recorded.camera, *pose, depth.workspace)
    elif depth.encoding != "plain":
        message = f"the encoding of point clouds must be plain, got {depth.encoding}"
        raise ConfigError(message, key=f"{KEY}.encoding")
    for frame, where in recorded.frames:
        if isinstance(frame, cloud.PointCloud):
            share = len(frame.points) / (len(frame.points) + frame.missing)
            measured = frame.points / depth.units_per_metre
        else:
            measured = image.metres(frame, encoding, **where)
            share = float(np.count_nonzero(measured > 0) / measured.size)
        yield segment(measured), share


def _take_of_folder(path: Path, depth: Depth, raw: Path) -> DepthTake:
    if depth.index is not None:
        listed = image.read_index(path / depth.index)
    elif depth.frames is not None:
        listed = image.numbered_frames(path, depth.frames, rate=depth.rate)
    else:
        message = "a folder of frames needs an index, or frames: a glob of numbered file names"
        raise ConfigError(message, key=f"{KEY}.index")
    files = [path / name for name in listed.files]
    counts = Counter(listed.counts)
    camera = None
    if not all(cloud.is_cloud(file) for file in files):
        camera = _intrinsics(path, depth, raw)

    def frames() -> Frames:
        for file in files:
            if camera is not None:
                shape = camera.height, camera.width
                yield image.read_depth(file, shape=shape), {"file": file}
                continue
            points = cloud.read_cloud(file)
            counts.update(points.counts)
            if points.viewpoint != cloud.UNTURNED:
                counts["unapplied_viewpoints"] += 1
            yield points, {}

    references = [os.path.relpath(file, raw) for file in files]
    return DepthTake(listed.time, references, camera, frames(), counts)


def _take_of_bag(path: Path, depth: Depth, raw: Path) -> DepthTake:
    """Return the bag's take: one pass reads the times in the headers, a second one the frames."""
    topic = rosbag.choose_topic(path, (rosbag.IMAGE, rosbag.CLOUD), depth.topic)
    time = np.array([*rosbag.messages(path, topic, rosbag.seconds)])
    where = {"file": path, "topic": topic}
    late = np.flatnonzero(np.diff(time) <= 0)
    if late.size:
        number = int(late[0]) + 1
        raise RecordingError("the time does not increase", **where, number=number)
    pick = rosbag.cloud_points
    camera = None
    if rosbag.topics(path)[topic] == rosbag.IMAGE:
        camera = _intrinsics(path, depth, raw, topic)
        pick = partial(rosbag.image_pixels, shape=(camera.height, camera.width))

    def frames() -> Frames:
        for number, message in enumerate(rosbag.messages(path, topic, pick)):
            in_metres = camera is None or message.dtype == np.float32
            if in_metres and depth.units_per_metre != 1:
                fault = "ROS defines float images and clouds in metres"
                where_stated = {"key": f"{KEY}.units_per_metre", "file": path}
                raise ConfigError(f"{fault}: units_per_metre must be 1", **where_stated)
            evidence = where | {"number": number}
            if camera is None:
                cloud.require_near(message, **evidence)
                yield cloud.PointCloud.measured(message), evidence
            else:
                yield image.RawDepth(message), evidence

    references = [f"{path.relative_to(raw)}#{number}" for number in range(len(time))]
    return DepthTake(time, references, camera, frames(), Counter())


def _intrinsics(path: Path, depth: Depth, raw: Path, topic: str = "") -> Intrinsics:
    """Return the intrinsics of a file, else of the bag's camera of the images in ``topic``."""
    if depth.width is None or depth.height is None:
        message = "depth images need the options width and height"
        raise ConfigError(message, key=f"{KEY}.width")
    size = {"width": depth.width, "height": depth.height}
    if depth.intrinsics is not None:
        keys = {"matrix": depth.camera_matrix, "distortion": depth.distortion}
        return read_intrinsics(raw / depth.intrinsics, **size, **keys)
    if not topic:
        message = "depth images need a file with the camera's intrinsics"
        raise ConfigError(message, key=f"{KEY}.intrinsics")
    stated = rosbag.choose_topic(path, (rosbag.CAMERA_INFO,), depth.camera_info)
    camera = next(rosbag.messages(path, stated, partial(rosbag.camera_info, **size)))
    if camera.distortion and "rect" in topic:
        raise RecordingError(
            "the topic's name says rectified, but its camera_info has a distortion; state the "
            "intrinsics in a file",
            file=path,
            topic=topic,
        )
    return camera
