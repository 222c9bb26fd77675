"""The arm's points in a depth image or a point cloud, as points of the plane in which it moves."""

import cv2
import numpy as np

from pipeline.arm.model import Arm
from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Workspace
from pipeline.formats.depth.cloud import load_open3d
from pipeline.formats.depth.intrinsics import Intrinsics

# until undistorted pixels are exact to about 1e-9 of the focal length; OpenCV's own default stops
# after five steps
UNDISTORTION = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-10)
LINK = 0.03  # m; points of a cloud so near are of one cluster: wider than clouds are thinned to
NEIGHBOURS = 4  # points within LINK that a point on a surface has at least, itself included


class ArmSegmenter:
    """Cuts the arm out of the depth images of one ``camera`` (x right, y down, z forward) at
    ``rotation`` (3, 3) and ``translation`` (3,) m in the arm's base: a pixel's depth d is the point
    c + d·r of the plane. ConfigError where no pixel sees the arm.
    """

    def __init__(
        self,
        arm: Arm,
        camera: Intrinsics,
        rotation: np.ndarray,
        translation: np.ndarray,
        crop: Workspace,
    ) -> None:
        self.crop, self.origin = crop, arm.chain.origin
        self.reach = float(arm.chain.lengths.sum()) + crop.girth
        self.camera, shape = arm.to_plane(translation), (camera.height, camera.width)
        grid = np.meshgrid(*(np.arange(size, dtype=float) for size in shape[::-1]))
        pixels = np.stack([each.ravel() for each in grid], axis=-1)[:, None]
        # where there is no distortion, OpenCV would still search for the pixel that it leads to
        bend = np.array(camera.distortion) if np.any(camera.distortion) else None
        lens = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
        ideal = cv2.undistortPoints(pixels, lens, bend, None, None, None, UNDISTORTION)[:, 0]
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
            raise ConfigError(f"{message} intrinsics and the crop", key="dataset.depth.camera")
        across, down = np.flatnonzero(sees.any(axis=0)), np.flatnonzero(sees.any(axis=1))
        self.window = (slice(down[0], down[-1] + 1), slice(across[0], across[-1] + 1))
        self.across_plane = rays[1][self.window].copy()
        self.in_plane = [rays[i][self.window].ravel() for i in (0, 2)]

    def __call__(self, depth: np.ndarray) -> np.ndarray:
        """Return points (I, 2) of the arm (x, z in the plane, m) of ``depth`` (rows, columns) m, 0
        or NaN without a measurement, row by row: in the slab about the plane, in reach, no part of
        the base or of a small patch, and thinned evenly.
        """
        crop, depth = self.crop, depth[self.window]
        with np.errstate(invalid="ignore"):
            across = depth * self.across_plane
            across += self.camera[1]
            on_plane = (np.abs(across, out=across) <= crop.half_depth) & (depth > 0)
        pixels, depths = np.flatnonzero(on_plane), depth[on_plane]
        x, z = (self.camera[2 * i] + depths * self.in_plane[i][pixels] for i in (0, 1))
        arm = _near_arm(x, z, self.origin, self.reach, crop)
        pixels, x, z = pixels[arm], x[arm], z[arm]
        if not len(pixels):
            return np.empty((0, 2))
        # the connected patch of each pixel, in the rows that have any
        width = depth.shape[1]
        first, last = pixels[0] // width, pixels[-1] // width
        mask = np.zeros((last - first + 1, width), dtype=np.uint8)
        inside = pixels - first * width
        mask.ravel()[inside] = 1
        patch = cv2.connectedComponents(mask, connectivity=8)[1].ravel()[inside]
        kept = _thinned(np.flatnonzero(np.bincount(patch)[patch] >= crop.min_pixels), crop)
        return np.stack([x[kept], z[kept]], axis=-1)


def cut_cloud(
    arm: Arm, rotation: np.ndarray, translation: np.ndarray, crop: Workspace, cloud: np.ndarray
) -> np.ndarray:
    """Return the points (I, 2) of the arm (x, z in the plane, m) in a ``cloud`` (N, 3) m at
    ``rotation`` (3, 3) and ``translation`` (3,) m in the arm's base, in its order, by the rules of
    :class:`ArmSegmenter`, without points with fewer than NEIGHBOURS others within LINK. Open3D
    decides by distances alone: its sums over many points depend on their order.
    """
    open3d, reach = load_open3d(), float(arm.chain.lengths.sum()) + crop.girth
    plane = arm.to_plane(cloud @ rotation.T + translation)
    points = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(plane))
    slab = np.array([np.inf, crop.half_depth, np.inf])
    points = points.crop(open3d.geometry.AxisAlignedBoundingBox(-slab, slab))
    x, _, z = np.asarray(points.points).T
    near = _near_arm(x, z, arm.chain.origin, reach, crop)
    points = points.select_by_index(np.flatnonzero(near))
    points = points.remove_radius_outlier(NEIGHBOURS, LINK)[0]
    cluster = np.asarray(points.cluster_dbscan(LINK, 1), dtype=int)
    kept = np.asarray(points.points)[np.bincount(cluster)[cluster] >= crop.min_pixels]
    return _thinned(kept[:, [0, 2]], crop)


def _near_arm(
    x: np.ndarray, z: np.ndarray, origin: np.ndarray, reach: float, crop: Workspace
) -> np.ndarray:
    """True of points in reach that belong neither to the turntable nor to the floor."""
    in_reach = (x - origin[0]) ** 2 + (z - origin[1]) ** 2 <= reach**2
    beside = np.abs(x - origin[0]) > crop.column_half_width
    return in_reach & (beside | (z - origin[1] > crop.column_top)) & (z > crop.floor)


def _thinned(points: np.ndarray, crop: Workspace) -> np.ndarray:
    if len(points) <= crop.max_points:
        return points
    return points[np.arange(crop.max_points) * len(points) // crop.max_points]
