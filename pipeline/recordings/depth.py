"""Depth takes as tables: the time of every frame on the camera's own clock, and the arm's points.

Frames come from files with an index or with numbered names, or from the messages of a ROS bag.
"""

from __future__ import annotations

import os
import pickle
from collections.abc import Iterable, Iterator
from dataclasses import asdict
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
from pipeline.perception.segment import ArmSegmenter, CloudSegmenter, Crop
from pipeline.recordings.inventory import named_takes
from pipeline.recordings.quality import DEPTH_CAMERA, quality_row

Measured = tuple[np.ndarray, float]  # depth (H, W) or points (N, 3) in m; share that was measured


def take_paths(raw: Path, depth: Depth) -> dict[str, Path]:
    """Return take → folder or bag, in the order of their paths; RecordingError where none matches
    or two have one name.
    """
    key, pattern = "dataset.depth.takes", depth.takes
    paths = named_takes(raw, pattern, key=key, wanted=lambda path: path.is_dir() or is_bag(path))
    if not paths:
        message = f"no folder of depth frames and no bag matches {pattern!r}"
        raise RecordingError(message, file=raw)
    return paths


def frame_rows(
    named: tuple[str, Path], depth: Depth, arm: Arm, raw: Path, folder: Path
) -> tuple[pd.DataFrame, list[dict]]:
    """Return the rows of the table ``frames`` of a take, given by its name and its folder or bag,
    on the camera's own clock, and their quality; write the arm's points below ``folder``, so that
    no frame is decoded twice.

    A frame whose points of the arm are the same as in the frame before was not measured: a frozen
    camera shows an earlier time. ``frozen_frames`` are counted and left out. Raises RecordingError
    for frames that are no depth images.
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
    quality = [quality_row(take, "test", DEPTH_CAMERA, key, value) for key, value in counts.items()]
    share = dropped / (dropped + len(clouds))
    quality.append(quality_row(take, "test", DEPTH_CAMERA, "dropped_share", share, "share"))
    return rows, quality


class DepthSequence:
    """Frames of the folder or bag ``path`` below ``raw``, read one at a time: memory does not grow
    with their number. Raises ConfigError and RecordingError as :class:`_Files` and :class:`_Bag`.

    ``time`` (F,) in s since the motion capture's start as far as the camera's own clock can tell;
    ``references`` (F,): file below ``raw``, or ``bag#message``; ``counts`` grow as frames are read.
    """

    def __init__(self, path: Path, depth: Depth, arm: Arm, raw: Path) -> None:
        self._frames = (_Bag if is_bag(path) else _Files)(path, depth, raw)
        time = self._frames.time
        self.time = time - (time[0] if depth.start is None else depth.start)
        self.references, self.counts = self._frames.references, self._frames.counts
        self._segment = _segmenter(pickle.dumps((self._frames.camera, arm, depth)))

    def points(self, frames: Iterable[int]) -> Iterator[tuple[np.ndarray, float]]:
        """Yield for each of the ``frames`` (increasing) the points (I, 2) of the arm, m in its
        plane, and the share of the frame that was measured.
        """
        for measured, share in self._frames.read(frames):
            yield self._segment(measured)[0], share


@lru_cache(maxsize=1)
def _segmenter(described: bytes) -> ArmSegmenter | CloudSegmenter:
    """Segmenter of a pickled camera (None: point clouds), arm and options: takes of one camera
    share it, and its rays take as long as several frames.
    """
    camera, arm, depth = pickle.loads(described)
    rotation = Rotation.from_euler("xyz", depth.camera.rpy).as_matrix()
    position, crop = np.array(depth.camera.position), Crop(**asdict(depth.workspace))
    if camera is None:
        return CloudSegmenter(arm, rotation, position, crop)
    matrix = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
    shape = (camera.height, camera.width)
    return ArmSegmenter(arm, matrix, np.array(camera.distortion), rotation, position, shape, crop)


class _Frames:
    """A take's frames: ``time`` (F,) s on the camera's clock, ``references``, ``counts`` and
    ``camera`` (None where the frames are point clouds).
    """

    camera: Intrinsics | None

    def __init__(self, path: Path, depth: Depth, raw: Path) -> None:
        disparity = None if depth.disparity is None else tuple(depth.disparity)
        scale = depth.units_per_metre, depth.saturation, depth.scale_key
        self.path, self.depth, self.raw = path, depth, raw
        self.encoding = Encoding(depth.encoding, *scale, disparity)

    def image(self, pixels: RawDepth, **evidence: object) -> Measured:
        image = metres(pixels, self.encoding, **evidence)
        return image, float(np.count_nonzero(image > 0) / image.size)

    def cloud(self, cloud: PointCloud) -> Measured:
        if self.encoding.kind != "plain":
            message = (
                f"point clouds are not encoded in {self.encoding.kind}; their encoding is plain"
            )
            raise ConfigError(message, key="dataset.depth.encoding")
        share = len(cloud.points) / (len(cloud.points) + cloud.missing)
        return cloud.points / self.encoding.units_per_metre, share

    @property
    def size(self) -> dict[str, int]:
        if self.depth.width is None or self.depth.height is None:
            raise ConfigError("depth images need their width and height", key="dataset.depth.width")
        return {"width": self.depth.width, "height": self.depth.height}

    @property
    def shape(self) -> tuple[int, int]:
        return self.camera.height, self.camera.width

    def calibrated(self) -> Intrinsics:
        depth, size = self.depth, self.size
        if depth.intrinsics is None:
            message = "depth images need a file of their camera's intrinsics"
            raise ConfigError(message, key="dataset.depth.intrinsics")
        keys = {"matrix": depth.camera_matrix, "distortion": depth.distortion}
        return read_intrinsics(self.raw / depth.intrinsics, **size, **keys)


class _Files(_Frames):
    """Images or point clouds in a folder. Raises RecordingError for an index or a calibration that
    cannot be read, a frame outside ``raw``, and a take of images and clouds.
    """

    def __init__(self, path: Path, depth: Depth, raw: Path) -> None:
        super().__init__(path, depth, raw)
        if depth.index is not None:
            index = read_index(path / depth.index)
        elif depth.frames is not None:
            index = numbered_frames(path, depth.frames, rate=depth.rate)
        else:
            message = (
                "a folder of frames needs their index, or frames: a glob of their numbered names"
            )
            raise ConfigError(message, key="dataset.depth.index")
        self.time, self.counts = index.time, index.counts
        self.files = [path / name for name in index.files]
        for file in self.files:
            if os.path.relpath(file, raw).startswith(os.pardir):
                raise RecordingError("the index names a frame outside the recordings", file=file)
        self.references = tuple(str(file.relative_to(raw)) for file in self.files)
        clouds = {is_cloud(file) for file in self.files}
        if len(clouds) > 1:
            message = "the take has images and point clouds; choose one by the index or by frames"
            raise RecordingError(message, file=path)
        self.camera = None if clouds == {True} else self.calibrated()

    def read(self, frames: Iterable[int]) -> Iterator[Measured]:
        for file in (self.files[frame] for frame in frames):
            if self.camera is not None:
                yield self.image(read_depth(file, shape=self.shape), file=file)
                continue
            cloud = read_cloud(file)
            turned = {} if cloud.viewpoint == UNTURNED else {"unapplied_viewpoints": 1}
            for name, number in (cloud.counts | turned).items():
                self.counts[name] = self.counts.get(name, 0) + number
            yield self.cloud(cloud)


class _Bag(_Frames):
    """Images or point clouds of one topic of a bag, by the time in their headers; a pass over the
    bag for the times, another for the frames.

    Raises RecordingError for a bag that cannot be read, a topic that is none or not the only one,
    messages without time or out of order; ConfigError for an Image in metres or a PointCloud2 whose
    unit is said to be another.
    """

    def __init__(self, path: Path, depth: Depth, raw: Path) -> None:
        super().__init__(path, depth, raw)
        self.topic = choose_topic(path, (ros.IMAGE, ros.CLOUD), depth.topic)
        self.time = np.array([*messages(path, self.topic, seconds)])
        self.counts: dict[str, int] = {}
        if (late := np.flatnonzero(np.diff(self.time) <= 0)).size:
            raise RecordingError("the time does not increase", **self.evidence(int(late[0]) + 1))
        name = path.relative_to(raw)
        self.references = tuple(f"{name}#{number}" for number in range(len(self.time)))
        self.camera = None
        if topics(path)[self.topic] != ros.IMAGE:
            self.require_metres("PointCloud2")
        else:
            self.camera = self.calibrated() if depth.intrinsics else self.camera_info()

    def read(self, frames: Iterable[int]) -> Iterator[Measured]:
        clouds, wanted = self.camera is None, {*frames}
        pick = ros.cloud_points if clouds else partial(ros.image_pixels, shape=self.shape)
        values = messages(self.path, self.topic, pick, wanted)
        for number, each in zip(sorted(wanted), values, strict=True):
            if clouds:
                yield self.cloud(PointCloud.measured(each))
                continue
            if each.dtype == np.float32:
                self.require_metres("Image in metres")
            yield self.image(RawDepth(each), **self.evidence(number))

    def camera_info(self) -> Intrinsics:
        topic = choose_topic(self.path, (ros.CAMERA_INFO,), self.depth.camera_info)
        camera = next(messages(self.path, topic, partial(ros.camera_info, **self.size), {0}))
        if camera.distortion and "rect" in self.topic:
            message = (
                "the images are called rectified, and their camera distorted; give the intrinsics "
                "that hold for them in a file"
            )
            raise RecordingError(message, file=self.path, topic=self.topic)
        return camera

    def require_metres(self, kind: str) -> None:
        if self.encoding.units_per_metre != 1:
            message = f"ROS defines {kind} in metres: units_per_metre must be 1"
            raise ConfigError(message, key="dataset.depth.units_per_metre", file=self.path)

    def evidence(self, number: int) -> dict[str, object]:
        return {"file": self.path, "topic": self.topic, "number": number}
