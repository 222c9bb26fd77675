"""Where a take's depth frames come from: files with an index or with numbered names, or the
messages of a ROS bag.

Either source has ``time`` (F,) s on the camera's clock, ``references`` (F,), ``counts``, ``camera``
(None where the frames are point clouds) and ``read``: of each of the frames asked for, depth (H, W)
in m with NaN or points (N, 3) in m, and the share that was measured.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.instruments import Depth
from pipeline.formats.depth.cloud import UNTURNED, PointCloud, is_cloud, read_cloud
from pipeline.formats.depth.image import Encoding, RawDepth, metres, read_depth
from pipeline.formats.depth.index import numbered_frames, read_index
from pipeline.formats.depth.intrinsics import Intrinsics, read_intrinsics
from pipeline.formats.depth.messages import (
    CAMERA_INFO,
    CLOUD,
    IMAGE,
    camera_info,
    cloud_points,
    image_pixels,
)
from pipeline.formats.rosbag import choose_topic, messages, seconds, topics

Measured = tuple[np.ndarray, float]


class FileFrames:
    """Images or point clouds in the folder ``path`` below ``raw``.

    ``counts`` of clouds grow as they are read: ``surplus_bytes`` behind the points, and
    ``unapplied_viewpoints``. Raises RecordingError for an index or a calibration that cannot be
    read, a frame outside ``raw``, and a take of images and clouds.
    """

    def __init__(self, path: Path, depth: Depth, raw: Path) -> None:
        if depth.index is None and depth.frames is None:
            raise ConfigError(
                "a folder of frames needs their index, or frames: a glob of their numbered names",
                key="dataset.depth.index",
            )
        index = (
            read_index(path / depth.index)
            if depth.index
            else numbered_frames(path, depth.frames, rate=depth.rate)
        )
        self.time, self.counts = index.time, index.counts
        self._files = [path / name for name in index.files]
        for file in self._files:
            if os.path.relpath(file, raw).startswith(os.pardir):
                raise RecordingError("the index names a frame outside the recordings", file=file)
        self.references = tuple(str(file.relative_to(raw)) for file in self._files)
        self._encoding = _encoding(depth)
        clouds = {is_cloud(file) for file in self._files}
        if len(clouds) > 1:
            raise RecordingError(
                "the take has images and point clouds; choose one by the index or by frames",
                file=path,
            )
        self.camera = None if clouds == {True} else _calibrated(depth, raw)

    def read(self, frames: Iterable[int]) -> Iterator[Measured]:
        for frame in frames:
            file = self._files[frame]
            if self.camera is None:
                cloud = read_cloud(file)
                for name, number in cloud.counts.items():
                    self.counts[name] = self.counts.get(name, 0) + number
                if cloud.viewpoint != UNTURNED:
                    name = "unapplied_viewpoints"
                    self.counts[name] = self.counts.get(name, 0) + 1
                yield _cloud(cloud, self._encoding)
            else:
                raw = read_depth(file, shape=(self.camera.height, self.camera.width))
                yield _image(raw, self._encoding, file=file)


class BagFrames:
    """Images or point clouds of one topic of the bag ``path``, by the time in their headers; a pass
    over the bag for the times, another for what is asked for.

    Raises RecordingError for a bag that cannot be read, a topic that is none or not the only one,
    messages without time or out of order, and an Image in metres or a PointCloud2 whose unit is
    said to be another.
    """

    def __init__(self, path: Path, depth: Depth, raw: Path) -> None:
        self._bag, self._encoding = path, _encoding(depth)
        self._topic = choose_topic(path, (IMAGE, CLOUD), depth.topic)
        stamps = [*messages(path, self._topic, seconds)]
        self.time, self.counts = np.array(stamps), {}
        if (late := np.flatnonzero(np.diff(self.time) <= 0)).size:
            raise RecordingError("the time does not increase", **self._evidence(int(late[0]) + 1))
        self.references = tuple(
            f"{path.relative_to(raw)}#{number}" for number in range(len(stamps))
        )
        self.camera = None
        if topics(path)[self._topic] == IMAGE:
            self.camera = _calibrated(depth, raw) if depth.intrinsics else self._camera_info(depth)
        else:
            self._require_metres("PointCloud2")

    def read(self, frames: Iterable[int]) -> Iterator[Measured]:
        clouds, wanted = self.camera is None, [*frames]
        shape = None if clouds else (self.camera.height, self.camera.width)
        pick = cloud_points if clouds else partial(image_pixels, shape=shape)
        held = messages(self._bag, self._topic, pick, {*wanted})
        for number, values in zip(sorted({*wanted}), held, strict=True):
            if clouds:
                yield _cloud(PointCloud.measured(values), self._encoding)
                continue
            if values.dtype == np.float32:
                self._require_metres("Image in metres")
            yield _image(RawDepth(values), self._encoding, **self._evidence(number))

    def _camera_info(self, depth: Depth) -> Intrinsics:
        topic = choose_topic(self._bag, (CAMERA_INFO,), depth.camera_info)
        width, height = _size(depth)
        read = partial(camera_info, width=width, height=height)
        camera = next(messages(self._bag, topic, read, {0}))
        if camera.distortion and "rect" in self._topic:
            raise RecordingError(
                "the images are called rectified, and their camera distorted; give the "
                "intrinsics that hold for them in a file",
                file=self._bag,
                topic=self._topic,
            )
        return camera

    def _require_metres(self, kind: str) -> None:
        if self._encoding.units_per_metre != 1:
            raise ConfigError(
                f"ROS defines {kind} in metres: units_per_metre must be 1",
                key="dataset.depth.units_per_metre",
                file=self._bag,
            )

    def _evidence(self, number: int) -> dict[str, object]:
        return {"file": self._bag, "topic": self._topic, "number": number}


def _encoding(depth: Depth) -> Encoding:
    disparity = None if depth.disparity is None else tuple(depth.disparity)
    return Encoding(
        depth.encoding, depth.units_per_metre, depth.saturation, depth.scale_key, disparity
    )


def _size(depth: Depth) -> tuple[int, int]:
    if depth.width is None or depth.height is None:
        raise ConfigError("depth images need their width and height", key="dataset.depth.width")
    return depth.width, depth.height


def _calibrated(depth: Depth, raw: Path) -> Intrinsics:
    width, height = _size(depth)
    if depth.intrinsics is None:
        raise ConfigError(
            "depth images need a file of their camera's intrinsics", key="dataset.depth.intrinsics"
        )
    return read_intrinsics(
        raw / depth.intrinsics,
        width=width,
        height=height,
        matrix=depth.camera_matrix,
        distortion=depth.distortion,
    )


def _image(raw: RawDepth, encoding: Encoding, **evidence: object) -> Measured:
    depth = metres(raw, encoding, **evidence)
    return depth, float(np.count_nonzero(depth > 0) / depth.size)


def _cloud(cloud: PointCloud, encoding: Encoding) -> Measured:
    if encoding.kind != "plain":
        raise ConfigError(
            f"point clouds are not encoded in {encoding.kind}; their encoding is plain",
            key="dataset.depth.encoding",
        )
    return cloud.points / encoding.units_per_metre, len(cloud.points) / (
        len(cloud.points) + cloud.missing
    )
