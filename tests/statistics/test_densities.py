"""Kernel densities against direct summation and their exact expectation; the energy test by hand,
its level on independent and on correlated records, and its power.
"""

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose
from scipy.stats import binom, energy_distance, kstest, norm
from sequences import correlated

from pipeline.core.errors import ModelDomainError
from pipeline.statistics import densities
from pipeline.statistics.densities import (
    autocorrelation_time,
    energy_test,
    kernel_density,
    normal_reference_bandwidth,
    thin_record,
)

COVARIANCE = np.array([[5.0, -2.0], [-2.0, 2.0]])
MEAN = np.array([3.0, 5.0])
DECAY = 0.9  # correlation of neighbouring samples: the time is (1 + 0.9)/(1 − 0.9) = 19


def draw(count, seed=28):
    return default_rng(seed).multivariate_normal(MEAN, COVARIANCE, count)


def direct_summation(samples, x, y, bandwidth):
    """Density (X, Y) as the sum of normal kernels."""
    along_x, along_y = (
        norm.pdf(points[:, None], samples[:, i], bandwidth[i])
        for i, points in enumerate((x, y))
    )
    return along_x @ along_y.T / len(samples)


def grid(points, reach):
    spread = reach * np.sqrt(np.diag(COVARIANCE))
    return np.linspace(MEAN - spread, MEAN + spread, points).T


@pytest.mark.parametrize(("count", "reach"), [(5, 4.0), (5000, 4.0), (3000, 0.5)])
def test_binning_agrees_with_direct_summation_also_on_a_grid_that_leaves_samples_out(
    count,
    reach,
):
    samples = draw(count)
    bandwidth = normal_reference_bandwidth(samples)
    x, y = grid(61, reach)
    direct = direct_summation(samples, x, y, bandwidth)

    density = kernel_density(samples, x, y, bandwidth)

    assert np.abs(density - direct).max() < 1e-3 * direct.max()
    # samples that are no numbers, or far off, count in N alone
    lost = np.array([[np.nan, 0.0], [np.inf, 5.0], [3.0, -1e300]])
    with_lost = kernel_density(np.vstack([samples, lost]), x, y, bandwidth)
    assert_allclose((count + 3) * with_lost, count * density, rtol=1e-12)


def test_the_bandwidth_of_a_normal_sample_is_the_normal_reference_and_outliers_leave_it_alone():
    samples = draw(40_000)
    # (4/((p+2)N))^{1/(p+4)} at p = 2
    reference = np.sqrt(np.diag(COVARIANCE)) * 40_000 ** (-1 / 6)
    assert_allclose(normal_reference_bandwidth(samples), reference, rtol=0.03)

    samples[:400] *= 1000
    assert_allclose(normal_reference_bandwidth(samples), reference, rtol=0.05)

    samples[:24_000, 1] = 5.0
    with pytest.raises(ModelDomainError, match="median absolute deviation"):
        normal_reference_bandwidth(samples)


@pytest.fixture
def few_permutations(monkeypatch):
    """199 divisions: the level is the same, and hundreds of tests take seconds."""
    monkeypatch.setattr(densities, "PERMUTATIONS", 199)


@pytest.mark.parametrize("p", [1, 2, 3])
def test_the_bandwidth_of_few_samples_is_the_rules(p):
    # median 2, deviations 2 1 0 2 7: MAD 2
    column = np.array([0.0, 1.0, 2.0, 4.0, 9.0])
    samples = np.stack([column] * p, axis=1)
    rule = 2 / 0.6745 * (4 / ((p + 2) * 5)) ** (1 / (p + 4))
    assert_allclose(normal_reference_bandwidth(samples), rule)


def record(samples, decay, rng):
    """A stationary record (samples, 2) of standard normal values whose correlation falls by
    ``decay`` a sample.
    """
    return correlated(rng.standard_normal((samples, 2)), decay)


def rejections(draw_pair, count, seed):
    """Number of ``count`` pairs of samples that the test rejects at 0.05."""
    p_values = []
    for rng in default_rng(seed).spawn(count):
        _, p_value = energy_test(*draw_pair(rng), rng)
        p_values.append(p_value)
    return np.sum(np.array(p_values) <= 0.05)


def test_the_distance_of_one_variable_is_twice_the_integrated_squared_difference():
    rng = default_rng(60)
    a = rng.normal(size=(40, 1))
    b = rng.normal(0.5, 2.0, (70, 1))
    # SciPy's is the root of it
    expected = energy_distance(a[:, 0], b[:, 0]) ** 2
    assert energy_test(a, b, rng)[0] == pytest.approx(expected, rel=1e-10)


@pytest.mark.usefixtures("few_permutations")
def test_the_true_division_counts_among_the_permutations():
    rng = default_rng(61)
    a = rng.standard_normal((40, 2))
    _, p_value = energy_test(a, a + 100.0, rng)
    assert p_value == 1 / (1 + densities.PERMUTATIONS)


@pytest.mark.usefixtures("few_permutations")
@pytest.mark.parametrize(("shift", "is_uniform"), [(0.0, True), (0.5, False)])
def test_p_values_of_one_law_are_uniform_and_of_two_are_not(shift, is_uniform):
    p_values = []
    for rng in default_rng(62).spawn(400):
        a = rng.standard_normal((40, 2))
        b = rng.standard_normal((80, 2))
        _, p_value = energy_test(a + shift, b, rng)
        p_values.append(p_value)

    uniformity = kstest(p_values, "uniform").pvalue
    assert uniformity > 1e-3 if is_uniform else uniformity < 1e-9


@pytest.mark.slow
@pytest.mark.usefixtures("few_permutations")
def test_thinned_correlated_records_are_rejected_as_often_as_stated_and_whole_ones_almost_always():
    def thin(rng):
        sample = thin_record(record(4000, DECAY, rng))
        return sample, rng.standard_normal((4 * len(sample), 2))

    def whole(rng):
        return record(4000, DECAY, rng)[:300], rng.standard_normal((600, 2))

    # 300 tests at 0.05: within the central 99.9 % of the binomial law, widened to 0.08 for the
    # correlation that thinning leaves
    least = binom(300, 0.05).ppf(5e-4)
    most = binom(300, 0.08).ppf(1 - 5e-4)
    assert least <= rejections(thin, 300, 63) <= most
    assert rejections(whole, 30, 64) > 24


def test_the_autocorrelation_time_is_that_of_the_slowest_component():
    rng = default_rng(67)
    slow = record(200_000, DECAY, rng)
    fast = record(200_000, 0.3, rng)
    both = np.column_stack([fast[:, 0], slow[:, 0]])
    white = rng.standard_normal((200_000, 2))

    assert autocorrelation_time(fast) == pytest.approx(1.3 / 0.7, rel=0.1)
    assert autocorrelation_time(both) == pytest.approx(19, rel=0.1)
    assert autocorrelation_time(white) == pytest.approx(1, abs=0.05)


def test_the_autocorrelation_time_is_the_inflation_of_the_variance_of_a_mean():
    rngs = default_rng(68).spawn(1000)
    means = [record(4000, DECAY, rng).mean(axis=0) for rng in rngs]
    assert np.var(means) * 4000 == pytest.approx(19, rel=0.15)


@pytest.mark.parametrize(
    "values",
    [
        np.ones((50, 2)),
        np.column_stack([np.arange(50.0), np.zeros(50)]),
        np.zeros((1, 2)),
    ],
)
def test_a_record_that_does_not_vary_has_no_autocorrelation_time(values):
    with pytest.raises(ModelDomainError, match="autocorrelation time"):
        autocorrelation_time(values)


def test_a_record_that_is_too_short_is_refused():
    with pytest.raises(ModelDomainError, match="too short"):
        thin_record(default_rng(70).standard_normal((2, 2)))
