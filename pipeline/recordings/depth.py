"""Depth takes as tables: the time of every frame on the camera's own clock, and the arm's points.

Frames come from files with an index or with numbered names, or from the messages of a ROS bag.
"""

from __future__ import annotations

import os
import pickle
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import lru_cache, partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from pipeline.arm.model import Arm
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.instruments import Depth
from pipeline.formats.depth import messages as ros
from pipeline.formats.depth.cloud import UNTURNED, PointCloud, is_cloud, read_cloud
from pipeline.formats.depth.image import Encoding, RawDepth, metres, read_depth
from pipeline.formats.depth.index import dropped_frames, numbered_frames, read_index
from pipeline.formats.depth.intrinsics import Intrinsics, read_intrinsics
from pipeline.formats.format import is_bag
from pipeline.formats.rosbag import choose_topic, messages, seconds, topics
from pipeline.perception.segment import ArmSegmenter, CloudSegmenter
from pipeline.recordings.inventory import named_takes
from pipeline.recordings.quality import DEPTH_CAMERA, quality_row

KEY = "dataset.depth"


def take_paths(raw: Path, depth: Depth) -> dict[str, Path]:
    """Return take → folder or bag; RecordingError where none matches or two have one name."""
    wanted = {"key": f"{KEY}.takes", "wanted": lambda path: path.is_dir() or is_bag(path)}
    if paths := named_takes(raw, depth.takes, **wanted):
        return paths
    message = f"no folder of depth frames and no bag matches {depth.takes!r}"
    raise RecordingError(message, file=raw)


def frame_rows(
    named: tuple[str, Path], depth: Depth, arm: Arm, raw: Path, folder: Path
) -> tuple[pd.DataFrame, list[dict]]:
    """Return the rows of the table ``frames`` of a take (name, and folder or bag) on the camera's
    own clock, and their quality; write the arm's points below ``folder``.

    ``frozen_frames``, whose points of the arm are those of the frame before, are counted and left
    out. Raises RecordingError for frames that are no depth images.
    """
    take, path = named
    sequence = DepthSequence(path, depth, arm, raw)
    clouds, valid = zip(*sequence.points(range(len(sequence.time))), strict=True)
    same = [len(a) > 0 and np.array_equal(a, b) for b, a in pairwise(clouds)]
    frozen = np.array([False, *same])
    kept = [points for points, still in zip(clouds, frozen, strict=True) if not still]
    empty = np.full(2, np.nan)
    centroid = np.array([points.mean(axis=0) if len(points) else empty for points in kept])
    rows = {"take": take, "part": "test", "frame": np.arange(len(clouds)), "t": sequence.time}
    rows = pd.DataFrame(rows | {"file": sequence.references, "valid": valid})[~frozen]
    rows = rows.assign(points=[len(points) for points in kept], x=centroid[:, 0], z=centroid[:, 1])
    np.save(folder / f"{take}.npy", np.concatenate(kept))
    dropped = dropped_frames(sequence.time)
    counts = {"dropped_frames": dropped, "frozen_frames": frozen.sum()} | sequence.counts
    share = ("dropped_share", dropped / (dropped + len(clouds)), "share")
    return rows, [quality_row(take, "test", DEPTH_CAMERA, *row) for row in (*counts.items(), share)]


class DepthSequence:
    """Frames of the folder or bag ``path`` below ``raw``, images or point clouds, read one at a
    time.

    ``time`` (F,) s since the motion capture's start by the camera's own clock; ``references`` (F,):
    file, or ``bag#message``; ``counts`` grow as frames are read. Raises RecordingError for files
    that cannot be read or contradict each other, ConfigError for what the options leave open.
    """

    def __init__(self, path: Path, depth: Depth, arm: Arm, raw: Path) -> None:
        disparity = None if depth.disparity is None else tuple(depth.disparity)
        scale = depth.units_per_metre, depth.saturation, depth.scale_key
        self._path, self._depth, self._raw = path, depth, raw
        self._encoding, self._topic = Encoding(depth.encoding, *scale, disparity), ""
        self.counts: Counter[str] = Counter()
        time, self._camera = self._open_bag() if is_bag(path) else self._open_folder()
        self.time = time - (time[0] if depth.start is None else depth.start)
        self._segment = _segmenter(pickle.dumps((self._camera, arm, depth)))

    def points(self, frames: Iterable[int]) -> Iterator[tuple[np.ndarray, float]]:
        """Yield for each of the ``frames`` (increasing) the points (I, 2) of the arm, m in its
        plane, and the share of the frame that was measured.
        """
        for frame, evidence in self._in_bag({*frames}) if self._topic else self._in_folder(frames):
            if isinstance(frame, PointCloud):
                if self._encoding.kind != "plain":
                    message = f"point clouds are not encoded in {self._encoding.kind}"
                    raise ConfigError(f"{message}; their encoding is plain", key=f"{KEY}.encoding")
                share = len(frame.points) / (len(frame.points) + frame.missing)
                measured = frame.points / self._encoding.units_per_metre
            else:
                measured = metres(frame, self._encoding, **evidence)
                share = float(np.count_nonzero(measured > 0) / measured.size)
            yield self._segment(measured)[0], share

    def _open_folder(self) -> tuple[np.ndarray, Intrinsics | None]:
        path, depth = self._path, self._depth
        if depth.index is not None:
            index = read_index(path / depth.index)
        elif depth.frames is not None:
            index = numbered_frames(path, depth.frames, rate=depth.rate)
        else:
            message = "a folder of frames needs their index, or frames: a glob of their numbered"
            raise ConfigError(f"{message} names", key=f"{KEY}.index")
        self.counts.update(index.counts)
        self._files = [path / name for name in index.files]
        for file in self._files:
            if os.path.relpath(file, self._raw).startswith(os.pardir):
                raise RecordingError("the index names a frame outside the recordings", file=file)
        self.references = tuple(str(file.relative_to(self._raw)) for file in self._files)
        clouds = {is_cloud(file) for file in self._files}
        if len(clouds) > 1:
            message = "the take has images and point clouds; choose one by the index or by frames"
            raise RecordingError(message, file=path)
        return index.time, None if clouds == {True} else self._intrinsics()

    def _in_folder(self, frames: Iterable[int]) -> Iterator[tuple[RawDepth | PointCloud, dict]]:
        for file in (self._files[frame] for frame in frames):
            if (camera := self._camera) is not None:
                yield read_depth(file, shape=(camera.height, camera.width)), {"file": file}
                continue
            cloud = read_cloud(file)
            turned = {} if cloud.viewpoint == UNTURNED else {"unapplied_viewpoints": 1}
            self.counts.update(cloud.counts | turned)
            yield cloud, {}

    def _open_bag(self) -> tuple[np.ndarray, Intrinsics | None]:
        """A pass over the bag for the times in the headers; another reads the frames."""
        path, depth = self._path, self._depth
        self._topic = choose_topic(path, (ros.IMAGE, ros.CLOUD), depth.topic)
        time = np.array([*messages(path, self._topic, seconds)])
        if (late := np.flatnonzero(np.diff(time) <= 0)).size:
            raise RecordingError("the time does not increase", **self._message(int(late[0]) + 1))
        name = path.relative_to(self._raw)
        self.references = tuple(f"{name}#{number}" for number in range(len(time)))
        if topics(path)[self._topic] == ros.IMAGE:
            return time, self._intrinsics()
        self._require_metres("PointCloud2")
        return time, None

    def _in_bag(self, frames: set[int]) -> Iterator[tuple[RawDepth | PointCloud, dict]]:
        pick = ros.cloud_points
        if (camera := self._camera) is not None:
            pick = partial(ros.image_pixels, shape=(camera.height, camera.width))
        values = messages(self._path, self._topic, pick, frames)
        for number, each in zip(sorted(frames), values, strict=True):
            if camera is not None and each.dtype == np.float32:
                self._require_metres("Image in metres")
            frame = PointCloud.measured(each) if camera is None else RawDepth(each)
            yield frame, self._message(number)

    def _message(self, number: int) -> dict[str, object]:
        return {"file": self._path, "topic": self._topic, "number": number}

    def _require_metres(self, kind: str) -> None:
        if self._encoding.units_per_metre != 1:
            message = f"ROS defines {kind} in metres: units_per_metre must be 1"
            raise ConfigError(message, key=f"{KEY}.units_per_metre", file=self._path)

    def _intrinsics(self) -> Intrinsics:
        """The calibration in a file, else the message of a bag."""
        depth, path = self._depth, self._path
        if depth.width is None or depth.height is None:
            raise ConfigError("depth images need their width and height", key=f"{KEY}.width")
        size = {"width": depth.width, "height": depth.height}
        if depth.intrinsics is not None:
            keys = {"matrix": depth.camera_matrix, "distortion": depth.distortion}
            return read_intrinsics(self._raw / depth.intrinsics, **size, **keys)
        if not self._topic:
            message = "depth images need a file of their camera's intrinsics"
            raise ConfigError(message, key=f"{KEY}.intrinsics")
        topic = choose_topic(path, (ros.CAMERA_INFO,), depth.camera_info)
        camera = next(messages(path, topic, partial(ros.camera_info, **size), {0}))
        if camera.distortion and "rect" in self._topic:
            message = (
                "the images are called rectified, and their camera distorted; give the intrinsics "
                "that hold for them in a file"
            )
            raise RecordingError(message, file=path, topic=self._topic)
        return camera


@lru_cache(maxsize=1)
def _segmenter(described: bytes) -> ArmSegmenter | CloudSegmenter:
    """Segmenter of a pickled camera (None: point clouds), arm and options, which takes share."""
    camera, arm, depth = pickle.loads(described)
    pose = Rotation.from_euler("xyz", depth.camera.rpy).as_matrix(), np.array(depth.camera.position)
    if camera is None:
        return CloudSegmenter(arm, *pose, depth.workspace)
    matrix = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
    shape = (camera.height, camera.width)
    return ArmSegmenter(arm, matrix, np.array(camera.distortion), *pose, shape, depth.workspace)
