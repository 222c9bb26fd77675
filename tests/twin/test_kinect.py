"""The twin's depth camera: exact geometry against analytic rays, and each part of the noise against its law."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import norm

import pipeline
import pipeline.arm
from pipeline.arm.model import load_arm
from pipeline.errors import ConfigError
from pipeline.twin.kinect import DepthCamera, KinectOptions, axial_std, corrupt, draw_bias, lateral_std
from pipeline.twin.scene import Solid, cast, prism

ARM = load_arm(Path(pipeline.arm.__file__).with_name("youbot.urdf"), ["arm_joint_2", "arm_joint_3", "arm_joint_4"], "arm_tool", {})
CANDLE = np.deg2rad([65.0, -146.0, 102.5])
FOLDED, EXTENDED = CANDLE + np.deg2rad([35.0, 135.0, 10.0]), CANDLE + np.deg2rad([-65.0, 65.0, -90.0])
UNBIASED = np.zeros(4502, dtype=np.float32)
CLEAN = KinectOptions(axial=(0.0, 0.0, 0.0, 0.0), lateral=(0.0, 0.0), edge_lost=0.0, edge_mixed=0.0)


@pytest.fixture(scope="module")
def camera() -> DepthCamera:
    return DepthCamera(ARM, KinectOptions(), UNBIASED)


def flat(depth: float, grazing: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    return np.full((424, 512), depth, dtype=np.float32), np.full((424, 512), grazing, dtype=np.float32)


def step(rows: int = 2000, near: float = 1.0, far: float = 2.0) -> tuple[np.ndarray, np.ndarray]:
    depth = np.full((rows, 40), near, dtype=np.float32)
    depth[:, 20:] = far
    return depth, np.zeros_like(depth)


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
        entered = np.abs(np.take_along_axis(ray, bounds[0].argmax(axis=-1)[..., None], axis=-1)[..., 0])
        np.testing.assert_allclose(np.cos(grazing[hit]), (entered / np.linalg.norm(ray, axis=-1))[hit], rtol=1e-9)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_each_link_is_seen_where_its_projection_and_its_front_face_say(camera: DepthCamera, share: float) -> None:
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
        expected = (-thickness / 2 - normal @ (camera.translation - ARM.translation)) / (normal @ ray)
        assert depth[v, u] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("share", np.linspace(0, 1, 6))
def test_the_arm_is_wholly_in_view_around_its_skeleton_and_clear_of_the_room(camera: DepthCamera, share: float) -> None:
    q = FOLDED + share * (EXTENDED - FOLDED)
    depth, _ = camera.render(q)
    points = backproject(camera, depth)
    scene = camera.options.scene
    x, z = ARM.chain.origin
    beside_stand = (np.abs(points[..., 0] - x) > scene.stand_width / 2 + 0.01) | (points[..., 2] > z)
    seen = (np.abs(points[..., 1]) < 0.04) & beside_stand
    arm = points[seen]
    assert arm.shape[0] > 2000
    assert distance_to_skeleton(arm[:, [0, 2]], q).max() < scene.link_width / 2 + 1e-3
    # the far end is seen, and the nearest solid of the room is the floor, far below
    tip = ARM.chain.points(q)[3]
    assert np.linalg.norm(arm[:, [0, 2]] - tip, axis=1).min() < 0.015
    assert arm[:, 2].min() > scene.floor_height + 0.5
    rows, columns = np.nonzero(seen)
    assert min(rows.min(), columns.min(), 423 - rows.max(), 511 - columns.max()) > 40


def test_an_arm_out_of_view_is_refused() -> None:
    with pytest.raises(ConfigError, match="wholly in the image"):
        DepthCamera(ARM, KinectOptions(distance=0.3), UNBIASED).render(EXTENDED)


@pytest.mark.parametrize("wrong", [{"range": (4.5, 0.5)}, {"edge_lost": 0.9, "edge_mixed": 0.2}, {"grazing_limit": 1.6}])
def test_impossible_options_are_refused(wrong: dict) -> None:
    with pytest.raises(ConfigError, match=r"twin\.kinect"):
        KinectOptions(**wrong)


@pytest.mark.parametrize(("depth", "grazing"), [(0.8, 0.0), (1.2, 0.9), (3.0, 1.3)])
def test_noise_of_a_flat_wall_has_the_axial_deviation(depth: float, grazing: float) -> None:
    options = KinectOptions()
    error = corrupt(*flat(depth, grazing), UNBIASED, options, np.random.default_rng(8)) - 1e3 * depth

    def predicted(z: float) -> float:
        # published law in mm, and the variance of rounding to 1 mm
        law = 1.5 - 0.5 * z + 0.3 * z**2 + 0.1 * z**1.5 * grazing**2 / (np.pi / 2 - grazing) ** 2
        return float(np.hypot(law, 1 / np.sqrt(12)))

    # 217 088 pixels: the deviation's standard error is 0.15 %
    assert error.std() == pytest.approx(predicted(depth), rel=0.006)
    assert not error.std() == pytest.approx(predicted(depth) * 1.02, rel=0.006)
    assert abs(error.mean()) < 5 * error.std() / np.sqrt(error.size)
    assert abs((error[:, 1:] * error[:, :-1]).mean()) < 5 * error.var() / np.sqrt(error.size)
    assert np.all(axial_std(*flat(depth, grazing), options) > 0)


@pytest.mark.parametrize("grazing", [0.0, 1.2])
def test_lateral_noise_moves_an_edge_by_the_published_deviation(grazing: float) -> None:
    options = replace(CLEAN, lateral=KinectOptions().lateral)
    depth, angle = step(rows=20_000)
    image = corrupt(depth, angle + np.float32(grazing), UNBIASED, options, np.random.default_rng(4))
    crossed = (image[:, 17:20] == 2000).mean(axis=0)
    sigma = 0.8 + 0.035 * grazing / (np.pi / 2 - grazing)
    assert lateral_std(np.float32(grazing), options) == pytest.approx(sigma, rel=1e-5)

    def scores(deviation: float) -> np.ndarray:
        # the pixel's centre lies 2.5, 1.5 and 0.5 px from the edge
        chance = norm.cdf(-np.array([2.5, 1.5, 0.5]) / deviation)
        return np.abs(crossed - chance) / np.sqrt(chance * (1 - chance) / 20_000)

    assert scores(sigma).max() < 4
    assert scores(1.1 * sigma).max() > 8
    assert np.all(image[:, :16] == 1000)
    assert np.all(image[:, 24:] == 2000)


def test_edges_lose_and_mix_their_pixels_at_the_stated_rates_and_nowhere_else() -> None:
    options = replace(CLEAN, edge_lost=0.3, edge_mixed=0.2)
    depth, angle = step()
    image = corrupt(depth, angle, UNBIASED, options, np.random.default_rng(4))
    edge = image[:, 19:21]
    # 4000 pixels: a rate of 0.3 has a standard error of 0.007
    assert (edge == 0).mean() == pytest.approx(0.3, abs=0.03)
    between = edge[(edge != 0) & (edge != 1000) & (edge != 2000)]
    assert between.size / edge.size == pytest.approx(0.2, abs=0.03)
    assert not between.size / edge.size == pytest.approx(0.3, abs=0.03)
    assert between.mean() == pytest.approx(1500, abs=5 * 1000 / np.sqrt(12 * between.size))
    np.testing.assert_array_equal(np.delete(image, [19, 20], axis=1), np.delete(np.rint(1000 * depth), [19, 20], axis=1))


def test_without_noise_the_image_is_the_exact_depth_in_whole_millimetres(camera: DepthCamera) -> None:
    depth, grazing = camera.render(FOLDED)
    image = corrupt(depth, grazing, UNBIASED, CLEAN, np.random.default_rng(0))
    seen = (depth >= 0.5) & (depth <= 4.5) & (grazing <= CLEAN.grazing_limit)
    assert image.dtype == np.uint16
    assert image.shape == (424, 512)
    np.testing.assert_array_equal(image, np.where(seen, np.rint(depth * np.float32(1000)), 0))
    assert 0.1 < seen.mean() < 0.9


@pytest.mark.parametrize(
    ("depth", "grazing", "valid"), [(0.45, 0, False), (4.55, 0, False), (0.0, 0, False), (2.0, 1.45, False), (2.0, 1.35, True)]
)
def test_no_depth_is_given_beyond_the_range_and_the_grazing_limit(depth: float, grazing: float, valid: bool) -> None:
    image = corrupt(*flat(depth, grazing), UNBIASED, CLEAN, np.random.default_rng(0))
    assert np.all((image > 0) == valid)


def test_bias_shifts_depth_smoothly_by_one_draw_a_session() -> None:
    options = KinectOptions(bias_offset_std=5e-3, bias_wiggle=2e-3)
    bias = draw_bias(options, np.random.default_rng(1))
    ramp = np.broadcast_to(np.linspace(0.6, 4.4, 512, dtype=np.float32), (424, 512)).copy()
    shift = corrupt(ramp, np.zeros_like(ramp), bias, CLEAN, np.random.default_rng(0)) - 1e3 * ramp
    assert np.abs(shift[0] - 1e3 * bias[(1e3 * ramp[0]).astype(int)]).max() <= 0.501
    offset, wiggle = np.mean(bias[:4230]), bias[:4230] - np.mean(bias[:4230])
    assert np.abs(wiggle).max() == pytest.approx(2e-3, rel=0.02)
    assert np.abs(np.diff(bias)).max() < 1e-3 * 2e-3 * 2 * np.pi / 0.47 * 1.01
    offsets = [np.mean(draw_bias(options, np.random.default_rng(seed))[:4230]) for seed in range(300)]
    assert np.std(offsets) == pytest.approx(5e-3, rel=0.15)
    assert offset == pytest.approx(offsets[1], abs=1e-9)


def digest(seed: int) -> str:
    camera = DepthCamera(ARM, KinectOptions(), draw_bias(KinectOptions(), np.random.default_rng(1)))
    rng = np.random.default_rng(seed)
    images = [camera.observe(q, rng) for q in np.linspace(FOLDED, EXTENDED, 5)]
    return hashlib.sha256(b"".join(image.tobytes() for image in images)).hexdigest()


@pytest.mark.slow
def test_an_equal_stream_gives_equal_bytes_in_this_and_in_another_process() -> None:
    script = f"import runpy; print(runpy.run_path({__file__!r})['digest'](2))"
    root = Path(pipeline.__file__).parents[1]
    elsewhere = subprocess.run([sys.executable, "-c", script], cwd=root, capture_output=True, text=True, check=True).stdout.strip()
    assert digest(2) == digest(2) == elsewhere
    assert digest(3) != elsewhere
