"""Depth images to look at: cut to where the arm moves, in false colours, with the plane's points as
pixels.
"""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.arm.model import Arm
from pipeline.formats.depth.intrinsics import Intrinsics

MARGIN = 0.08  # m round the arm's reach
BEHIND = 0.3  # m behind the arm's plane, what is farther has one colour
LEVELS = 64  # depths told apart: fewer bytes, no less to see


class DepthView:
    """The part of one fixed camera's images in which the ``arm`` moves.

    ``camera`` its intrinsics; ``rotation`` (3, 3) and ``translation`` (3,) m: its pose (x right, y
    down, z forward) in the arm's base frame; ``reached`` (N, 2) points of the plane, m, that the
    view must hold. ``size`` is (width, height) of the view in px.
    """

    def __init__(
        self,
        arm: Arm,
        camera: Intrinsics,
        rotation: np.ndarray,
        translation: np.ndarray,
        reached: np.ndarray,
    ) -> None:
        self._arm, self._rotation, self._translation = arm, rotation, translation
        self._matrix = np.array(
            [[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]]
        )
        self._distortion = np.array(camera.distortion, dtype=float)
        corners = [(x, z) for x in (-MARGIN, MARGIN) for z in (-MARGIN, MARGIN)]
        around = np.concatenate([reached + corner for corner in corners])
        shape = np.array([camera.width, camera.height])
        pixels = self._project(around)
        low, high = (
            np.clip(side, 0, shape).astype(int)
            for side in (np.floor(pixels.min(axis=0)), np.ceil(pixels.max(axis=0)) + 1)
        )
        self._window = (slice(low[1], high[1]), slice(low[0], high[0]))
        self.size = (int(high[0] - low[0]), int(high[1] - low[1]))
        self._corner = low
        depth = self._in_camera(reached)[:, 2]
        self._near, self._far = float(depth.min() - MARGIN), float(depth.max() + BEHIND)

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """(N, 2) px from the view's upper left corner, right and down, of ``points`` (N, 2) of the
        plane (x, z in m).
        """
        return self._project(points) - self._corner

    def colours(self, depth: np.ndarray) -> np.ndarray:
        """(rows, columns, 3) RGB of 8 bits: the view of the ``depth`` (rows, columns) in m, near
        yellow, far blue, black where nothing was measured.
        """
        shown = depth[self._window]
        measured = shown > 0
        nearness = np.clip(
            (self._far - np.where(measured, shown, self._far)) / (self._far - self._near), 0, 1
        )
        levels = np.round(nearness * (LEVELS - 1)) * (255 / (LEVELS - 1))
        colours = cv2.applyColorMap(levels.astype(np.uint8), cv2.COLORMAP_VIRIDIS)
        colours[~measured] = 0
        return cv2.cvtColor(colours, cv2.COLOR_BGR2RGB)

    def _in_camera(self, points: np.ndarray) -> np.ndarray:
        """(N, 3) m in the camera's frame of ``points`` (N, 2) of the plane."""
        spatial = np.stack([points[:, 0], np.zeros(len(points)), points[:, 1]], axis=-1)
        return (self._arm.to_base(spatial) - self._translation) @ self._rotation

    def _project(self, points: np.ndarray) -> np.ndarray:
        nowhere = np.zeros(3)
        pixels, _ = cv2.projectPoints(
            self._in_camera(points), nowhere, nowhere, self._matrix, self._distortion
        )
        return pixels[:, 0]
