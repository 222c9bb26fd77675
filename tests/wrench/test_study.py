"""The numerical study: standard errors, errors of fresh systems, and what the paper claims about
numbers of cables.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pipeline.core.errors import ConfigError
from pipeline.wrench.bounds import Bounds, draw_systems
from pipeline.wrench.matrix import matrix_model, optimal_sigma_s, unbounded_sigma_s
from pipeline.wrench.parametric import wrench_covariance
from pipeline.wrench.study import covariance_errors, estimate_sigma_s, run_study, variance_errors

STUDY = Bounds(
    tension=(3.0, 5.0),
    direction=(np.pi / 4, np.pi),
    tension_sd=(0.5, 1.0),
    concentration=(100.0, 800.0),
)
ROUND = Bounds(
    tension=(5.0, 9.0), direction=(0.3, 2.8), tension_sd=(0.5, 2.0), concentration=(100.0, 800.0)
)
SPACE = replace(ROUND, elevation=(0.2, 1.2), attachment=(-1.0, 1.0))


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


def test_one_system_has_no_standard_error():
    with pytest.raises(ConfigError):
        estimate_sigma_s(STUDY, 1, 3, np.random.default_rng(18))
