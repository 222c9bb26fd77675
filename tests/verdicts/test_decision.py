"""Verdicts follow from claims and numbers alone, and from whose recordings they are."""

from __future__ import annotations

import json

import pytest

from pipeline.verdicts.claims import parse_claims
from pipeline.verdicts.decision import (
    FORCED,
    NO_EVIDENCE,
    NO_RECORDING,
    NOT_REPRODUCED,
    REPRODUCED,
    SYNTHETIC_CANNOT,
    WITHOUT_RECORDING,
    Decided,
    decide,
    decide_each,
    verdict_data,
)
from pipeline.verdicts.reference import ArmNames
from pipeline.verdicts.run import Run

JOINTS = ("shoulder", "elbow", "wrist")
ARM = ArmNames(JOINTS, ("x", "z", "phi"))
TEXTS = {key: key for key in ("where", "statement", "quantity", "reason")}
VALUE = {"file": "metrics/motion", "key": "{model}_error"}
CLAIM = TEXTS | {
    "id": "mean",
    "about": "method",
    "rule": "below",
    "limit": 0.02,
    "each": {"model": ["additive", "wishart"]},
    "value": VALUE,
}
EVIDENCE = {"metrics/motion": {"additive_error": 0.01, "wishart_error": 0.015}}


def verdict(evidence=EVIDENCE, recordings="synthetic", **changes):
    (result,) = decide(parse_claims([CLAIM | changes]), evidence, recordings, ARM)
    return result


def test_a_claim_holds_where_its_rule_holds_in_every_case():
    assert verdict().verdict == REPRODUCED
    failing = verdict(limit=0.012)
    assert failing.verdict == NOT_REPRODUCED
    assert [(case.case, case.value, case.holds) for case in failing.cases] == [
        ("additive", 0.01, True),
        ("wishart", 0.015, False),
    ]


@pytest.mark.parametrize(
    ("about", "recordings", "expected"),
    [
        ("method", "synthetic", REPRODUCED),
        ("method", "real", REPRODUCED),
        ("robots", "synthetic", SYNTHETIC_CANNOT),
        ("robots", "real", REPRODUCED),
        ("robots", "paper", REPRODUCED),
        ("specimen", "synthetic", SYNTHETIC_CANNOT),
        ("specimen", "real", NO_EVIDENCE),
        ("specimen", "paper", REPRODUCED),
    ],
)
def test_what_is_said_of_a_robot_only_its_recordings_decide(about, recordings, expected):
    result = verdict(about=about, recordings=recordings)
    assert result.verdict == expected
    assert all(case.holds for case in result.cases)


def test_a_missing_number_is_no_evidence_and_the_others_are_still_shown():
    result = verdict({"metrics/motion": {"additive_error": 0.01}})
    assert result.verdict == NO_EVIDENCE
    assert [(case.value, case.holds) for case in result.cases] == [(0.01, True), (None, None)]
    assert verdict({}).verdict == NO_EVIDENCE
    nothing = {key: {"file": "metrics/motion", "key": "nothing"} for key in ("than", "low", "high")}
    assert verdict(rule="less", limit=None, **nothing).verdict == NO_EVIDENCE


def test_an_order_with_a_gap_is_not_judged():
    changes = {
        "rule": "decreasing",
        "limit": None,
        "each": {"model": ["wishart", "none", "additive"]},
    }
    assert [case.holds for case in verdict(**changes).cases] == [None, None, None]
    assert verdict(**changes | {"each": {"model": ["wishart", "additive"]}}).verdict == REPRODUCED
    assert (
        verdict(**changes | {"each": {"model": ["additive", "wishart"]}}).verdict == NOT_REPRODUCED
    )


def test_published_values_belong_to_the_cases_in_their_order():
    changes = {
        "rule": "within_relative",
        "limit": None,
        "tolerance": 0.1,
        "published": [0.01, 0.0151],
    }
    assert verdict(**changes).verdict == REPRODUCED
    assert verdict(**changes | {"published": [0.0151, 0.01]}).verdict == NOT_REPRODUCED
    assert [case.published for case in verdict(**changes | {"published": 0.01}).cases] == [
        0.01,
        0.01,
    ]


def test_standard_errors_add_in_squares_and_give_distance_and_interval():
    evidence = {"metrics/wrench": {"e": 5.0, "se": 0.3, "ee": 0.4}}
    value, *errors = ({"file": "metrics/wrench", "key": key} for key in ("e", "se", "ee"))
    changes = {
        "each": {},
        "value": value,
        "standard_error": errors,
        "rule": "standard_errors",
        "published": 6.0,
    }
    (case,) = verdict(evidence, **changes | {"limit": 2.5}).cases
    assert (case.distance, case.low, case.high, case.holds) == pytest.approx(
        (2.0, 4.02, 5.98, True), abs=1e-4
    )
    assert verdict(evidence, **changes | {"limit": 1.5}).verdict == NOT_REPRODUCED


@pytest.mark.parametrize("joints", [("slide",), JOINTS, tuple("abcdefg")])
def test_every_joint_of_an_arm_of_any_size_is_a_case_by_its_own_name(joints):
    evidence = {f"{name}_error": 0.01 for name in joints[:-1]} | {f"{joints[-1]}_error": 0.03}
    value = {"file": "metrics/motion", "key": "{joint}_error"}
    claims, arm = parse_claims([CLAIM | {"each": {"joint": "every"}, "value": value}]), ARM
    arm = arm._replace(joints=joints, task=("x",))
    (result,) = decide(claims, {"metrics/motion": evidence}, "real", arm)
    assert [case.case for case in result.cases] == list(joints)
    assert [case.holds for case in result.cases] == [True] * (len(joints) - 1) + [False]
    assert result.verdict == NOT_REPRODUCED
    del evidence[f"{joints[-1]}_error"]
    (result,) = decide(claims, {"metrics/motion": evidence}, "real", arm)
    assert result.verdict == NO_EVIDENCE


def test_a_claim_about_every_joint_has_no_evidence_where_there_is_no_joint():
    """Of no cases all hold, which says nothing."""
    value = {"file": "metrics/motion", "key": "{joint}_error"}
    claims = parse_claims([CLAIM | {"each": {"joint": "every"}, "value": value}])
    (result,) = decide(claims, {"metrics/motion": {}}, "real", ArmNames((), ()))
    assert (result.verdict, result.cases) == (NO_EVIDENCE, ())


def test_a_claim_that_singles_out_a_joint_has_evidence_on_the_papers_kind_of_arm_alone():
    evidence = {"metrics/motion": {f"{name}_error": 0.01 for name in JOINTS}}
    value, than = (
        {"file": "metrics/motion", "key": f"{{{name}}}_error"} for name in ("joint", "joint 3")
    )
    changes = {"each": {"joint": ["{joint 1}", "{joint 2}"]}, "value": value, "than": than}
    ends = {key: {"file": "metrics/motion", "key": "{joint}_error"} for key in ("low", "high")}
    claims = parse_claims([CLAIM | changes | ends | {"rule": "less", "limit": None}])
    (here,) = decide(claims, evidence, "real", ARM)
    assert [case.case for case in here.cases] == ["shoulder", "elbow"]
    assert here.verdict == NOT_REPRODUCED
    # the same names and numbers, in space
    (there,) = decide(claims, evidence, "real", ARM._replace(task=("x", "y", "z")))
    assert there.verdict == NO_EVIDENCE and {case.value for case in there.cases} == {None}


def test_the_papers_own_parameters_are_not_held_against_those_of_another_kind_of_arm():
    claims = parse_claims([CLAIM | {"about": "specimen"}])
    (here,), (there,) = (
        decide(claims, EVIDENCE, "paper", arm) for arm in (ARM, ArmNames(tuple("abcdef"), ("x",)))
    )
    assert here.verdict == REPRODUCED
    assert there.verdict == NO_EVIDENCE and there.cases[0].value is None


def test_runs_are_decided_by_whose_recordings_they_are_and_by_their_own_joints():
    value = {"file": "metrics/motion", "key": "{joint}_error"}
    claims = parse_claims([CLAIM | {"each": {"joint": "every"}, "value": value}])
    metrics = {"motion": {"shoulder_error": 0.01, "hip_error": 0.02}}
    runs = [
        Run(name, "paper", synthetic, joints, ["x"], {}, metrics, {})
        for name, synthetic, joints in (
            ("youbot", True, ["shoulder"]),
            ("ur5", False, ["hip"]),
            ("lab", False, ["shoulder"]),
        )
    ]
    decided = decide_each(claims, runs, ["lab"])
    assert [whose.recordings for whose in decided] == ["synthetic", "real", "paper", "none"]
    assert [whose.verdicts[0].cases[0].value for whose in decided[:3]] == [0.01, 0.02, 0.01]
    assert [w.verdicts[0].verdict for w in decided[:2]] == [REPRODUCED, NOT_REPRODUCED]


def test_a_claim_that_needs_no_recording_is_decided_once_in_a_column_of_its_own():
    value = {"file": "metrics/wrench", "key": "mean"}
    study = CLAIM | {"id": "study", "each": {}, "value": value, "recording": "none"}
    metrics = {"wrench": {"mean": 0.01}, "motion": dict(EVIDENCE["metrics/motion"])}
    runs = [Run(n, "paper", False, list(JOINTS), ["x"], {}, metrics, {}) for n in ("a", "b")]
    decided = decide_each(parse_claims([CLAIM, study]), runs, [])
    assert [[v.verdict for v in whose.verdicts] for whose in decided] == [
        [REPRODUCED, NO_RECORDING],
        [REPRODUCED, NO_RECORDING],
        [NO_RECORDING, REPRODUCED],
    ]
    data = verdict_data(decided)
    assert list(data[1]["datasets"]) == [WITHOUT_RECORDING]


def test_what_the_construction_forces_has_no_verdict_on_any_recordings():
    forced = {"by": "construction", "because": "the level is the recorded one"}
    for recordings in ("synthetic", "real", "paper"):
        assert verdict(recordings=recordings, **forced).verdict == FORCED
        assert verdict(recordings=recordings, limit=0.012, **forced).verdict == FORCED
    assert verdict({}, **forced).verdict == NO_EVIDENCE
    level = {"by": "level", "because": "it holds at the recorded level"}
    assert verdict(**level).verdict == REPRODUCED


@pytest.mark.parametrize(("share", "expected"), [(0.4, REPRODUCED), (0.6, NO_EVIDENCE)])
def test_recordings_that_differ_mostly_from_each_other_are_no_evidence(share, expected):
    unless = {"file": "metrics/motion", "key": "share", "limit": 0.5, "reason": "a lag"}
    evidence = {"metrics/motion": EVIDENCE["metrics/motion"] | {"share": share}}
    decided = verdict(evidence, unless=unless)
    assert decided.verdict == expected
    assert {case.holds for case in decided.cases} == ({True} if share < 0.5 else {None})
    assert verdict(unless=unless).verdict == REPRODUCED  # without the quantity


TEST = {
    "rule": "follows",
    "limit": None,
    "threshold": {"file": "metrics/motion", "key": "{model}_limit"},
    "power": {"file": "metrics/motion", "key": "{model}_power"},
}


@pytest.mark.parametrize(
    ("powers", "limits", "expected"),
    [
        ((0.9, 0.9), (0.005, 0.01), REPRODUCED),
        ((0.9, 0.1), (0.005, 0.01), NO_EVIDENCE),
        ((0.9, 0.1), (0.02, 0.01), NOT_REPRODUCED),  # one case refutes a claim on all
        ((0.1, 0.1), (0.02, 0.02), NO_EVIDENCE),  # a test without power refutes nothing
    ],
)
def test_a_test_without_power_is_no_evidence(powers, limits, expected):
    models = ("additive", "wishart")
    metrics = EVIDENCE["metrics/motion"] | {
        f"{model}_{name}": value
        for name, values in (("power", powers), ("limit", limits))
        for model, value in zip(models, values, strict=True)
    }
    assert verdict({"metrics/motion": metrics}, **TEST).verdict == expected


@pytest.mark.parametrize(
    ("rule", "low", "high", "expected"),
    [
        ("less", -0.2, -0.1, REPRODUCED),
        ("less", 0.1, 0.2, NOT_REPRODUCED),
        ("less", -0.1, 0.2, NO_EVIDENCE),
        ("less", None, None, NO_EVIDENCE),
        ("greater", 0.1, 0.2, REPRODUCED),
        ("greater", -0.2, -0.1, NOT_REPRODUCED),
        ("greater", -0.1, 0.2, NO_EVIDENCE),
    ],
)
def test_an_order_whose_interval_covers_zero_is_no_verdict(rule, low, high, expected):
    keys = {key: {"file": "metrics/motion", "key": key} for key in ("than", "low", "high")}
    ends = {name: end for name, end in (("low", low), ("high", high)) if end is not None}
    evidence = {"metrics/motion": EVIDENCE["metrics/motion"] | {"than": 0.1} | ends}
    assert verdict(evidence, rule=rule, limit=None, **keys).verdict == expected


def test_the_data_hold_every_claim_with_its_evidence_and_are_strict_json():
    claims = parse_claims(
        [CLAIM, CLAIM | {"id": "other", "each": {}, "value": {"file": "m", "key": "x"}}]
    )
    data = verdict_data(
        [
            Decided("youbot", "synthetic", decide(claims, EVIDENCE, "synthetic", ARM)),
            Decided("ur5", "real", decide(claims, {}, "real", ARM)),
        ]
    )
    assert json.loads(json.dumps(data, allow_nan=False)) == data
    assert [entry["id"] for entry in data] == ["mean", "other"]
    assert data[0]["evidence"] == [
        "metrics/motion.json: additive_error",
        "metrics/motion.json: wishart_error",
    ]
    here = data[0]["datasets"]["youbot"]["cases"][1]
    assert (here["value"], here["holds"]) == (0.015, True)
    there = data[0]["datasets"]["ur5"]
    assert there["verdict"] == NO_EVIDENCE and there["cases"][0]["value"] is None
