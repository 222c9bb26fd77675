"""The numerical study: Σ_S against nested quadrature, and what the paper claims about numbers of cables."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import quad
from scipy.special import i0e, i1e

from pipeline.errors import ConfigError
from pipeline.wrench.matrix import matrix_model, optimal_sigma_s
from pipeline.wrench.parametric import force_covariance
from pipeline.wrench.study import Bounds, draw_systems, estimate_sigma_s, relative_errors, run_study

STUDY = Bounds(tension=(3.0, 5.0), direction=(np.pi / 4, np.pi), tension_sd=(0.5, 1.0), concentration=(100.0, 800.0))
OBLIQUE = Bounds(tension=(5.0, 9.0), direction=(0.5, 1.2), tension_sd=(0.5, 2.0), concentration=(100.0, 800.0))


def uniform_mean(function, bounds):
    low, high = bounds
    return quad(function, low, high, epsabs=1e-13, epsrel=1e-11)[0] / (high - low)


def quadrature_sigma_s(bounds, agents):
    """E[Σ_S] where its bound never holds, by nested one-dimensional integrals.

    Cable i adds T̲²g + σ_T²h to the numerator and T̲² + σ_T² to the denominator; g and h depend on direction and concentration alone,
    and with 1/D = ∫exp(−sD)ds the share of the tensions in the denominator is an integral over s of products of one-cable means.
    """
    squared_length = uniform_mean(lambda k: (i1e(k) / i0e(k)) ** 2, bounds.concentration)
    ratio = uniform_mean(lambda k: i1e(k) / i0e(k) / k, bounds.concentration)
    squares = np.array([uniform_mean(lambda t: np.cos(t) ** 2, bounds.direction), uniform_mean(lambda t: np.sin(t) ** 2, bounds.direction)])
    cos2 = uniform_mean(lambda t: np.cos(2 * t), bounds.direction) * np.array([1.0, -1.0])
    g, h = squares * (1 - squared_length) - ratio * cos2, -ratio * cos2

    def integrand(s):
        noise = uniform_mean(lambda v: np.exp(-s * v**2), bounds.tension_sd)
        tension = uniform_mean(lambda t: np.exp(-s * t**2), bounds.tension)
        weighted = uniform_mean(lambda t: t**2 * np.exp(-s * t**2), bounds.tension)
        return agents * weighted * tension ** (agents - 1) * noise**agents

    share = quad(integrand, 0, np.inf, epsabs=1e-12)[0]
    return g * share + h * (1 - share)


@pytest.mark.parametrize("agents", [1, 3])
def test_the_average_of_the_optimal_sigma_s_is_its_expectation_by_quadrature(agents):
    estimate = estimate_sigma_s(OBLIQUE, 20_000, agents, np.random.default_rng(9))
    assert estimate.clipped == 0
    z = (estimate.mean - quadrature_sigma_s(OBLIQUE, agents)) / estimate.standard_error
    assert np.abs(z).max() < 4
    other = Bounds(OBLIQUE.tension, (0.5, 1.3), OBLIQUE.tension_sd, OBLIQUE.concentration)
    assert np.abs(estimate.mean - quadrature_sigma_s(other, agents)).max() > 8 * estimate.standard_error.max()


def test_entries_held_by_the_bound_are_counted():
    along_x = Bounds((1.0, 1.5), (0.0, 0.05), (2.0, 2.5), (150.0, 200.0))
    estimate = estimate_sigma_s(along_x, 500, 3, np.random.default_rng(10))
    assert estimate.clipped == 500
    assert estimate.mean[0] == 0.0 < estimate.mean[1]


def test_the_standard_error_is_the_spread_of_the_estimate_over_seeds():
    estimates = [estimate_sigma_s(STUDY, 200, 3, rng) for rng in np.random.default_rng(11).spawn(400)]
    spread = np.std([e.mean for e in estimates], axis=0, ddof=1)
    stated = np.mean([e.standard_error for e in estimates], axis=0)
    np.testing.assert_allclose(spread / stated, 1.0, atol=0.15)  # four standard errors of a deviation from 400 draws


def test_systems_stay_within_their_bounds_and_fill_them():
    system = draw_systems(STUDY, 4000, 3, np.random.default_rng(12))
    for name in ("tension", "direction", "tension_sd", "concentration"):
        low, high = getattr(STUDY, name)
        values = getattr(system, name)
        assert values.shape == (4000, 3)
        assert low <= values.min() < low + 0.01 * (high - low)
        assert high >= values.max() > high - 0.01 * (high - low)


def test_a_system_served_by_its_own_sigma_s_has_no_error_and_by_none_a_large_one():
    system = draw_systems(OBLIQUE, 1, 3, np.random.default_rng(13))
    own = optimal_sigma_s(matrix_model(system), np.einsum("...ii->...i", force_covariance(system)))
    assert relative_errors(system, own[0])[0] < 1e-12
    assert relative_errors(system, np.zeros(2))[0] > 0.01


def test_the_error_falls_with_the_number_of_cables_in_every_repeat():
    _, _, spread = run_study(STUDY, [3, 5, 10, 15, 20], 1000, 2000, 5, np.random.default_rng(14))
    means = spread.pivot(index="repeat", columns="agents", values="mean")
    assert (np.diff(means.to_numpy(), axis=1) < 0).all()


def test_the_study_is_that_of_its_generator_and_more_repeats_leave_the_first_ones_alone():
    one = run_study(STUDY, [3, 5], 100, 50, 2, np.random.default_rng(15))
    more = run_study(STUDY, [3, 5], 100, 50, 4, np.random.default_rng(15))
    other = run_study(STUDY, [3, 5], 100, 50, 2, np.random.default_rng(16))
    for a, b in zip(one[:2], more[:2], strict=True):
        pd.testing.assert_frame_equal(a, b)
    pd.testing.assert_frame_equal(one[2], more[2].iloc[:4])
    assert not one[1].error.equals(other[1].error)


@pytest.mark.parametrize("change", [{"tension": (5.0, 3.0)}, {"tension": (0.0, 3.0)}, {"concentration": (0.0, np.inf)}])
def test_bounds_that_bound_no_system_are_refused(change):
    with pytest.raises(ConfigError):
        Bounds(**({"tension": (3.0, 5.0), "direction": (0.0, 1.0), "tension_sd": (0.5, 1.0), "concentration": (100.0, 800.0)} | change))


def test_one_system_has_no_standard_error():
    with pytest.raises(ConfigError):
        estimate_sigma_s(STUDY, 1, 3, np.random.default_rng(18))
