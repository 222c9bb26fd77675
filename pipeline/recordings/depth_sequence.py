"""The depth frames of one take as what the analysis needs of them: the arm's points in its plane,
frame by frame.
"""

from __future__ import annotations

import pickle
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.arm.model import Arm
from pipeline.core.errors import RecordingError
from pipeline.core.options.instruments import Depth
from pipeline.formats.format import is_bag
from pipeline.perception.segment import ArmSegmenter, CloudSegmenter, Crop
from pipeline.recordings.depth_frames import BagFrames, FileFrames
from pipeline.recordings.take_names import named_takes


def take_paths(raw: Path, depth: Depth) -> dict[str, Path]:
    """Take → folder or bag, in the order of their paths; RecordingError where none matches or two
    have one name.
    """
    paths = named_takes(
        raw,
        depth.takes,
        key="dataset.depth.takes",
        wanted=lambda path: path.is_dir() or is_bag(path),
    )
    if not paths:
        raise RecordingError(
            f"no folder of depth frames and no bag matches {depth.takes!r}", file=raw
        )
    return paths


class DepthSequence:
    """Frames of the folder or bag ``path``, read one at a time: memory does not grow with their
    number.

    ``depth`` is the dataset's description of the camera, ``raw`` the folder of the recordings.
    ``time`` (F,) in s since the motion capture's start as far
    as the camera's own clock can tell; ``references`` (F,) say where below ``raw`` each frame is: a
    file, or ``bag#message``.
    """

    def __init__(self, path: Path, depth: Depth, arm: Arm, raw: Path) -> None:
        self._frames = (BagFrames if is_bag(path) else FileFrames)(path, depth, raw)
        self.time = self._frames.time - (
            self._frames.time[0] if depth.start is None else depth.start
        )
        self.references, self.counts = self._frames.references, self._frames.counts
        self._segment = _segmenter(pickle.dumps((self._frames.camera, arm, depth)))

    def points(self, frames: Iterable[int]) -> Iterator[tuple[np.ndarray, float]]:
        """Of each of the ``frames`` (increasing): points (I, 2) of the arm, m in its plane, and the
        share of it that was measured.
        """
        for measured, share in self._frames.read(frames):
            yield self._segment(measured)[0], share


@lru_cache(maxsize=1)
def _segmenter(described: bytes) -> ArmSegmenter | CloudSegmenter:
    """What cuts the arm out of the frames of a camera (None: of point clouds), which is pickled
    with the arm and the description ``depth``: takes of one camera have the same, and its rays take
    as long as several frames.
    """
    camera, arm, depth = pickle.loads(described)
    rotation = Rotation.from_euler("xyz", depth.camera.rpy).as_matrix()
    position, crop = np.array(depth.camera.position), Crop(**asdict(depth.workspace))
    if camera is None:
        return CloudSegmenter(arm, rotation, position, crop)
    matrix = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
    shape = (camera.height, camera.width)
    return ArmSegmenter(arm, matrix, np.array(camera.distortion), rotation, position, shape, crop)
