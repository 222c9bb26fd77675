"""The kernel density against direct summation, its exact expectation, and the bandwidth of a normal
sample.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from pipeline.core.errors import ModelDomainError
from pipeline.statistics import kde
from pipeline.statistics.kde import (
    kernel_density,
    marginal_density,
    normal_reference_bandwidth,
)

COVARIANCE = np.array([[5.0, -2.0], [-2.0, 2.0]])
MEAN = np.array([3.0, 5.0])


def draw(count, seed=28):
    return np.random.default_rng(seed).multivariate_normal(MEAN, COVARIANCE, count)


def direct_summation(samples, x, y, bandwidth):
    kernels = [
        np.exp(-0.5 * ((g[:, None] - samples[:, i]) / bandwidth[i]) ** 2) / bandwidth[i]
        for i, g in enumerate((x, y))
    ]
    return kernels[0] @ kernels[1].T / (2 * np.pi * len(samples))


def grid(points, reach):
    return (
        np.linspace(m - reach * s, m + reach * s, points)
        for m, s in zip(MEAN, np.sqrt(np.diag(COVARIANCE)), strict=True)
    )


@pytest.mark.parametrize("count", [5, 200, 5000])
def test_binning_agrees_with_direct_summation(count):
    samples = draw(count)
    bandwidth = normal_reference_bandwidth(samples)
    x, y = grid(61, 4.0)
    direct = direct_summation(samples, x, y, bandwidth)
    difference = np.abs(kernel_density(samples, x, y, bandwidth) - direct).max() / direct.max()
    assert difference < 1e-3
    assert (
        np.abs(direct_summation(samples, x, y, 1.05 * bandwidth) - direct).max() / direct.max()
        > 10 * 1e-3
    )


def test_no_kernel_is_off_by_more_than_stated_wherever_its_sample_lies(monkeypatch):
    x = np.linspace(-4.0, 4.0, 81)
    one = np.ones(2)

    def worst():
        places = np.random.default_rng(9).uniform(-0.5, 0.5, (40, 1, 2))
        return max(
            np.abs(kernel_density(at, x, x, one) - direct_summation(at, x, x, one)).max()
            * 2
            * np.pi
            for at in places
        )

    assert worst() < 8e-4
    # the control: two nodes a bandwidth are too few
    monkeypatch.setattr(kde, "NODES_PER_BANDWIDTH", 2)
    assert worst() > 8e-4


def test_a_grid_that_leaves_samples_out_has_the_same_density_where_it_is():
    samples = draw(3000)
    bandwidth = normal_reference_bandwidth(samples)
    x, y = grid(21, 0.5)
    direct = direct_summation(samples, x, y, bandwidth)
    np.testing.assert_allclose(kernel_density(samples, x, y, bandwidth), direct, rtol=1e-3)


def test_the_density_integrates_to_one():
    samples = draw(4000)
    x, y = grid(121, 6.0)
    density = kernel_density(samples, x, y, normal_reference_bandwidth(samples))
    assert density.min() >= 0
    assert density.sum() * (x[1] - x[0]) * (y[1] - y[0]) == pytest.approx(1, abs=1e-6)


def test_averaged_over_draws_the_estimate_is_the_normal_density_widened_by_the_kernel():
    bandwidth = np.array([0.9, 0.5])
    x, y = grid(9, 2.0)
    estimates = np.array([kernel_density(draw(2000, seed), x, y, bandwidth) for seed in range(100)])
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    error = estimates.std(axis=0, ddof=1) / np.sqrt(len(estimates))
    widened = multivariate_normal(MEAN, COVARIANCE + np.diag(bandwidth**2)).pdf(points)
    assert np.abs((estimates.mean(axis=0) - widened) / error).max() < 5
    assert (
        np.abs(
            (estimates.mean(axis=0) - multivariate_normal(MEAN, COVARIANCE).pdf(points)) / error
        ).max()
        > 20
    )


def test_the_bandwidth_of_a_normal_sample_is_the_normal_reference_and_outliers_leave_it_alone():
    samples = draw(40_000)
    reference = np.sqrt(np.diag(COVARIANCE)) * 40_000 ** (-1 / 6)  # (4/((p+2)N))^{1/(p+4)} at p = 2
    np.testing.assert_allclose(normal_reference_bandwidth(samples), reference, rtol=0.03)
    spoiled = samples.copy()
    spoiled[:400] *= 1000
    np.testing.assert_allclose(normal_reference_bandwidth(spoiled), reference, rtol=0.05)
    assert spoiled.std() > 10 * samples.std()


def test_the_bandwidth_follows_the_rule_for_any_number_of_variables():
    column = np.array([0.0, 1.0, 2.0, 4.0, 9.0])  # median 2, deviations 2 1 0 2 7: MAD 2
    for p in (1, 2, 3):
        expected = 2 / 0.6745 * (4 / ((p + 2) * 5)) ** (1 / (p + 4))
        np.testing.assert_allclose(
            normal_reference_bandwidth(np.tile(column[:, None], p)), expected, rtol=1e-14
        )


def test_a_variable_that_stands_still_has_no_density():
    samples = draw(100)
    samples[:60, 1] = 5.0
    with pytest.raises(ModelDomainError, match="median absolute deviation"):
        normal_reference_bandwidth(samples)


def test_a_marginal_density_is_the_sum_of_its_kernels():
    samples, x = draw(300)[:, 0], np.linspace(-6, 12, 50)
    (bandwidth,) = normal_reference_bandwidth(samples[:, None])
    # by hand: the median absolute deviation, and the rule for one variable
    mad = np.median(np.abs(samples - np.median(samples)))
    assert bandwidth == pytest.approx(mad / 0.6745 * (4 / (3 * 300)) ** 0.2, rel=1e-12)
    kernels = np.exp(-0.5 * ((x[:, None] - samples) / bandwidth) ** 2)
    direct = kernels.mean(axis=1) / (bandwidth * np.sqrt(2 * np.pi))
    np.testing.assert_allclose(marginal_density(samples, x), direct, rtol=1e-9)
