"""Every rule holds where it should and nowhere else, and none holds for want of a number; a
reference finds the one number it addresses; malformed claims are refused by name and key; a run is
read again as it was.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.core import config
from pipeline.core.columns import PLANE
from pipeline.core.errors import ConfigError, ContractError
from pipeline.core.validation import validated
from pipeline.statistics.curves import POWER
from pipeline.verdicts.claims import ClaimsFile, parse_claims
from pipeline.verdicts.decision import COMMAND, decide
from pipeline.verdicts.rules import LEAST_POWER, RULES
from pipeline.verdicts.run import ArmNames, Reference, Run, read_run, read_runs

ROOT = Path(__file__).parents[2]
COLUMNS = ["value", "than", "low", "high", "threshold", "power", "standard_error"]
COLUMNS += ["published", "tolerance", "limit", "yardstick", "distance"]
JOINTS = ("arm_joint_2", "arm_joint_3", "arm_joint_4")
ARM = ArmNames(JOINTS, PLANE)
ROWS = [("C1", "diagonal", 3, 1.0), ("C1", "full", 3, 2.0), ("C2", "diagonal", 5, 3.0)]
EVIDENCE = {
    "metrics/motion": {"wishart_std": 0.5, "std_arm_joint_3_rad": 0.25, "gap": float("nan")},
    "tables/sigma_s": pd.DataFrame(ROWS, columns=["name", "form", "agents", "e"]),
    "tables/t": pd.DataFrame({"score": ["rms_arm_joint_2"], "mean": [1.5]}),
}


def cases(value, **others) -> pd.DataFrame:
    table = pd.DataFrame({"value": value} | others, dtype=float).reindex(columns=COLUMNS)
    return table.assign(yardstick=table.published.fillna(table.limit))


ENDS = {"than": 1.5, "low": [-1, 0.1], "high": [-0.1, 1]}
# an interval about zero that is too wide shows no equivalence
ABOUT = {"low": [-1, -3, -1, -5], "high": [1, 1, 3, 5], "than": 10, "tolerance": 0.2}
AROUND = {"low": [5, 8, 5, 7.4], "high": [6, 9, 6.6, 9], "published": 7, "tolerance": 0.5}


@pytest.mark.parametrize(
    ("rule", "value", "others", "expected"),
    [
        ("within_relative", [11.9, 12.1, -10], {"published": 10, "tolerance": 0.2}, [1, 0, 0]),
        ("within_relative", [-11.9, -12.1], {"published": -10, "tolerance": 0.2}, [1, 0]),
        ("within_absolute", [0.044, 0.046], {"published": 0.04, "tolerance": 0.005}, [1, 0]),
        ("below", [0.9, 1.0], {"limit": 1.0}, [1, 0]),
        ("below", [0.9, 1.9], {"published": [1.0, 2.0]}, [1, 1]),
        ("above", [1.1, 1.0], {"limit": 1.0}, [1, 0]),
        ("less", [1.0, 2.0], ENDS, [1, 0]),
        ("greater", [1.0, 2.0], ENDS, [0, 1]),
        ("follows", [0.5, 0.5], {"threshold": [0.4, 0.6], "power": 1.0}, [1, 0]),
        ("varies", [0.3, 0.2], {"threshold": 0.1, "limit": 0.25}, [1, 0]),
        ("decreasing", [3, 2, 2, 1], {}, [1, 1, 0, 1]),
        ("equivalent", [0, 0, 0, 0], ABOUT, [1, 0, 0, 0]),
        ("interval_contains", [0, 0, 0, 0], AROUND, [0, 0, 1, 1]),
        ("standard_errors", [1, 1, 1], {"distance": [1.9, -2.1, np.inf], "limit": 2}, [1, 0, 0]),
    ],
)
def test_a_rule_holds_on_its_side_of_the_yardstick_alone(rule, value, others, expected):
    assert RULES[rule].holds(cases(value, **others)).tolist() == expected


def test_no_rule_holds_without_its_numbers():
    missing = cases([np.nan, 1.0], tolerance=0.1)
    others = set(RULES) - {"decreasing"}
    assert not any(RULES[rule].holds(missing).any() for rule in others) and len(others) == 11


@pytest.mark.parametrize(
    ("rule", "value", "others", "expected"),
    [
        ("less", [1, 1, 1], {"low": [-2, 1, -1], "high": [-1, 2, 1]}, [1, 1, 0]),
        ("less", [1.0], {}, [0]),
        ("follows", [0.5, 0.5], {"threshold": 0.4, "power": [0.79, 0.8]}, [0, 1]),
        ("varies", [0.2, 0.3, 0.5], {"limit": 0.25, "threshold": 0.4}, [1, 0, 1]),
        ("below", [0.2], {"limit": 0.25}, [1]),
    ],
)
def test_a_rule_decides_nothing_that_chance_alone_would_make(rule, value, others, expected):
    assert RULES[rule].decides(cases(value, **others)).tolist() == expected
    assert LEAST_POWER == POWER


@pytest.mark.parametrize(
    ("file", "key", "rows", "column", "expected"),
    [
        ("metrics/motion", "wishart_std", {}, "", 0.5),
        ("tables/sigma_s", "", {"name": "C1", "form": "full"}, "e", 2.0),
        ("tables/sigma_s", "", {"agents": 5}, "e", 3.0),
        # a joint by its number has the name that the run gives it
        ("metrics/motion", "std_{joint 2}_rad", {}, "", 0.25),
        ("tables/t", "", {"score": "rms_{joint 1}"}, "mean", 1.5),
        ("metrics/motion", "no_such", {}, "", None),
        ("metrics/motion", "gap", {}, "", None),
        ("metrics/none", "wishart_std", {}, "", None),
        ("tables/sigma_s", "e", {}, "", None),
        ("metrics/motion", "", {"name": "C1"}, "e", None),
        ("tables/sigma_s", "", {"name": "C3"}, "e", None),
        ("tables/sigma_s", "", {"colour": "red"}, "e", None),
        ("tables/sigma_s", "", {"name": "C2"}, "f", None),
    ],
)
def test_a_number_is_found_and_one_that_a_run_lacks_is_none(file, key, rows, column, expected):
    assert Reference(file, key, rows, column).look_up(EVIDENCE, ARM) == expected


def test_placeholders_take_the_values_of_a_case_and_several_rows_are_refused():
    with pytest.raises(ConfigError, match="2 rows fit"):
        Reference("tables/sigma_s", rows={"name": "C1"}, column="e").look_up(EVIDENCE, ARM)
    rows = {"name": "{c}", "form": "diagonal", "agents": 3}
    template = Reference("tables/sigma_s", rows=rows, column="{column}")
    case = template.in_case({"c": "C1", "column": "e"})
    assert case.look_up(EVIDENCE, ARM) == 1.0
    assert case.address == "tables/sigma_s.csv: e where name = C1, form = diagonal, agents = 3"
    in_case = Reference("metrics/motion", "std_{joint}_rad").in_case({"joint": "{joint 2}"})
    assert in_case.address == "metrics/motion.json: std_{joint 2}_rad"
    with pytest.raises(ConfigError, match="placeholder"):
        template.in_case({"c": "C1"})
    for parts in ({}, {"key": "a", "column": "b"}, {"key": "a", "rows": {"b": 1}}):
        with pytest.raises(ConfigError, match="needs a key, or a column"):
            Reference("metrics/motion", **parts)


@pytest.mark.parametrize(
    ("joints", "task"),
    [((*JOINTS, "arm_joint_5"), PLANE), (JOINTS, ("x", "z")), (JOINTS, ("x", "y", "z"))],
)
def test_the_joints_of_another_arm_or_task_than_the_papers_have_no_numbers(joints, task):
    arm = ArmNames(joints, task)
    assert arm.numbered == () and ARM.numbered == JOINTS
    assert Reference("metrics/motion", "std_{joint 2}_rad").look_up(EVIDENCE, arm) is None
    named = Reference("metrics/motion", "std_{joint}_rad").in_case({"joint": "arm_joint_3"})
    assert named.look_up(EVIDENCE, arm) == 0.25


VALUE = {"file": "metrics/motion", "key": "{model}_error"}
CLAIM = {key: key for key in ("where", "statement", "quantity", "reason")} | {
    "id": "mean",
    "about": "method",
    "rule": "below",
    "limit": 0.02,
    "each": {"model": ["additive", "wishart"]},
    "value": VALUE,
}
ORDER = {"rule": "less", "limit": None, **dict.fromkeys(("than", "low", "high"), VALUE)}
EVERY = {"limit": None, "each": {"model": ["a"], "joint": "every"}}
RELATIVE = {"rule": "within_relative", "limit": None}


@pytest.mark.parametrize(
    ("changes", "key"),
    [
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
        ({"unless": {"file": "metrics/motion", "key": "share", "reason": "so"}}, "unless.limit"),
        ({"tolerance": 0.1}, "tolerance"),
        (RELATIVE | {"published": 1.0}, "tolerance"),
        (RELATIVE | {"tolerance": 0.1}, "published"),
        ({"limit": None, "published": [1.0, 2.0, 3.0]}, "published"),
        ({"each": {"model": "every"}}, "each"),
        ({"each": {"model": []}}, "each"),
        (EVERY | {"published": [1.0, 2.0]}, "published"),
        ({"published_value": 3}, "published_value"),
        ({"value": {"file": "metrics/motion", "name": "x"}}, "value.name"),
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


STEPS = ["all", "moving, ‖J⁻¹‖: 1, 2"]
TABLE = pd.DataFrame({"steps": STEPS, "mean": [0.1 + 0.2, -np.inf], "low": [np.nan, 1e-300]})
MODELS = {"a": "additive", "g": "gaussian", "gf": "gaussian"}
METRICS, TABLES = {"motion": {"x": 1 / 3}}, {"scores": TABLE}
RUN = Run("lab", "paper", False, ["base", "elbow"], ["x", "z"], MODELS, METRICS, TABLES)


def test_a_run_comes_back_from_its_file_with_every_digit_gap_and_infinity(tmp_path):
    file = tmp_path / "lab.json"
    file.write_text(RUN.to_json(), encoding="utf-8")
    again = read_run(file)
    assert again.metrics == METRICS and again.models == MODELS
    assert again.arm == (("base", "elbow"), ("x", "z"))
    pd.testing.assert_frame_equal(again.tables["scores"], TABLE, check_exact=True)
    assert again.evidence.keys() == {"metrics/motion", "tables/scores"}
    assert again.to_json() == RUN.to_json()
    # a row of a table is a line of the file
    lines = RUN.to_json().splitlines()
    assert sum("0.30000000000000004" in line for line in lines) == 1


def test_the_run_at_hand_comes_first_and_a_file_that_is_no_run_is_refused_by_name(tmp_path):
    for name in ("b", "a", "c"):
        text = RUN.to_json().replace('"lab"', f'"{name}"')
        (tmp_path / f"{name}.json").write_text(text, encoding="utf-8")
    assert [run.dataset for run in read_runs(tmp_path, first="c")] == ["c", "a", "b"]
    with pytest.raises(ContractError, match="no evidence of the dataset d"):
        read_runs(tmp_path, first="d")
    damaged = ("", "[]", '{"tables": 3}', '{"tables": {}}', RUN.to_json().replace("scale", "size"))
    for text in damaged:
        (tmp_path / "lab.json").write_text(text, encoding="utf-8")
        with pytest.raises(ContractError, match=r"lab\.json"):
            read_run(tmp_path / "lab.json")


def test_every_claim_has_evidence_that_a_stage_writes_and_reasons_that_exist():
    """On the synthetic youBot, which has every instrument; other datasets lack some."""
    stated = validated(ClaimsFile, config.read_yaml(ROOT / "reports/claims.yaml"))
    claims, run = parse_claims(stated.claims), read_run(ROOT / "reports/datasets/youbot.json")
    missing = [
        f"{verdict.claim.id}: {case.case}"
        for verdict in decide(claims, run.evidence, "paper", run.arm)
        for case in verdict.cases
        if case.value is None
    ]
    assert missing == []
    stage = config.read_yaml(ROOT / "dvc.yaml")["stages"][COMMAND.removeprefix("dvc repro ")]
    written = {next(iter(out)) for out in stage["outs"] if isinstance(out, dict)}
    for claim in claims:
        for reference in claim.references():
            assert f"reports/${{dataset}}/{Path(reference.file).parent}" in written, claim.id
    datasets = {file.stem for file in (ROOT / "pipeline/conf/dataset").glob("*.yaml")}
    errata = config.read_yaml(ROOT / "pipeline/verdicts/errata.yaml")["errata"]
    assert {name for claim in claims for name in claim.why} <= datasets
    reasons = [reason for claim in claims for reason in claim.why.values()]
    linked = {link for reason in reasons for link in re.findall(r"\(errata\.md#(.*?)\)", reason)}
    assert linked and linked <= {erratum["id"] for erratum in errata}
    # as in the errata, numbers come from a run
    assert not any(re.search(r"\d[.,]\d|\de-?\d", reason) for reason in reasons)
