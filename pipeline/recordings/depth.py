"""Tables of depth takes: times of the frames on the camera's clock, and points on the arm."""

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path

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
from pipeline.recordings.quality import DEPTH_CAMERA, quality_row

KEY = "dataset.depth"
# F frames, read one at a time: times (F,) in s on the camera's clock; references (file, or
# bag#message); intrinsics, None for point clouds; frames with evidence; counts, updated by reading
Frames = Iterator[tuple[image.RawDepth | cloud.PointCloud, dict[str, object]]]
DepthTake = tuple[np.ndarray, Sequence[str], Intrinsics | None, Frames, Counter[str]]


def take_paths(raw: Path, depth: Depth) -> dict[str, Path]:
    """Return take → folder or bag; RecordingError where none matches or two share a name."""
    wanted = {"what": "folder of depth frames and no bag", "key": f"{KEY}.takes"}
    return named_takes(
        raw, depth.takes, wanted=lambda p: p.is_dir() or is_bag(p), **wanted
    )


def frame_rows(
    named: tuple[str, Path], depth: Depth, arm: Arm, raw: Path, folder: Path
) -> tuple[pd.DataFrame, list[dict]]:
    """Return the rows of the table ``frames`` of a take (name, and folder or bag) and the quality
    rows; write the arm's points in m below ``folder``. Times are in s since the start of the motion
    capture, on the camera's clock.

    ``frozen_frames``, whose points equal the points of the frame before, are left out and counted.
    Raises RecordingError for unreadable or contradictory files, ConfigError for missing options.
    """
    name, path = named
    source = _of_bag if is_bag(path) else _of_folder
    time, references, camera, frames, lost = source(path, depth, raw)
    time = time - (time[0] if depth.start is None else depth.start)
    clouds, valid = zip(*_points(frames, camera, depth, arm), strict=True)
    same = (
        len(after) > 0 and np.array_equal(before, after)
        for before, after in pairwise(clouds)
    )
    frozen, empty = np.array([False, *same]), np.full(2, np.nan)
    kept = [points for points, still in zip(clouds, frozen, strict=True) if not still]
    centroid = np.array(
        [points.mean(axis=0) if len(points) else empty for points in kept]
    )
    rows = {"take": name, "part": "test", "frame": np.arange(len(clouds)), "t": time}
    rows = pd.DataFrame(rows | {"file": references, "valid": valid})[~frozen]
    rows = rows.assign(
        points=[len(points) for points in kept], x=centroid[:, 0], z=centroid[:, 1]
    )
    np.save(folder / f"{name}.npy", np.concatenate(kept))
    dropped = image.dropped_frames(time)
    counts = {"dropped_frames": dropped, "frozen_frames": frozen.sum()} | lost
    share = ("dropped_share", dropped / (dropped + len(clouds)), "share")
    return rows, [
        quality_row(name, "test", DEPTH_CAMERA, *row)
        for row in (*counts.items(), share)
    ]


def _points(
    frames: Frames, camera: Intrinsics | None, depth: Depth, arm: Arm
) -> Iterator[tuple[np.ndarray, float]]:
    """Yield the arm's points (I, 2), m in the arm's plane, and the measured share per frame."""
    pose = (
        Rotation.from_euler("xyz", depth.camera.rpy).as_matrix(),
        np.array(depth.camera.position),
    )
    scale = depth.units_per_metre, depth.saturation, depth.scale_key
    encoding = image.Encoding(
        depth.encoding, *scale, depth.disparity and tuple(depth.disparity)
    )
    segment = partial(cut_cloud, arm, *pose, depth.workspace)
    if camera is not None:
        segment = ArmSegmenter(arm, camera, *pose, depth.workspace)
    elif depth.encoding != "plain":
        message = f"the encoding of point clouds must be plain, got {depth.encoding}"
        raise ConfigError(message, key=f"{KEY}.encoding")
    for frame, where in frames:
        if isinstance(frame, cloud.PointCloud):
            share = len(frame.points) / (len(frame.points) + frame.missing)
            measured = frame.points / depth.units_per_metre
        else:
            measured = image.metres(frame, encoding, **where)
            share = float(np.count_nonzero(measured > 0) / measured.size)
        yield segment(measured), share


def _of_folder(path: Path, depth: Depth, raw: Path) -> DepthTake:
    if depth.index is not None:
        listed = image.read_index(path / depth.index)
    elif depth.frames is not None:
        listed = image.numbered_frames(path, depth.frames, rate=depth.rate)
    else:
        message = "a folder of frames needs an index, or frames: a glob of numbered file names"
        raise ConfigError(message, key=f"{KEY}.index")
    files, counts = [path / name for name in listed.files], Counter(listed.counts)
    camera = None if all(map(cloud.is_cloud, files)) else _intrinsics(path, depth, raw)

    def frames() -> Frames:
        for file in files:
            if camera is not None:
                yield (
                    image.read_depth(file, shape=(camera.height, camera.width)),
                    {"file": file},
                )
                continue
            points = cloud.read_cloud(file)
            turned = (
                {}
                if points.viewpoint == cloud.UNTURNED
                else {"unapplied_viewpoints": 1}
            )
            counts.update(points.counts | turned)
            yield points, {}

    references = [os.path.relpath(file, raw) for file in files]
    return listed.time, references, camera, frames(), counts


def _of_bag(path: Path, depth: Depth, raw: Path) -> DepthTake:
    """Return the bag's take: one pass reads the times in the headers, a second one the frames."""
    topic = rosbag.choose_topic(path, (rosbag.IMAGE, rosbag.CLOUD), depth.topic)
    time = np.array([*rosbag.messages(path, topic, rosbag.seconds)])
    where = {"file": path, "topic": topic}
    if (late := np.flatnonzero(np.diff(time) <= 0)).size:
        raise RecordingError(
            "the time does not increase", **where, number=int(late[0]) + 1
        )
    pick, camera = rosbag.cloud_points, None
    if rosbag.topics(path)[topic] == rosbag.IMAGE:
        camera = _intrinsics(path, depth, raw, topic)
        pick = partial(rosbag.image_pixels, shape=(camera.height, camera.width))

    def frames() -> Frames:
        for number, each in enumerate(rosbag.messages(path, topic, pick)):
            if depth.units_per_metre != 1 and (
                camera is None or each.dtype == np.float32
            ):
                message = "ROS defines float images and clouds in metres: units_per_metre must"
                raise ConfigError(
                    f"{message} be 1", key=f"{KEY}.units_per_metre", file=path
                )
            evidence = where | {"number": number}
            if camera is None:
                cloud.require_near(each, **evidence)
                yield cloud.PointCloud.measured(each), evidence
            else:
                yield image.RawDepth(each), evidence

    references = [f"{path.relative_to(raw)}#{number}" for number in range(len(time))]
    return time, references, camera, frames(), Counter()


def _intrinsics(path: Path, depth: Depth, raw: Path, topic: str = "") -> Intrinsics:
    """Return the intrinsics of a file, else of the bag's camera of the images in ``topic``."""
    if depth.width is None or depth.height is None:
        raise ConfigError(
            "depth images need the options width and height", key=f"{KEY}.width"
        )
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
        message = "the topic's name says rectified, but its camera_info has a distortion; state the"
        raise RecordingError(f"{message} intrinsics in a file", file=path, topic=topic)
    return camera
