"""The arm's points in a depth image or a point cloud, as points of the plane in which it moves."""

from __future__ import annotations

from collections import Counter

import cv2
import numpy as np

from pipeline.arm.model import Arm
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.instruments import Workspace
from pipeline.formats.depth.cloud import load_open3d

# until undistorted pixels are exact to about 1e-9 of the focal length; OpenCV's own default stops
# after five steps
UNDISTORTION = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-10)
LINK = 0.03  # m; points of a cloud so near are of one cluster: wider than clouds are thinned to
NEIGHBOURS = 4  # points within LINK that a point on a surface has at least, itself included


class ArmSegmenter:
    """Cuts the arm out of the depth images of one fixed camera.

    ``camera_matrix`` (3, 3) and ``distortion`` (k,) as OpenCV's; ``rotation`` (3, 3),
    ``translation`` (3,) m: pose of the camera (x right, y down, z forward) in the arm's base;
    ``shape`` (rows, columns). A pixel at depth d is at c + d·r in the plane. ConfigError where none
    sees the arm.
    """

    def __init__(
        self,
        arm: Arm,
        camera_matrix: np.ndarray,
        distortion: np.ndarray,
        rotation: np.ndarray,
        translation: np.ndarray,
        shape: tuple[int, int],
        crop: Workspace,
    ) -> None:
        self.crop, self.shape, self.origin = crop, tuple(shape), arm.chain.origin
        self.reach = float(arm.chain.lengths.sum()) + crop.girth
        self.camera = arm.to_plane(np.asarray(translation, dtype=float))
        grid = np.meshgrid(*(np.arange(size, dtype=float) for size in shape[::-1]))
        pixels = np.stack([each.ravel() for each in grid], axis=-1)[:, None]
        # where there is no distortion, OpenCV would still search for the pixel that it leads to
        bend = np.asarray(distortion, dtype=float) if np.any(distortion) else None
        matrix = np.asarray(camera_matrix, dtype=float)
        ideal = cv2.undistortPoints(pixels, matrix, bend, None, None, None, UNDISTORTION)[:, 0]
        rays = np.concatenate([ideal, np.ones((len(ideal), 1))], axis=1) @ rotation.T @ arm.rotation
        rays = np.ascontiguousarray(rays.T).reshape(3, *shape)
        sees = np.zeros(shape, dtype=bool)
        # the slab is thin against the reach: a ray that passes the arm's space is in reach at one
        # of its faces
        for face in (-crop.half_depth, crop.half_depth):
            with np.errstate(divide="ignore", invalid="ignore"):
                depth = (face - self.camera[1]) / rays[1]
                away = (self.camera[i] + depth * rays[i] - self.origin[i // 2] for i in (0, 2))
                distance = np.hypot(*away)
            sees |= (depth > 0) & (distance <= self.reach)
        if not sees.any():
            message = "no pixel of the depth camera sees the arm: check the camera's pose, its"
            raise ConfigError(f"{message} intrinsics and the crop", shape=shape)
        across, down = np.flatnonzero(sees.any(axis=0)), np.flatnonzero(sees.any(axis=1))
        self.window = (slice(down[0], down[-1] + 1), slice(across[0], across[-1] + 1))
        self.across_plane = rays[1][self.window].copy()
        self.in_plane = [rays[i][self.window].ravel() for i in (0, 2)]

    def __call__(self, depth: np.ndarray, **evidence: object) -> tuple[np.ndarray, dict[str, int]]:
        """Return points (I, 2) of the arm (x, z in the plane, m) of ``depth`` (rows, columns) m, 0
        or NaN without a measurement, row by row, and the pixels left out by reason: ``no_depth``,
        ``off_plane``, ``out_of_reach``, ``base``, ``isolated`` in small patches, ``thinned``
        evenly. Raises RecordingError for another shape.
        """
        if depth.shape != self.shape:
            message = f"a depth image of {depth.shape} pixels from a camera of {self.shape}"
            raise RecordingError(message, **evidence)
        crop, depth = self.crop, depth[self.window]
        measured = depth > 0
        with np.errstate(invalid="ignore"):
            across = depth * self.across_plane
            across += self.camera[1]
            on_plane = np.abs(across, out=across) <= crop.half_depth
        on_plane &= measured
        pixels, depths = np.flatnonzero(on_plane), depth[on_plane]
        number = np.count_nonzero(measured)
        x, z = (self.camera[2 * i] + depths * self.in_plane[i][pixels] for i in (0, 1))
        in_reach = _in_reach(x, z, self.origin, self.reach)
        arm = in_reach & _above_base(x, z, self.origin, crop)
        reached, own = np.count_nonzero(in_reach), np.count_nonzero(arm)
        dropped = {"no_depth": depth.size - number, "off_plane": number - len(pixels)}
        dropped |= {"out_of_reach": len(pixels) - reached, "base": reached - own}
        pixels, x, z = pixels[arm], x[arm], z[arm]
        patch = _patches(pixels, depth.shape[1])
        kept = np.flatnonzero(np.bincount(patch)[patch] >= crop.min_pixels)
        dropped["isolated"] = own - len(kept)
        dropped["thinned"] = max(0, len(kept) - crop.max_points)
        kept = _thinned(kept, crop)
        return np.stack([x[kept], z[kept]], axis=-1), dropped


class CloudSegmenter:
    """Cuts the arm out of point clouds by the rules of :class:`ArmSegmenter`; ``rotation`` (3, 3),
    ``translation`` (3,) m of the clouds in the arm's base. Open3D decides by distances alone (crop,
    radius outliers, DBSCAN): its sums over many points depend on their order.
    """

    def __init__(
        self, arm: Arm, rotation: np.ndarray, translation: np.ndarray, crop: Workspace
    ) -> None:
        self.arm, self.crop = arm, crop
        self.pose = np.asarray(rotation, dtype=float), np.asarray(translation, dtype=float)
        self.reach = float(arm.chain.lengths.sum()) + crop.girth

    def __call__(self, cloud: np.ndarray) -> tuple[np.ndarray, dict[str, int]]:
        """Return points (I, 2) of the arm (x, z in the plane, m) in the order of the ``cloud`` (N,
        3) m, and the numbers left out by reason; ``isolated`` are points with fewer than NEIGHBOURS
        others within LINK, and small clusters.
        """
        open3d = load_open3d()
        crop, origin, (rotation, translation) = self.crop, self.arm.chain.origin, self.pose
        plane = self.arm.to_plane(cloud @ rotation.T + translation)
        points = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(plane))
        slab, dropped = np.array([np.inf, crop.half_depth, np.inf]), Counter()

        def keep(chosen: open3d.geometry.PointCloud, reason: str) -> np.ndarray:
            nonlocal points
            dropped[reason] += len(points.points) - len(chosen.points)
            points = chosen
            return np.asarray(points.points)[:, [0, 2]]

        def among(mask: np.ndarray) -> open3d.geometry.PointCloud:
            return points.select_by_index(np.flatnonzero(mask))

        found = keep(points.crop(open3d.geometry.AxisAlignedBoundingBox(-slab, slab)), "off_plane")
        found = keep(among(_in_reach(*found.T, origin, self.reach)), "out_of_reach")
        keep(among(_above_base(*found.T, origin, crop)), "base")
        keep(points.remove_radius_outlier(NEIGHBOURS, LINK)[0], "isolated")
        cluster = np.asarray(points.cluster_dbscan(LINK, 1), dtype=int)
        found = keep(among(np.bincount(cluster)[cluster] >= crop.min_pixels), "isolated")
        dropped["thinned"] = max(0, len(found) - crop.max_points)
        return _thinned(found, crop), dict(dropped)


def _patches(pixels: np.ndarray, width: int) -> np.ndarray:
    """(I,) number of the connected patch of each of the growing ``pixels`` (I,) of an image."""
    if not len(pixels):
        return pixels
    first, last = pixels[0] // width, pixels[-1] // width
    mask = np.zeros((last - first + 1, width), dtype=np.uint8)
    inside = pixels - first * width
    mask.ravel()[inside] = 1
    return cv2.connectedComponents(mask, connectivity=8)[1].ravel()[inside]


def _in_reach(x: np.ndarray, z: np.ndarray, origin: np.ndarray, reach: float) -> np.ndarray:
    return (x - origin[0]) ** 2 + (z - origin[1]) ** 2 <= reach**2


def _above_base(x: np.ndarray, z: np.ndarray, origin: np.ndarray, crop: Workspace) -> np.ndarray:
    beside = np.abs(x - origin[0]) > crop.column_half_width
    return (beside | (z - origin[1] > crop.column_top)) & (z > crop.floor)


def _thinned(points: np.ndarray, crop: Workspace) -> np.ndarray:
    if len(points) <= crop.max_points:
        return points
    return points[np.arange(crop.max_points) * len(points) // crop.max_points]
