"""A Kinect v2 that looks at the arm's plane. Camera frame: x right, y down, z forward (OpenCV's);
pixel (u, v) sees along ((u − c_x)/f_x, (v − c_y)/f_y, 1), free of distortion; depth is z.
"""

from __future__ import annotations

import numpy as np

from pipeline.arm.model import Arm
from pipeline.core.errors import ConfigError
from pipeline.laboratory.options import KinectOptions
from pipeline.laboratory.scene import arm_at, arm_prisms, cast, moved, room_prisms
from pipeline.laboratory.sensor import read_depth

Window = tuple[slice, slice]  # rows and columns of an image


def _about(axis: int, angle: float) -> np.ndarray:
    """Rotation (3, 3) by ``angle`` (rad) about a coordinate axis."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.eye(3)
    rotation[[i, j], [i, j]] = np.cos(angle)
    rotation[i, j], rotation[j, i] = -np.sin(angle), np.sin(angle)
    return rotation


class DepthCamera:
    """A Kinect v2 on the −y side of the arm's plane, looking along its normal but for the errors of
    its set-up; ``bias`` from :func:`pipeline.laboratory.sensor.draw_bias`; ``rotation`` (3, 3) and
    ``translation`` (3,) m: its pose in the arm's base frame.
    """

    def __init__(self, arm: Arm, options: KinectOptions, bias: np.ndarray) -> None:
        self.options, self._bias, self._chain = options, bias, arm.chain
        # columns: the camera's axes in the plane's frame, x along x, y down, z along the normal,
        # then yaw, pitch and roll
        facing = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
        turn = _about(1, options.yaw) @ _about(0, options.pitch) @ _about(2, options.roll)
        self._rotation = facing @ turn
        aim = np.array([options.aim[0], 0.0, options.aim[1]])
        self._position = aim - options.distance * self._rotation[:, 2]
        self.rotation, self.translation = arm.rotation @ self._rotation, arm.to_base(self._position)
        self._x = (np.arange(options.width) - options.cx) / options.fx
        self._y = (np.arange(options.height) - options.cy) / options.fy
        self._arm = arm_prisms(arm.chain, options.scene)
        # what a ray sees where it meets nothing of the arm; infinite depth where it meets nothing
        depth = np.full((options.height, options.width), np.inf, dtype=np.float32)
        self._room = depth, np.zeros_like(depth)
        for solid in room_prisms(arm.chain, options.scene):
            self._draw(self._in_camera(solid), (slice(None), slice(None)), *self._room)

    def _in_camera(self, solid: np.ndarray) -> np.ndarray:
        return moved(solid, self._rotation.T, -self._rotation.T @ self._position)

    def _draw(self, solid, window: Window, depth: np.ndarray, grazing: np.ndarray) -> None:
        """Draw a solid of the camera's frame, in the rows and columns ``window``."""
        images = cast(solid, self._x[window[1]], self._y[window[0]])
        nearer = images[0] < depth[window]
        for image, new in zip((depth, grazing), images, strict=True):
            np.copyto(image[window], new, where=nearer, casting="same_kind")

    def _window(self, solid: np.ndarray) -> Window:
        """Rows and columns of the image that a solid covers; ConfigError where not in view."""
        o, (x, y, z) = self.options, np.moveaxis(solid, -1, 0)
        if np.all(z > 0):
            sides = (o.fy * y / z + o.cy, o.height), (o.fx * x / z + o.cx, o.width)
            if all(p.min() >= 0 and p.max() <= size - 1 for p, size in sides):
                ends = ((int(np.floor(p.min())), int(np.ceil(p.max())) + 1) for p, _ in sides)
                return tuple(slice(*pair) for pair in ends)
        message = "laboratory.kinect: the arm is not wholly in the image; put the camera further"
        raise ConfigError(f"{message} away or aim it anew", distance=o.distance, aim=o.aim)

    def render(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return exact depth (height, width) in m, 0 where nothing is, and grazing angle in rad,
        float32, at angles ``q`` (3,) in rad; ConfigError where the arm is not wholly in view.
        """
        depth, grazing = (image.copy() for image in self._room)
        for solid in map(self._in_camera, arm_at(self._arm, self._chain, q)):
            self._draw(solid, self._window(solid), depth, grazing)
        depth[np.isinf(depth)] = 0.0
        return depth, grazing

    def observe(self, q: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return the depth image (height, width) in mm, uint16, at angles ``q`` (3,) rad."""
        return read_depth(*self.render(q), self._bias, self.options, rng)
