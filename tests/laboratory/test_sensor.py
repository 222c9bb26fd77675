"""The depth sensor: each part of its noise against its law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from pipeline.laboratory.options import KinectOptions
from pipeline.laboratory.sensor import Sensor, axial_std, draw_bias, lateral_std

UNBIASED = np.zeros(4502, dtype=np.float32)
CLEAN = KinectOptions(axial=(0.0, 0.0, 0.0, 0.0), lateral=(0.0, 0.0), edge_lost=0.0, edge_mixed=0.0)


def read(
    depth: np.ndarray,
    grazing: np.ndarray,
    bias: np.ndarray,
    options: KinectOptions,
    rng: np.random.Generator,
) -> np.ndarray:
    """The reading of a scene that has always been there."""
    whole = tuple(slice(0, size) for size in depth.shape)
    return Sensor(options, bias, depth, grazing).read(whole, depth, grazing, rng)


def ramp() -> np.ndarray:
    """Depth (424, 512) from nothing on the left to 4.8 m on the right."""
    return np.tile(np.linspace(0.0, 4.8, 512, dtype=np.float32), (424, 1))


def flat(depth: float, grazing: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    return np.full((424, 512), depth, dtype=np.float32), np.full(
        (424, 512), grazing, dtype=np.float32
    )


def step(rows: int = 2000, near: float = 1.0, far: float = 2.0) -> tuple[np.ndarray, np.ndarray]:
    depth = np.full((rows, 40), near, dtype=np.float32)
    depth[:, 20:] = far
    return depth, np.zeros_like(depth)


@pytest.mark.parametrize(("depth", "grazing"), [(0.8, 0.0), (1.2, 0.9), (3.0, 1.3)])
def test_noise_of_a_flat_wall_has_the_axial_deviation(depth: float, grazing: float) -> None:
    options = KinectOptions()
    error = read(*flat(depth, grazing), UNBIASED, options, np.random.default_rng(8)) - 1e3 * depth

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
    image = read(depth, angle + np.float32(grazing), UNBIASED, options, np.random.default_rng(4))
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
    image = read(depth, angle, UNBIASED, options, np.random.default_rng(4))
    edge = image[:, 19:21]
    # 4000 pixels: a rate of 0.3 has a standard error of 0.007
    assert (edge == 0).mean() == pytest.approx(0.3, abs=0.03)
    between = edge[(edge != 0) & (edge != 1000) & (edge != 2000)]
    assert between.size / edge.size == pytest.approx(0.2, abs=0.03)
    assert not between.size / edge.size == pytest.approx(0.3, abs=0.03)
    assert between.mean() == pytest.approx(1500, abs=5 * 1000 / np.sqrt(12 * between.size))
    np.testing.assert_array_equal(
        np.delete(image, [19, 20], axis=1), np.delete(np.rint(1000 * depth), [19, 20], axis=1)
    )


def test_without_noise_the_image_is_the_exact_depth_in_whole_millimetres() -> None:
    depth, grazing = ramp(), np.tile(np.linspace(0.0, 1.7, 424, dtype=np.float32)[:, None], 512)
    image = read(depth, grazing, UNBIASED, CLEAN, np.random.default_rng(0))
    valid = (depth >= 0.5) & (depth <= 4.5) & (grazing <= CLEAN.grazing_limit)
    assert image.dtype == np.uint16
    assert image.shape == (424, 512)
    np.testing.assert_array_equal(image, np.where(valid, np.rint(depth * np.float32(1000)), 0))
    assert 0.1 < valid.mean() < 0.9


@pytest.mark.parametrize(
    ("rows", "columns"), [((100, 200), (50, 90)), ((300, 424), (0, 40)), ((0, 424), (500, 512))]
)
def test_what_changed_since_the_scene_at_rest_is_read_as_if_it_had_always_been_there(
    rows: tuple[int, int], columns: tuple[int, int]
) -> None:
    rest, grazing = flat(2.0)
    rest[:, 200:300], window = 1.5, (slice(*rows), slice(*columns))
    changed, angle = rest.copy(), grazing.copy()
    changed[window], angle[window] = 1.1, 0.9
    changed[rows[0] + 10 : rows[0] + 20, columns[0] + 5 : columns[0] + 10] = 0.0
    bias = draw_bias(KinectOptions(), np.random.default_rng(1))
    sensor = Sensor(KinectOptions(), bias, rest, grazing)
    # what another window had before is forgotten
    before = slice(rows[0] // 2, rows[0] // 2 + 60), slice(columns[0] // 2, columns[0] // 2 + 30)
    sensor.read(
        before,
        *(image[before] + np.float32(0.2) for image in (rest, grazing)),
        np.random.default_rng(3),
    )
    reading = sensor.read(window, changed[window], angle[window], np.random.default_rng(2))
    alone = read(changed, angle, bias, KinectOptions(), np.random.default_rng(2))
    np.testing.assert_array_equal(reading, alone)
    # the control: the scene at rest is read otherwise
    assert np.any(
        reading != sensor.read(window, rest[window], grazing[window], np.random.default_rng(2))
    )


def test_bias_shifts_depth_smoothly_by_one_draw_a_session() -> None:
    options = KinectOptions(bias_offset_std=5e-3, bias_wiggle=2e-3)
    bias = draw_bias(options, np.random.default_rng(1))
    depth = ramp().clip(0.6, 4.4)
    shift = read(depth, np.zeros_like(depth), bias, CLEAN, np.random.default_rng(0)) - 1e3 * depth
    assert np.abs(shift[0] - 1e3 * bias[(1e3 * depth[0]).astype(int)]).max() <= 0.501
    offset, wiggle = np.mean(bias[:4230]), bias[:4230] - np.mean(bias[:4230])
    assert np.abs(wiggle).max() == pytest.approx(2e-3, rel=0.02)
    assert np.abs(np.diff(bias)).max() < 1e-3 * 2e-3 * 2 * np.pi / 0.47 * 1.01
    offsets = [
        np.mean(draw_bias(options, np.random.default_rng(seed))[:4230]) for seed in range(300)
    ]
    assert np.std(offsets) == pytest.approx(5e-3, rel=0.15)
    assert offset == pytest.approx(offsets[1], abs=1e-9)
