"""A condition of the wrench is the stage's own study within scaled bounds, and its order is asked of the cables compared."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline import rng
from pipeline.survey.conditions import WrenchCondition
from pipeline.survey.wrench import asked_of, scaled, wrench_evidence
from pipeline.wrench.study import run_study


def test_the_base_condition_is_the_study_of_its_seed(study):
    evidence = wrench_evidence(WrenchCondition(9, (2, 3)), study.wrench)
    _, errors, spread = run_study(study.wrench.bounds, (2, 3), 20, 20, 2, rng.stream(9, "wrench.study"))
    metrics = evidence["metrics/wrench"]
    assert metrics["study_m2_mean_error"] == pytest.approx(errors.query("agents == 2")["error"].mean(), rel=1e-12)
    assert metrics["study_m3_greatest_error"] == errors.query("agents == 3")["error"].max()
    assert metrics["study_m3_greatest_error_median_over_repeats"] == spread.query("agents == 3")["maximum"].median()
    assert evidence["tables/sigma_s"]["system_class"].unique().tolist() == ["C1"]


def test_factors_scale_the_bounds_of_concentration_and_tension_alone(study):
    bounds = scaled(study.wrench.bounds, WrenchCondition(9, (3,), kappa=0.5, tension_std=2.0))
    assert (bounds.concentration, bounds.tension_sd) == ((50.0, 400.0), (1.0, 2.0))
    assert (bounds.tension, bounds.direction) == (study.wrench.bounds.tension, study.wrench.bounds.direction)


def test_directions_that_are_better_known_leave_the_random_matrix_less(study):
    entries = [
        wrench_evidence(WrenchCondition(9, (3,), kappa=kappa), study.wrench)["tables/sigma_s"]["e11"].iloc[0] for kappa in (0.5, 4.0)
    ]
    assert np.all(np.diff(entries) < 0)


def test_the_order_over_numbers_of_cables_is_asked_of_those_compared(claims):
    asked = {claim.id: claim for claim in asked_of(claims, (2, 4))}
    assert asked["wrench-mean-error-falls"].cases == [{"cables": 2}, {"cables": 4}]
    assert asked["wrench-mean-error"] in claims and len(asked) == len(claims)
