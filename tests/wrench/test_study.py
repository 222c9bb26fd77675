"""The numerical study: the expectation of Σ_S against direct integration and averages, standard
errors, errors of fresh systems, and what the paper claims about numbers of cables.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from cable_systems import planar_cables
from scipy.integrate import dblquad

from pipeline.core.errors import ConfigError
from pipeline.wrench.bounds import Bounds, draw_systems
from pipeline.wrench.matrix import FORMS, matrix_model, unbounded_sigma_s
from pipeline.wrench.parametric import wrench_covariance
from pipeline.wrench.study import (
    averaged_sigma_s,
    covariance_errors,
    expected_sigma_s,
    expected_unbounded_sigma_s,
    run_study,
    variance_errors,
)

# the bound Σ_S ≥ 0 holds often within the first, and hardly ever with many cables within the second
WIDE = Bounds((1.5, 6.0), (0.1, 0.7), (0.5, 2.3), (100.0, 400.0))
ROUND = Bounds((5.0, 9.0), (0.3, 2.8), (0.5, 2.0), (100.0, 800.0))
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
    distance = (unbounded.mean(axis=0) - expected_unbounded_sigma_s(bounds, agents)) / error
    assert np.abs(distance).max() < 4


@pytest.mark.parametrize("agents", [1, 3])
@pytest.mark.parametrize("form", FORMS)
def test_with_its_own_bounds_alone_it_is_what_averages_over_systems_tend_to(form, agents):
    estimate = averaged_sigma_s(draw_systems(WIDE, 40_000, agents, np.random.default_rng(46)))[form]
    expected = expected_sigma_s(WIDE, agents, np.random.default_rng(47))[form]
    assert estimate.clipped > 1000
    assert np.abs(z_scores(estimate, expected)).max() < 4
    # the standard error tends to the deviation of single systems over √systems
    deviations = np.diag(estimate.standard_error) * np.sqrt(estimate.systems)
    np.testing.assert_allclose(deviations, np.diag(expected.deviation), rtol=0.05)
    error = np.diag(estimate.standard_error)
    assert np.max(np.diag(estimate.mean - expected_unbounded_sigma_s(WIDE, agents)) / error) > 8
    other = Bounds(WIDE.tension, (0.1, 0.8), WIDE.tension_sd, WIDE.concentration)
    moved = estimate.mean - expected_sigma_s(other, agents, np.random.default_rng(48))[form].mean
    assert np.max(np.abs(np.diag(moved)) / error) > 8


def test_a_system_served_by_its_own_sigma_s_has_no_error_and_one_system_no_average():
    systems = draw_systems(ROUND, 50, 20, np.random.default_rng(52))
    model, covariance = matrix_model(systems), wrench_covariance(systems)
    modelled = model.covariance(unbounded_sigma_s(model, covariance))
    for errors in (variance_errors, covariance_errors):
        assert np.abs(errors(modelled, covariance)).max() < 1e-12
        np.testing.assert_allclose(errors(1.5 * modelled, covariance), 0.5)
    with pytest.raises(ConfigError, match="at least 2 systems"):
        averaged_sigma_s(draw_systems(ROUND, 1, 20, np.random.default_rng(53)))


def test_where_no_system_is_held_it_is_the_quadrature_alone():
    exact = expected_unbounded_sigma_s(ROUND, 20)
    expected = expected_sigma_s(ROUND, 20, np.random.default_rng(51))
    np.testing.assert_array_equal(expected["full"].mean, exact)
    np.testing.assert_array_equal(expected["diagonal"].mean, np.diag(np.diag(exact)))
    assert not any(value.standard_error.any() for value in expected.values())


STUDY = Bounds((3.0, 5.0), (np.pi / 4, np.pi), (0.5, 1.0), (100.0, 800.0))


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
