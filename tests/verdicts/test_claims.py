"""A reference finds the number in its row; malformed claims are refused by name and key; a run is
read as it was written; verdicts follow from claims, numbers and the kind of recordings.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from case_tables import cases_beside

from pipeline.core.columns import PLANE
from pipeline.core.errors import ConfigError, ContractError
from pipeline.evidence.table import evidence_row, evidence_table
from pipeline.verdicts import decision as d
from pipeline.verdicts.claims import parse_claims
from pipeline.verdicts.run import ArmNames, Reference, Run, read_run, read_runs
from pipeline.verdicts.run import index_evidence as index

cases = cases_beside(__file__)
JOINTS = ("arm_joint_2", "arm_joint_3", "arm_joint_4")
ARM = ArmNames(JOINTS, PLANE)


def test_a_row_of_evidence_is_found_by_all_of_its_keys_and_no_two_rows_have_the_same():
    rows = [evidence_row("std", 2.0, model="wishart", joint=JOINTS[1])]
    rows.append(
        evidence_row(
            "std",
            -1.0,
            -2.0,
            0.5,
            model="wishart",
            rival="additive",
            entry=12,
        ),
    )
    evidence = index(evidence_table([*rows, evidence_row("u", np.inf)]))
    template = Reference("std", model="{model}", joint="{joint 2}")
    names = {"model": "wishart"}
    assert template.look_up(evidence, names | ARM.numbered) == 2.0

    difference = Reference(
        "std",
        model="wishart",
        rival="additive",
        entry="12",
        column="low",
    )
    assert difference.look_up(evidence, {}) == -2.0
    for missing in (template, Reference("std", model="wishart"), Reference("u")):
        assert missing.look_up(evidence, ARM.numbered) is None
    assert template.look_up(evidence, names | ArmNames((), ()).numbered) is None
    with pytest.raises(ContractError, match="equal keys: std, wishart, arm_joint_3"):
        index(evidence_table([rows[0], rows[0]]))


def metric(key: str) -> dict[str, str]:
    return {"quantity": "std", "model": key}


def evidence_of(numbers: dict[str, float | None]) -> pd.DataFrame:
    """The table of the ``numbers`` of :func:`metric`; low and high are ends of the difference."""
    low = numbers.get("low", np.nan)
    high = numbers.get("high", np.nan)
    difference = evidence_row("std", -0.1, low, high, model="wishart", rival="a")
    rows = [difference]
    for name, value in numbers.items():
        if value is None or name in ("low", "high"):
            continue
        rows.append(evidence_row("std", value, model=name))
    return evidence_table(rows)


MODELS = ("additive", "wishart")
CLAIM = {key: key for key in ("where", "statement", "quantity", "reason")} | {
    "id": "mean",
    "about": "method",
    "rule": "below",
    "limit": 0.02,
    "each": {"model": [*MODELS]},
    "value": metric("{model}_error"),
}
EVERY = CLAIM | {"each": {"joint": "every"}, "value": metric("{joint}_error")}
FILE = Path(__file__).with_name("claim_cases.yaml")
CASES = yaml.safe_load(FILE.read_text(encoding="utf-8"))


@pytest.mark.parametrize("case", CASES["malformed"], ids=str)
def test_a_malformed_claim_is_refused_with_its_name_and_key(case):
    with pytest.raises(ConfigError) as refused:
        parse_claims([CLAIM | case["claim"]])

    assert refused.value.evidence["claim"] == "mean"
    assert str(refused.value.evidence["key"]).startswith(case["key"])


def test_two_claims_of_one_name_are_refused():
    with pytest.raises(ConfigError, match="two claims have the same id"):
        parse_claims([CLAIM, CLAIM])


STEPS = ["all", "moving, ‖J⁻¹‖: 1, 2"]
TABLE = pd.DataFrame(
    {"steps": STEPS, "mean": [0.1 + 0.2, -np.inf], "low": [np.nan, 1e-300]},
)
KINDS = {"a": "additive", "g": "gaussian", "gf": "gaussian"}
EVIDENT = evidence_table([evidence_row("sigma_s", 1 / 3, configuration=3, entry="01")])
METRICS = {"motion": {"x": 1 / 3}}
TABLES = {"scores": TABLE, "evidence": EVIDENT}
RUN = Run("lab", "paper", False, ["base", "elbow"], ["x", "z"], KINDS, METRICS, TABLES)


def test_a_run_comes_back_from_its_file_with_every_digit_gap_and_infinity(tmp_path):
    file = tmp_path / "lab.json"
    file.write_text(RUN.to_json(), encoding="utf-8")
    again = read_run(file)

    assert again.metrics == METRICS and again.models == KINDS
    assert again.arm == (("base", "elbow"), ("x", "z"))
    for name, table in TABLES.items():  # keys of digits stay text
        pd.testing.assert_frame_equal(again.tables[name], table, check_exact=True)
    assert again.to_json() == RUN.to_json()

    # a row of a table is a line of the file
    lines = RUN.to_json().splitlines()
    assert sum("0.30000000000000004" in line for line in lines) == 1


def test_the_run_at_hand_comes_first_and_a_file_that_is_no_run_is_refused_by_name(
    tmp_path,
):
    for name in ("b", "a", "c"):
        text = replace(RUN, dataset=name).to_json()
        (tmp_path / f"{name}.json").write_text(text, encoding="utf-8")
    assert [run.dataset for run in read_runs(tmp_path, tmp_path / "c.json")] == [
        "c",
        "a",
        "b",
    ]
    with pytest.raises(ContractError, match="no evidence of the dataset d"):
        read_runs(tmp_path, tmp_path / "d.json")

    twice = replace(RUN, tables={"evidence": pd.concat([EVIDENT] * 2)}).to_json()
    copy = replace(RUN, dataset="ur5").to_json()
    deep = "[" * 10**5
    broken = (
        twice,
        copy,
        deep,
        "",
        "[]",
        '{"tables": 3}',
        RUN.to_json().replace("scale", "size"),
    )
    for text in broken:
        (tmp_path / "lab.json").write_text(text, encoding="utf-8")
        with pytest.raises(ContractError, match=r"lab\.json"):
            read_run(tmp_path / "lab.json")


NUMBERS = {"additive_error": 0.01, "wishart_error": 0.015}


def verdict(
    recordings="synthetic",
    arm=ARM,
    claim=CLAIM,
    numbers=NUMBERS,
    more=None,
    **changes,
):
    """Return the verdict on ``claim`` with ``changes`` from ``numbers`` and ``more`` numbers."""
    evidence = evidence_of(numbers | (more or {}))
    (result,) = d.decide(parse_claims([claim | changes]), evidence, recordings, arm)
    return result


FORCED = CASES["definitions"]["forced"]
BETWEEN = CASES["definitions"]["between"]


@pytest.mark.parametrize("case", CASES["verdicts"], ids=str)
def test_a_verdict_follows_from_rule_numbers_and_recordings(case):
    changes = case.get("claim", {})
    numbers = case.get("numbers", {})

    result = verdict(case["recordings"], more=numbers, **changes)

    assert result.verdict == getattr(d, case["verdict"])
    if case.get("undecided"):
        assert {of_claim.holds for of_claim in result.cases} == {None}


def test_standard_errors_add_in_squares():
    changes = {
        "each": {},
        "rule": "standard_errors",
        "published": 6.0,
        "value": metric("e"),
        "standard_error": [metric("se"), metric("ee")],
    }
    numbers = {"e": 5.0, "se": 0.3, "ee": 0.4}
    (case,) = verdict(more=numbers, **changes, limit=2.5).cases
    assert case.distance == pytest.approx(2.0) and case.holds
    # the interval is the rule's own
    assert (case.low, case.high) == pytest.approx((3.75, 6.25), abs=1e-4)
    refuted = verdict(more=numbers, **changes, limit=1.5)
    assert refuted.verdict == d.NOT_REPRODUCED
    # each of them is a number that the claim refers to
    (claim,) = parse_claims([CLAIM | changes])
    assert {reference.model for reference in claim.references} == {"e", "se", "ee"}


@pytest.mark.parametrize("joints", [("slide",), tuple("abcdefg")])
def test_every_joint_of_an_arm_of_any_size_is_a_case_by_its_own_name(joints):
    *following, last = joints
    numbers = {f"{joint}_error": 0.01 for joint in following}
    numbers[f"{last}_error"] = 0.03
    result = verdict("real", ArmNames(joints, ("x",)), EVERY, numbers)
    holds = {case.case: case.holds for case in result.cases}

    assert holds == dict.fromkeys(following, True) | {last: False}
    assert result.verdict == d.NOT_REPRODUCED
    assert verdict("real", ArmNames((), ()), EVERY)[1:] == (d.NO_EVIDENCE, ())


def test_a_joint_that_the_command_moves_by_less_than_a_hundredth_of_the_greatest_range_is_no_case():
    rows = []
    for joint, value in zip(JOINTS, (1.0, 0.02, 0.005), strict=True):
        rows.append(evidence_row("commanded_range", value, joint=joint))

    assert d.moving_joints(evidence_table(rows), JOINTS) == JOINTS[:2]
    assert d.moving_joints(evidence_table([]), JOINTS) == JOINTS


def test_a_claim_that_singles_out_a_joint_has_evidence_on_the_papers_kind_of_arm_alone():
    changes = {
        "each": {"joint": ["{joint 1}", "{joint 2}"]},
        "value": metric("{joint}_error"),
    }
    changes |= {"numbers": {f"{name}_error": 0.01 for name in JOINTS}}
    here = verdict("real", **changes)
    assert tuple(case.case for case in here.cases) == JOINTS[:2]
    assert here.verdict == d.REPRODUCED

    # the same names and numbers, in space
    there = verdict("real", ARM._replace(task=("x", "y", "z")), **changes)
    assert there.verdict == d.NO_EVIDENCE
    assert {case.value for case in there.cases} == {None}


def test_runs_are_decided_by_whose_recordings_they_are_and_claims_without_recording_once():
    study = CLAIM | {"id": "study", "each": {}, "recording": "none", "rule": "above"}
    study |= {"value": metric("mean")}
    numbers = {"shoulder_error": 0.01, "hip_error": 0.02, "mean": 1.0}
    tables = {"evidence": evidence_of(numbers)}
    template = Run("youbot", "paper", True, ["shoulder"], ["x"], {}, {}, tables)
    runs = [
        template,
        replace(template, dataset="ur5", synthetic=False, joints=["hip"]),
        replace(template, dataset="lab", synthetic=False),
    ]
    decided = d.decide_each(parse_claims([EVERY, study]), runs, ["lab"])
    youbot, ur5, lab, independent = decided
    kinds = [column.recordings for column in decided]

    assert kinds == ["synthetic", "real", "paper", "none"]
    for column, value in zip(decided, (0.01, 0.02, 0.01), strict=False):
        assert column.verdicts[0].cases[0].value == value
    assert youbot.verdicts[0].verdict == d.REPRODUCED
    assert [v.verdict for v in ur5.verdicts] == [d.NOT_REPRODUCED, d.NO_RECORDING]
    assert lab.verdicts[1].verdict == independent.verdicts[1].verdict == d.REPRODUCED

    table = d.verdict_table(decided)
    assert table[["claim", "dataset"]].to_numpy().tolist() == [
        *(["mean", name] for name in ("youbot", "ur5", "lab")),
        *(["study", name] for name in ("lab", d.WITHOUT_RECORDING)),
    ]
    assert table["value"].tolist() == [0.01, 0.02, 0.01, 1.0, 1.0]
    assert table["holds"].tolist() == [True, False, True, True, True]


def test_a_number_of_a_rule_is_not_printed_as_a_value_compared_with():
    changes = {
        "each": {},
        "value": metric("wishart") | {"rival": "a"},
        "than": metric("than"),
    }
    numbers = {"numbers": {"than": 0.2, "low": -0.2, "high": 0.1, "limit": 0.5}}
    changes |= {"rule": "varies", "limit": None, "threshold": metric("limit")}
    (case,) = verdict(**changes, **numbers).cases
    assert d.case_text(case) == "-0.1 ([-0.2, 0.1]) (limit 0.5) ✗"

    forced = {"value": metric("wishart"), "rule": "less", "limit": None} | FORCED
    (case,) = verdict(
        **changes | forced | {"threshold": None},
        numbers={"wishart": 1, "than": 3},
    ).cases
    assert case.difference == -2 and case.holds is None  # it has no interval

    numbers["numbers"] |= {"wishart": -0.1, "a": 0.2}
    (case,) = verdict(**numbers, **BETWEEN, each={}, rule="less").cases
    assert d.case_text(case) == "-0.1 against 0.2 (difference [-0.2, 0.1])"


FOLLOWING = {"quantity": "std_correlation", "model": "wishart", "joint": "{joint}"}
CONTROLLED = EVERY | {
    "rule": "follows",
    "limit": None,
    "control_model": "speed",
    "about": "robots",
    "value": FOLLOWING,
    "threshold": FOLLOWING | {"quantity": "std_correlation_limit"},
    "power": FOLLOWING | {"quantity": "std_correlation_power"},
}


@cases("speed law")
def test_a_claim_that_holds_for_the_speed_law_too_has_a_verdict_of_its_own(
    correlations,
    powers,
    expected,
):
    rows = []
    numbers = {"wishart": ((0.6,) * 3, (0.9,) * 3), "speed": (correlations, powers)}
    for model, (values, tested) in numbers.items():
        for joint, value, power in zip(JOINTS, values, tested, strict=True):
            keys = {"model": model, "joint": joint}
            rows.append(evidence_row("std_correlation", value, **keys))
            rows.append(evidence_row("std_correlation_limit", 0.5, **keys))
            rows.append(evidence_row("std_correlation_power", power, **keys))
    claims = parse_claims([CONTROLLED])

    (result,) = d.decide(claims, evidence_table(rows), "real", ARM)

    assert result.verdict == getattr(d, expected)
    assert [case.speed_law for case in result.cases] == correlations
