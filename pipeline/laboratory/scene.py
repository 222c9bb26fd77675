"""The scene before the depth camera, of convex prisms: corners of both ends (2, n, 3) in m, turning
left seen from outside the first.

Along a ray (x, y, 1) the plane of a face lies at an inverse depth linear in x and y, and the ray is
inside between the least of the faces turned to the camera and the greatest of those turned away:
exactly rounded operations decide which face is met, on every processor alike.
"""

import numpy as np

from pipeline.arm.chain import PlanarChain, segment_frames
from pipeline.core.compiled import compiled
from pipeline.core.errors import ConfigError
from pipeline.laboratory.options import SceneOptions

ARC = 16  # facets of half a circle
# m, stands for the distance zero of a plane that passes through the camera: nothing of its face is
# seen, and it bounds the other faces as a plane does from behind
THROUGH = 1e-200


def moved(ends: np.ndarray, rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """Return a prism, every point p at ``rotation @ p + translation``, exactly rounded."""
    return (ends[..., None, :] * rotation).sum(axis=-1) + translation


def faces(ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Outward unit normals n (n + 2, 3) and distances d (n + 2,) m of the planes n · p = d."""
    first, second = ends
    n = len(first)
    # corners far apart, for a normal that their rounding does not turn
    end = np.cross(first[n // 3] - first[0], first[2 * n // 3] - first[0])
    sides = np.cross(second - first, np.roll(first, -1, axis=0) - first)
    normal = np.concatenate([sides, [end, -end]])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return normal, (normal * np.concatenate([first, ends[:, 0]])).sum(axis=-1)


def prism(outline: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return the polygon ``outline`` (n, 2) in x, z, turning left, from y ``low`` to ``high``."""
    edge = np.roll(outline, -1, axis=0) - outline
    after = np.roll(edge, -1, axis=0)
    if not (np.all(edge[:, 0] * after[:, 1] > edge[:, 1] * after[:, 0]) and low < high):
        message = "laboratory.kinect.scene: a solid is wider than long, or has no extent; make it"
        raise ConfigError(f"{message} longer or more slender")
    return np.stack([np.insert(outline, 1, y, axis=1) for y in (low, high)])


def _rectangle(left: float, right: float, bottom: float, top: float) -> np.ndarray:
    return np.array([[left, bottom], [right, bottom], [right, top], [left, top]])


def _rounded(bottom: float, top: float, width: float) -> np.ndarray:
    """Outline of a bar along z whose ends are half circles around (0, bottom) and (0, top)."""
    angle = np.linspace(0.0, np.pi, ARC + 1)
    cap = width / 2 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.concatenate([cap + np.array([0.0, top]), np.array([0.0, bottom]) - cap])


def room_prisms(chain: PlanarChain, options: SceneOptions) -> list[np.ndarray]:
    """Turntable, neck, stand, floor and wall, which stand still, in the plane's frame."""
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


def arm_prisms(chain: PlanarChain, options: SceneOptions) -> list[tuple[int, np.ndarray]]:
    """Return the solids of the three links: index of the link, and solid in its segment frame."""
    o, (first, second, third), finger = options, chain.lengths, options.finger_width / 2
    solids = (
        (0, _rounded(0.0, first, o.link_width), o.link_depths[0]),
        (1, _rounded(0.0, second, o.link_width), o.link_depths[1]),
        (2, _rounded(0.0, o.hand_share * third - o.tool_width / 2, o.tool_width), o.link_depths[2]),
        (2, _rectangle(-finger, finger, 0.0, third), o.finger_depth),
    )
    return [(link, prism(outline, -depth / 2, depth / 2)) for link, outline, depth in solids]


def arm_at(
    solids: list[tuple[int, np.ndarray]], chain: PlanarChain, q: np.ndarray
) -> list[np.ndarray]:
    """Return the solids of :func:`arm_prisms` at angles ``q`` (3,) rad in the plane's frame."""
    rotation, origin = segment_frames(chain, q)
    return [moved(solid, rotation[link], origin[link]) for link, solid in solids]


def arccos(cosine: np.ndarray) -> np.ndarray:
    """Return the angle in rad, 0 to π/2, of ``cosine`` by exactly rounded operations."""
    tangent = np.sqrt((1 - cosine) / (1 + cosine))
    for _ in range(3):  # of a half, a quarter, an eighth and a sixteenth of the angle
        tangent = tangent / (1 + np.sqrt(1 + tangent * tangent))
    square, series = tangent * tangent, 0.0
    for power in range(17, 0, -2):  # at most 0.1¹⁹/19 is left of the arc tangent's series
        series = 1 / power - square * series
    return 16 * tangent * series


def cast(solid: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return depth (h, w) along z in m, infinite where nothing is met, and grazing angle (h, w) in
    rad of the rays (x, y, 1), ``x`` (w,), ``y`` (h,), and ``solid``, both in the camera's frame.
    """
    enter, leave, distance = (np.full((len(y), len(x)), value) for value in (np.inf, 0.0, 0.0))
    normals, distances = faces(solid)
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
def _pass(slope, distance, x, y, enter, leave, entered):
    """Inverse depths (1/m) at which rays ``enter`` and ``leave`` (h, w) the faces of one solid, and
    distance of the face ``entered``. A face is at the inverse depth (x, y, 1) · ``slope`` (F, 3),
    at ``distance`` (F,), negative if turned to the camera.
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
