"""The numerical study: the expectation of Σ_S against direct integration and averages, standard
errors, errors of fresh systems, and what the paper claims about numbers of cables.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from planar_cables import planar_cables
from scipy.integrate import dblquad

from pipeline.wrench.bounds import Bounds, draw_systems
from pipeline.wrench.matrix import FORMS, matrix_model, optimal_sigma_s, unbounded_sigma_s
from pipeline.wrench.parametric import wrench_covariance
from pipeline.wrench.study import (
    covariance_errors,
    estimate_sigma_s,
    expected_sigma_s,
    expected_unbounded_sigma_s,
    run_study,
    variance_errors,
)

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


STUDY = Bounds(
    tension=(3.0, 5.0),
    direction=(np.pi / 4, np.pi),
    tension_sd=(0.5, 1.0),
    concentration=(100.0, 800.0),
)


def test_entries_held_by_the_bound_are_counted():
    along_x = Bounds((1.0, 1.5), (0.0, 0.05), (2.0, 2.5), (150.0, 200.0))
    estimates = estimate_sigma_s(along_x, 500, 3, np.random.default_rng(10))
    assert {form: estimate.clipped for form, estimate in estimates.items()} == {
        "diagonal": 500,
        "full": 500,
    }
    assert estimates["diagonal"].mean[0, 0] == 0.0 < estimates["diagonal"].mean[1, 1]
    assert np.linalg.eigvalsh(estimates["full"].mean)[0] >= 0


@pytest.mark.parametrize(("form", "entries"), [("diagonal", [0, 3]), ("full", [0, 1, 3])])
def test_the_standard_error_is_the_spread_of_the_estimate_over_seeds(form, entries):
    estimates = [
        estimate_sigma_s(STUDY, 200, 3, rng)[form] for rng in np.random.default_rng(11).spawn(400)
    ]
    spread = np.std([e.mean for e in estimates], axis=0, ddof=1).ravel()[entries]
    stated = np.mean([e.standard_error for e in estimates], axis=0).ravel()[entries]
    # four standard errors of a deviation from 400 draws
    np.testing.assert_allclose(spread / stated, 1.0, atol=0.15)


@pytest.mark.parametrize("bounds", [ROUND, SPACE])
def test_a_system_served_by_its_own_sigma_s_has_no_error_and_by_none_a_large_one(bounds):
    system = draw_systems(bounds, 1, 8, np.random.default_rng(13))
    model, covariance = matrix_model(system), wrench_covariance(system)
    unbounded = unbounded_sigma_s(model, covariance)
    (diagonal, _), (full, held) = (
        optimal_sigma_s(unbounded, form) for form in ("diagonal", "full")
    )
    assert held[0] == 0
    assert variance_errors(model.covariance(diagonal), covariance)[0] < 1e-12
    whole = {
        form: covariance_errors(model.covariance(sigma_s), covariance)[0]
        for form, sigma_s in (("diagonal", diagonal), ("full", full))
    }
    assert whole["full"] < 1e-12 < 0.01 < whole["diagonal"]
    for errors in (variance_errors, covariance_errors):
        assert errors(model.actuation_part(), covariance)[0] > 0.01


def test_off_diagonal_terms_lower_the_error_of_the_covariance_and_less_so_with_few_cables():
    _, errors, _ = run_study(STUDY, [3, 20], 1000, 2000, 1, np.random.default_rng(42))
    gain = (errors["covariance_error_diagonal"] - errors["covariance_error_full"]).groupby(
        errors["agents"]
    )
    assert (gain.mean() > 4 * gain.sem()).all()
    relative = gain.mean() / errors["covariance_error_diagonal"].groupby(errors["agents"]).mean()
    assert relative[20] > 2 * relative[3]


@pytest.mark.slow
def test_the_error_falls_with_the_number_of_cables_in_every_repeat():
    _, _, spread = run_study(STUDY, [3, 5, 10, 15, 20], 1000, 2000, 5, np.random.default_rng(14))
    means = spread.pivot(index="repeat", columns="agents", values="mean")
    assert (np.diff(means.to_numpy(), axis=1) < 0).all()


@pytest.mark.slow
def test_the_study_is_that_of_its_generator_and_more_repeats_leave_the_first_ones_alone():
    one = run_study(STUDY, [3, 5], 100, 50, 2, np.random.default_rng(15))
    more = run_study(STUDY, [3, 5], 100, 50, 4, np.random.default_rng(15))
    other = run_study(STUDY, [3, 5], 100, 50, 2, np.random.default_rng(16))
    for a, b in zip(one[:2], more[:2], strict=True):
        pd.testing.assert_frame_equal(a, b)
    pd.testing.assert_frame_equal(one[2], more[2].iloc[:4])
    assert not one[1].error.equals(other[1].error)
