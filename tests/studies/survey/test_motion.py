"""Conditions whose outcome is known beforehand."""

from __future__ import annotations

from dataclasses import replace

import pandas as pd
import pytest

from pipeline.cases.case import KINDS, Case
from pipeline.cases.verdict import decided
from pipeline.studies.survey import motion as survey_motion
from pipeline.studies.survey.conditions import Factors, MotionCondition
from pipeline.studies.survey.motion import motion_evidence
from pipeline.studies.survey.points import MOTION, decidable

# sway of one size at any speed, and nothing else that moves the robot off its command: additive
# noise is the truth
ADDITIVE = Factors(
    clearance=0.0,
    speed_error_std=0.0,
    encoder_ripple=0.0,
    jitter_std=0.0,
    start_std=0.0,
    speed_exponent=0.0,
    encoder_offset_std=0.0,
    length_std=0.0,
)


@pytest.fixture(scope="module")
def verdicts(study):
    """Claim → verdict of a condition with given factors, by name."""
    conditions = {"base": Factors(), "additive": ADDITIVE, "still": Factors(disturbances=0.0)}
    # over 12 takes the standard deviation of each step varies by a fifth by chance alone
    motion = replace(study.motion, training_takes=40)
    result = {
        name: decided(
            decidable(study.claims, MOTION),
            motion_evidence(MotionCondition(3, "own", 60, factors), motion),
            study.motion.laboratory.arm,
        )
        for name, factors in conditions.items()
    }
    return {
        name: rows.drop_duplicates("claim").set_index("claim")["verdict"]
        for name, rows in result.items()
    }


def test_where_additive_noise_is_the_truth_the_matrix_models_lose(verdicts):
    assert verdicts["additive"][["gaussian-predicts-better", "noise-is-dynamic"]].tolist() == [
        "fails",
        "fails",
    ]
    assert verdicts["additive"]["wishart-predicts-worse"] == "holds"
    assert verdicts["base"][["gaussian-predicts-better", "noise-is-dynamic"]].tolist() == [
        "holds",
        "holds",
    ]


def test_a_robot_that_nothing_disturbs_has_no_dynamic_noise(verdicts):
    assert (
        verdicts["still"]["noise-is-dynamic"] == "fails"
        and verdicts["still"]["mean-error"] == "holds"
    )


def test_every_claim_about_motion_camera_and_filter_is_decided(verdicts, study):
    assert (verdicts["base"] != "no evidence").all()
    requested = {
        claim.id
        for claim in study.claims
        if not claim.id.startswith(("wrench", "sigma-s", "force"))
    }
    assert set(verdicts["base"].index) == requested


def test_a_motion_through_a_singular_pose_is_no_evidence_and_no_failure(study):
    laboratory = study.motion.laboratory
    straight = replace(
        laboratory.trajectories["own"], folded=(1.8, -2.6, 2.0), extended=(1.8, -2.5, 2.0)
    )
    through = replace(study.motion, laboratory=replace(laboratory, trajectories={"own": straight}))
    evidence = motion_evidence(MotionCondition(3, "own", 60), through)
    rows = decided(decidable(study.claims, MOTION), evidence, laboratory.arm)
    assert set(rows["verdict"]) == {"no evidence"} and rows["value"].isna().all()


def test_closed_loops_stand_beside_no_filter_and_leave_the_papers_evidence_as_it_is(
    study, monkeypatch
):
    condition = MotionCondition(3, "own", 60)
    evidence = motion_evidence(condition, study.motion)
    against = evidence.pop("tables/filter_against_none")
    closed = {f"{kind}_closed" for kind in KINDS}
    assert set(against["model"]) == {"none", "memory", *KINDS} | closed
    monkeypatch.setattr(survey_motion, "Case", lambda *parts, closed: Case(*parts))
    alone = motion_evidence(condition, study.motion)
    assert alone.keys() == evidence.keys()
    for name, values in alone.items():
        same = values.equals if isinstance(values, pd.DataFrame) else values.__eq__
        assert same(evidence[name])
