"""The arm's points in a depth image: an analytic renderer of flat links is the truth."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import cv2
import numpy as np
from numpy.testing import assert_allclose, assert_array_equal
from planar_poses import planar_chain
from scipy.spatial.transform import Rotation

from pipeline.arm.model import Arm
from pipeline.core.options.dataset import Workspace
from pipeline.formats.depth.intrinsics import Intrinsics
from pipeline.perception.segment import ArmSegmenter

SHAPE = (212, 256)
# distorted about as much as a Kinect v2
DISTORTION = (0.09, -0.27, 0.001, -0.002, 0.09)
CAMERA = Intrinsics(182.7, 182.7, 127.4, 102.7, SHAPE[1], SHAPE[0], DISTORTION)
FRONT = -0.03  # m, y of the visible faces of the links
WIDTH = 0.06  # m


CHAIN = planar_chain(0.01, 0.115)
ARM = Arm(
    CHAIN,
    Rotation.from_euler("z", 2.9).as_matrix(),
    np.array([0.02, -0.01, 0.0]),
)
Q = np.array([-0.5, 1.4, -0.6])
# the camera is 1.1 m before the plane, turned by a few degrees
FACING = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
TILT = Rotation.from_euler("xyz", [-0.05, 0.1, 0.02]).as_matrix()
TURN = ARM.rotation @ FACING @ TILT
PLACE = np.array([-0.05, -1.1, 0.25])  # m, in the plane's frame


@cache
def ideal_pixels() -> np.ndarray:
    """(rows · columns, 3) rays in the camera's frame; the distortion inverted by a fixed point of
    the forward model.
    """
    v, u = np.indices(SHAPE).reshape(2, -1)
    x = (u - CAMERA.cx) / CAMERA.fx
    y = (v - CAMERA.cy) / CAMERA.fy
    ideal = np.stack([x, y, np.ones(x.shape)], axis=-1)
    target = ideal[:, :2].copy()

    still = np.zeros(3)
    identity = np.eye(3)
    distortion = np.array(CAMERA.distortion)
    for _ in range(30):
        seen, _ = cv2.projectPoints(ideal, still, still, identity, distortion)
        ideal[:, :2] += target - seen[:, 0]
    return ideal


def rays() -> np.ndarray:
    """(rows · columns, 3) rays in the plane's frame."""
    return ideal_pixels() @ TURN.T @ ARM.rotation


def on_arm(points: np.ndarray) -> np.ndarray:
    """Mask of the points (..., 2) that lie on the rectangles of the links."""
    inside = np.zeros(points.shape[:-1], dtype=bool)
    for start, end in pairwise(CHAIN.points(Q)):
        length = np.hypot(*(end - start))
        x, z = (end - start) / length
        along = (points - start) @ [x, z]
        aside = (points - start) @ [z, -x]
        inside |= (along >= 0) & (along <= length) & (np.abs(aside) <= WIDTH / 2)
    return inside


def render() -> tuple[np.ndarray, np.ndarray]:
    """Depth image (m) of the links' faces before a wall 1 m behind, and which pixels see the
    arm.
    """
    r = rays()
    near = (FRONT - PLACE[1]) / r[:, 1]
    far = (1.0 - PLACE[1]) / r[:, 1]
    faces = PLACE + near[:, None] * r
    hit = on_arm(faces[:, [0, 2]])
    depth = np.where(hit, near, far)
    return depth.reshape(SHAPE), hit.reshape(SHAPE)


CROP = Workspace(0.05, 0.05, 0.0, -0.02, -1.0, min_pixels=20, max_points=100_000)
BASE = Workspace(0.05, 0.05, 0.05, 0.05, 0.12, min_pixels=1, max_points=100_000)


def segmenter(crop: Workspace = CROP, camera: Intrinsics = CAMERA) -> ArmSegmenter:
    return ArmSegmenter(ARM, camera, TURN, ARM.to_base(PLACE), crop)


def test_every_pixel_of_the_arm_and_no_other_is_found_where_it_is() -> None:
    depth, hit = render()
    points = segmenter()(depth)
    truth = (PLACE + depth.reshape(-1, 1) * rays())[hit.ravel()][:, [0, 2]]
    assert len(points) > 500
    assert_allclose(points, truth, atol=1e-7)

    # control: distortion that is ignored moves the points
    moved = segmenter(camera=replace(CAMERA, distortion=()))(depth)
    assert np.mean(on_arm(moved)) < 0.999
    assert np.mean(on_arm(points)) == 1.0


def test_pixels_without_depth_are_left_out() -> None:
    depth, hit = render()
    lost = np.flatnonzero(hit)[::7]
    depth.flat[lost[::2]] = 0.0
    depth.flat[lost[1::2]] = np.nan
    assert len(segmenter()(depth)) == hit.sum() - len(lost)


def test_a_flying_pixel_alone_beside_the_arm_is_left_out() -> None:
    depth, hit = render()
    cut = segmenter()
    rows, columns = cut.window
    beside = cv2.dilate(hit.astype(np.uint8), np.ones((7, 7))).astype(bool)
    row, column = np.argwhere(~beside[rows, columns])[0]
    pixel = rows.start + row, columns.start + column
    ray = rays().reshape(*SHAPE, 3)[pixel]
    depth[pixel] = (FRONT - PLACE[1]) / ray[1]  # the depth of the arm
    assert len(cut(depth)) == hit.sum()


def test_patches_base_and_points_beyond_the_stated_numbers_are_left_out() -> None:
    depth, hit = render()
    total = int(hit.sum())
    everything = segmenter()(depth)
    # turntable and floor
    x, z = (everything - CHAIN.origin).T
    base = ((np.abs(x) <= 0.05) & (z <= 0.05)) | (everything[:, 1] <= 0.12)
    assert base.sum() > 50

    assert len(segmenter(replace(CROP, min_pixels=total))(depth)) == total
    assert len(segmenter(replace(CROP, min_pixels=total + 1))(depth)) == 0
    assert_array_equal(segmenter(BASE)(depth), everything[~base])
    assert len(segmenter(replace(CROP, max_points=300))(depth)) == 300
