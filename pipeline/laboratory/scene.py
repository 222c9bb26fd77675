"""The scene before the depth camera: the arm's solids, its stand and the room; and the door to
Open3D's ray casting.

Everything is a prism, so that Embree only has to say which triangle a ray meets first; the depth is
then taken from that triangle's plane in double precision. Embree's own distance is in single
precision and uses an approximate reciprocal that differs between makes of processor, so it must not
reach an image that is to have the same bytes on every machine.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType

import numpy as np

from pipeline.arm.chain import PlanarChain
from pipeline.arm.segments import segment_frames
from pipeline.laboratory.options import SceneOptions

ARC = 16  # facets of half a circle
NO_TRIANGLE = np.uint32(0xFFFFFFFF)  # Open3D's id of a ray that meets nothing


def _load_open3d() -> ModuleType:
    """Open3D, after the libusb that its library asks for but does not bring along."""
    import libusb_package

    ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
    import open3d

    return open3d


o3d = _load_open3d()


@dataclass(frozen=True)
class Solid:
    """A triangle mesh."""

    vertices: np.ndarray  # (V, 3) m
    triangles: np.ndarray  # (T, 3) indices of vertices


def prism(outline: np.ndarray, low: float, high: float) -> Solid:
    """The convex polygon ``outline`` (n, 2) in x and z, extruded along y from ``low`` to ``high``
    (m).
    """
    n = len(outline)
    vertices = np.concatenate(
        [np.stack([outline[:, 0], np.full(n, y), outline[:, 1]], axis=-1) for y in (low, high)]
    )
    i = np.arange(n)
    after = (i + 1) % n
    fan = np.stack([np.zeros(n - 2, dtype=int), i[1:-1], i[2:]], axis=-1)
    sides = np.concatenate(
        [np.stack([i, after, i + n], axis=-1), np.stack([after, after + n, i + n], axis=-1)]
    )
    return Solid(vertices, np.concatenate([fan, fan + n, sides]))


def _rectangle(left: float, right: float, bottom: float, top: float) -> np.ndarray:
    return np.array([[left, bottom], [right, bottom], [right, top], [left, top]])


def _rounded(bottom: float, top: float, width: float) -> np.ndarray:
    """Outline of a bar along z whose ends are half circles around (0, bottom) and (0, top)."""
    angle = np.linspace(0.0, np.pi, ARC + 1)
    cap = width / 2 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.concatenate([cap + np.array([0.0, top]), np.array([0.0, bottom]) - cap])


def merge(solids: Sequence[Solid]) -> Solid:
    """One mesh of several."""
    first = np.cumsum([0] + [len(solid.vertices) for solid in solids[:-1]])
    return Solid(
        np.concatenate([solid.vertices for solid in solids]),
        np.concatenate(
            [solid.triangles + shift for solid, shift in zip(solids, first, strict=True)]
        ),
    )


def room_solid(chain: PlanarChain, options: SceneOptions) -> Solid:
    """Everything that stands still, in the plane's frame: turntable, stand, floor and wall."""
    x, z = chain.origin
    half, stand, far = options.base_width / 2, options.stand_width / 2, 20.0
    return merge(
        [
            prism(_rectangle(x - half, x + half, 0.0, z - options.base_gap), -half, half),
            # the neck that carries joint O1, hidden behind the first link
            prism(
                _rectangle(x - half / 2, x + half / 2, z - options.base_gap, z), -half / 2, half / 2
            ),
            prism(_rectangle(x - stand, x + stand, options.floor_height, 0.0), -stand, stand),
            prism(
                _rectangle(-far, far, options.floor_height - 0.1, options.floor_height),
                -far,
                options.wall_distance,
            ),
            prism(
                _rectangle(-far, far, options.floor_height, far),
                options.wall_distance,
                options.wall_distance + 0.1,
            ),
        ]
    )


class ArmSolid:
    """The three links as solids that move with their segment frames."""

    def __init__(self, chain: PlanarChain, options: SceneOptions) -> None:
        first, second, third = chain.lengths
        hand, finger = options.hand_share * third, options.finger_width / 2
        half = [depth / 2 for depth in options.link_depths]
        links = [
            prism(_rounded(0.0, first, options.link_width), -half[0], half[0]),
            prism(_rounded(0.0, second, options.link_width), -half[1], half[1]),
            merge(
                [
                    prism(
                        _rounded(0.0, hand - options.tool_width / 2, options.tool_width),
                        -half[2],
                        half[2],
                    ),
                    prism(
                        _rectangle(-finger, finger, 0.0, third),
                        -options.finger_depth / 2,
                        options.finger_depth / 2,
                    ),
                ]
            ),
        ]
        self.chain = chain
        self.at_rest = merge(links)
        self.link = np.repeat(np.arange(3), [len(solid.vertices) for solid in links])

    def at(self, q: np.ndarray) -> Solid:
        """The arm at joint angles ``q`` (3,) in rad, in the plane's frame."""
        rotation, origin = segment_frames(self.chain, q)
        moved = (
            np.einsum("vab,vb->va", rotation[self.link], self.at_rest.vertices) + origin[self.link]
        )
        return Solid(moved, self.at_rest.triangles)


def cast(solid: Solid, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Depth (h, w) along the camera's z axis in m, infinite where nothing is met, and grazing angle
    (h, w) in rad; both float64.

    ``solid`` in the camera's frame; ``directions`` (h, w, 3) of the rays through the camera's
    origin with z component 1. The grazing angle is the one between ray and surface normal: 0
    head-on, π/2 along the surface.
    """
    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(
        o3d.core.Tensor.from_numpy(solid.vertices.astype(np.float32)),
        o3d.core.Tensor.from_numpy(solid.triangles.astype(np.uint32)),
    )
    rays = np.zeros((*directions.shape[:2], 6), dtype=np.float32)
    rays[..., 3:] = directions
    met = scene.cast_rays(o3d.core.Tensor.from_numpy(rays), nthreads=1)["primitive_ids"].numpy()
    corner, *others = np.moveaxis(solid.vertices[solid.triangles], 1, 0)
    normal = np.cross(others[0] - corner, others[1] - corner)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    offset = np.einsum("ta,ta->t", normal, corner)
    hit = met != NO_TRIANGLE
    triangle, ray = met[hit], directions[hit]
    slope = (normal[triangle] * ray).sum(axis=-1)
    depth, grazing = np.full(met.shape, np.inf), np.zeros(met.shape)
    depth[hit] = offset[triangle] / slope
    grazing[hit] = np.arccos(np.minimum(np.abs(slope) / np.sqrt((ray * ray).sum(axis=-1)), 1.0))
    return depth, grazing
