"""Verdicts follow from claims and numbers alone, and from whose recordings they are."""

from __future__ import annotations

import json

import pytest

from pipeline.verdicts import decision as d
from pipeline.verdicts.claims import parse_claims
from pipeline.verdicts.run import ArmNames, Run

JOINTS = ("shoulder", "elbow", "wrist")
ARM = ArmNames(JOINTS, ("x", "z", "phi"))
TEXTS = {key: key for key in ("where", "statement", "quantity", "reason")}
MODELS = ("additive", "wishart")


def metric(key: str) -> dict[str, str]:
    return {"file": "metrics/motion", "key": key}


CLAIM = TEXTS | {"id": "mean", "about": "method", "rule": "below", "limit": 0.02}
CLAIM |= {"each": {"model": [*MODELS]}, "value": metric("{model}_error")}
EVERY = CLAIM | {"each": {"joint": "every"}, "value": metric("{joint}_error")}
NUMBERS = {"additive_error": 0.01, "wishart_error": 0.015}


def verdict(recordings="synthetic", arm=ARM, claim=CLAIM, numbers=NUMBERS, more=None, **changes):
    """Verdict on ``claim`` with ``changes`` from ``numbers`` and ``more`` of them."""
    evidence = {"metrics/motion": numbers | (more or {})}
    (result,) = d.decide(parse_claims([claim | changes]), evidence, recordings, arm)
    return result


def test_a_claim_holds_where_its_rule_holds_in_every_case():
    assert verdict().verdict == d.REPRODUCED
    failing = verdict(limit=0.012)
    assert failing.verdict == d.NOT_REPRODUCED
    cases = [(case.case, case.value, case.holds) for case in failing.cases]
    assert cases == [("additive", 0.01, True), ("wishart", 0.015, False)]


@pytest.mark.parametrize(
    ("about", "recordings", "expected"),
    [
        ("method", "synthetic", d.REPRODUCED),
        ("method", "real", d.REPRODUCED),
        ("robots", "synthetic", d.SYNTHETIC_CANNOT),
        ("robots", "real", d.REPRODUCED),
        ("robots", "paper", d.REPRODUCED),
        ("specimen", "synthetic", d.SYNTHETIC_CANNOT),
        ("specimen", "real", d.NO_EVIDENCE),
        ("specimen", "paper", d.REPRODUCED),
    ],
)
def test_what_is_said_of_a_robot_only_its_recordings_decide(about, recordings, expected):
    result = verdict(recordings, about=about)
    assert result.verdict == expected
    assert all(case.holds for case in result.cases)


def test_a_missing_number_is_no_evidence_and_the_others_are_still_shown():
    result = verdict(numbers={"additive_error": 0.01})
    assert result.verdict == d.NO_EVIDENCE
    assert [(case.value, case.holds) for case in result.cases] == [(0.01, True), (None, None)]
    infinite = verdict(more={"additive_error": float("inf")}, rule="above")
    assert [case.value for case in infinite.cases] == [None, 0.015]


def test_an_order_with_a_gap_is_not_judged():
    for models, holds, expected in (
        (["wishart", "none", "additive"], [None] * 3, d.NO_EVIDENCE),
        (["wishart", "additive"], [True, True], d.REPRODUCED),
        (["additive", "wishart"], [True, False], d.NOT_REPRODUCED),
    ):
        result = verdict(rule="decreasing", limit=None, each={"model": models})
        assert [case.holds for case in result.cases] == holds and result.verdict == expected


def test_published_values_go_by_case_and_standard_errors_add_in_squares():
    changes = {"rule": "within_relative", "limit": None, "tolerance": 0.1}
    assert verdict(**changes, published=[0.01, 0.0151]).verdict == d.REPRODUCED
    assert verdict(**changes, published=[0.0151, 0.01]).verdict == d.NOT_REPRODUCED
    assert [c.published for c in verdict(**changes, published=0.01).cases] == [0.01, 0.01]
    value, *errors = (metric(key) for key in ("e", "se", "ee"))
    changes = {"each": {}, "value": value, "standard_error": errors, "published": 6.0}
    changes |= {"more": {"e": 5.0, "se": 0.3, "ee": 0.4}, "rule": "standard_errors"}
    (case,) = verdict(**changes, limit=2.5).cases
    known = (case.distance, case.low, case.high, case.holds)
    assert known == pytest.approx((2.0, 4.02, 5.98, True), abs=1e-4)
    assert verdict(**changes, limit=1.5).verdict == d.NOT_REPRODUCED


@pytest.mark.parametrize("joints", [("slide",), tuple("abcdefg")])
def test_every_joint_of_an_arm_of_any_size_is_a_case_by_its_own_name(joints):
    numbers = {f"{name}_error": 0.01 for name in joints[:-1]} | {f"{joints[-1]}_error": 0.03}
    arm = ArmNames(joints, ("x",))
    result = verdict("real", arm, EVERY, numbers)
    assert [case.case for case in result.cases] == list(joints)
    assert [case.holds for case in result.cases] == [True] * (len(joints) - 1) + [False]
    assert result.verdict == d.NOT_REPRODUCED
    del numbers[f"{joints[-1]}_error"]
    assert verdict("real", arm, EVERY, numbers).verdict == d.NO_EVIDENCE
    # of no cases all hold, which says nothing
    assert verdict("real", ArmNames((), ()), EVERY)[1:] == (d.NO_EVIDENCE, ())


def test_a_claim_that_singles_out_a_joint_has_evidence_on_the_papers_kind_of_arm_alone():
    numbers = {f"{name}_error": 0.01 for name in JOINTS}
    changes = dict.fromkeys(("value", "low", "high"), metric("{joint}_error"))
    changes |= {"each": {"joint": ["{joint 1}", "{joint 2}"]}, "than": metric("{joint 3}_error")}
    changes |= {"numbers": numbers, "rule": "less", "limit": None}
    here = verdict("real", **changes)
    assert [case.case for case in here.cases] == ["shoulder", "elbow"]
    assert here.verdict == d.NOT_REPRODUCED
    # the same names and numbers, in space
    there = verdict("real", ARM._replace(task=("x", "y", "z")), **changes)
    assert there.verdict == d.NO_EVIDENCE and {case.value for case in there.cases} == {None}
    # nor are the paper's own parameters held against those of another kind of arm
    assert verdict("paper", about="specimen").verdict == d.REPRODUCED
    there = verdict("paper", ArmNames(tuple("abcdef"), ("x",)), about="specimen")
    assert there.verdict == d.NO_EVIDENCE and there.cases[0].value is None


def test_runs_are_decided_by_whose_recordings_they_are_and_by_their_own_joints():
    metrics = {"motion": {"shoulder_error": 0.01, "hip_error": 0.02}}
    known = (("youbot", True, "shoulder"), ("ur5", False, "hip"), ("lab", False, "shoulder"))
    runs = [Run(name, "paper", own, [joint], ["x"], {}, metrics, {}) for name, own, joint in known]
    decided = d.decide_each(parse_claims([EVERY]), runs, ["lab"])
    assert [whose.recordings for whose in decided] == ["synthetic", "real", "paper", "none"]
    assert [whose.verdicts[0].cases[0].value for whose in decided[:3]] == [0.01, 0.02, 0.01]
    assert [w.verdicts[0].verdict for w in decided[:2]] == [d.REPRODUCED, d.NOT_REPRODUCED]


def test_a_claim_that_needs_no_recording_is_decided_once_in_a_column_of_its_own():
    value = {"file": "metrics/wrench", "key": "mean"}
    study = CLAIM | {"id": "study", "each": {}, "value": value, "recording": "none"}
    metrics = {"wrench": {"mean": 0.01}, "motion": NUMBERS}
    runs = [Run(n, "paper", False, [*JOINTS], ["x"], {}, metrics, {}) for n in ("a", "b")]
    decided = d.decide_each(parse_claims([CLAIM, study]), runs, [])
    of_a_run = [d.REPRODUCED, d.NO_RECORDING]
    verdicts = [[v.verdict for v in whose.verdicts] for whose in decided]
    assert verdicts == [of_a_run, of_a_run, of_a_run[::-1]]
    assert list(d.verdict_data(decided)[1]["datasets"]) == [d.WITHOUT_RECORDING]


def test_what_the_construction_forces_has_no_verdict_on_any_recordings():
    forced = {"by": "construction", "because": "the level is the recorded one"}
    for recordings in ("synthetic", "real", "paper"):
        assert verdict(recordings, **forced).verdict == d.FORCED
        assert verdict(recordings, limit=0.012, **forced).verdict == d.FORCED
    assert verdict(numbers={}, **forced).verdict == d.NO_EVIDENCE
    assert verdict(by="level", because="it holds at the level").verdict == d.REPRODUCED


@pytest.mark.parametrize(("share", "expected"), [(0.4, d.REPRODUCED), (0.6, d.NO_EVIDENCE)])
def test_recordings_that_differ_mostly_from_each_other_are_no_evidence(share, expected):
    unless = metric("share") | {"limit": 0.5, "reason": "a lag"}
    decided = verdict(more={"share": share}, unless=unless)
    assert decided.verdict == expected
    assert {case.holds for case in decided.cases} == ({True} if share < 0.5 else {None})
    assert verdict(unless=unless).verdict == d.REPRODUCED  # without the quantity


@pytest.mark.parametrize(
    ("powers", "limits", "expected"),
    [
        ((0.9, 0.9), (0.005, 0.01), d.REPRODUCED),
        ((0.9, 0.1), (0.005, 0.01), d.NO_EVIDENCE),
        ((0.9, 0.1), (0.02, 0.01), d.NOT_REPRODUCED),  # one case refutes a claim on all
        ((0.1, 0.1), (0.02, 0.02), d.NO_EVIDENCE),  # a test without power refutes nothing
    ],
)
def test_a_test_without_power_is_no_evidence(powers, limits, expected):
    more = {f"{model}_power": value for model, value in zip(MODELS, powers, strict=True)}
    more |= {f"{model}_limit": value for model, value in zip(MODELS, limits, strict=True)}
    ends = {"threshold": metric("{model}_limit"), "power": metric("{model}_power")}
    assert verdict(more=more, rule="follows", limit=None, **ends).verdict == expected


@pytest.mark.parametrize(
    ("rule", "low", "high", "expected"),
    [
        ("less", -0.2, -0.1, d.REPRODUCED),
        ("less", -0.1, 0.2, d.NO_EVIDENCE),
        ("less", None, None, d.NO_EVIDENCE),
        ("greater", -0.2, -0.1, d.NOT_REPRODUCED),
    ],
)
def test_an_order_whose_interval_covers_zero_is_no_verdict(rule, low, high, expected):
    keys = {key: metric(key) for key in ("than", "low", "high")}
    more = {"than": 0.1} | ({} if low is None else {"low": low, "high": high})
    assert verdict(more=more, rule=rule, limit=None, **keys).verdict == expected


def test_the_data_hold_every_claim_with_its_evidence_and_are_strict_json():
    claims = parse_claims([CLAIM, CLAIM | {"id": "other", "each": {}, "value": metric("x")}])
    here = d.decide(claims, {"metrics/motion": NUMBERS}, "synthetic", ARM)
    there = d.decide(claims, {}, "real", ARM)
    data = d.verdict_data([d.Decided("youbot", "synthetic", here), d.Decided("ur5", "real", there)])
    assert json.loads(json.dumps(data, allow_nan=False)) == data
    assert [entry["id"] for entry in data] == ["mean", "other"]
    assert data[0]["evidence"] == [f"metrics/motion.json: {model}_error" for model in MODELS]
    case = data[0]["datasets"]["youbot"]["cases"][1]
    assert (case["value"], case["holds"]) == (0.015, True)
    other = data[0]["datasets"]["ur5"]
    assert other["verdict"] == d.NO_EVIDENCE and other["cases"][0]["value"] is None
