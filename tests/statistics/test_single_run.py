"""The test of one run over its blocks: its errors are as stated for correlated noise and for a
burst, and the stated power is the share of detections.
"""

import numpy as np
import pytest

from pipeline.statistics.single_run import (
    SpeedEffect,
    blocks_of_run,
    least_variation,
    slowest_and_fastest_third,
    speed_effect,
)
from pipeline.statistics.takes import TAILS

MARGIN = np.log(1.25)
REPEATS = 60


def speeds_of(steps: int, periods: int) -> np.ndarray:
    """Return the speeds (steps,) of a joint that moves to and fro."""
    return np.abs(np.sin(2 * np.pi * periods * np.arange(steps) / steps))


def correlated(rng: np.random.Generator, steps: int, share: float) -> np.ndarray:
    """Return noise (steps,) of variance 1 whose neighbours have the correlation ``share``."""
    noise = rng.standard_normal(steps)
    for k in range(1, steps):
        noise[k] = share * noise[k - 1] + np.sqrt(1 - share**2) * noise[k]
    return noise


def effects(
    ratio: float,
    steps: int = 1000,
    share: float = 0.8,
    burst: float = 1.0,
) -> list[SpeedEffect]:
    """Return the effects in REPEATS runs whose noise has ``ratio`` times the standard deviation at
    fast steps, and ``burst`` times during a quarter of the run that begins anywhere.
    """
    rng = np.random.default_rng(5)
    speeds = speeds_of(steps, periods=steps // 250)
    slow, fast = slowest_and_fastest_third(speeds).astype(float)
    scale = ratio ** ((1.0 + fast - slow) / 2)
    result = []
    for _ in range(REPEATS):
        during = np.roll(np.arange(steps) < steps // 4, rng.integers(steps))
        bursts = np.where(during, burst, 1.0)
        noise = scale * bursts * correlated(rng, steps, share)
        result.append(speed_effect(noise, speeds, MARGIN))
    return result


def shares(results: list[SpeedEffect]) -> tuple[float, float]:
    """Return the shares of runs whose interval is above the margin, and within it."""
    above = []
    within = []
    for result in results:
        low = result.difference.low
        high = result.difference.high
        above.append(low > MARGIN)
        within.append(-low < MARGIN and high < MARGIN)
    return np.mean(above), np.mean(within)


def most_errors() -> float:
    level = TAILS[0]
    return level + 3.5 * np.sqrt(level * (1 - level) / REPEATS)


@pytest.mark.slow
@pytest.mark.parametrize(("share", "burst"), [(0.0, 1.0), (0.8, 1.0), (0.0, 10.0)])
def test_a_ratio_at_the_margin_is_seldom_called_greater_or_smaller(share, burst):
    above, within = shares(effects(1.25, share=share, burst=burst))
    assert above <= most_errors()
    assert within <= most_errors()


@pytest.mark.slow
def test_constant_noise_is_within_the_margin_in_a_long_run_and_growing_noise_above_it():
    above, within = shares(effects(1.0, steps=8000, share=0.0))
    assert above == 0.0
    assert within > 0.8
    above, within = shares(effects(2.5, steps=2000, share=0.0))
    assert above > 0.8
    assert within == 0.0


@pytest.mark.slow
def test_a_burst_leaves_a_run_undecided():
    """A burst that begins anywhere decides nothing, though it is ten times the noise."""
    above, within = shares(effects(1.0, burst=10.0))
    assert above <= most_errors()
    assert within <= most_errors()


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.9])
def test_the_stated_power_is_the_share_of_detections_of_a_ratio_of_two(share):
    results = effects(2.0, steps=500, share=share)
    above, _ = shares(results)
    stated = np.mean([result.power for result in results])
    error = 3 * np.sqrt(stated * (1 - stated) / REPEATS)
    # the power of one run is itself an estimate
    assert above == pytest.approx(stated, abs=error + 0.1)


def test_the_estimate_is_the_log_of_the_ratio_and_its_sign_goes_with_the_command():
    speeds = speeds_of(5000, periods=20)
    scale = np.where(speeds > np.quantile(speeds, 2 / 3), 2.0, 1.0)
    noise = scale * np.random.default_rng(2).standard_normal(5000)
    growing = speed_effect(noise, speeds, MARGIN).difference
    falling = speed_effect(noise, 1.0 - speeds, MARGIN).difference
    assert growing.low < np.log(2.0) < growing.high
    assert growing.high - growing.low < 0.2
    # equal speeds lie in either third
    assert falling.difference == pytest.approx(-growing.difference, abs=0.01)


def test_blocks_are_longer_than_the_noise_is_correlated_and_have_slow_and_fast_steps():
    rng = np.random.default_rng(3)
    thirds = slowest_and_fastest_third(speeds_of(2000, periods=8))
    white = blocks_of_run(rng.standard_normal(2000), thirds)
    bursts = np.repeat([0.1, 3.0, 0.1, 3.0, 0.1], 400)
    clustered = blocks_of_run(bursts * rng.standard_normal(2000), thirds)
    assert len(white) > len(clustered) > 0
    assert clustered[0].stop > 100
    for block in white + clustered:
        shares = thirds[:, block].mean(axis=1)
        assert shares.min() >= 0.1
    # half of the run is slow and half is fast: no block can compare them
    in_order = slowest_and_fastest_third(np.arange(2000.0))
    assert blocks_of_run(rng.standard_normal(2000), in_order) == []


@pytest.mark.parametrize("noise", [np.zeros(600), np.repeat([0.0, 1e-3], 300)])
def test_a_run_without_noise_in_a_block_has_no_difference_and_no_power(noise):
    effect = speed_effect(noise, speeds_of(600, periods=4), MARGIN)
    assert np.isnan(effect.difference.low)
    assert effect.power == 0.0


def test_values_that_vary_by_a_quarter_seldom_fall_short_of_the_least_variation():
    rng = np.random.default_rng(4)
    drawn = 1.0 + 0.25 * rng.standard_normal((4000, 8))
    variations = drawn.std(axis=1) / drawn.mean(axis=1)
    assert np.mean(variations < least_variation(1)) == pytest.approx(0.025, abs=0.01)
    # more joints: each of them falls short more seldom
    assert least_variation(5) < least_variation(1)
