"""Malformed claims are refused by name and key, and the paper's claims have evidence."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from pipeline.core import config
from pipeline.core.errors import ConfigError
from pipeline.core.validation import validated
from pipeline.verdicts.claims import Stated, parse_claims
from pipeline.verdicts.decision import COMMAND, decide
from pipeline.verdicts.run import read_run

ROOT = Path(__file__).parents[2]
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
ORDER = {"rule": "less", "limit": None, **dict.fromkeys(("than", "low", "high"), VALUE)}
EVERY = {"limit": None, "each": {"model": ["a"], "joint": "every"}}


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
        (ORDER | {"low": None}, "low"),
        (ORDER | {"than": None}, "than"),
        (ORDER | {"power": VALUE}, "power"),
        ({"rule": "follows", "limit": None, "threshold": VALUE}, "power"),
        ({"rule": "varies"}, "threshold"),
        ({"by": "chance", "because": "so"}, "by"),
        ({"by": "level"}, "because"),
        ({"because": "so"}, "because"),
        ({"source": "project"}, "where"),
        ({"where": ""}, "where"),
        ({"source": "somebody"}, "source"),
        ({"recording": "some"}, "recording"),
        ({"unless": {"file": "metrics/motion", "key": "share", "reason": "so"}}, "unless.limit"),
        ({"tolerance": 0.1}, "tolerance"),
        ({"rule": "within_relative", "limit": None, "published": 1.0}, "tolerance"),
        ({"rule": "within_relative", "limit": None, "tolerance": 0.1}, "published"),
        ({"limit": None, "published": [1.0, 2.0, 3.0]}, "published"),
        ({"limit": None, "published": [1.0, "2"]}, "published"),
        ({"each": {"model": "every"}}, "each"),
        ({"each": {"model": []}}, "each"),
        (EVERY | {"published": [1.0, 2.0]}, "published"),
        (EVERY | {"published": 1.0, "parameter": "x"}, "parameter"),
        ({"statement": 3}, "statement"),
        ({"parameter": "x"}, "parameter"),
        ({"why": {"youbot": 3}}, "why.youbot"),
        ({"why": "so"}, "why"),
        ({"published_value": 3}, "published_value"),
        ({"value": {"file": "metrics/motion", "name": "x"}}, "value.name"),
        ({"value": "metrics/motion"}, "value"),
    ],
)
def test_a_malformed_claim_is_refused_with_its_name_and_key(changes, key):
    with pytest.raises(ConfigError) as refused:
        parse_claims([CLAIM | changes])
    assert refused.value.evidence["claim"] == "mean"
    assert str(refused.value.evidence["key"]).startswith(key)


def test_claims_without_their_keys_names_or_cases_are_refused():
    with pytest.raises(ConfigError, match="no value for rule"):
        parse_claims([{key: value for key, value in CLAIM.items() if key != "rule"}])
    with pytest.raises(ConfigError, match="two claims have one id"):
        parse_claims([CLAIM, CLAIM])
    with pytest.raises(ConfigError, match="placeholder"):
        parse_claims([CLAIM | {"each": {"joint": "every"}}])
    # a joint by its place in the chain is no placeholder of a case
    joint = {"file": "metrics/motion", "key": "{model}_{joint 3}"}
    assert parse_claims([CLAIM | {"value": joint}])
    for entries in (None, {}, [3]):
        with pytest.raises(ConfigError):
            parse_claims(entries)


@pytest.fixture(scope="module")
def claims():
    return parse_claims(validated(Stated, config.read_yaml(ROOT / "reports/claims.yaml")).claims)


def test_the_evidence_of_every_claim_is_in_the_run(claims):
    """On the synthetic youBot, which has every instrument; other datasets lack some."""
    run = read_run(ROOT / "reports/datasets/youbot.json")
    missing = [
        f"{verdict.claim.id}: {case.case}"
        for verdict in decide(claims, run.evidence, "paper", run.arm)
        for case in verdict.cases
        if case.value is None
    ]
    assert missing == []


def test_the_reasons_of_failures_name_datasets_and_errata_that_exist(claims):
    datasets = {file.stem for file in (ROOT / "pipeline/conf/dataset").glob("*.yaml")}
    errata = config.read_yaml(ROOT / "pipeline/verdicts/errata.yaml")["errata"]
    reasons = {name: reason for claim in claims for name, reason in claim.why.items()}
    assert reasons and reasons.keys() <= datasets
    linked = {
        link
        for claim in claims
        for reason in claim.why.values()
        for link in re.findall(r"\(errata\.md#(.*?)\)", reason)
    }
    assert linked and linked <= {erratum["id"] for erratum in errata}
    # as in the errata, numbers come from a run
    assert not any(re.search(r"\d[.,]\d|\de-?\d", r) for c in claims for r in c.why.values())


def test_every_claim_is_recomputed_by_a_stage_that_writes_its_evidence(claims):
    stage = config.read_yaml(ROOT / "dvc.yaml")["stages"][COMMAND.removeprefix("dvc repro ")]
    written = {next(iter(out)) for out in stage["outs"] if isinstance(out, dict)}
    for claim in claims:
        for reference in claim.references():
            assert f"reports/${{dataset}}/{Path(reference.file).parent}" in written, claim.id
