"""The depth frames of one take as what the analysis needs of them: the arm's points in its plane, frame by frame."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.arm.model import Arm
from pipeline.instruments.depth import metres, read_depth, read_index, read_intrinsics
from pipeline.perception.segment import ArmSegmenter, Crop
from pipeline.schema import Depth


class DepthSequence:
    """Frames of the folder ``path``, read one at a time: memory does not grow with their number.

    ``depth`` is the dataset's description of the camera (:class:`pipeline.schema.Depth`), ``raw`` the folder of the recordings.
    ``time`` (F,) in s on the camera's own clock, ``files`` (F,).
    """

    def __init__(self, path: Path, depth: Depth, arm: Arm, raw: Path) -> None:
        index = read_index(path / depth.index)
        self.time, self.counts = index.time, index.counts
        self.files = [path / name for name in index.files]
        self._units, self._take = depth.units_per_metre, path.name
        camera = read_intrinsics(raw / depth.intrinsics, width=depth.width, height=depth.height)
        self._shape = (camera.height, camera.width)
        self._segment = ArmSegmenter(
            arm,
            np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]]),
            np.array(camera.distortion),
            Rotation.from_euler("xyz", depth.camera.rpy).as_matrix(),
            np.array(depth.camera.position),
            self._shape,
            Crop(**asdict(depth.workspace)),
        )

    def points(self, frame: int) -> tuple[np.ndarray, float]:
        """(I, 2) points of the arm in frame ``frame``, m in the plane, and the share of the image's pixels with a depth."""
        depth = read_depth(self.files[frame], shape=self._shape)
        points, _ = self._segment(metres(depth, units_per_metre=self._units), take=self._take, frame=frame, file=self.files[frame])
        return points, float(np.count_nonzero(depth) / depth.size)
