"""The view of a depth frame shows the arm where it is: projected points fall on the surface they
were measured on.
"""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.arm.model import load_arm
from pipeline.formats.depth.intrinsics import Intrinsics
from pipeline.perception.segment import ArmSegmenter, Crop
from pipeline.tools.page.depth_view import DepthView

CAMERA = Intrinsics(
    fx=365.0,
    fy=365.0,
    cx=255.3,
    cy=206.8,
    distortion=(0.09, -0.27, 0.0, 0.0, 0.09),
    width=512,
    height=424,
)
ROTATION, POSITION = (
    Rotation.from_euler("xyz", [-1.6, 0.01, -0.05]).as_matrix(),
    np.array([0.07, -1.15, 0.25]),
)


@pytest.fixture(scope="module")
def arm():
    joints = ["arm_joint_2", "arm_joint_3", "arm_joint_4"]
    return load_arm(
        "pipeline/arm/youbot.urdf",
        joints,
        "arm_tool",
        {"arm_joint_1": 2.9670597283903604, "arm_joint_5": 2.923426497090502},
    )


@pytest.fixture(scope="module")
def reached(arm) -> np.ndarray:
    angles = np.linspace(-1.5, 1.5, 13)
    return arm.chain.origin + 0.4 * np.stack([np.sin(angles), np.cos(angles)], axis=-1)


@pytest.fixture(scope="module")
def view(arm, reached) -> DepthView:
    return DepthView(arm, CAMERA, ROTATION, POSITION, reached)


def depth_of_the_plane(arm, rows: int = 424, columns: int = 512) -> np.ndarray:
    """The depth image of the arm's plane itself, by the ray of each pixel."""
    u, v = np.meshgrid(np.arange(columns, dtype=float), np.arange(rows, dtype=float))
    matrix = np.array([[CAMERA.fx, 0, CAMERA.cx], [0, CAMERA.fy, CAMERA.cy], [0, 0, 1]])
    pixels = np.stack([u.ravel(), v.ravel()], axis=-1)[:, None]
    ideal = cv2.undistortPoints(
        pixels, matrix, np.array(CAMERA.distortion), None, None, None, (3, 100, 1e-10)
    )[:, 0]
    rays = np.column_stack([ideal, np.ones(len(ideal))]) @ ROTATION.T @ arm.rotation
    return (-arm.to_plane(POSITION)[1] / rays[:, 1]).reshape(rows, columns)


def test_points_of_the_plane_and_their_pixels_agree_with_the_way_back_through_the_depth(arm, view):
    depth = depth_of_the_plane(arm)
    crop = Crop(floor=-9.0, column_top=-9.0, max_points=10**6)
    segment = ArmSegmenter(
        arm,
        np.array([[CAMERA.fx, 0, CAMERA.cx], [0, CAMERA.fy, CAMERA.cy], [0, 0, 1]]),
        np.array(CAMERA.distortion),
        ROTATION,
        POSITION,
        depth.shape,
        crop,
    )
    points, _ = segment(depth)
    # row by row, one pixel to the right of the other: so must be their projections
    pixels = view.pixels(points)
    steps = np.array([b - a for a, b in pairwise(pixels[:200])])
    assert np.abs(steps[np.abs(steps[:, 1]) < 0.5] - [1, 0]).max() < 0.01
    assert np.abs(pixels - np.round(pixels)).max() < 0.02
    # and the control: beside the plane they do not fall on pixels
    beside = view.pixels(points + np.array([0.0, 5e-4]))
    assert np.abs(beside - np.round(beside)).max() > 0.1


def test_the_view_holds_all_that_is_reached_with_room_to_spare(view, reached):
    pixels, (width, height) = view.pixels(reached), view.size
    assert (pixels > 5).all() and (pixels < np.array([width, height]) - 5).all()
    assert width < CAMERA.width and height < CAMERA.height


def test_the_image_is_near_to_far_bright_to_dark_and_black_where_nothing_was_measured(arm, view):
    depth = depth_of_the_plane(arm)
    depth[:, 256:] += 0.1
    depth[:212] = np.nan
    image = view.colours(depth)
    assert image.shape[1::-1] == view.size
    assert (image[0] == 0).all()
    below = image[-1].astype(int).sum(axis=-1)
    assert below[0] > below[-1] > 0
    red, _, blue = image[-1, 0].astype(int)
    assert red > blue, "near is yellow"
