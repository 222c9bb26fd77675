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
from standard_errors import largest_score

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


SHAPE = (424, 512)  # of an image
RAMP = np.tile(np.linspace(0.0, 4.8, 512, dtype=np.float32), (424, 1))  # depth in m


@pytest.mark.parametrize("seed", range(10))
def test_depth_of_a_box_equals_that_of_analytic_slabs(seed):
    rng = default_rng(seed)
    rotation = Rotation.random(rng=rng).as_matrix()
    centre = np.array([*rng.uniform(-0.1, 0.1, 2), 1.2])
    half = np.array([0.1, 0.07, 0.2])
    x = (np.arange(80) - 39.5) / 80
    y = (np.arange(60) - 29.5) / 80

    solid = place_solid(prism(BOX, -half[1], half[1]), rotation, centre)
    depth, grazing = cast(solid, x, y)

    rays = np.stack([*np.meshgrid(x, y), np.ones((60, 80))], axis=-1) @ rotation
    origin = -centre @ rotation
    walls = np.stack([-half - origin, half - origin])[:, None, None] / rays
    near = walls.min(axis=0)
    far = walls.max(axis=0)
    enter = near.max(axis=-1)
    leave = far.min(axis=-1)
    hit = enter < leave
    assert_array_equal(np.isfinite(depth), hit)
    assert_allclose(depth[hit], enter[hit], rtol=1e-9)

    face = near.argmax(axis=-1)[..., None]
    across = np.abs(np.take_along_axis(rays, face, axis=-1)[..., 0])
    cosine = across / np.linalg.norm(rays, axis=-1)
    assert_allclose(np.cos(grazing[hit]), cosine[hit], rtol=1e-9)


def digest(seed: int) -> str:
    bias = draw_bias(KinectOptions(), default_rng(1))
    camera = DepthCamera(ARM, KinectOptions(), bias)
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
    command = [sys.executable, "-c", script]
    root = Path(pipeline.__file__).parents[1]
    variables = os.environ | {"PYTHONPATH": "tests/helpers"} | environment
    output = subprocess.check_output(command, cwd=root, env=variables, text=True)
    return tuple(output.split())


@pytest.mark.slow
def test_an_equal_stream_gives_equal_bytes_in_any_process_on_any_instruction_set():
    lacking = "-AVX2,-FMA,-FMA4,-AVX512F,-AVX512VL"
    environments = [
        {},
        {"NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR"},
        {"GLIBC_TUNABLES": f"glibc.cpu.hwcaps={lacking}"},
    ]
    results = [elsewhere(**environment) for environment in environments]
    images, functions = zip(*results, strict=True)

    assert digest(2) == digest(2) != digest(3)
    assert {*images} == {digest(2)}
    # the libraries' own functions do follow the instruction set
    assert len({*functions}) > 1


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


def image_of_edge(options: KinectOptions, rows: int, grazing: float = 0.0):
    """Depth (rows, 40) in m, 1 on the left and 2 on the right, and its image in mm."""
    depth = np.ones((rows, 40), dtype=np.float32)
    depth[:, 20:] = 2.0
    angle = np.full_like(depth, grazing)
    return depth, read_depth(depth, angle, UNBIASED, options, default_rng(4))


@pytest.mark.parametrize(("depth", "grazing"), [(0.8, 0.0), (1.2, 0.9), (3.0, 1.3)])
def test_noise_of_a_flat_wall_has_the_axial_deviation(depth: float, grazing: float):
    wall = (np.full(SHAPE, value, dtype=np.float32) for value in (depth, grazing))
    image = read_depth(*wall, UNBIASED, KinectOptions(), default_rng(8))
    error = image - 1e3 * depth
    # published law in mm, and the variance of rounding to 1 mm
    of_angle = grazing**2 / (np.pi / 2 - grazing) ** 2
    law = 1.5 - 0.5 * depth + 0.3 * depth**2 + 0.1 * depth**1.5 * of_angle
    predicted = np.hypot(law, 1 / np.sqrt(12))

    # 217 088 pixels: the deviation's standard error is 0.15 %
    assert error.std() == pytest.approx(predicted, rel=0.006)
    assert error.std() != pytest.approx(1.02 * predicted, rel=0.006)
    assert largest_score(error.ravel()) < 5
    # neighbours are independent
    products = error[:, 1:] * error[:, :-1]
    assert abs(products.mean()) < 5 * error.var() / np.sqrt(error.size)


@pytest.mark.parametrize("grazing", [0.0, 1.2])
def test_lateral_noise_moves_an_edge_by_the_published_deviation(grazing: float):
    options = replace(CLEAN, lateral=KinectOptions().lateral)
    _, image = image_of_edge(options, 20_000, grazing)
    crossed = image[:, 17:20] == 2000
    sigma = 0.8 + 0.035 * grazing / (np.pi / 2 - grazing)
    stated = lateral_deviation(np.full(1, grazing, np.float32), options)

    def score(deviation: float) -> float:
        # the pixel's centre lies 2.5, 1.5 and 0.5 px from the edge
        return largest_score(crossed, norm.cdf([-2.5, -1.5, -0.5], scale=deviation))

    assert stated == pytest.approx(sigma, rel=1e-5)
    assert score(sigma) < 4
    assert score(1.1 * sigma) > 8
    assert np.all(image[:, :16] == 1000)
    assert np.all(image[:, 24:] == 2000)


def test_edges_lose_and_mix_their_pixels_at_the_stated_rates_and_nowhere_else():
    options = replace(CLEAN, edge_lost=0.3, edge_mixed=0.2)
    depth, image = image_of_edge(options, 2000)
    edge = image[:, 19:21]
    between = edge[(edge != 0) & (edge != 1000) & (edge != 2000)]
    mixed = between.size / edge.size

    # 4000 pixels: a rate of 0.3 has a standard error of 0.007
    assert (edge == 0).mean() == pytest.approx(0.3, abs=0.03)
    assert mixed == pytest.approx(0.2, abs=0.03)
    assert mixed != pytest.approx(0.3, abs=0.03)
    # uniform between the two depths
    error = 1000 / np.sqrt(12 * between.size)
    assert between.mean() == pytest.approx(1500, abs=5 * error)
    exact = np.rint(1000 * depth)
    for beside in (np.s_[:, :19], np.s_[:, 21:]):
        assert_array_equal(image[beside], exact[beside])


def test_without_noise_the_image_is_the_exact_depth_in_whole_millimetres():
    column = np.linspace(0.0, 1.7, 424, dtype=np.float32)
    grazing = np.tile(column[:, None], 512)
    valid = (RAMP >= 0.5) & (RAMP <= 4.5) & (grazing <= CLEAN.grazing_limit)

    image = read_depth(RAMP, grazing, UNBIASED, CLEAN, default_rng(0))

    assert image.dtype == np.uint16
    expected = np.where(valid, np.rint(RAMP * np.float32(1000)), 0)
    assert_array_equal(image, expected)
    assert 0.1 < valid.mean() < 0.9


BIASED = KinectOptions(bias_offset_std=5e-3, bias_wiggle=2e-3)


PERIODS = slice(4230)  # nine periods of the wiggle, in mm


def test_bias_shifts_depth_smoothly():
    bias = draw_bias(BIASED, default_rng(1))
    depth = RAMP.clip(0.6, 4.4)
    image = read_depth(depth, np.zeros_like(depth), bias, CLEAN, default_rng(0))
    millimetres = 1e3 * depth[0]
    shift = image[0] - millimetres
    waves = bias[PERIODS]
    steepest = 1e-3 * 2e-3 * 2 * np.pi / 0.47

    assert np.abs(shift - 1e3 * bias[millimetres.astype(int)]).max() <= 0.501
    assert np.abs(waves - waves.mean()).max() == pytest.approx(2e-3, rel=0.02)
    assert np.abs(np.diff(bias)).max() < 1.01 * steepest


def test_the_offset_of_the_bias_is_one_draw_a_session():
    biases = [draw_bias(BIASED, default_rng(seed)) for seed in range(300)]
    offsets = [bias[PERIODS].mean() for bias in biases]
    assert np.std(offsets) == pytest.approx(5e-3, rel=0.15)
