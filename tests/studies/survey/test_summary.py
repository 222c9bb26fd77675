"""Counts, costs and agreement are those of the table."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from pipeline.studies.survey import summary
from pipeline.studies.survey.conditions import (
    BASE,
    FACTORS,
    Factors,
    MotionCondition,
    WrenchCondition,
)
from pipeline.studies.survey.summary import (
    VARIED,
    Tally,
    against_the_pipeline,
    cost,
    verdict_counts,
)
from pipeline.verdicts.reference import ArmNames


def rows(point: str, condition, words: dict[str, str], seconds: float) -> pd.DataFrame:
    """A point's rows: two cases of each claim, the second of which decides."""
    motion = isinstance(condition, MotionCondition)
    place = dict.fromkeys((*FACTORS, *VARIED["wrench"][1:]), np.nan) | (
        vars(condition.factors) if motion else {"kappa": 1.0, "tension_std": 1.0}
    )
    place |= {
        "study": "motion" if motion else "wrench",
        "seed": condition.seed,
        "cpu_seconds": seconds,
    }
    place |= (
        {"trajectory": condition.trajectory, "particles": condition.particles, "agents": ""}
        if motion
        else {"trajectory": "", "particles": 0, "agents": " ".join(map(str, condition.agents))}
    )
    cases = [
        {
            "claim": claim,
            "about": "method",
            "case": case,
            "value": 1.0,
            "than": 2.0,
            "holds": "holds" if case == "a" else word,
            "verdict": word,
        }
        for claim, word in words.items()
        for case in ("a", "b")
    ]
    return pd.DataFrame(cases).assign(point=point, **place)


def tallied(tables: list[pd.DataFrame]) -> Tally:
    tally = Tally()
    passed = list(tally.passing(iter(tables)))
    assert all(one is other for one, other in zip(passed, tables, strict=True))
    return tally


@pytest.fixture(params=[1, 2, 100])
def tally(request, monkeypatch) -> Tally:
    monkeypatch.setattr(summary, "PART", request.param)
    twice = Factors(clearance=2.0)
    parts = [
        rows("1", MotionCondition(7, "own", 10), {"x": "holds", "y": "fails"}, 2.0),
        rows("2", MotionCondition(8, "own", 10), {"x": "holds", "y": "no evidence"}, 4.0),
        rows("3", MotionCondition(7, "own", 10, twice), {"x": "fails", "y": "fails"}, 6.0),
        rows("4", MotionCondition(8, "own", 10, twice), {"x": "holds", "y": "fails"}, 8.0),
        rows("5", WrenchCondition(7, (3, 5)), {"w": "holds"}, 1.0),
    ]
    return tallied(parts)


def test_verdicts_are_counted_by_level_and_the_base_condition_stands_first(tally):
    counts = verdict_counts(tally, "one_at_a_time").set_index(
        ["study", "factor", "level", "claim"]
    )[["conditions", "holds", "fails"]]
    assert counts.T.to_dict("list") == {
        ("motion", BASE, "", "x"): [2, 2, 0],
        ("motion", BASE, "", "y"): [2, 0, 1],
        ("motion", "clearance", "2", "x"): [2, 1, 1],
        ("motion", "clearance", "2", "y"): [2, 0, 2],
        ("wrench", BASE, "", "w"): [1, 1, 0],
    }


def test_of_every_combination_the_base_level_is_a_level_too(tally):
    counts = (
        verdict_counts(tally, "factorial")
        .query("claim == 'x'")
        .set_index(["factor", "level"])["holds"]
    )
    assert counts.to_dict() == {(BASE, ""): 2, ("clearance", "1"): 2, ("clearance", "2"): 1}


def test_a_million_conditions_cost_a_million_times_one(tally):
    result = cost(tally.points, 5_000)
    assert (result["conditions"], result["cpu_seconds"]) == (5, 21.0)
    assert result["motion_cpu_seconds_per_condition_mean"] == 5.0
    assert result["motion_core_hours_of_1000000_conditions_mean"] == pytest.approx(1e6 * 5.0 / 3600)
    assert result["wrench_core_hours_of_1000000_conditions_greatest"] == pytest.approx(1e6 / 3600)
    assert (result["bytes_per_condition"], result["gigabytes_of_1000000_conditions"]) == (
        1000.0,
        1.0,
    )


def test_the_base_condition_is_held_against_the_run_case_by_case(claims):
    by_id = {claim.id: claim for claim in claims}
    evidence = {"metrics/fit_wishart": {"sigma_b": 0.26}, "metrics/fit_gaussian": {"u": 40.0}}
    words = {"sigma-b": "holds", "u": "holds"}
    points = [rows(str(seed), MotionCondition(seed, "own", 10), words, 1.0) for seed in (7, 8)]
    points.append(
        rows(
            "9",
            MotionCondition(7, "own", 10, Factors(clearance=2.0)),
            {"sigma-b": "fails", "u": "fails"},
            1.0,
        )
    )
    tally = tallied([table[table["case"] == "b"].assign(case="") for table in points])
    arm = ArmNames(("a", "b", "c"), ("x", "z", "phi"))
    beside = against_the_pipeline(tally, [by_id["sigma-b"], by_id["u"]], evidence, arm).set_index(
        "claim"
    )
    assert beside["agrees"].to_dict() == {"sigma-b": True, "u": False}
    assert beside.loc[
        "u", ["value_pipeline", "holds_pipeline", "value_survey", "seeds", "holding"]
    ].tolist() == [40.0, "fails", 1.0, 2, 2]
