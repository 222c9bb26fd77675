"""The depth camera: geometry against analytic rays, and the sensor's noise against its laws."""

import hashlib
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from planar_poses import load_arm
from scipy.spatial.transform import Rotation
from scipy.stats import norm

import pipeline
import pipeline.arm
from pipeline.core.errors import ConfigError
from pipeline.laboratory.kinect import (
    DepthCamera,
    cast,
    draw_bias,
    lateral_deviation,
    place_solid,
    prism,
    read_depth,
)
from pipeline.laboratory.options import KinectOptions

URDF = Path(pipeline.arm.__file__).with_name("youbot.urdf")
ARM = load_arm(URDF, ["arm_joint_2", "arm_joint_3", "arm_joint_4"], "arm_tool", {})
FOLDED, EXTENDED = np.deg2rad([[100.0, -11.0, 112.5], [0.0, -81.0, 12.5]])
UNBIASED = np.zeros(4502, dtype=np.float32)


BOX = np.array([[-0.1, -0.2], [0.1, -0.2], [0.1, 0.2], [-0.1, 0.2]])


def test_depth_of_a_box_equals_that_of_analytic_slabs():
    rng = default_rng(2)
    half = np.array([0.1, 0.07, 0.2])
    x, y = (np.arange(80) - 39.5) / 80, (np.arange(60) - 29.5) / 80
    directions = np.stack([*np.meshgrid(x, y), np.ones((60, 80))], axis=-1)
    for rotation in Rotation.random(10, rng=rng).as_matrix():
        centre = np.array([*rng.uniform(-0.1, 0.1, 2), 1.2])
        depth, grazing = cast(
            place_solid(prism(BOX, -half[1], half[1]), rotation, centre),
            x,
            y,
        )
        origin, ray = -centre @ rotation, directions @ rotation
        bounds = np.sort(
            np.stack([(-half - origin) / ray, (half - origin) / ray]),
            axis=0,
        )
        enter, leave = bounds[0].max(axis=-1), bounds[1].min(axis=-1)
        hit = enter < leave
        assert_array_equal(np.isfinite(depth), hit)
        assert_allclose(depth[hit], enter[hit], rtol=1e-9)
        face = bounds[0].argmax(axis=-1)[..., None]
        entered = np.abs(np.take_along_axis(ray, face, axis=-1)[..., 0])
        cosine = entered / np.linalg.norm(ray, axis=-1)
        assert_allclose(np.cos(grazing[hit]), cosine[hit], rtol=1e-9)


def digest(seed: int) -> str:
    camera = DepthCamera(
        ARM,
        KinectOptions(),
        draw_bias(KinectOptions(), default_rng(1)),
    )
    rng = default_rng(seed)
    images = [camera.observe(q, rng) for q in np.linspace(FOLDED, EXTENDED, 5)]
    return hashlib.sha256(b"".join(image.tobytes() for image in images)).hexdigest()


def elsewhere(**environment: str) -> tuple[str, str]:
    """Digests of the images and of values of NumPy's functions, computed in another process."""
    script = (
        f"import hashlib, runpy; images = runpy.run_path({__file__!r})['digest'](2); "
        "import numpy as np; x = np.linspace(0.01, 0.99, 10**5); "
        "functions = [f(x).tobytes() for f in (np.sin, np.exp, np.arccos, np.arctan)]; "
        "print(images, hashlib.sha256(b''.join(functions)).hexdigest())"
    )
    how = {
        "cwd": Path(pipeline.__file__).parents[1],
        "env": os.environ | {"PYTHONPATH": "tests/helpers"} | environment,
    }
    done = subprocess.run(
        [sys.executable, "-c", script],
        **how,
        capture_output=True,
        text=True,
        check=True,
    )
    return tuple(done.stdout.split())


@pytest.mark.slow
def test_an_equal_stream_gives_equal_bytes_in_any_process_on_any_instruction_set():
    here = digest(2)
    assert here == digest(2) != digest(3)

    images, functions = elsewhere()
    assert images == here

    numpy_level = {"NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR"}
    lacking = "-AVX2,-FMA,-FMA4,-AVX512F,-AVX512VL"
    glibc_level = {"GLIBC_TUNABLES": f"glibc.cpu.hwcaps={lacking}"}
    all_functions = {functions}
    for environment in (numpy_level, glibc_level):
        images, functions = elsewhere(**environment)
        assert images == here
        all_functions.add(functions)

    # the libraries' own functions do follow the instruction set
    assert len(all_functions) > 1


def test_a_scene_that_cannot_be_seen_is_refused():
    with pytest.raises(ConfigError, match="or narrower"):
        prism(BOX[[0, 2, 1, 3]], -1.0, 1.0)
    with pytest.raises(ConfigError, match="is inside a solid"):
        cast(prism(BOX, -0.07, 0.07), np.zeros(1), np.zeros(1))

    # too near, and with the arm behind the camera
    for pose in ({"distance": 0.3}, {"yaw": np.pi / 2, "aim": (4.0, 0.17)}):
        with pytest.raises(ConfigError, match="wholly in the image"):
            DepthCamera(ARM, KinectOptions(**pose), UNBIASED).render(EXTENDED)


CLEAN = KinectOptions(
    axial=(0.0, 0.0, 0.0, 0.0),
    lateral=(0.0, 0.0),
    edge_lost=0.0,
    edge_mixed=0.0,
)


def ramp() -> np.ndarray:
    """Depth (424, 512) from nothing on the left to 4.8 m on the right."""
    return np.tile(np.linspace(0.0, 4.8, 512, dtype=np.float32), (424, 1))


def step(rows: int = 2000) -> tuple[np.ndarray, np.ndarray]:
    """Depth (rows, 40) of 1 m on the left and 2 m on the right, and the angle 0."""
    depth = np.ones((rows, 40), dtype=np.float32)
    depth[:, 20:] = 2.0
    return depth, np.zeros_like(depth)


@pytest.mark.parametrize(("depth", "grazing"), [(0.8, 0.0), (1.2, 0.9), (3.0, 1.3)])
def test_noise_of_a_flat_wall_has_the_axial_deviation(depth: float, grazing: float):
    options = KinectOptions()
    wall = (np.full((424, 512), value, dtype=np.float32) for value in (depth, grazing))
    image = read_depth(*wall, UNBIASED, options, default_rng(8))
    error = image - 1e3 * depth

    def predicted(z: float) -> float:
        # published law in mm, and the variance of rounding to 1 mm
        law = (
            1.5
            - 0.5 * z
            + 0.3 * z**2
            + 0.1 * z**1.5 * grazing**2 / (np.pi / 2 - grazing) ** 2
        )
        return float(np.hypot(law, 1 / np.sqrt(12)))

    # 217 088 pixels: the deviation's standard error is 0.15 %
    assert error.std() == pytest.approx(predicted(depth), rel=0.006)
    assert not error.std() == pytest.approx(predicted(depth) * 1.02, rel=0.006)
    assert abs(error.mean()) < 5 * error.std() / np.sqrt(error.size)
    assert abs((error[:, 1:] * error[:, :-1]).mean()) < 5 * error.var() / np.sqrt(
        error.size,
    )


@pytest.mark.parametrize("grazing", [0.0, 1.2])
def test_lateral_noise_moves_an_edge_by_the_published_deviation(grazing: float):
    options = replace(CLEAN, lateral=KinectOptions().lateral)
    depth, angle = step(rows=20_000)
    angle = angle + np.float32(grazing)
    image = read_depth(depth, angle, UNBIASED, options, default_rng(4))
    crossed = (image[:, 17:20] == 2000).mean(axis=0)
    sigma = 0.8 + 0.035 * grazing / (np.pi / 2 - grazing)
    stated = lateral_deviation(np.full(1, grazing, np.float32), options)

    assert stated == pytest.approx(sigma, rel=1e-5)

    def scores(deviation: float) -> np.ndarray:
        # the pixel's centre lies 2.5, 1.5 and 0.5 px from the edge
        chance = norm.cdf(-np.array([2.5, 1.5, 0.5]) / deviation)
        return np.abs(crossed - chance) / np.sqrt(chance * (1 - chance) / 20_000)

    assert scores(sigma).max() < 4
    assert scores(1.1 * sigma).max() > 8
    assert np.all(image[:, :16] == 1000)
    assert np.all(image[:, 24:] == 2000)


def test_edges_lose_and_mix_their_pixels_at_the_stated_rates_and_nowhere_else():
    options = replace(CLEAN, edge_lost=0.3, edge_mixed=0.2)
    depth, angle = step()
    image = read_depth(depth, angle, UNBIASED, options, default_rng(4))
    edge = image[:, 19:21]

    # 4000 pixels: a rate of 0.3 has a standard error of 0.007
    assert (edge == 0).mean() == pytest.approx(0.3, abs=0.03)

    between = edge[(edge != 0) & (edge != 1000) & (edge != 2000)]
    assert between.size / edge.size == pytest.approx(0.2, abs=0.03)
    assert not between.size / edge.size == pytest.approx(0.3, abs=0.03)
    assert between.mean() == pytest.approx(
        1500,
        abs=5 * 1000 / np.sqrt(12 * between.size),
    )

    image[:, 19:21] = np.rint(1000 * depth[:, 19:21])
    assert_array_equal(image, np.rint(1000 * depth))


def test_without_noise_the_image_is_the_exact_depth_in_whole_millimetres():
    depth, grazing = (
        ramp(),
        np.tile(np.linspace(0.0, 1.7, 424, dtype=np.float32)[:, None], 512),
    )
    image = read_depth(depth, grazing, UNBIASED, CLEAN, default_rng(0))
    valid = (depth >= 0.5) & (depth <= 4.5) & (grazing <= CLEAN.grazing_limit)

    assert image.dtype == np.uint16
    assert image.shape == (424, 512)
    assert_array_equal(
        image,
        np.where(valid, np.rint(depth * np.float32(1000)), 0),
    )
    assert 0.1 < valid.mean() < 0.9


def test_bias_shifts_depth_smoothly_by_one_draw_a_session():
    options = KinectOptions(bias_offset_std=5e-3, bias_wiggle=2e-3)
    bias = draw_bias(options, default_rng(1))
    depth, rng = ramp().clip(0.6, 4.4), default_rng(0)
    image = read_depth(depth, np.zeros_like(depth), bias, CLEAN, rng)
    shift = image[0] - 1e3 * depth[0]
    expected = 1e3 * bias[(1e3 * depth[0]).astype(int)]

    assert np.abs(shift - expected).max() <= 0.501

    waves = bias[:4230]  # nine periods
    assert np.abs(waves - np.mean(waves)).max() == pytest.approx(2e-3, rel=0.02)

    steepest = 1e-3 * 2e-3 * 2 * np.pi / 0.47
    assert np.abs(np.diff(bias)).max() < 1.01 * steepest

    offsets = []
    for seed in range(300):
        drawn = draw_bias(options, default_rng(seed))
        offsets.append(np.mean(drawn[:4230]))

    assert np.std(offsets) == pytest.approx(5e-3, rel=0.15)
