"""Points of the arm in a depth image or a point cloud, in the plane of the arm's motion."""

import cv2
import numpy as np
from numpy import ndarray

from pipeline.arm.model import Arm
from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Workspace
from pipeline.formats.depth.cloud import load_open3d
from pipeline.formats.depth.intrinsics import Intrinsics

# exact to about 1e-9 of the focal length; OpenCV's default stops after five steps
UNDISTORTION = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-10)
LINK = 0.03  # m; greatest distance of neighbours in a cluster; above the spacing of thinned clouds
# least number of points within LINK of a surface point, which counts itself
NEIGHBOURS = 4


class ArmSegmenter:
    """Segmentation of the arm in depth images of one ``camera`` (x right, y down, z forward) at
    ``rotation`` (3, 3) and ``translation`` (3,) m in the base frame. Depth d is the point c + d·r,
    c the camera, r the pixel's ray. Raises ConfigError if no pixel sees the arm.
    """

    def __init__(
        self,
        arm: Arm,
        camera: Intrinsics,
        rotation: ndarray,
        translation: ndarray,
        crop: Workspace,
    ) -> None:
        self.crop = crop
        self.arm = arm
        self.camera = arm.to_plane(translation)
        shape = camera.height, camera.width
        rays = _rays(camera) @ rotation.T @ arm.rotation
        rays = np.ascontiguousarray(rays.T).reshape(3, *shape)

        x0, z0 = arm.chain.origin
        reach = arm.chain.lengths.sum() + crop.girth
        sees = np.zeros(shape, dtype=bool)
        # the slab is thin: a ray through the workspace is in reach at one face of the slab
        for face in (-crop.half_depth, crop.half_depth):
            with np.errstate(divide="ignore", invalid="ignore"):
                depth = (face - self.camera[1]) / rays[1]
                x = self.camera[0] + depth * rays[0] - x0
                z = self.camera[2] + depth * rays[2] - z0
                distance = np.hypot(x, z)
            sees |= (depth > 0) & (distance <= reach)
        if not sees.any():
            raise ConfigError(
                "no pixel of the depth camera sees the arm: check the camera's pose, its "
                "intrinsics and the crop",
                key="dataset.depth.camera",
            )

        across = np.flatnonzero(sees.any(axis=0))
        down = np.flatnonzero(sees.any(axis=1))
        rows = slice(down[0], down[-1] + 1)
        columns = slice(across[0], across[-1] + 1)
        self.window = (rows, columns)
        self.across_plane = rays[1][self.window].copy()
        self.in_plane = [rays[i][self.window].ravel() for i in (0, 2)]

    def __call__(self, depth: ndarray) -> ndarray:
        """Return the arm's points (I, 2) (x, z in the plane, m) in ``depth`` (rows, columns) m, 0
        or NaN for no measurement, in row order. Points are in the slab about the plane, in reach,
        outside the base, in patches of at least ``min_pixels``, and thinned evenly.
        """
        depth = depth[self.window]
        with np.errstate(invalid="ignore"):
            across = depth * self.across_plane
            across += self.camera[1]
            in_slab = np.abs(across, out=across) <= self.crop.half_depth
            on_plane = in_slab & (depth > 0)
        pixels = np.flatnonzero(on_plane)
        depths = depth[on_plane]
        x = self.camera[0] + depths * self.in_plane[0][pixels]
        z = self.camera[2] + depths * self.in_plane[1][pixels]

        near = _near_arm(x, z, self.arm, self.crop)
        pixels = pixels[near]
        x = x[near]
        z = z[near]
        if not len(pixels):
            return np.empty((0, 2))

        # label of each pixel's connected patch, in the occupied rows
        width = depth.shape[1]
        first = pixels[0] // width
        last = pixels[-1] // width
        mask = np.zeros((last - first + 1, width), dtype=np.uint8)
        inside = pixels - first * width
        mask.ravel()[inside] = 1
        _, patches = cv2.connectedComponents(mask, connectivity=8)
        patch = patches.ravel()[inside]
        is_large = np.bincount(patch)[patch] >= self.crop.min_pixels
        chosen = _thin(np.flatnonzero(is_large), self.crop)
        return np.stack([x[chosen], z[chosen]], axis=-1)


def _rays(camera: Intrinsics) -> ndarray:
    """Return the points (rows·columns, 3) of the pixels' rays at a depth of 1, in the camera's
    frame.
    """
    rows, columns = np.indices((camera.height, camera.width))
    pixels = np.stack([columns, rows], axis=-1).astype(float)
    pixels = pixels.reshape(-1, 1, 2)
    # without distortion, None saves OpenCV's iterations
    bend = np.array(camera.distortion) if np.any(camera.distortion) else None
    ideal = cv2.undistortPoints(
        pixels,
        camera.matrix,
        bend,
        criteria=UNDISTORTION,
    )
    return cv2.convertPointsToHomogeneous(ideal)[:, 0]


def cut_cloud(
    arm: Arm,
    rotation: ndarray,
    translation: ndarray,
    crop: Workspace,
    cloud: ndarray,
) -> ndarray:
    """Return the arm's points (I, 2) (x, z in the plane, m) in a ``cloud`` (N, 3) m at ``rotation``
    (3, 3) and ``translation`` (3,) m in the base frame, by the rules of :class:`ArmSegmenter`.
    Points with fewer than NEIGHBOURS points within LINK are removed. Open3D's sums depend on the
    order of the points: only its comparisons of distances are used.
    """
    open3d = load_open3d()
    plane = arm.to_plane(cloud @ rotation.T + translation)
    points = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(plane))
    slab = np.array([np.inf, crop.half_depth, np.inf])
    points = points.crop(open3d.geometry.AxisAlignedBoundingBox(-slab, slab))
    x, _, z = np.asarray(points.points).T
    points = points.select_by_index(np.flatnonzero(_near_arm(x, z, arm, crop)))
    points, _ = points.remove_radius_outlier(NEIGHBOURS, LINK)

    cluster = np.asarray(points.cluster_dbscan(LINK, 1), dtype=int)
    is_large = np.bincount(cluster)[cluster] >= crop.min_pixels
    on_arm = np.asarray(points.points)[is_large]
    return _thin(on_arm[:, [0, 2]], crop)


def _near_arm(x: ndarray, z: ndarray, arm: Arm, crop: Workspace) -> ndarray:
    """Return True for points in reach that are neither on the turntable nor on the floor."""
    x0, z0 = arm.chain.origin
    right = x - x0
    up = z - z0
    reach = arm.chain.lengths.sum() + crop.girth
    in_reach = right**2 + up**2 <= reach**2
    beside_column = np.abs(right) > crop.column_half_width
    above_column = up > crop.column_top
    above_floor = z > crop.floor
    off_column = beside_column | above_column
    return in_reach & off_column & above_floor


def _thin(points: ndarray, crop: Workspace) -> ndarray:
    """Return at most ``max_points`` of the ``points``, evenly spaced in their order."""
    count = min(len(points), crop.max_points)
    chosen = np.arange(count) * len(points) // max(count, 1)
    return points[chosen]
