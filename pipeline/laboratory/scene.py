"""The scene before the depth camera, the arm, its stand and the room, and where rays meet it.

Everything is a convex prism. Along a ray (x, y, 1) the plane of a face lies at an inverse depth
that is linear in x and y, and the ray is inside of the prism between the least of those of the
faces turned to the camera and the greatest of those turned away. Exactly rounded operations on
doubles thus decide which face is met, also where a ray brushes an edge. Ray casters that work in
single precision decide it there by approximate reciprocals, which differ between makes of
processor, and the images are to have the same bytes on all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arm.chain import PlanarChain
from pipeline.arm.frames import segment_frames
from pipeline.core.compiled import compiled
from pipeline.core.errors import ConfigError
from pipeline.laboratory.options import SceneOptions

ARC = 16  # facets of half a circle
# m, stands for the distance zero of a plane that passes through the camera: nothing of its face is
# seen, and it bounds the other faces as a plane does from behind
THROUGH = 1e-200
AFTER, BEFORE = [1, 2, 0], [2, 0, 1]  # of each axis the others


@dataclass(frozen=True)
class Prism:
    """A convex prism."""

    ends: np.ndarray  # (2, n, 3) m, corners of both ends, turning left seen from outside the first

    def moved(self, rotation: np.ndarray, translation: np.ndarray) -> Prism:
        """Return it with every point p at ``rotation @ p + translation``; no library's product,
        whose last bits follow the instruction set.
        """
        return Prism((self.ends[..., None, :] * rotation).sum(axis=-1) + translation)

    def faces(self) -> tuple[np.ndarray, np.ndarray]:
        """Return outward unit normals n (n + 2, 3) and distances d (n + 2,) in m of the planes n ·
        p = d of sides and ends.
        """
        first, second = self.ends
        n = len(first)
        # corners far apart, for a normal that their rounding does not turn
        end = _cross(first[n // 3] - first[0], first[2 * n // 3] - first[0])
        sides = _cross(second - first, np.roll(first, -1, axis=0) - first)
        normal = np.concatenate([sides, [end, -end]])
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        return normal, (normal * np.concatenate([first, self.ends[:, 0]])).sum(axis=-1)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a × b (..., 3); NumPy's own takes ten times as long for as few."""
    return a[..., AFTER] * b[..., BEFORE] - a[..., BEFORE] * b[..., AFTER]


def prism(outline: np.ndarray, low: float, high: float) -> Prism:
    """Return the polygon ``outline`` (n, 2) in x and z, convex and turning from x to z, extruded
    along y from ``low`` to ``high`` (m); ConfigError for any other outline.
    """
    edge = np.roll(outline, -1, axis=0) - outline
    after = np.roll(edge, -1, axis=0)
    if not (np.all(edge[:, 0] * after[:, 1] > edge[:, 1] * after[:, 0]) and low < high):
        raise ConfigError(
            "laboratory.kinect.scene: a solid has no room for its width in its length, or no "
            "extent; make it longer or more slender",
            width=float(np.ptp(outline[:, 0])),
            depth=high - low,
        )
    return Prism(np.stack([np.insert(outline, 1, y, axis=1) for y in (low, high)]))


def _rectangle(left: float, right: float, bottom: float, top: float) -> np.ndarray:
    return np.array([[left, bottom], [right, bottom], [right, top], [left, top]])


def _rounded(bottom: float, top: float, width: float) -> np.ndarray:
    """Outline of a bar along z whose ends are half circles around (0, bottom) and (0, top)."""
    angle = np.linspace(0.0, np.pi, ARC + 1)
    cap = width / 2 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.concatenate([cap + np.array([0.0, top]), np.array([0.0, bottom]) - cap])


def room_prisms(chain: PlanarChain, options: SceneOptions) -> list[Prism]:
    """Return everything that stands still, in the plane's frame: turntable, neck, stand, floor and
    wall.
    """
    (x, z), far, wall = chain.origin, 20.0, options.wall_distance
    half, stand, floor = options.base_width / 2, options.stand_width / 2, options.floor_height
    gap = z - options.base_gap
    return [
        prism(_rectangle(x - half, x + half, 0.0, gap), -half, half),
        # the neck that carries joint O1, hidden behind the first link
        prism(_rectangle(x - half / 2, x + half / 2, gap, z), -half / 2, half / 2),
        prism(_rectangle(x - stand, x + stand, floor, 0.0), -stand, stand),
        prism(_rectangle(-far, far, floor - 0.1, floor), -far, wall),
        prism(_rectangle(-far, far, floor, far), wall, wall + 0.1),
    ]


class ArmPrisms:
    """The solids of the three links, which move with their segment frames."""

    def __init__(self, chain: PlanarChain, options: SceneOptions) -> None:
        (first, second, third), width = chain.lengths, options.link_width
        hand, finger = options.hand_share * third, options.finger_width / 2
        depths = (*options.link_depths, options.finger_depth)
        outlines = (
            _rounded(0.0, first, width),
            _rounded(0.0, second, width),
            _rounded(0.0, hand - options.tool_width / 2, options.tool_width),
            _rectangle(-finger, finger, 0.0, third),
        )
        self.chain = chain
        #: index of the link and solid in its segment frame
        self.at_rest = [
            (link, prism(outline, -depth / 2, depth / 2))
            for link, outline, depth in zip((0, 1, 2, 2), outlines, depths, strict=True)
        ]

    def at(self, q: np.ndarray) -> list[Prism]:
        """Return the arm at joint angles ``q`` (3,) in rad, in the plane's frame."""
        rotation, origin = segment_frames(self.chain, q)
        return [solid.moved(rotation[link], origin[link]) for link, solid in self.at_rest]


def arccos(cosine: np.ndarray) -> np.ndarray:
    """Return the angle in rad, from 0 to π/2, of ``cosine`` from 0 to 1, of its shape, by exactly
    rounded operations: the last bit of the C library's follows the instruction set.
    """
    tangent = np.sqrt((1 - cosine) / (1 + cosine))
    for _ in range(3):  # of a half, a quarter, an eighth and a sixteenth of the angle
        tangent = tangent / (1 + np.sqrt(1 + tangent * tangent))
    square, series = tangent * tangent, 0.0
    for power in range(17, 0, -2):  # at most 0.1¹⁹/19 is left of the arc tangent's series
        series = 1 / power - square * series
    return 16 * tangent * series


def cast(solid: Prism, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return depth (h, w) along the camera's z axis in m, infinite where nothing is met, and
    grazing angle (h, w) in rad; both float64.

    ``solid`` in the camera's frame, the camera outside of it; ``x`` (w,) and ``y`` (h,) of the
    rays (x, y, 1) through the camera's origin. The grazing angle is the one between ray and surface
    normal: 0 head-on, π/2 along the surface.
    """
    enter, leave, distance = (np.full((len(y), len(x)), value) for value in (np.inf, 0.0, 0.0))
    normals, distances = solid.faces()
    distances[distances == 0] = THROUGH
    _pass(normals / distances[:, None], distances, x, y, enter, leave, distance)
    if np.isinf(enter).any():
        raise ConfigError("laboratory.kinect: the camera is inside a solid of the scene; move it")
    met = enter > leave
    depth, grazing = np.full(met.shape, np.inf), np.zeros(met.shape)
    enter, range_ = enter[met], np.sqrt(x * x + (y * y + 1)[:, None])[met]
    depth[met] = 1.0 / enter
    grazing[met] = arccos(np.minimum(distance[met] * enter / range_, 1.0))
    return depth, grazing


@compiled
def _pass(
    slope: np.ndarray,
    distance: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    enter: np.ndarray,
    leave: np.ndarray,
    entered: np.ndarray,
) -> None:
    """The inverse depths at which the rays ``x`` (w,), ``y`` (h,) ``enter`` and ``leave`` (h, w)
    the faces of one solid, 1/m, and the distance of the face ``entered`` (h, w), m; row by row,
    which stays in the cache.

    The plane of a face lies at the inverse depth (x, y, 1) · ``slope`` (F, 3), and ``distance``
    (F,) from the camera, negative where it is turned to it.
    """
    for row in range(y.size):
        nearest, farthest, of_face = enter[row], leave[row], entered[row]
        for face in range(distance.size):
            across, size = slope[face, 0], -distance[face]
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
                    farthest[column] = inverse if inverse > farthest[column] else farthest[column]
