"""Standard deviations over time: a true model passes the test and has the least error, constant
noise does not, and where neither can be told the power says so. Intervals over takes cover as often
as they say, and pairing makes them narrow.
"""

import numpy as np
import pandas as pd
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose
from scipy.stats import ttest_rel
from sequences import correlated

from pipeline.statistics.curves import (
    HALF_EXPLAINED,
    POWER,
    RECOGNISED,
    ModelledNoise,
    following_tests,
    jackknifed_mean_error,
    jackknifed_spreads,
    variation_limits,
)
from pipeline.statistics.takes import (
    REPLICATES,
    drawn_takes,
    jackknife_counts,
    jackknife_difference,
    lag_one_correlation,
    paired_difference,
    percentile_interval,
    resampled_differences,
    share_between,
)

STEPS = 160
DRAWS = 25
TAKES = 40
JOINTS = ("elbow", "wrist")
NOT_STEADY = np.zeros(STEPS, dtype=bool)
LAWS = {
    "normal": lambda rng, size: rng.standard_normal(size),
    "heavy-tailed": lambda rng, size: rng.standard_t(5, size) * np.sqrt(0.6),
}


def curve(variation: float) -> np.ndarray:
    """(STEPS, 2) standard deviations of so much variation over their mean."""
    phases = np.linspace(0, 4 * np.pi, STEPS, endpoint=False)
    wave = 1 + np.sqrt(2) * variation * np.sin(phases)
    return 1e-3 * np.stack([wave, wave[::-1]], axis=1)


def takes_of(
    std: np.ndarray,
    law: str,
    share: float,
    takes: int,
    rng,
) -> np.ndarray:
    """(takes, STEPS, 2) noise, correlated from step to step by ``share``."""
    draws = LAWS[law](rng, (takes, *std.shape))
    return std * correlated(draws, share, axis=1)


def constant(std: np.ndarray) -> np.ndarray:
    """Standard deviations (STEPS, n) of the same mean square that do not vary."""
    return np.sqrt(np.mean(std**2, axis=0)) * np.ones_like(std)


@pytest.mark.slow
@pytest.mark.parametrize("variation", [0.05, 0.4])
@pytest.mark.parametrize(
    # of_many: the variation of which many takes are drawn, else few
    ("law", "share", "of_many"),
    [("normal", 0.0, 0.05), ("normal", 0.7, 0.4), ("heavy-tailed", 0.0, 0.05)],
)
def test_a_true_model_passes_in_all_joints_and_constant_noise_fails_as_often_as_the_power_says(
    variation,
    law,
    share,
    of_many,
):
    takes = 50 if variation == of_many else 4
    std = curve(variation)
    rng = default_rng(takes)

    def tested(truth: np.ndarray) -> pd.DataFrame:
        """Rows of tests of ``std``, of noise with the standard deviations ``truth``."""
        tables = []
        for draw in range(DRAWS):
            noise = takes_of(truth, law, share, takes, rng)
            rows = following_tests(std, noise, NOT_STEADY, JOINTS, rng)
            tables.append(rows.assign(draw=draw))
        return pd.concat(tables, ignore_index=True)

    def share_passed(rows: pd.DataFrame, limits: pd.Series | float) -> float:
        """Share of draws in which all joints reach their limits."""
        passed = rows["correlation"] >= limits
        return passed.groupby(rows["draw"]).all().mean()

    of_model = tested(std)
    of_constant = tested(constant(std))
    error = np.sqrt(RECOGNISED * (1 - RECOGNISED) / DRAWS)
    rejected = np.mean(of_constant["correlation"] < of_constant["limit"])
    power = of_model["power"].mean()

    assert of_model["limit"].max() <= HALF_EXPLAINED
    assert share_passed(of_model, of_model["limit"]) >= RECOGNISED - 4 * error
    assert rejected == pytest.approx(power, abs=0.15)
    # control: a fixed limit of √½ would fail the true model where nothing can be told
    if takes == 4 and variation == 0.05:
        assert power < POWER
        assert share_passed(of_model, HALF_EXPLAINED) < 0.1
    elif variation == 0.4 and share == 0:
        assert power > POWER


@pytest.mark.slow
@pytest.mark.parametrize("law", [2.5, np.inf])  # degrees of freedom of Student's law
def test_few_takes_with_heavy_tails_refute_no_true_model_and_vary_no_constant_noise(
    law,
):
    """Residuals about the mean of four takes have lighter tails than the noise; shares of wrong
    verdicts over five joints at once are within 3.5 standard errors of 1 − RECOGNISED.
    """
    rng = default_rng(1)
    joints = "abcde"
    repeats = 40
    std = np.repeat(curve(0.6)[:, :1], len(joints), axis=1)
    flat = np.full_like(std, std.mean())
    refuted = []
    rejected = []
    varied = []
    for _ in range(repeats):
        draws = rng.standard_normal((4, *std.shape))
        if np.isfinite(law):
            draws = rng.standard_t(law, (4, *std.shape))
        for failing, truth in ((refuted, std), (rejected, flat)):
            rows = following_tests(std, truth * draws, NOT_STEADY, joints, rng)
            failing.append((rows["correlation"] < rows["limit"]).to_numpy())
        _, high = variation_limits(draws, rng).T
        varied.append((variation_of(draws) > high).any())

    error = np.sqrt(RECOGNISED * (1 - RECOGNISED) / repeats)
    most = 1 - RECOGNISED + 3.5 * error
    assert np.any(refuted, axis=1).mean() <= most
    assert np.mean(varied) <= most
    assert np.mean(rejected) > POWER


def variation_of(noise: np.ndarray) -> np.ndarray:
    """(n,) standard deviation over mean of the standard deviation at each step."""
    std = noise.std(axis=0, ddof=1)
    return std.std(axis=0) / std.mean(axis=0)


@pytest.mark.parametrize(("variation", "is_beyond"), [(0.0, False), (0.6, True)])
@pytest.mark.parametrize("law", LAWS)
def test_noise_that_varies_is_above_its_limits_and_constant_noise_of_many_takes_below(
    law,
    variation,
    is_beyond,
):
    rng = default_rng(50)
    noise = takes_of(curve(variation), law, 0.3, 100, rng)
    low, high = variation_limits(noise, rng).T
    if is_beyond:
        assert (variation_of(noise) > high).all()
    else:
        assert (variation_of(noise) < low).all()


def test_steps_without_noise_leave_limits_and_a_joint_without_noise_has_none():
    rng = default_rng(4)
    noise = takes_of(curve(0.1), "normal", 0.0, 4, rng)
    noise[..., 1] = 0.0
    # in the middle, after a loud start: the running sum of the variances rounds below zero there
    noise[:, STEPS // 3 : 2 * STEPS // 3, 0] = 0.0

    limits, without_noise = variation_limits(noise, rng)

    assert np.isfinite(limits).all()
    assert limits[0] < limits[1]
    assert np.isnan(without_noise).all()


RAMP = np.linspace(0.2, 2.0, STEPS)[:, None] * np.array([1.0, 0.5])
FLAT = constant(RAMP)
MEASUREMENT = np.full(2, 0.01)


def noise_of(std: np.ndarray, takes: int, seed: int) -> np.ndarray:
    return std * default_rng(seed).normal(size=(takes, *std.shape))


@pytest.mark.parametrize("level", [0.1, 10.0])
def test_errors_are_compared_at_one_level_and_the_true_model_has_the_least(level):
    noise = noise_of(np.sqrt(RAMP**2 + MEASUREMENT), TAKES, 2)
    even = np.mean(RAMP**2, axis=1)[:, None] * np.ones(2)  # one variance for all joints
    motion = {
        "flat": level * FLAT**2,
        "ramp": RAMP**2,
        "same": 2 * FLAT**2,
        "even": level * even,
    }
    modelled = {}
    for name, variances in motion.items():
        modelled[name] = ModelledNoise(variances, MEASUREMENT, noise)

    errors, sizes = jackknifed_spreads(modelled, noise)

    first = {name: values[:, 0] for name, values in errors.items()}
    assert jackknife_difference(first["ramp"] - first["flat"]).high < 0
    assert first["ramp"][0] < 0.2 < first["flat"][0] < 1
    # the model of one variance has the greater error in the joint with the least
    assert jackknife_difference(first["even"] - errors["even"][:, 1]).high < 0
    assert_allclose(errors["same"], errors["flat"])
    for of_joint in sizes["ramp"].T:
        wider = jackknife_difference(of_joint)
        assert wider.low < 0 < wider.high
    assert sizes["even"][0, 0] < 0


def test_the_error_of_a_biased_mean_varies_more_and_an_order_by_chance_is_not_decided():
    noise = noise_of(FLAT, TAKES, 7)
    course = np.sin(np.linspace(0, 3, STEPS))[:, None]
    plain = jackknifed_mean_error(noise)
    again = jackknifed_mean_error(noise_of(FLAT, TAKES, 8))
    biased = jackknifed_mean_error(noise + course)

    assert jackknife_difference(plain - biased).high < 0

    chance = jackknife_difference(plain - again)
    assert chance.low < 0 < chance.high


def means(values: dict[str, np.ndarray]):
    return lambda model, takes: np.array([values[model][takes].mean()])


def resampled(a: np.ndarray, b: np.ndarray, rng: np.random.Generator):
    models = {"a": a, "b": b}
    differences = resampled_differences(means(models), [*models], len(a), rng)
    return differences["b"][0]


def test_the_interval_of_a_paired_difference_is_that_of_the_paired_t_test():
    rng = default_rng(9)
    takes = rng.normal(0, 5, 12)  # what a take is like, which both models share
    a = takes + rng.normal(0.3, 0.2, 12)
    b = takes + rng.normal(0, 0.2, 12)
    expected = ttest_rel(a, b).confidence_interval(0.95)

    differences = paired_difference(a, b)

    numbers = ((a - b).mean(), expected.low, expected.high)
    assert differences[:3] == pytest.approx(numbers)
    # control: unpaired, the takes' own spread would hide the difference
    assert differences.low > 0 > paired_difference(a, b[::-1]).low
    for few in (3, 4, 12):  # the jackknife of a mean is the same
        paired = paired_difference(a[:few], b[:few])
        assert jackknife((a - b)[:few]) == pytest.approx(paired)


def jackknife(values: np.ndarray):
    counts = jackknife_counts(len(values))
    return jackknife_difference(counts @ values / counts.sum(axis=1))


def percentile(values: np.ndarray):
    rng = default_rng(int(1e6 * abs(values[0])))
    return resampled(np.zeros(len(values)), values, rng)


@pytest.mark.parametrize(
    ("interval", "takes", "repeats"),
    [(jackknife, 6, 3000), (percentile, TAKES, 150)],
)
def test_intervals_cover_the_true_mean_as_often_as_they_say(interval, takes, repeats):
    draws = default_rng(10).normal(1, 2, (repeats, takes))
    intervals = np.array([interval(values)[:3] for values in draws])
    middle, low, high = intervals.T
    share = np.mean((low <= 1) & (1 <= high))
    error = np.sqrt(0.95 * 0.05 / repeats)

    assert abs(share - 0.95) < 4 * error
    assert_allclose(middle, draws.mean(axis=1))


def test_one_further_value_lies_in_a_percentile_interval_as_often_as_it_says():
    draws = default_rng(11).normal(size=(79, 4000))
    further = draws[-1]
    low, high = percentile_interval(draws[:-1])
    inside = (low <= further) & (further <= high)

    assert inside.mean() == pytest.approx(0.95, abs=0.014)

    # the linear form would be too short
    low, high = np.quantile(draws[:39], (0.025, 0.975), axis=0)
    inside = (low <= further) & (further <= high)
    assert inside.mean() < 0.93


def test_an_interval_that_does_not_exist_is_a_gap():
    single = paired_difference(np.array([2.0]), np.array([0.5]))
    alone = resampled(np.ones(1), np.zeros(1), default_rng(3))

    assert single.difference == 1.5 and np.isnan(single[1:]).all()
    assert alone.difference == -1 and np.isnan(alone.low)
    assert np.isnan(jackknife(np.array([0.0, 1.0])).low)
    assert np.isfinite(jackknife(np.array([0.0, 1.0, 3.0]))).all()


@pytest.mark.parametrize("missing", [np.nan, -np.inf])
def test_a_difference_of_missing_scores_is_a_gap(missing):
    scores = np.array([[1.0, missing], [0.0, missing]])
    assert np.isnan(paired_difference(*scores)).all()


def test_a_resampling_of_one_take_alone_is_left_out():
    """It has no variance."""
    drawn = drawn_takes(2, default_rng(4))
    assert 0 < len(drawn) < REPLICATES
    assert all(len({*indices}) == 2 for indices in drawn)


def test_the_lag_one_correlation_is_that_of_its_law_whatever_the_mean_at_each_step():
    noise = default_rng(6).standard_normal((100, 401))
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
    groups,
    offset,
    least,
    greatest,
):
    noise = default_rng(10).normal(size=(4, 100, 3))
    noise[2:] += offset
    assert least <= share_between(noise, groups) <= greatest
