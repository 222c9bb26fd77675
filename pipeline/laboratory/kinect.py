"""Synthetic Kinect v2 in front of the arm's plane, and a scene of convex prisms.

Camera frame (OpenCV): x right, y down, z forward. Pixel (u, v) is the ray ((u − c_x)/f_x,
(v − c_y)/f_y, 1) without distortion; depth is z. A prism is the array (2, n, 3) m of the corners of
its two ends, counterclockwise seen from outside the first end. The inverse depth of a face's plane
is linear in x and y. A ray is inside the prism between the least inverse depth of the faces toward
the camera and the greatest inverse depth of the other faces. All operations are exactly rounded,
so that the written bytes do not depend on the processor.
"""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.random import Generator

from pipeline.arm.chain import PlanarChain, segment_frames
from pipeline.arm.model import Arm
from pipeline.core.compiled import compiled
from pipeline.core.errors import ConfigError
from pipeline.laboratory.options import KinectOptions, SceneOptions

ARC = 16  # number of facets of a half circle
# m, replaces the distance 0 of a plane through the camera, so that its face counts as turned away
THROUGH = 1e-200
# px, greatest shift of an edge by lateral noise; at the least std 1 draw in 5000 is beyond
REACH = 3
BIAS_STEP = 1e-3  # m, grid of the bias table: the bias varies over decimetres
BIAS_STEPS = np.float32(1 / BIAS_STEP)  # 1/m
QUARTER_TURN = np.float32(np.pi / 2)  # rad
MILLIMETRES = np.float32(1000)  # in a metre
Window = tuple[slice, slice]  # rows and columns of an image


def place_solid(
    ends: np.ndarray,
    rotation: np.ndarray,
    translation: np.ndarray,
) -> np.ndarray:
    """Return the prism with every point p moved to ``rotation @ p + translation``."""
    return (ends[..., None, :] * rotation).sum(axis=-1) + translation


def _faces(ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return outward unit normals n (F, 3) and distances d (F,) m of the face planes n · p = d."""
    first, second = ends
    # use distant corners, to reduce the effect of rounding on the normal
    n = len(first)
    origin = first[0]
    third = first[n // 3]
    two_thirds = first[2 * n // 3]
    end = np.cross(third - origin, two_thirds - origin)
    edges = np.roll(first, -1, axis=0) - first
    sides = np.cross(second - first, edges)

    normal = np.concatenate([sides, [end, -end]])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    corner = np.concatenate([first, ends[:, 0]])
    return normal, (normal * corner).sum(axis=-1)


def prism(outline: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return the prism with the counterclockwise polygon ``outline`` (n, 2) in x, z, from y ``low``
    to ``high``; ConfigError for an outline that is not convex.
    """
    x, z = (np.roll(outline, -1, axis=0) - outline).T  # of the edges
    next_x = np.roll(x, -1)
    next_z = np.roll(z, -1)
    turns_left = np.all(x * next_z > z * next_x)
    if not (turns_left and low < high):
        message = (
            "a solid is wider than long, or has no extent; make it longer or narrower"
        )
        raise ConfigError(message, key="laboratory.kinect.scene")
    ends = [np.insert(outline, 1, y, axis=1) for y in (low, high)]
    return np.stack(ends)


def _rectangle(left: float, right: float, bottom: float, top: float) -> np.ndarray:
    return np.array([[left, bottom], [right, bottom], [right, top], [left, top]])


def _rounded_bar(bottom: float, top: float, width: float) -> np.ndarray:
    """Return the outline of a bar along z with half circles around (0, bottom) and (0, top)."""
    angle = np.linspace(0.0, np.pi, ARC + 1)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    cap = width / 2 * circle
    upper = cap + np.array([0.0, top])
    lower = np.array([0.0, bottom]) - cap
    return np.concatenate([upper, lower])


Span = tuple[float, float]  # least and greatest coordinate in m


def _around(middle: float, half: float) -> Span:
    return middle - half, middle + half


def _box(x: Span, y: Span, z: Span) -> np.ndarray:
    return prism(_rectangle(*x, *z), *y)


def _static_solids(chain: PlanarChain, options: SceneOptions) -> list[np.ndarray]:
    """Return turntable, neck, stand, floor and wall, in the plane's frame."""
    x, z = chain.origin
    half = options.base_width / 2
    stand = options.stand_width / 2
    floor = options.floor_height
    wall = options.wall_distance
    turntable_top = z - options.base_gap
    far = -20.0, 20.0
    return [
        _box(_around(x, half), _around(0.0, half), (0.0, turntable_top)),
        # the neck that carries joint O1, hidden behind the first link
        _box(_around(x, half / 2), _around(0.0, half / 2), (turntable_top, z)),
        _box(_around(x, stand), _around(0.0, stand), (floor, 0.0)),
        _box(far, (far[0], wall), (floor - 0.1, floor)),
        _box(far, (wall, wall + 0.1), (floor, far[1])),
    ]


def _arm_solids(
    chain: PlanarChain,
    options: SceneOptions,
) -> list[tuple[int, np.ndarray]]:
    """Return (index of the link, solid in the link's segment frame) of all solids of the arm."""
    first, second, third = chain.lengths
    finger = options.finger_width / 2
    hand = options.hand_share * third - options.tool_width / 2
    width = options.link_width
    depth_1, depth_2, depth_3 = options.link_depths
    outlines = (
        (0, _rounded_bar(0.0, first, width), depth_1),
        (1, _rounded_bar(0.0, second, width), depth_2),
        (2, _rounded_bar(0.0, hand, options.tool_width), depth_3),
        (2, _rectangle(-finger, finger, 0.0, third), options.finger_depth),
    )
    solids = []
    for link, outline, depth in outlines:
        solids.append((link, prism(outline, -depth / 2, depth / 2)))
    return solids


def _arccos(cosine: np.ndarray) -> np.ndarray:
    """Return the angle in rad, 0 to π/2, of ``cosine``, by exactly rounded operations."""
    tangent = np.sqrt((1 - cosine) / (1 + cosine))  # of half the angle
    for _ in range(3):  # of 1/4, 1/8 and 1/16 of the angle
        tangent = tangent / (1 + np.sqrt(1 + tangent * tangent))
    square = tangent * tangent
    series = 0.0
    # the next term of the arc tangent is at most 0.1¹⁹/19
    for power in range(17, 0, -2):
        series = 1 / power - square * series
    return 16 * tangent * series


def cast(
    solid: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return depth (h, w) in m along z (infinite if the ray misses the ``solid``) and grazing angle
    (h, w) in rad of the rays (x, y, 1), ``x`` (w,), ``y`` (h,), in the camera's frame. Raises
    ConfigError for a camera inside the solid.
    """
    shape = len(y), len(x)
    enter = np.full(shape, np.inf)
    leave = np.zeros(shape)
    distance = np.zeros(shape)

    normals, distances = _faces(solid)
    distances[distances == 0] = THROUGH
    _pass(normals / distances[:, None], distances, x, y, enter, leave, distance)
    if np.isinf(enter).any():
        message = "the camera is inside a solid of the scene; move it"
        raise ConfigError(message, key="laboratory.kinect")

    met = enter > leave
    depth = np.full(shape, np.inf)
    grazing = np.zeros(shape)
    enter = enter[met]
    square = x * x + (y * y + 1)[:, None]
    ray_length = np.sqrt(square)[met]
    cosine = distance[met] * enter / ray_length
    depth[met] = 1.0 / enter
    grazing[met] = _arccos(np.minimum(cosine, 1.0))
    return depth, grazing


@compiled
def _pass(slope, distance, x, y, enter, leave, entered):
    """Update the inverse depths (1/m) at which rays ``enter`` and ``leave`` (h, w) one solid, and
    the distance of the face ``entered``. Face f has the inverse depth (x, y, 1) · ``slope`` (F, 3)
    and the ``distance`` (F,), negative if the face is toward the camera.
    """
    for row in range(y.size):
        nearest = enter[row]
        farthest = leave[row]
        of_face = entered[row]
        for face in range(distance.size):
            across = slope[face, 0]
            size = -distance[face]
            down = slope[face, 1] * y[row] + slope[face, 2]
            if size > 0.0:
                for column in range(x.size):
                    inverse = across * x[column] + down
                    nearer = inverse < nearest[column]
                    nearest[column] = inverse if nearer else nearest[column]
                    of_face[column] = size if nearer else of_face[column]
            else:
                for column in range(x.size):
                    inverse = across * x[column] + down
                    farther = inverse > farthest[column]
                    farthest[column] = inverse if farther else farthest[column]


def _about(axis: int, angle: float) -> np.ndarray:
    """Return the rotation (3, 3) by ``angle`` (rad) about a coordinate axis."""
    cosine = np.cos(angle)
    sine = np.sin(angle)
    plane = [(axis + 1) % 3, (axis + 2) % 3]
    rotation = np.eye(3)
    rotation[np.ix_(plane, plane)] = [[cosine, -sine], [sine, cosine]]
    return rotation


def _orientation(options: KinectOptions) -> np.ndarray:
    """Return the camera's axes in the plane's frame, the columns of (3, 3)."""
    facing = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    yaw = _about(1, options.yaw)
    pitch = _about(0, options.pitch)
    roll = _about(2, options.roll)
    return facing @ (yaw @ pitch @ roll)


class DepthCamera:
    """Kinect v2 in front of the arm's plane; ``rotation``, ``translation`` (m) in the base."""

    def __init__(self, arm: Arm, options: KinectOptions, bias: np.ndarray) -> None:
        self.options = options
        self._bias = bias
        self._chain = arm.chain
        self._rotation = _orientation(options)
        x, z = options.aim
        towards = self._rotation[:, 2]
        self._position = np.array([x, 0.0, z]) - options.distance * towards
        self.rotation = arm.rotation @ self._rotation
        self.translation = arm.to_base(self._position)

        self._x = (np.arange(options.width) - options.cx) / options.fx
        self._y = (np.arange(options.height) - options.cy) / options.fy
        self._arm = _arm_solids(arm.chain, options.scene)

        # images without the arm; the depth is infinite if a ray misses all solids
        shape = options.height, options.width
        depth = np.full(shape, np.inf, np.float32)
        grazing = np.zeros(shape, np.float32)
        whole = slice(None), slice(None)
        for solid in _static_solids(arm.chain, options.scene):
            self._draw(self._in_camera(solid), whole, depth, grazing)
        self._background = depth, grazing

    def _in_camera(self, solid: np.ndarray) -> np.ndarray:
        to_camera = self._rotation.T
        return place_solid(solid, to_camera, -to_camera @ self._position)

    def _draw(
        self,
        solid,
        window: Window,
        depth: np.ndarray,
        grazing: np.ndarray,
    ) -> None:
        """Draw a solid, given in the camera's frame, into the ``window`` of the images."""
        rows, columns = window
        images = cast(solid, self._x[columns], self._y[rows])
        nearer = images[0] < depth[window]
        for image, new in zip((depth, grazing), images, strict=True):
            np.copyto(image[window], new, where=nearer, casting="same_kind")

    def _window(self, solid: np.ndarray) -> Window:
        """Return the rows and columns that a solid covers; ConfigError if it is not in view."""
        camera = self.options
        x, y, z = np.moveaxis(solid, -1, 0)
        if np.all(z > 0):
            row = camera.fy * y / z + camera.cy
            column = camera.fx * x / z + camera.cx
            rows_in_view = row.min() >= 0 and row.max() <= camera.height - 1
            columns_in_view = column.min() >= 0 and column.max() <= camera.width - 1
            if rows_in_view and columns_in_view:
                return _pixels_over(row), _pixels_over(column)
        raise ConfigError(
            f"the arm is not wholly in the image at distance {camera.distance} m and aim "
            f"{camera.aim}; move the camera away or change aim",
            key="laboratory.kinect",
        )

    def render(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return exact depth (h, w) in m (0: none) and grazing angle in rad at ``q`` (3,) rad."""
        depth, grazing = np.copy(self._background)
        rotation, origin = segment_frames(self._chain, q)
        for link, solid in self._arm:
            in_plane = place_solid(solid, rotation[link], origin[link])
            posed = self._in_camera(in_plane)
            self._draw(posed, self._window(posed), depth, grazing)
        depth[np.isinf(depth)] = 0.0
        return depth, grazing

    def observe(self, q: np.ndarray, rng: Generator) -> np.ndarray:
        """Return the depth image (height, width) in mm, uint16, at angles ``q`` (3,) rad."""
        return read_depth(*self.render(q), self._bias, self.options, rng)


def _pixels_over(coordinate: np.ndarray) -> slice:
    """Return the pixels that cover the least to the greatest ``coordinate`` in px."""
    first = int(np.floor(coordinate.min()))
    last = int(np.ceil(coordinate.max()))
    return slice(first, last + 1)


def draw_bias(options: KinectOptions, rng: Generator) -> np.ndarray:
    """Draw the session's systematic depth error (K,) in m at the depths 0, 1 mm, 2 mm, …"""
    depth = np.arange(0.0, options.range[1] + BIAS_STEP, BIAS_STEP)
    phase = rng.uniform(0, 2 * np.pi)
    offset = options.bias_offset_std * rng.standard_normal()
    angle = 2 * np.pi * depth / options.bias_period + phase
    bias = offset + options.bias_wiggle * np.sin(angle)
    # round, since the last bit of the sine depends on the processor
    return np.round(bias, 7).astype(np.float32)


def lateral_deviation(grazing: np.ndarray, options: KinectOptions) -> np.ndarray:
    """Return σ_L in px per axis (Nguyen et al. 2012) at the ``grazing`` angle in rad, which is
    clipped at the grazing limit.
    """
    a, b = options.lateral
    angle = np.minimum(grazing, np.float32(options.grazing_limit))
    return np.float32(a) + np.float32(b) * (angle / (QUARTER_TURN - angle))


class Sensor(NamedTuple):
    """Options of the sensor for compiled code, float32."""

    bias: np.ndarray  # (K,) m, of :func:`draw_bias`
    axial: np.ndarray  # (4,) factors of σ_z, Fankhauser et al. 2015
    grazing_limit: np.float32  # rad
    range: np.ndarray  # (2,) m, least and greatest depth
    # (2,) below the first an edge's pixel is lost, below the second it is mixed
    thresholds: np.ndarray


class EdgePixels(NamedTuple):
    """B pixels at edges of solids in an image of N pixels."""

    pixel: np.ndarray  # (B,) indices in the image
    near: np.ndarray  # (N,) m, least depth in the neighbourhood
    far: np.ndarray  # (N,) m, greatest depth in the neighbourhood
    fate: np.ndarray  # (2, B) uniform variates: loss or mixture, and weight of ``far``


@compiled
def _measure(depth, grazing, source, noise, sensor, edges):
    """Return the image (N,) in mm, uint16, from standard normal ``noise`` (N,), float32, which it
    overwrites. Pixel p shows pixel ``source[p]`` of exact ``depth`` (N,) in m and ``grazing`` angle
    (N,) in rad, none beyond the limits of the ``sensor``; ``edges`` are lost or mixtures of two
    depths.
    """
    image = np.zeros(noise.size, np.uint16)
    a, b, c, d = sensor.axial
    nearest, farthest = sensor.range
    for pixel in range(noise.size):
        z = depth[source[pixel]]
        angle = grazing[source[pixel]]
        if z > 0 and z <= farthest and angle <= sensor.grazing_limit:
            term = angle / (QUARTER_TURN - angle)
            by_distance = a + z * (b + c * z)
            by_angle = d * z * np.sqrt(z) * (term * term)
            std = by_distance + by_angle
            shifted = z + sensor.bias[int(z * BIAS_STEPS)]
            noise[pixel] = noise[pixel] * std + shifted
        else:
            noise[pixel] = 0.0
    lost, mixed = sensor.thresholds
    near = edges.near
    far = edges.far
    fate = edges.fate
    for k in range(edges.pixel.size):
        pixel = edges.pixel[k]
        if fate[0, k] < lost:
            noise[pixel] = 0.0
        elif fate[0, k] < mixed:
            noise[pixel] = near[pixel] + fate[1, k] * (far[pixel] - near[pixel])
    for pixel in range(noise.size):
        if nearest <= noise[pixel] <= farthest:
            image[pixel] = np.uint16(np.rint(noise[pixel] * MILLIMETRES))
    return image


def read_depth(
    depth: np.ndarray,
    grazing: np.ndarray,
    bias: np.ndarray,
    options: KinectOptions,
    rng: Generator,
) -> np.ndarray:
    """Draw the sensor's image (h, w) in mm, uint16 (0: no depth), from exact ``depth`` (h, w) in m
    (0: no surface), ``grazing`` angle (h, w) in rad, float32, and ``bias`` of :func:`draw_bias`.
    """
    exact = np.where(depth > 0, depth, np.float32(np.inf))
    around = {"kernel": np.ones((3, 3), np.uint8), "borderType": cv2.BORDER_REPLICATE}
    near = cv2.erode(exact, **around)
    far = cv2.dilate(exact, **around)
    edge = far > near * np.float32(1 + options.edge_ratio)
    side = 2 * REACH + 1
    around_edge = cv2.dilate(edge.view(np.uint8), np.ones((side, side), np.uint8))
    band = np.flatnonzero(around_edge)

    # lateral noise: a pixel near an edge shows a neighbouring pixel
    lateral = lateral_deviation(grazing.ravel()[band], options)
    variates = rng.standard_normal((2, band.size), dtype=np.float32)
    shift = np.rint(lateral * variates).clip(-REACH, REACH).astype(np.intp)
    places = np.stack(np.unravel_index(band, grazing.shape)) + shift
    source = np.arange(depth.size, dtype=np.int32)
    source[band] = np.ravel_multi_index(tuple(places), grazing.shape, mode="clip")

    noise = rng.standard_normal(depth.size, dtype=np.float32)
    pixels = np.flatnonzero(edge)
    fate = rng.random((2, pixels.size), dtype=np.float32)
    edges = EdgePixels(pixels, near.ravel(), far.ravel(), fate)
    lost = options.edge_lost
    mixed = options.edge_mixed
    sensor = Sensor(
        bias=bias,
        axial=np.array(options.axial, np.float32),
        grazing_limit=np.float32(options.grazing_limit),
        range=np.array(options.range, np.float32),
        thresholds=np.array([lost, lost + mixed], np.float32),
    )
    image = _measure(depth.ravel(), grazing.ravel(), source, noise, sensor, edges)
    return image.reshape(depth.shape)
