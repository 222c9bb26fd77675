"""Statistics over takes: intervals cover as often as they say, and pairing makes them narrow."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import ttest_rel

from pipeline.statistics.takes import (
    jackknife_counts,
    jackknife_difference,
    lag_one_correlation,
    paired_difference,
    percentile_interval,
    resampled_differences,
    share_between,
    takes_moments,
)

TAKES = 40


def means(values: dict[str, np.ndarray]):
    return lambda model, takes: {"mean": float(values[model][takes].mean())}


def resampled(a: np.ndarray, b: np.ndarray, rng: np.random.Generator):
    rows = resampled_differences(means({"a": a, "b": b}), ["a", "b"], len(a), rng)
    return rows.set_index("model")


def test_the_interval_of_a_paired_difference_is_that_of_the_paired_t_test():
    rng = np.random.default_rng(9)
    takes = rng.normal(0, 5, 12)  # what a take is like, which both models share
    a, b = takes + rng.normal(0.3, 0.2, 12), takes + rng.normal(0, 0.2, 12)
    expected = ttest_rel(a, b).confidence_interval(0.95)
    differences = paired_difference(a, b)
    assert differences == pytest.approx(((a - b).mean(), expected.low, expected.high))
    # control: unpaired, the takes' own spread would hide the difference
    assert differences.low > 0 > paired_difference(a, b[::-1]).low


def jackknife(values: np.ndarray):
    counts = jackknife_counts(len(values))
    return jackknife_difference(counts @ values / counts.sum(axis=1))


def percentile(values: np.ndarray):
    rng = np.random.default_rng(int(1e6 * abs(values[0])))
    return resampled(np.zeros(len(values)), values, rng).loc["b", ["difference", "low", "high"]]


@pytest.mark.parametrize(
    ("interval", "takes", "repeats"),
    [
        (lambda values: paired_difference(values, 0 * values), 6, 3000),
        (jackknife, 6, 3000),
        (percentile, TAKES, 150),
    ],
)
def test_intervals_cover_the_true_mean_as_often_as_they_say(interval, takes, repeats):
    draws = np.random.default_rng(10).normal(1, 2, (repeats, takes))
    ends = np.array([interval(values) for values in draws])
    share = np.mean((ends[:, 1] <= 1) & (ends[:, 2] >= 1))
    assert abs(share - 0.95) < 4 * np.sqrt(0.95 * 0.05 / repeats)
    np.testing.assert_allclose(ends[:, 0], draws.mean(axis=1))


def test_one_further_value_lies_in_a_percentile_interval_as_often_as_it_says():
    draws = np.random.default_rng(11).normal(size=(79, 4000))
    low, high = percentile_interval(draws[:-1])
    assert np.mean((low <= draws[-1]) & (draws[-1] <= high)) == pytest.approx(0.95, abs=0.014)
    # the linear form would be too short
    low, high = np.quantile(draws[:39], (0.025, 0.975), axis=0)
    assert np.mean((low <= draws[-1]) & (draws[-1] <= high)) < 0.93


def test_an_interval_that_does_not_exist_is_a_gap():
    single = paired_difference(np.array([2.0]), np.array([0.5]))
    assert single.difference == 1.5 and np.isnan(single[1:]).all()
    for missing in (np.nan, -np.inf):
        assert np.isnan(paired_difference(np.array([1.0, missing]), np.array([0.0, missing]))).all()
    rows = resampled(np.ones(1), np.zeros(1), np.random.default_rng(3))
    assert rows["low"].isna().all() and rows.loc["b", "difference"] == -1
    assert np.isnan(jackknife(np.array([0.0, 1.0])).low)
    assert np.isfinite(jackknife(np.array([0.0, 1.0, 3.0]))).all()


def test_the_same_takes_are_drawn_for_all_models_and_the_first_has_no_difference():
    rng = np.random.default_rng(0)
    common = rng.normal(size=TAKES)
    other = common + 0.3 + 0.1 * rng.normal(size=TAKES)
    rows = resampled(common, other, rng)
    assert rows.loc["a", ["difference", "low", "high"]].isna().all()
    half = 2.02 * (other - common).std(ddof=1) / np.sqrt(TAKES)
    assert rows.loc["b", "high"] - rows.loc["b", "low"] == pytest.approx(2 * half, rel=0.3)
    # control: unpaired takes would leave an interval ten times as wide
    wide = resampled(common, np.roll(other, 7), rng).loc["b"]
    assert wide["high"] - wide["low"] > 5 * half


def test_moments_over_takes_are_those_of_each_step():
    samples = np.random.default_rng(1).normal(size=(7, 4, 3)) * [1.0, 2.0, 3.0]
    mean, covariance = takes_moments(samples)
    np.testing.assert_allclose(mean, samples.mean(axis=0))
    np.testing.assert_allclose(covariance, [np.cov(step.T) for step in samples.swapaxes(0, 1)])


def test_the_lag_one_correlation_is_that_of_its_law_whatever_the_mean_at_each_step():
    noise = np.random.default_rng(6).standard_normal((100, 401))
    moving = noise[:, 1:] - 0.5 * noise[:, :-1]  # correlation −0.5/1.25
    trend = 10 * np.sin(np.arange(400))
    assert lag_one_correlation(moving + trend) == pytest.approx(-0.4, abs=0.025)
    assert lag_one_correlation(np.ones((3, 5))) == 0.0


@pytest.mark.parametrize(
    ("groups", "offset", "least", "greatest"),
    [
        ("aabb", 0.0, 0.25, 0.42),  # (groups − 1)/(takes − 1) = 1/3
        ("aabb", 5.0, 0.9, 1.0),
        ("aaaa", 5.0, 0.0, 0.0),
        ("abcd", 5.0, 0.0, 0.0),
    ],
)
def test_what_lies_between_recordings_is_their_share_of_the_variance(
    groups, offset, least, greatest
):
    noise = np.random.default_rng(10).normal(size=(4, 100, 3))
    noise[2:] += offset
    assert least <= share_between(noise, groups) <= greatest
