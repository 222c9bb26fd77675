"""A condition of the wrench is the stage's own study within scaled bounds, and its order is asked
of the cables compared.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pipeline.cases.verdict import FAILS, HOLDS, decided
from pipeline.core import rng
from pipeline.studies.survey.conditions import WrenchCondition
from pipeline.studies.survey.points import WRENCH, decidable
from pipeline.studies.survey.wrench import WrenchStudy, claims_for, scaled, wrench_evidence
from pipeline.verdicts.reference import ArmNames
from pipeline.wrench.study import run_study


@pytest.mark.slow
def test_the_base_condition_is_the_study_of_its_seed(study):
    evidence = wrench_evidence(WrenchCondition(9, (2, 3)), study.wrench)
    _, errors, spread = run_study(
        study.wrench.bounds, (2, 3), 20, 20, 2, rng.stream(9, "wrench.study")
    )
    metrics = evidence["metrics/wrench"]
    assert metrics["study_m2_mean_error"] == pytest.approx(
        errors.query("agents == 2")["error"].mean(), rel=1e-12
    )
    assert metrics["study_m3_greatest_error"] == errors.query("agents == 3")["error"].max()
    assert (
        metrics["study_m3_greatest_error_median_over_repeats"]
        == spread.query("agents == 3")["maximum"].median()
    )
    assert evidence["tables/sigma_s"]["system_class"].unique().tolist() == ["C1"]


def test_factors_scale_the_bounds_of_concentration_and_tension_alone(study):
    bounds = scaled(study.wrench.bounds, WrenchCondition(9, (3,), kappa=0.5, tension_std=2.0))
    assert (bounds.concentration, bounds.tension_sd) == ((50.0, 400.0), (1.0, 2.0))
    assert (bounds.tension, bounds.direction) == (
        study.wrench.bounds.tension,
        study.wrench.bounds.direction,
    )


def test_directions_that_are_better_known_leave_the_random_matrix_less(study):
    entries = [
        wrench_evidence(WrenchCondition(9, (3,), kappa=kappa), study.wrench)["tables/sigma_s"][
            "e11"
        ].iloc[0]
        for kappa in (0.5, 4.0)
    ]
    assert np.all(np.diff(entries) < 0)


@pytest.fixture(scope="module")
def longer(study) -> WrenchStudy:
    return replace(study.wrench, rig=replace(study.wrench.rig, duration=300.0))


def measured(study: WrenchStudy, **factors: float) -> pd.Series:
    moments = wrench_evidence(WrenchCondition(9, (3,), **factors), study)[
        "tables/force_moments"
    ].set_index("source")
    assert set(moments["configuration"]) == {"C1"}
    return moments.loc["measured"]


@pytest.mark.slow
def test_the_robots_pull_with_the_force_of_their_mean_tensions_and_directions(longer):
    configuration, result = longer.configurations["C1"], measured(longer)
    tension, direction = np.array(configuration.tension), np.array(configuration.direction)
    np.testing.assert_allclose(
        result[["fx", "fy"]].astype(float),
        [tension @ np.cos(direction), tension @ np.sin(direction)],
        atol=0.1,
    )


@pytest.mark.slow
def test_robots_that_slip_twice_as_hard_and_wander_less_are_felt(longer):
    base, slipping, steady = (
        measured(longer),
        measured(longer, tension_std=2.0),
        measured(longer, tension_std=0.01, kappa=4.0),
    )
    # in y the tensions' variances and the directions' add up; alone the latter are a quarter at
    # four times the concentration
    tension_part = (
        np.array([0.5, 0.6, 0.7]) ** 2
        @ np.sin(np.array(longer.configurations["C1"].direction)) ** 2
    )
    assert slipping["var_fy"] - base["var_fy"] == pytest.approx(3 * tension_part, rel=0.2)
    assert steady["var_fx"] == pytest.approx((base["var_fx"] - tension_in_x(longer)) / 4, rel=0.3)


def tension_in_x(study: WrenchStudy) -> float:
    return float(
        np.array([0.5, 0.6, 0.7]) ** 2 @ np.cos(np.array(study.configurations["C1"].direction)) ** 2
    )


def test_the_claims_on_measured_force_are_decided(study, claims):
    evidence = wrench_evidence(WrenchCondition(9, (3,)), study.wrench)
    rows = decided(decidable(claims, WRENCH), evidence, ArmNames(("a",), ("x",))).set_index("claim")
    about_c1 = rows[
        rows["case"].str.contains("C1")
        & rows.index.isin(["force-mean", "force-modelled-as-measured"])
    ]
    assert (
        len(about_c1) == 3
        and about_c1["value"].notna().all()
        and about_c1["holds"].isin([HOLDS, FAILS]).all()
    )


def test_the_order_over_numbers_of_cables_is_claims_for_those_compared(claims):
    changed = {claim.id: claim for claim in claims_for(claims, (2, 4))}
    assert changed["wrench-mean-error-falls"].cases() == [{"cables": 2}, {"cables": 4}]
    assert changed["wrench-mean-error"] in claims and len(changed) == len(claims)
