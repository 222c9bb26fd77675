"""The von Mises–Fisher law: its mean length in closed form and in its limits, and its draws."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import i0, i1
from scipy.stats import ks_2samp

from pipeline.wrench.directions import LARGE, mean_resultant_length, sample_directions
from tests.wrench.parametric_law import directions_about


def test_the_mean_length_is_a_ratio_of_bessel_functions_in_the_plane_and_of_hyperbolic_in_space():
    kappa = np.array([0.01, 0.5, 4.0, 169.35, 600.0])
    np.testing.assert_allclose(mean_resultant_length(kappa, 2), i1(kappa) / i0(kappa), rtol=1e-13)
    closed = 1 / np.tanh(kappa) - 1 / kappa  # which loses digits as κ falls
    np.testing.assert_allclose(mean_resultant_length(kappa, 3), closed, rtol=1e-13 / kappa.min())
    assert np.abs(mean_resultant_length(kappa, 3) - mean_resultant_length(kappa, 2)).min() > 1e-4


@pytest.mark.parametrize("p", [2, 3])
def test_it_is_smooth_where_the_series_takes_over_and_finite_where_bessel_functions_fail(p):
    below, above = mean_resultant_length(LARGE * np.array([1.0, 1 + 1e-9]), p)
    assert above == pytest.approx(below, abs=1e-14)
    lengths = mean_resultant_length(np.array([1e-8, 2e9, 1e15]), p)
    np.testing.assert_allclose(lengths, [1e-8 / p, 1 - (p - 1) / 4e9, 1.0], rtol=1e-9)
    assert 1 - lengths[1] == pytest.approx((p - 1) / 4e9, rel=1e-6)


@pytest.mark.parametrize("mean", [[0.6, -0.8], [0.0, 0.6, -0.8]])
def test_drawn_directions_have_the_law_of_an_independent_sampler_and_not_of_another_spread(mean):
    rng = np.random.default_rng(61)
    means, kappas = np.array([mean, mean]), np.array([3.0, 40.0])
    drawn = sample_directions(means, kappas, 4000, rng)
    assert drawn.shape == (4000, 2, len(mean))
    np.testing.assert_allclose(np.linalg.norm(drawn, axis=-1), 1.0, rtol=1e-12)
    for cable, kappa in enumerate(kappas):
        other = directions_about(np.array(mean), kappa, 4000, rng)
        for component in range(len(mean)):
            assert ks_2samp(drawn[:, cable, component], other[:, component]).pvalue > 1e-4
    assert ks_2samp(drawn[:, 0, -1], other[:, -1]).pvalue < 1e-10
    again = sample_directions(means, kappas, 4000, np.random.default_rng(61))
    np.testing.assert_array_equal(drawn, again)
