"""A Kinect v2 that looks at the arm's plane: exact depth images, and what the sensor would make of them.

Camera frame: x right, y down, z forward along the optical axis (OpenCV's). Pixel (u, v) sees along ((u − c_x)/f_x, (v − c_y)/f_y, 1);
images are free of lens distortion, as rectified ones are. Depth is the z coordinate, not the range along the ray.
"""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.arm.model import Arm
from pipeline.errors import ConfigError
from pipeline.twin.options import KinectOptions
from pipeline.twin.scene import ArmSolid, Solid, cast, room_solid

REACH = 3  # px, how far lateral noise may carry an edge; beyond it lies 1 draw in 5000 at the smallest standard deviation
BIAS_STEP = 1e-3  # m, grid of the bias table: the bias varies over decimetres


def draw_bias(options: KinectOptions, rng: np.random.Generator) -> np.ndarray:
    """The session's systematic error of depth: its value (K,) in m at depths 0, 1 mm, 2 mm … up to the end of the range."""
    depth = np.arange(0.0, options.range[1] + BIAS_STEP, BIAS_STEP)
    phase = rng.uniform(0, 2 * np.pi)
    offset = options.bias_offset_std * rng.standard_normal()
    bias = offset + options.bias_wiggle * np.sin(2 * np.pi * depth / options.bias_period + phase)
    # rounded: a processor's last bit of the sine must not reach the image
    return np.round(bias, 7).astype(np.float32)


def _grazing_term(grazing: np.ndarray, options: KinectOptions) -> np.ndarray:
    """θ/(π/2 − θ) up to the grazing limit, past which no pixel has a depth."""
    angle = np.minimum(grazing, np.float32(options.grazing_limit))
    return angle / (np.float32(np.pi / 2) - angle)


def axial_std(depth: np.ndarray, grazing: np.ndarray, options: KinectOptions) -> np.ndarray:
    """σ_z in m at depth z (m) and grazing angle θ (rad), of the arguments' common shape; Fankhauser et al. (2015)."""
    a, b, c, d = (np.float32(value) for value in options.axial)
    return a + depth * (b + c * depth) + d * depth * np.sqrt(depth) * _grazing_term(grazing, options) ** 2


def lateral_std(grazing: np.ndarray, options: KinectOptions) -> np.ndarray:
    """σ_L in px, each axis, at grazing angle θ (rad); Nguyen et al. (2012)."""
    a, b = (np.float32(value) for value in options.lateral)
    return a + b * _grazing_term(grazing, options)


def corrupt(depth: np.ndarray, grazing: np.ndarray, bias: np.ndarray, options: KinectOptions, rng: np.random.Generator) -> np.ndarray:
    """The sensor's image (h, w) in mm, uint16, 0 where it has no depth, of an exact ``depth`` (h, w) in m and ``grazing`` angle in rad.

    In this order: lateral noise moves edges (inside surfaces the axial law, measured on planes, holds it already); systematic and
    axial error; loss and mixing at edges; loss beyond range and grazing limit; rounding to 1 mm. ``bias`` is from :func:`draw_bias`.
    Only operations that IEEE 754 rounds exactly act on the image, so its bytes do not depend on the processor.
    """
    exact = np.where(depth > 0, depth, np.float32(np.inf)).astype(np.float32, copy=False)
    around = {"kernel": np.ones((3, 3), np.uint8), "borderType": cv2.BORDER_REPLICATE}
    near, far = cv2.erode(exact, **around), cv2.dilate(exact, **around)
    edge = far > near * np.float32(1 + options.edge_ratio)
    band = np.flatnonzero(cv2.dilate(edge.view(np.uint8), np.ones((2 * REACH + 1, 2 * REACH + 1), np.uint8)))
    rows, columns = np.divmod(band, exact.shape[1])
    spread = lateral_std(grazing.ravel()[band], options)
    shift = np.rint(spread * rng.standard_normal((2, band.size), dtype=np.float32)).clip(-REACH, REACH).astype(np.intp)
    source = (np.clip(rows + shift[0], 0, exact.shape[0] - 1), np.clip(columns + shift[1], 0, exact.shape[1] - 1))
    image, angle = exact.copy(), grazing.astype(np.float32)
    image.ravel()[band], angle.ravel()[band] = exact[source], grazing[source]

    visible = (image <= options.range[1]) & (angle <= options.grazing_limit)
    image = np.where(visible, image, np.float32(0))
    noise = rng.standard_normal(image.shape, dtype=np.float32)
    measured = image + bias[(image * np.float32(1 / BIAS_STEP)).astype(np.intp)] + axial_std(image, angle, options) * noise

    border = np.flatnonzero(edge)
    fate, weight = rng.random((2, border.size), dtype=np.float32)
    lost, mixes = fate < options.edge_lost, (fate >= options.edge_lost) & (fate < options.edge_lost + options.edge_mixed)
    mixed = border[mixes]
    front, back = near.ravel()[mixed], far.ravel()[mixed]
    measured.ravel()[mixed] = front + weight[mixes] * (back - front)
    visible.ravel()[mixed] = True
    visible.ravel()[border[lost]] = False

    visible &= (measured >= options.range[0]) & (measured <= options.range[1])
    return np.where(visible, np.rint(measured * np.float32(1000)), np.float32(0)).astype(np.uint16)


def _about(axis: int, angle: float) -> np.ndarray:
    """Rotation (3, 3) by ``angle`` (rad) about a coordinate axis."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.eye(3)
    rotation[[i, j], [i, j]] = np.cos(angle)
    rotation[i, j], rotation[j, i] = -np.sin(angle), np.sin(angle)
    return rotation


class DepthCamera:
    """A Kinect v2 on the −y side of the arm's plane, looking along its normal but for the errors of its set-up."""

    def __init__(self, arm: Arm, options: KinectOptions, bias: np.ndarray) -> None:
        """``bias``: the session's systematic error, from :func:`draw_bias`."""
        self.options, self.bias = options, bias
        # columns: the camera's axes in the plane's frame, x along x, y down, z along the normal, then yaw, pitch and roll
        facing = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
        self._rotation = facing @ _about(1, options.yaw) @ _about(0, options.pitch) @ _about(2, options.roll)
        self._position = np.array([options.aim[0], 0.0, options.aim[1]]) - options.distance * self._rotation[:, 2]
        #: pose of the camera in the arm's base frame: a point p of the camera's frame (m) is at ``rotation @ p + translation``
        self.rotation = arm.rotation @ self._rotation
        self.translation = arm.to_base(self._position)
        v, u = np.mgrid[: options.height, : options.width]
        self._directions = np.stack([(u - options.cx) / options.fx, (v - options.cy) / options.fy, np.ones(u.shape)], axis=-1)
        self._arm = ArmSolid(arm.chain, options.scene)
        self._room = cast(self._in_camera(room_solid(arm.chain, options.scene)), self._directions)

    def _in_camera(self, solid: Solid) -> Solid:
        return Solid((solid.vertices - self._position) @ self._rotation, solid.triangles)

    def _window(self, solid: Solid) -> tuple[slice, slice]:
        """Rows and columns of the image that a solid of the camera's frame covers; ConfigError where it is not wholly in view."""
        x, y, z = solid.vertices.T
        sizes = (self.options.height, self.options.width)
        if np.all(z > 0):
            rows, columns = self.options.fy * y / z + self.options.cy, self.options.fx * x / z + self.options.cx
            if all(p.min() >= 0 and p.max() <= size - 1 for p, size in zip((rows, columns), sizes, strict=True)):
                return tuple(slice(int(np.floor(p.min())), int(np.ceil(p.max())) + 1) for p in (rows, columns))
        raise ConfigError(
            "twin.kinect: the arm is not wholly in the image; put the camera further away or aim it anew",
            distance=self.options.distance, aim=self.options.aim,
        )  # fmt: skip

    def render(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Exact depth (height, width) in m, 0 where nothing is, and grazing angle in rad, both float32, at angles ``q`` (3,) in rad.

        Raises ConfigError where the arm is not wholly in view.
        """
        depth, grazing = (image.copy() for image in self._room)
        solid = self._in_camera(self._arm.at(q))
        window = self._window(solid)
        arm_depth, arm_grazing = cast(solid, self._directions[window])
        nearer = arm_depth < depth[window]
        depth[window][nearer], grazing[window][nearer] = arm_depth[nearer], arm_grazing[nearer]
        return np.where(np.isfinite(depth), depth, 0.0).astype(np.float32), grazing.astype(np.float32)

    def observe(self, q: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """The sensor's depth image (height, width) in mm, uint16, 0 where it has none, at joint angles ``q`` (3,) in rad."""
        return corrupt(*self.render(q), self.bias, self.options, rng)
