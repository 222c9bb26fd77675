"""The laboratory's depth camera: exact geometry against analytic rays."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import pipeline
import pipeline.arm
from pipeline.arm.model import load_arm
from pipeline.core.errors import ConfigError
from pipeline.laboratory.kinect import DepthCamera
from pipeline.laboratory.options import KinectOptions
from pipeline.laboratory.scene import Solid, cast, prism
from pipeline.laboratory.sensor import draw_bias

ARM = load_arm(
    Path(pipeline.arm.__file__).with_name("youbot.urdf"),
    ["arm_joint_2", "arm_joint_3", "arm_joint_4"],
    "arm_tool",
    {},
)
CANDLE = np.deg2rad([65.0, -146.0, 102.5])
FOLDED, EXTENDED = (
    CANDLE + np.deg2rad([35.0, 135.0, 10.0]),
    CANDLE + np.deg2rad([-65.0, 65.0, -90.0]),
)
UNBIASED = np.zeros(4502, dtype=np.float32)


@pytest.fixture(scope="module")
def camera() -> DepthCamera:
    return DepthCamera(ARM, KinectOptions(), UNBIASED)


def backproject(camera: DepthCamera, depth: np.ndarray) -> np.ndarray:
    """Points (h, w, 3) in the plane's frame, by the calibration that goes with the images."""
    o = camera.options
    v, u = np.mgrid[: o.height, : o.width]
    points = np.stack([(u - o.cx) / o.fx * depth, (v - o.cy) / o.fy * depth, depth], axis=-1)
    return ARM.to_plane(points @ camera.rotation.T + camera.translation)


def distance_to_skeleton(points: np.ndarray, q: np.ndarray) -> np.ndarray:
    joints = ARM.chain.points(q)
    start, along = joints[:3], np.diff(joints, axis=0)
    offset = points[:, None] - start
    share = np.clip((offset * along).sum(-1) / (along**2).sum(-1), 0, 1)
    return np.linalg.norm(offset - share[..., None] * along, axis=-1).min(axis=1)


def test_depth_of_a_box_equals_that_of_analytic_slabs() -> None:
    rng = np.random.default_rng(2)
    half = np.array([0.1, 0.07, 0.2])
    box = prism(np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half[[0, 2]], -half[1], half[1])
    v, u = np.mgrid[:60, :80]
    directions = np.stack([(u - 39.5) / 80, (v - 29.5) / 80, np.ones(u.shape)], axis=-1)
    for rotation in Rotation.random(10, rng=rng).as_matrix():
        centre = np.array([*rng.uniform(-0.1, 0.1, 2), 1.2])
        depth, grazing = cast(Solid(box.vertices @ rotation.T + centre, box.triangles), directions)
        origin, ray = -centre @ rotation, directions @ rotation
        bounds = np.sort(np.stack([(-half - origin) / ray, (half - origin) / ray]), axis=0)
        enter, leave = bounds[0].max(axis=-1), bounds[1].min(axis=-1)
        # rays that brush an edge within single precision may fall to either side
        clear = np.abs(leave - enter) > 1e-5
        hit = (enter < leave) & clear
        np.testing.assert_array_equal(np.isfinite(depth)[clear], hit[clear])
        np.testing.assert_allclose(depth[hit], enter[hit], rtol=1e-9)
        entered = np.abs(
            np.take_along_axis(ray, bounds[0].argmax(axis=-1)[..., None], axis=-1)[..., 0]
        )
        np.testing.assert_allclose(
            np.cos(grazing[hit]), (entered / np.linalg.norm(ray, axis=-1))[hit], rtol=1e-9
        )


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_each_link_is_seen_where_its_projection_and_its_front_face_say(
    camera: DepthCamera, share: float
) -> None:
    q = FOLDED + share * (EXTENDED - FOLDED)
    depth, _ = camera.render(q)
    o, nodes = camera.options, ARM.chain.points(q)
    for j, thickness in enumerate(o.scene.link_depths):
        x, z = nodes[j] + 0.4 * (nodes[j + 1] - nodes[j])
        p = (ARM.to_base(np.array([x, -thickness / 2, z])) - camera.translation) @ camera.rotation
        u, v = round(o.fx * p[0] / p[2] + o.cx), round(o.fy * p[1] / p[2] + o.cy)
        # the ray of that pixel meets the front face y = −thickness/2
        ray = camera.rotation @ [(u - o.cx) / o.fx, (v - o.cy) / o.fy, 1.0]
        normal = ARM.rotation[:, 1]
        expected = (-thickness / 2 - normal @ (camera.translation - ARM.translation)) / (
            normal @ ray
        )
        assert depth[v, u] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("share", np.linspace(0, 1, 6))
def test_the_arm_is_wholly_in_view_around_its_skeleton_and_clear_of_the_room(
    camera: DepthCamera, share: float
) -> None:
    q = FOLDED + share * (EXTENDED - FOLDED)
    depth, _ = camera.render(q)
    points = backproject(camera, depth)
    scene = camera.options.scene
    x, z = ARM.chain.origin
    beside_stand = (np.abs(points[..., 0] - x) > scene.stand_width / 2 + 0.01) | (
        points[..., 2] > z
    )
    visible = (np.abs(points[..., 1]) < 0.04) & beside_stand
    arm = points[visible]
    assert arm.shape[0] > 2000
    assert distance_to_skeleton(arm[:, [0, 2]], q).max() < scene.link_width / 2 + 1e-3
    # the far end is seen, and the nearest solid of the room is the floor, far below
    tip = ARM.chain.points(q)[3]
    assert np.linalg.norm(arm[:, [0, 2]] - tip, axis=1).min() < 0.015
    assert arm[:, 2].min() > scene.floor_height + 0.5
    rows, columns = np.nonzero(visible)
    assert min(rows.min(), columns.min(), 423 - rows.max(), 511 - columns.max()) > 40


def test_an_arm_out_of_view_is_refused() -> None:
    with pytest.raises(ConfigError, match="wholly in the image"):
        DepthCamera(ARM, KinectOptions(distance=0.3), UNBIASED).render(EXTENDED)


@pytest.mark.parametrize(
    "wrong", [{"range": (4.5, 0.5)}, {"edge_lost": 0.9, "edge_mixed": 0.2}, {"grazing_limit": 1.6}]
)
def test_impossible_options_are_refused(wrong: dict) -> None:
    with pytest.raises(ConfigError, match=r"laboratory\.kinect"):
        KinectOptions(**wrong)


def digest(seed: int) -> str:
    camera = DepthCamera(ARM, KinectOptions(), draw_bias(KinectOptions(), np.random.default_rng(1)))
    rng = np.random.default_rng(seed)
    images = [camera.observe(q, rng) for q in np.linspace(FOLDED, EXTENDED, 5)]
    return hashlib.sha256(b"".join(image.tobytes() for image in images)).hexdigest()


@pytest.mark.slow
def test_an_equal_stream_gives_equal_bytes_in_this_and_in_another_process() -> None:
    script = f"import runpy; print(runpy.run_path({__file__!r})['digest'](2))"
    root = Path(pipeline.__file__).parents[1]
    elsewhere = subprocess.run(
        [sys.executable, "-c", script], cwd=root, capture_output=True, text=True, check=True
    ).stdout.strip()
    assert digest(2) == digest(2) == elsewhere
    assert digest(3) != elsewhere
