"""The laboratory's depth camera: exact geometry against analytic rays, and the sensor's noise
against its laws."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from fractions import Fraction
from operator import mul
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
from pipeline.laboratory.scene import Prism, cast, prism
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


BOX = np.array([[-0.1, -0.2], [0.1, -0.2], [0.1, 0.2], [-0.1, 0.2]])


def test_depth_of_a_box_equals_that_of_analytic_slabs() -> None:
    rng = np.random.default_rng(2)
    half = np.array([0.1, 0.07, 0.2])
    x, y = (np.arange(80) - 39.5) / 80, (np.arange(60) - 29.5) / 80
    directions = np.stack([*np.meshgrid(x, y), np.ones((60, 80))], axis=-1)
    for rotation in Rotation.random(10, rng=rng).as_matrix():
        centre = np.array([*rng.uniform(-0.1, 0.1, 2), 1.2])
        depth, grazing = cast(prism(BOX, -half[1], half[1]).moved(rotation, centre), x, y)
        origin, ray = -centre @ rotation, directions @ rotation
        bounds = np.sort(np.stack([(-half - origin) / ray, (half - origin) / ray]), axis=0)
        enter, leave = bounds[0].max(axis=-1), bounds[1].min(axis=-1)
        hit = enter < leave
        np.testing.assert_array_equal(np.isfinite(depth), hit)
        np.testing.assert_allclose(depth[hit], enter[hit], rtol=1e-9)
        entered = np.abs(
            np.take_along_axis(ray, bounds[0].argmax(axis=-1)[..., None], axis=-1)[..., 0]
        )
        np.testing.assert_allclose(
            np.cos(grazing[hit]), (entered / np.linalg.norm(ray, axis=-1))[hit], rtol=1e-9
        )


def exact_depth(solid: Prism, x: float, y: float) -> float:
    """Depth in rational arithmetic of the very corners; infinite where the ray meets nothing."""
    first, second = ([[Fraction(c) for c in corner] for corner in end] for end in solid.ends)
    n, ray = len(first), (Fraction(x), Fraction(y), Fraction(1))
    faces = [(first[i], second[i], first[(i + 1) % n]) for i in range(n)]
    faces += [(first[0], first[1], first[2]), (second[0], second[2], second[1])]
    low, high = Fraction(0), None
    for a, b, c in faces:
        u, v = ([p - q for p, q in zip(corner, a, strict=True)] for corner in (b, c))
        normal = [u[i - 2] * v[i - 1] - u[i - 1] * v[i - 2] for i in range(3)]
        distance, slope = (sum(map(mul, normal, p)) for p in (a, ray))
        if distance < 0 and slope >= 0:
            return np.inf
        if distance < 0:
            low = max(low, distance / slope)
        elif slope > 0:
            high = min(high or distance / slope, distance / slope)
    return float(low) if high is not None and low < high else np.inf


def test_a_ray_that_brushes_an_edge_meets_the_face_that_rational_arithmetic_says() -> None:
    rng = np.random.default_rng(5)
    met, single = [], []
    # rays to either side of an edge between the ends, 1e-10 m off it
    aside = np.array([1e-10, 0.0, 0.0])
    for rotation in Rotation.random(40, rng=rng).as_matrix():
        solid = prism(BOX, -0.07, 0.07).moved(rotation, np.array([*rng.uniform(-0.1, 0.1, 2), 1.2]))
        edge = solid.ends[0] + rng.random((4, 1)) * (solid.ends[1] - solid.ends[0])
        for point in np.concatenate([edge - aside, edge + aside]):
            x, y, _ = point / point[2]
            depth = cast(solid, np.array([x]), np.array([y]))[0][0, 0]
            exact = exact_depth(solid, x, y)
            assert depth == pytest.approx(exact, rel=1e-12)
            met.append(np.isfinite(exact))
            rounded = Prism(solid.ends.astype(np.float32).astype(float))
            single.append(exact_depth(rounded, float(np.float32(x)), float(np.float32(y))))
    # both sides occur, and single precision does not tell them apart
    assert 100 < np.sum(met) < 280
    assert np.sum(np.isfinite(single) != met) > 20


def test_the_plane_of_a_face_may_pass_through_the_camera() -> None:
    # seen by a camera at the height of its top: the front alone
    front = np.array([[-1.0, 0.0, 2.0], [-1.0, 1.0, 2.0], [1.0, 1.0, 2.0], [1.0, 0.0, 2.0]])
    solid = Prism(np.stack([front, front + np.array([0.0, 0.0, 1.0])]))
    depth, grazing = cast(solid, np.array([0.0]), np.array([-0.1, 0.1]))
    np.testing.assert_array_equal(depth[:, 0], [np.inf, 2.0])
    assert np.cos(grazing[1, 0]) == pytest.approx(1 / np.hypot(1, 0.1))


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
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


def digest(seed: int) -> str:
    camera = DepthCamera(ARM, KinectOptions(), draw_bias(KinectOptions(), np.random.default_rng(1)))
    rng = np.random.default_rng(seed)
    images = [camera.observe(q, rng) for q in np.linspace(FOLDED, EXTENDED, 5)]
    return hashlib.sha256(b"".join(image.tobytes() for image in images)).hexdigest()


def elsewhere(**environment: str) -> tuple[str, str]:
    """The digest of the images, and that of functions of numpy, in a process of its own."""
    script = (
        f"import hashlib, runpy; images = runpy.run_path({__file__!r})['digest'](2); "
        "import numpy as np; x = np.linspace(0.01, 0.99, 10**5); "
        "functions = [f(x).tobytes() for f in (np.sin, np.exp, np.arccos, np.arctan)]; "
        "print(images, hashlib.sha256(b''.join(functions)).hexdigest())"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=Path(pipeline.__file__).parents[1],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return tuple(done.stdout.split())


@pytest.mark.slow
def test_an_equal_stream_gives_equal_bytes_in_any_process_on_any_instruction_set() -> None:
    here = digest(2)
    assert here == digest(2) != digest(3)
    images, functions = elsewhere()
    assert images == here
    levels = [
        elsewhere(NPY_DISABLE_CPU_FEATURES="X86_V3 X86_V4 AVX512_ICL AVX512_SPR"),
        elsewhere(GLIBC_TUNABLES="glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX512F,-AVX512VL"),
    ]
    assert [images for images, _ in levels] == [here, here]
    # the libraries' own functions do follow the instruction set
    assert len({functions, *(found for _, found in levels)}) > 1


def test_a_scene_that_cannot_be_seen_is_refused() -> None:
    with pytest.raises(ConfigError, match="more slender"):
        prism(BOX[[0, 2, 1, 3]], -1.0, 1.0)
    with pytest.raises(ConfigError, match="stands in a solid"):
        cast(prism(BOX, -0.07, 0.07), np.zeros(1), np.zeros(1))
    with pytest.raises(ConfigError, match="wholly in the image"):
        DepthCamera(ARM, KinectOptions(distance=0.3), UNBIASED).render(EXTENDED)
