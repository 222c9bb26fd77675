"""Verdicts follow from claims and numbers alone, malformed claims are refused by name and key, and the paper's claims have evidence."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest

from pipeline import config
from pipeline.audit.claims import NO_EVIDENCE, NOT_REPRODUCED, REPRODUCED, SYNTHETIC_CANNOT, Stated, decide, parse_claims, verdict_table
from pipeline.audit.strict import build
from pipeline.errors import ConfigError

ROOT = Path(__file__).parents[2]
TEXTS = {key: key for key in ("where", "statement", "quantity", "reason", "stage")}
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
    (result,) = decide(parse_claims([CLAIM | changes]), evidence, recordings)
    return result


def test_a_claim_holds_where_its_rule_holds_in_every_case():
    assert verdict().verdict == REPRODUCED
    failing = verdict(limit=0.012)
    assert failing.verdict == NOT_REPRODUCED
    assert [(case.case, case.value, case.holds) for case in failing.cases] == [("additive", 0.01, True), ("wishart", 0.015, False)]
    assert failing.command == "dvc repro stage"


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
    assert verdict(rule="less", limit=None, than={"file": "metrics/motion", "key": "nothing"}).verdict == NO_EVIDENCE


def test_an_order_with_a_gap_is_not_judged():
    changes = {"rule": "decreasing", "limit": None, "each": {"model": ["wishart", "none", "additive"]}}
    assert [case.holds for case in verdict(**changes).cases] == [None, None, None]
    assert verdict(**changes | {"each": {"model": ["wishart", "additive"]}}).verdict == REPRODUCED
    assert verdict(**changes | {"each": {"model": ["additive", "wishart"]}}).verdict == NOT_REPRODUCED


def test_published_values_belong_to_the_cases_in_their_order():
    changes = {"rule": "within_relative", "limit": None, "tolerance": 0.1, "published": [0.01, 0.0151]}
    assert verdict(**changes).verdict == REPRODUCED
    assert verdict(**changes | {"published": [0.0151, 0.01]}).verdict == NOT_REPRODUCED
    assert [case.published for case in verdict(**changes | {"published": 0.01}).cases] == [0.01, 0.01]


def test_standard_errors_add_in_squares_and_give_distance_and_interval():
    evidence = {"metrics/wrench": {"e": 5.0, "se": 0.3, "ee": 0.4}}
    value, *errors = ({"file": "metrics/wrench", "key": key} for key in ("e", "se", "ee"))
    changes = {"each": {}, "value": value, "standard_error": errors, "rule": "standard_errors", "published": 6.0}
    (case,) = verdict(evidence, **changes | {"limit": 2.5}).cases
    assert (case.distance, case.low, case.high, case.holds) == pytest.approx((2.0, 4.02, 5.98, True))
    assert verdict(evidence, **changes | {"limit": 1.5}).verdict == NOT_REPRODUCED


def test_the_same_claims_judge_the_numbers_of_any_variation():
    claims = parse_claims([CLAIM])
    variations = {share: {"metrics/motion": {"additive_error": 0.01, "wishart_error": 0.015 * share}} for share in (1.0, 2.0)}
    tables = {share: verdict_table(decide(claims, evidence, "synthetic")) for share, evidence in variations.items()}
    assert tables[1.0]["verdict"].tolist() == [REPRODUCED] * 2
    assert tables[2.0]["verdict"].tolist() == [NOT_REPRODUCED] * 2
    assert tables[2.0]["holds"].tolist() == [True, False]
    assert list(tables[1.0].columns) == ["id", "verdict", "case", "value", "than", "low", "high", "published", "distance", "holds"]


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"about": "robot"}, "about"),
        ({"rule": "near"}, "rule"),
        ({"limit": "0.02"}, "limit"),
        ({"limit": True}, "limit"),
        ({"limit": None}, "limit"),
        ({"published": 0.02}, "limit"),
        ({"rule": "less"}, "limit"),
        ({"rule": "less", "limit": None}, "than"),
        ({"tolerance": 0.1}, "tolerance"),
        ({"rule": "within_relative", "limit": None, "published": 1.0}, "tolerance"),
        ({"rule": "within_relative", "limit": None, "tolerance": 0.1}, "published"),
        ({"limit": None, "published": [1.0, 2.0, 3.0]}, "published"),
        ({"limit": None, "published": [1.0, "2"]}, "published"),
        ({"each": {"model": "wishart"}}, "each"),
        ({"each": {"model": []}}, "each"),
        ({"statement": 3}, "statement"),
        ({"published_value": 3}, "published_value"),
        ({"value": {"file": "metrics/motion"}}, "value"),
        ({"value": {"file": "metrics/motion", "name": "x"}}, "name"),
        ({"value": "metrics/motion"}, "value"),
    ],
)
def test_a_malformed_claim_is_refused_with_its_name_and_key(changes, key):
    with pytest.raises(ConfigError) as refused:
        parse_claims([CLAIM | changes])
    assert refused.value.evidence["claim"] == "mean"
    assert refused.value.evidence["key"] == key


def test_claims_without_their_keys_names_or_cases_are_refused():
    with pytest.raises(ConfigError, match="the key 'rule' is missing"):
        parse_claims([{key: value for key, value in CLAIM.items() if key != "rule"}])
    with pytest.raises(ConfigError, match="two claims have one id"):
        parse_claims([CLAIM, CLAIM])
    with pytest.raises(ConfigError, match="placeholder"):
        parse_claims([CLAIM | {"each": {"joint": [1]}}])
    for entries in (None, {}, [3]):
        with pytest.raises(ConfigError):
            parse_claims(entries)


@pytest.fixture(scope="module")
def claims():
    return parse_claims(build(Stated, config.read_yaml(ROOT / "reports/claims.yaml")).claims)


def test_the_evidence_of_every_claim_is_in_the_reports(claims):
    """On the synthetic youBot, which has every instrument; other datasets lack some."""
    evidence = {f"metrics/{file.stem}": json.loads(file.read_text()) for file in (ROOT / "reports/metrics").glob("*.json")}
    evidence |= {f"tables/{file.stem}": pd.read_csv(file) for file in (ROOT / "reports/tables").glob("*.csv")}
    missing = [
        f"{claim.id}: {reference.address}" for claim in claims for reference in claim.references if reference.look_up(evidence) is None
    ]
    assert missing == []


def test_every_claim_is_recomputed_by_a_stage_that_writes_its_evidence(claims):
    stages = config.read_yaml(ROOT / "dvc.yaml")["stages"]
    for claim in claims:
        name, _, model = claim.stage.partition("@")
        entries = [entry for kind in ("outs", "metrics") for entry in stages[name].get(kind, [])]
        written = {(entry if isinstance(entry, str) else next(iter(entry))).replace("${item.model}", model) for entry in entries}
        files = [reference.file for reference in claim.references]
        assert any(f"reports/{file}.json" in written or f"reports/{Path(file).parent}" in written for file in files), claim.id
