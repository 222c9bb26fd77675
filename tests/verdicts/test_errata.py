"""Errata read with the numbers of a run in their prose; every test that an entry names exists, and
no entry has a measured number typed.
"""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

from pipeline.core import config
from pipeline.core.errors import ConfigError
from pipeline.verdicts.claims import parse_claims
from pipeline.verdicts.decision import decide_each
from pipeline.verdicts.errata import MISSING, errata_page, parse_errata
from pipeline.verdicts.run import Run, read_run

ROOT = Path(__file__).parents[2]
VALUES = {"published": {"claim": "sigma", "number": "published"}}
VALUES |= {"ours": {"file": "metrics/fit", "key": "sigma_b"}}
ENTRY = {"id": "bias", "title": "A biased estimator", "place": "Sec. 4", "values": VALUES}
ENTRY |= {"paper": "It is {published}.", "fact": "It is {ours}.", "done": "Another one."}
ENTRY |= {"tests": ["tests/models/test_noise.py::test_one"]}
CLAIM = {key: key for key in ("where", "statement", "quantity", "reason")} | {"id": "sigma"}
CLAIM |= {"about": "method", "rule": "within_relative", "tolerance": 0.1, "published": 0.25}
CLAIM |= {"value": VALUES["ours"]}
JOINTS = ["shoulder", "elbow", "wrist"]


def page(evidence, **changes) -> str:
    run = Run("lab", "paper", True, JOINTS, ["x", "z", "phi"], {}, {"fit": evidence}, {})
    decided = decide_each(parse_claims([CLAIM]), [run], [])
    return errata_page(parse_errata([ENTRY | changes]), run, decided)


def test_numbers_of_the_run_and_of_the_claims_stand_in_the_prose():
    text = page({"sigma_b": 0.28765})
    assert "**The paper** (Sec. 4): It is 0.25." in text
    assert "**In fact**: It is 0.2877." in text
    assert "- `tests/models/test_noise.py::test_one`" in text
    assert f"It is {MISSING}." in page({})


def test_a_variance_a_step_may_stand_as_the_deviation_of_the_sum_of_so_many():
    added = {"claim": "sigma", "number": "published", "steps": 64}
    assert "It is 4." in page({}, values=VALUES | {"published": added})


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"tests": []}, "tests"),
        ({"tests": ["test_noise.py"]}, "tests"),
        ({"values": {}}, "values"),
        ({"values": 3}, "values"),
        ({"values": VALUES | {"ours": {"file": "metrics/fit"}}}, "key"),
        ({"values": {"ours": {"claim": "sigma", "number": "mean"}}}, "values.ours"),
        ({"note": "x"}, "note"),
        ({"title": 3}, "title"),
    ],
)
def test_a_malformed_entry_is_refused_with_its_name_and_key(changes, key):
    with pytest.raises(ConfigError) as refused:
        parse_errata([ENTRY | changes])
    assert refused.value.evidence["erratum"] == "bias"
    assert refused.value.evidence["key"].startswith(key)


def test_a_claim_that_does_not_exist_is_refused():
    with pytest.raises(ConfigError, match="no claim 'alpha'"):
        page({}, values=VALUES | {"published": {"claim": "alpha", "number": "published"}})


ERRATA = parse_errata(config.read_yaml(ROOT / "pipeline/verdicts/errata.yaml")["errata"])


@cache
def names_of_tests(file: str) -> set[str]:
    nodes = ast.walk(ast.parse((ROOT / file).read_text()))
    names = {node.name for node in nodes if isinstance(node, ast.FunctionDef)}
    return {name for name in names if name.startswith("test_")}


@pytest.mark.parametrize("erratum", ERRATA, ids=lambda erratum: erratum.id)
def test_every_test_that_an_entry_names_exists_and_no_measured_number_is_typed(erratum):
    for test in erratum.tests:
        file, _, name = test.partition("::")
        assert name in names_of_tests(file), test
    text = f"{erratum.title} {erratum.paper} {erratum.fact} {erratum.done}"
    assert not re.search(r"\d[.,]\d|\de-?\d", text)


def test_every_number_of_the_errata_is_in_the_run():
    run = read_run(ROOT / "reports/datasets/youbot.json")
    claims = parse_claims(config.read_yaml(ROOT / "reports/claims.yaml")["claims"])
    decided = decide_each(claims, [run], [])
    assert MISSING not in errata_page(ERRATA, run, decided)
    assert len({erratum.id for erratum in ERRATA}) == len(ERRATA)


def test_a_joint_is_named_by_its_place_in_the_papers_arm():
    values = {"ours": {"file": "metrics/fit", "key": "std_{joint 1}_rad"}}
    text = page({"std_shoulder_rad": 0.125}, paper="It.", values=values)
    assert "**In fact**: It is 0.125." in text
