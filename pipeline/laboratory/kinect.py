"""A Kinect v2 that looks at the arm's plane. Camera frame: x right, y down, z forward (OpenCV's);
pixel (u, v) sees along ((u − c_x)/f_x, (v − c_y)/f_y, 1), free of distortion; depth is z.

The exact image gets noise, a systematic error and losses at edges by exactly rounded operations, so
that bytes do not depend on the processor.
"""

import cv2
import numpy as np
from numpy.random import Generator

from pipeline.arm.model import Arm
from pipeline.core.errors import ConfigError
from pipeline.laboratory.options import KinectOptions
from pipeline.laboratory.scene import arm_at, arm_prisms, cast, moved, room_prisms

# px, how far lateral noise may carry an edge; beyond it lies 1 draw in 5000 at the smallest
# standard deviation
REACH = 3
BIAS_STEP = 1e-3  # m, grid of the bias table: the bias varies over decimetres
Window = tuple[slice, slice]  # rows and columns of an image


def _about(axis: int, angle: float) -> np.ndarray:
    """Rotation (3, 3) by ``angle`` (rad) about a coordinate axis."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.eye(3)
    rotation[[i, j], [i, j]] = np.cos(angle)
    rotation[i, j], rotation[j, i] = -np.sin(angle), np.sin(angle)
    return rotation


class DepthCamera:
    """A Kinect v2 before the arm's plane; ``rotation``, ``translation`` (m) in the base."""

    def __init__(self, arm: Arm, options: KinectOptions, bias: np.ndarray) -> None:
        self.options, self._bias, self._chain = options, bias, arm.chain
        # columns: the camera's axes in the plane's frame
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
        """Return exact depth (h, w) in m, 0 for none, and grazing angle in rad, at ``q`` (3,)."""
        depth, grazing = (image.copy() for image in self._room)
        for solid in map(self._in_camera, arm_at(self._arm, self._chain, q)):
            self._draw(solid, self._window(solid), depth, grazing)
        depth[np.isinf(depth)] = 0.0
        return depth, grazing

    def observe(self, q: np.ndarray, rng: Generator) -> np.ndarray:
        """Return the depth image (height, width) in mm, uint16, at angles ``q`` (3,) rad."""
        return read_depth(*self.render(q), self._bias, self.options, rng)


def draw_bias(options: KinectOptions, rng: Generator) -> np.ndarray:
    """Draw the session's systematic error of depth (K,) in m at depths 0, 1 mm, 2 mm …."""
    depth = np.arange(0.0, options.range[1] + BIAS_STEP, BIAS_STEP)
    phase = rng.uniform(0, 2 * np.pi)
    offset = options.bias_offset_std * rng.standard_normal()
    bias = offset + options.bias_wiggle * np.sin(2 * np.pi * depth / options.bias_period + phase)
    # rounded: a processor's last bit of the sine must not reach the image
    return np.round(bias, 7).astype(np.float32)


def deviations(
    depth: np.ndarray, grazing: np.ndarray, options: KinectOptions
) -> tuple[np.ndarray, np.ndarray]:
    """Return σ_z in m (Fankhauser et al. 2015) and σ_L in px, each axis (Nguyen et al. 2012), at
    depth z (m) and grazing angle θ (rad): in θ/(π/2 − θ) up to the grazing limit, past which no
    pixel has a depth.
    """
    angle = np.minimum(grazing, np.float32(options.grazing_limit))
    term = angle / (np.float32(np.pi / 2) - angle)
    a, b, c, d = (np.float32(value) for value in options.axial)
    axial = a + depth * (b + c * depth) + d * depth * np.sqrt(depth) * term**2
    a, b = (np.float32(value) for value in options.lateral)
    return axial, a + b * term


def read_depth(
    depth: np.ndarray, grazing: np.ndarray, bias: np.ndarray, options: KinectOptions, rng: Generator
) -> np.ndarray:
    """Return the sensor's image (h, w) in mm, uint16, 0 without depth, of exact ``depth`` (h, w) in
    m, 0 where nothing is, ``grazing`` angle (h, w) in rad, float32, and ``bias``.
    """
    exact = np.where(depth > 0, depth, np.float32(np.inf))
    around = {"kernel": np.ones((3, 3), np.uint8), "borderType": cv2.BORDER_REPLICATE}
    near, far = cv2.erode(exact, **around), cv2.dilate(exact, **around)
    edge = far > near * np.float32(1 + options.edge_ratio)
    window = np.ones((2 * REACH + 1, 2 * REACH + 1), np.uint8)
    band = np.flatnonzero(cv2.dilate(edge.view(np.uint8), window))
    # the pixels that those of the band show by lateral noise
    lateral = deviations(depth.ravel()[band], grazing.ravel()[band], options)[1]
    shift = np.rint(lateral * rng.standard_normal((2, band.size), dtype=np.float32))
    shift = shift.clip(-REACH, REACH).astype(np.intp)
    places = np.stack(np.unravel_index(band, grazing.shape)) + shift
    shown = np.ravel_multi_index(tuple(places), grazing.shape, mode="clip")

    visible = (depth > 0) & (depth <= options.range[1]) & (grazing <= options.grazing_limit)
    seen = np.where(visible, depth, np.float32(0))
    mean = seen + bias[(seen * np.float32(1 / BIAS_STEP)).astype(np.intp)]
    parts = [mean, deviations(seen, grazing, options)[0], visible]
    for part in parts:
        part.ravel()[band] = part.ravel()[shown]
    mean, measured, visible = parts
    measured *= rng.standard_normal(measured.shape, dtype=np.float32)
    measured += mean

    border = np.flatnonzero(edge)
    fate, weight = rng.random((2, border.size), dtype=np.float32)
    lost = fate < options.edge_lost
    mixes = ~lost & (fate < options.edge_lost + options.edge_mixed)
    mixed = border[mixes]
    front, back = near.ravel()[mixed], far.ravel()[mixed]
    measured.ravel()[mixed] = front + weight[mixes] * (back - front)
    visible.ravel()[mixed] = True
    visible.ravel()[border[lost]] = False
    visible &= (measured >= options.range[0]) & (measured <= options.range[1])
    return np.rint(np.where(visible, measured, 0) * np.float32(1000)).astype(np.uint16)
