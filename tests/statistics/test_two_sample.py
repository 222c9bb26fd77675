"""The energy test: its statistic by hand, its level on independent and on correlated records, and
its power.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom, energy_distance, kstest

from pipeline.core.errors import ModelDomainError
from pipeline.statistics import two_sample
from pipeline.statistics.two_sample import autocorrelation_time, energy_test, thinned

# correlation of a record's neighbouring samples, whose autocorrelation time is (1 + 0.9)/(1 − 0.9)
# = 19
DECAY = 0.9


@pytest.fixture
def few_permutations(monkeypatch):
    """199 divisions: the level is the same, and hundreds of tests take seconds."""
    monkeypatch.setattr(two_sample, "PERMUTATIONS", 199)


def record(samples, decay, rng):
    """A stationary record (samples, 2) of standard normal values whose correlation falls by
    ``decay`` a sample.
    """
    innovation = rng.standard_normal((samples, 2)) * np.sqrt(1 - decay**2)
    return lfilter(
        [1.0], [1.0, -decay], innovation, axis=0, zi=decay * rng.standard_normal((1, 2))
    )[0]


def rejections(draw, count, seed, level=0.05):
    """How many of ``count`` pairs of samples the test rejects at ``level``."""
    return sum(
        energy_test(*draw(rng), rng)[1] <= level for rng in np.random.default_rng(seed).spawn(count)
    )


def test_the_distance_of_one_variable_is_twice_the_integrated_squared_difference():
    rng = np.random.default_rng(60)
    a, b = rng.normal(size=(40, 1)), rng.normal(0.5, 2.0, (70, 1))
    # SciPy's is the root of it
    assert energy_test(a, b, rng)[0] == pytest.approx(
        energy_distance(a[:, 0], b[:, 0]) ** 2, rel=1e-10
    )


def test_the_distance_does_not_change_with_a_turn_of_the_axes_and_grows_with_the_unit():
    rng = np.random.default_rng(61)
    a, b = rng.normal(size=(30, 2)), rng.normal(0.3, 1.5, (50, 2))
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    distance, _ = energy_test(a, b, rng)
    assert energy_test(a @ turn.T, b @ turn.T, rng)[0] == pytest.approx(distance, rel=1e-10)
    assert energy_test(1000 * a, 1000 * b, rng)[0] == pytest.approx(1000 * distance, rel=1e-10)


@pytest.mark.usefixtures("few_permutations")
def test_p_values_of_one_law_are_uniform_and_of_two_are_not():
    rngs = np.random.default_rng(62).spawn(400)
    same = [
        energy_test(rng.standard_normal((40, 2)), rng.standard_normal((80, 2)), rng)[1]
        for rng in rngs
    ]
    other = [
        energy_test(rng.standard_normal((40, 2)) + 0.5, rng.standard_normal((80, 2)), rng)[1]
        for rng in rngs[:100]
    ]
    assert kstest(same, "uniform").pvalue > 1e-3
    assert kstest(other, "uniform").pvalue < 1e-9


@pytest.mark.slow
@pytest.mark.usefixtures("few_permutations")
def test_thinned_correlated_records_are_rejected_as_often_as_stated_and_whole_ones_almost_always():
    def thin(rng):
        sample = thinned(record(4000, DECAY, rng))
        return sample, rng.standard_normal((4 * len(sample), 2))

    def whole(rng):
        return record(4000, DECAY, rng)[:300], rng.standard_normal((600, 2))

    # 300 tests at 0.05: within the central 99.9 % of the binomial law, widened to 0.08 for the
    # correlation that thinning leaves
    assert binom.ppf(5e-4, 300, 0.05) <= rejections(thin, 300, 63) <= binom.ppf(1 - 5e-4, 300, 0.08)
    assert rejections(whole, 30, 64) > 24


@pytest.mark.usefixtures("few_permutations")
@pytest.mark.parametrize(("deviation", "least"), [(1.5, 0.9), (0.65, 0.9)])
def test_a_wrong_variance_of_a_correlated_record_is_found(deviation, least):
    def scaled(rng):
        sample = thinned(deviation * record(4000, DECAY, rng))
        return sample, rng.standard_normal((4 * len(sample), 2))

    assert rejections(scaled, 60, 65) >= least * 60


@pytest.mark.usefixtures("few_permutations")
def test_a_wrong_shape_of_the_right_mean_and_covariance_is_found():
    def skewed(rng):
        return rng.exponential(size=(200, 2)) - 1, rng.standard_normal((800, 2))

    assert rejections(skewed, 40, 66) >= 36


def test_the_autocorrelation_time_is_that_of_the_slowest_component():
    rng = np.random.default_rng(67)
    slow, fast = record(200_000, DECAY, rng), record(200_000, 0.3, rng)
    assert autocorrelation_time(slow) == pytest.approx(19, rel=0.1)
    assert autocorrelation_time(fast) == pytest.approx(1.3 / 0.7, rel=0.1)
    assert autocorrelation_time(np.column_stack([fast[:, 0], slow[:, 0]])) == pytest.approx(
        19, rel=0.1
    )
    assert autocorrelation_time(rng.standard_normal((200_000, 2))) == pytest.approx(1, abs=0.05)


def test_the_autocorrelation_time_is_the_variance_of_the_mean_in_independent_samples():
    means = [record(4000, DECAY, rng).mean(axis=0) for rng in np.random.default_rng(68).spawn(1000)]
    assert np.var(means) * 4000 == pytest.approx(19, rel=0.15)


def test_thinning_leaves_little_correlation_and_not_too_many_samples():
    rng = np.random.default_rng(69)
    kept = thinned(record(11_000, DECAY, rng))
    assert 200 < len(kept) <= 300
    assert np.abs(np.corrcoef(kept[1:, 0], kept[:-1, 0])[0, 1]) < 0.2
    assert len(thinned(rng.standard_normal((50_000, 2)))) <= 300
    assert len(thinned(rng.standard_normal((100, 2)))) < 100


@pytest.mark.parametrize(
    "values", [np.ones((50, 2)), np.column_stack([np.arange(50.0), np.zeros(50)]), np.zeros((1, 2))]
)
def test_a_record_that_does_not_vary_is_refused(values):
    with pytest.raises(ModelDomainError, match="autocorrelation time"):
        autocorrelation_time(values)


def test_a_record_too_short_for_two_independent_samples_is_refused():
    with pytest.raises(ModelDomainError, match="too short"):
        thinned(np.random.default_rng(70).standard_normal((2, 2)))
