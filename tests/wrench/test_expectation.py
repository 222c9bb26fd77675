"""The expectation of Σ_S against direct integration, averages over many systems, and a case that is
known.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from planar_cables import planar_cables
from scipy.integrate import dblquad

from pipeline.wrench.bounds import Bounds, draw_systems
from pipeline.wrench.expectation import expected_sigma_s, expected_unbounded_sigma_s
from pipeline.wrench.matrix import FORMS, matrix_model, unbounded_sigma_s
from pipeline.wrench.parametric import wrench_covariance
from pipeline.wrench.study import estimate_sigma_s

# the bound Σ_S ≥ 0 holds often within the first, and hardly ever with many cables within the second
WIDE = Bounds(
    tension=(1.5, 6.0), direction=(0.1, 0.7), tension_sd=(0.5, 2.3), concentration=(100.0, 400.0)
)
ROUND = Bounds(
    tension=(5.0, 9.0), direction=(0.3, 2.8), tension_sd=(0.5, 2.0), concentration=(100.0, 800.0)
)
DISTINCT = ((0, 0), (0, 1), (1, 1))
APART = replace(WIDE, attachment=(-0.2, 0.5))
SPACE = replace(ROUND, elevation=(0.2, 1.2), attachment=(-0.2, 0.5))


def z_scores(estimate, expected):
    """Deviation of the average from the expectation in standard errors of both, for the entries
    that vary.
    """
    error = np.hypot(estimate.standard_error, expected.standard_error)
    deviation = estimate.mean - expected.mean
    assert np.all(deviation[error == 0] == 0)
    return deviation[error > 0] / error[error > 0]


def test_for_one_cable_it_is_the_integral_over_tension_and_its_deviation():
    bounds = Bounds(WIDE.tension, (0.6, 0.6), WIDE.tension_sd, (150.0, 150.0))
    expected = expected_unbounded_sigma_s(bounds, 1)
    area = np.ptp(bounds.tension) * np.ptp(bounds.tension_sd)
    for i, j in DISTINCT:

        def entry(sd, tension, i=i, j=j):
            system = planar_cables(*(np.array([value]) for value in (tension, 0.6, sd, 150.0)))
            return unbounded_sigma_s(matrix_model(system), wrench_covariance(system))[i, j]

        direct = dblquad(entry, *bounds.tension, *bounds.tension_sd, epsabs=1e-10)[0] / area
        assert expected[i, j] == pytest.approx(direct, abs=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("bounds", "agents"),
    [(WIDE, 1), (WIDE, 3), (ROUND, 1), (ROUND, 8), (APART, 3), (SPACE, 3), (SPACE, 30)],
)
def test_without_the_bound_it_is_what_averages_over_systems_tend_to(bounds, agents):
    systems = draw_systems(bounds, 20_000, agents, np.random.default_rng(45))
    unbounded = unbounded_sigma_s(matrix_model(systems), wrench_covariance(systems))
    error = unbounded.std(axis=0, ddof=1) / np.sqrt(len(unbounded))
    assert (
        np.abs((unbounded.mean(axis=0) - expected_unbounded_sigma_s(bounds, agents)) / error).max()
        < 4
    )


@pytest.mark.parametrize("agents", [1, 3])
@pytest.mark.parametrize("form", FORMS)
def test_with_its_own_bounds_alone_it_is_what_averages_over_systems_tend_to(form, agents):
    estimate = estimate_sigma_s(WIDE, 40_000, agents, np.random.default_rng(46))[form]
    expected = expected_sigma_s(WIDE, agents, np.random.default_rng(47))[form]
    assert estimate.clipped > 1000
    assert np.abs(z_scores(estimate, expected)).max() < 4
    error = np.diag(estimate.standard_error)
    assert np.max(np.diag(estimate.mean - expected_unbounded_sigma_s(WIDE, agents)) / error) > 8
    other = Bounds(WIDE.tension, (0.1, 0.8), WIDE.tension_sd, WIDE.concentration)
    moved = estimate.mean - expected_sigma_s(other, agents, np.random.default_rng(48))[form].mean
    assert np.max(np.abs(np.diag(moved)) / error) > 8


@pytest.mark.slow
def test_its_error_is_that_of_other_scrambles_and_far_below_that_of_a_thousand_systems():
    runs = [expected_sigma_s(WIDE, 3, rng) for rng in np.random.default_rng(49).spawn(30)]
    estimates = estimate_sigma_s(WIDE, 1000, 3, np.random.default_rng(50))
    for form in FORMS:
        spread = np.std([run[form].mean for run in runs], axis=0, ddof=1)
        stated = np.mean([run[form].standard_error for run in runs], axis=0)
        varies = stated > 0
        np.testing.assert_allclose(spread[varies] / stated[varies], 1.0, atol=0.6)
        assert (stated[varies] < 0.05 * estimates[form].standard_error[varies]).all()


@pytest.mark.parametrize("form", FORMS)
def test_the_deviation_over_systems_is_that_of_drawn_ones(form):
    expected = expected_sigma_s(WIDE, 3, np.random.default_rng(52))[form].deviation
    drawn = estimate_sigma_s(WIDE, 40_000, 3, np.random.default_rng(53))[
        form
    ].standard_error * np.sqrt(40_000)
    varies = drawn > 0
    # a standard deviation from 40 000 systems is known to half a percent or so
    np.testing.assert_allclose(expected[varies], drawn[varies], rtol=0.02)
    assert not expected[~varies].any()
    # control: within other bounds it is another
    other = Bounds(WIDE.tension, (0.1, 0.8), WIDE.tension_sd, WIDE.concentration)
    assert (
        np.abs(
            expected_sigma_s(other, 3, np.random.default_rng(54))[form].deviation[varies]
            / drawn[varies]
            - 1
        ).max()
        > 0.1
    )


def test_where_no_system_is_held_it_is_the_quadrature_alone():
    exact = expected_unbounded_sigma_s(ROUND, 20)
    expected = expected_sigma_s(ROUND, 20, np.random.default_rng(51))
    np.testing.assert_array_equal(expected["full"].mean, exact)
    np.testing.assert_array_equal(expected["diagonal"].mean, np.diag(np.diag(exact)))
    assert not any(value.standard_error.any() for value in expected.values())


def test_bounds_of_no_width_give_the_sigma_s_of_their_one_system():
    bounds = Bounds((4.0, 4.0), (0.9, 0.9), (1.0, 1.0), (200.0, 200.0))
    system = planar_cables(np.full(2, 4.0), np.full(2, 0.9), np.full(2, 1.0), np.full(2, 200.0))
    unbounded = unbounded_sigma_s(matrix_model(system), wrench_covariance(system))
    np.testing.assert_allclose(expected_unbounded_sigma_s(bounds, 2), unbounded, rtol=1e-7)
