"""A reference finds the number in its row; malformed claims are refused by name and key; a run is
read as it was written; verdicts follow from claims, numbers and the kind of recordings.
"""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pipeline.core.columns import PLANE
from pipeline.core.errors import ConfigError, ContractError
from pipeline.evidence.table import evidence_row, evidence_table
from pipeline.verdicts import decision as d
from pipeline.verdicts.claims import parse_claims
from pipeline.verdicts.run import ArmNames, Reference, Run, read_run, read_runs
from pipeline.verdicts.run import index_evidence as index

JOINTS = ("arm_joint_2", "arm_joint_3", "arm_joint_4")
ARM = ArmNames(JOINTS, PLANE)


def test_a_row_of_evidence_is_found_by_all_of_its_keys_and_no_two_rows_have_the_same():
    rows = [evidence_row("std", 2.0, model="wishart", joint=JOINTS[1])]
    rows.append(
        evidence_row(
            "std", -1.0, -2.0, 0.5, model="wishart", rival="additive", entry=12
        )
    )
    evidence = index(evidence_table([*rows, evidence_row("u", np.inf)]))
    template, names = (
        Reference("std", model="{model}", joint="{joint 2}"),
        {"model": "wishart"},
    )
    assert template.look_up(evidence, names | ARM.numbered) == 2.0
    difference = Reference(
        "std", model="wishart", rival="additive", entry="12", column="low"
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
    known = {name: value for name, value in numbers.items() if value is not None}
    ends = [known.pop(name, np.nan) for name in ("low", "high")]
    rows = [evidence_row("std", value, model=name) for name, value in known.items()]
    return evidence_table(
        [*rows, evidence_row("std", -0.1, *ends, model="wishart", rival="a")]
    )


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
ORDER = {
    "rule": "less",
    "limit": None,
    **dict.fromkeys(("than", "difference"), metric("e")),
}
RELATIVE = {"rule": "within_relative", "limit": None}


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"rule": "near"}, "rule"),
        ({"limit": "0.02"}, "limit"),
        ({"limit": None}, "limit"),
        ({"published": 0.02}, "limit"),
        (ORDER | {"difference": None}, "difference"),
        (ORDER | {"margin": 0.1}, "difference"),  # of other rows than value and than
        (ORDER | {"power": metric("p")}, "power"),
        ({"than": metric("e")}, "than"),
        ({"rule": "follows", "limit": None, "threshold": metric("t")}, "power"),
        ({"unless": {"value": metric("share"), "reason": "so"}}, "unless.limit"),
        # a quantity that no stage writes, and a column that the table lacks
        ({"value": metric("e") | {"quantity": "stdd"}}, "quantity"),
        (
            {"unless": {"value": {"quantity": "share"}, "limit": 1.0, "reason": "so"}},
            "quantity",
        ),
        ({"value": metric("e") | {"modle": "a"}}, "value.modle"),
        (RELATIVE | {"published": 1.0}, "tolerance"),
        (RELATIVE | {"tolerance": 0.1}, "published"),
        (RELATIVE | {"published": 1.0, "tolerance": -0.1}, "tolerance"),
        ({"where": ""}, "where"),
        ({"limit": None, "published": [1.0, 2.0, 3.0]}, "published"),
        ({"each": {"model": "every"}}, "each"),
        ({"each": {"joint": "every"}}, "{model}"),
        ({"published_value": 3}, "published_value"),
    ],
)
def test_a_malformed_claim_is_refused_with_its_name_and_key(changes, key):
    with pytest.raises(ConfigError) as refused:
        parse_claims([CLAIM | changes])
    assert refused.value.evidence["claim"] == "mean"
    assert str(refused.value.evidence["key"]).startswith(key)


def test_two_claims_of_one_name_are_refused():
    with pytest.raises(ConfigError, match="two claims have the same id"):
        parse_claims([CLAIM, CLAIM])


STEPS = ["all", "moving, ‖J⁻¹‖: 1, 2"]
TABLE = pd.DataFrame(
    {"steps": STEPS, "mean": [0.1 + 0.2, -np.inf], "low": [np.nan, 1e-300]}
)
KINDS = {"a": "additive", "g": "gaussian", "gf": "gaussian"}
EVIDENT = evidence_table([evidence_row("sigma_s", 1 / 3, configuration=3, entry="01")])
METRICS, TABLES = {"motion": {"x": 1 / 3}}, {"scores": TABLE, "evidence": EVIDENT}
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
    copy, deep = replace(RUN, dataset="ur5").to_json(), "[" * 10**5
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
    recordings="synthetic", arm=ARM, claim=CLAIM, numbers=NUMBERS, more=None, **changes
):
    """Return the verdict on ``claim`` with ``changes`` from ``numbers`` and ``more`` numbers."""
    evidence = evidence_of(numbers | (more or {}))
    (result,) = d.decide(parse_claims([claim | changes]), evidence, recordings, arm)
    return result


FAILING, FORCED = (
    {"limit": 0.012},
    {"by": "construction", "because": "the level is the recorded"},
)
PUBLISHED = RELATIVE | {"tolerance": 0.1}
UNLESS = {"unless": {"value": metric("share"), "limit": 0.5, "reason": "a lag"}}
POWER_OF = {"rule": "follows", "limit": None}
POWER_OF |= {key: metric(f"{{model}}_{key}") for key in ("threshold", "power")}
BETWEEN = {
    "value": metric("wishart"),
    "than": metric("a"),
    "limit": None,
    "margin": 0.01,
}
BETWEEN |= {"difference": metric("wishart") | {"rival": "a"}}
WITHOUT_ENDS = {"wishart": 0.0, "a": 0.1}
AROUND_ZERO, BELOW_ZERO = (
    WITHOUT_ENDS | {"low": -0.2, "high": high} for high in (0.1, -0.1)
)


def powers(powers, thresholds) -> dict[str, float]:
    """Return powers and thresholds of both models."""
    power, threshold = (
        [f"{model}_{key}" for model in MODELS] for key in ("power", "threshold")
    )
    return dict(zip(power, powers, strict=True)) | dict(
        zip(threshold, thresholds, strict=True)
    )


@pytest.mark.parametrize(
    ("recordings", "changes", "more", "expected"),
    [
        ("synthetic", {}, {}, d.REPRODUCED),
        ("synthetic", FAILING, {}, d.NOT_REPRODUCED),
        ("synthetic", {"about": "robots"}, {}, d.SYNTHETIC_PASSES),
        ("synthetic", {"about": "robots"} | FAILING, {}, d.SYNTHETIC_FAILS),
        ("real", {"about": "robots"}, {}, d.REPRODUCED),
        ("paper", {"about": "robots"}, {}, d.REPRODUCED),
        ("synthetic", {"about": "specimen"}, {}, d.SYNTHETIC_PASSES),
        ("real", {"about": "specimen"}, {}, d.NO_EVIDENCE),
        ("paper", {"about": "specimen"}, {}, d.REPRODUCED),
        # what the construction forces has no verdict
        ("synthetic", FORCED, {}, d.FORCED),
        ("paper", FORCED | FAILING, {}, d.FORCED),
        ("real", FORCED, {"wishart_error": None}, d.NO_EVIDENCE),
        # a missing number, and a gap in an order
        ("real", {}, {"wishart_error": None}, d.NO_EVIDENCE),
        ("real", {"rule": "decreasing", "limit": None}, {}, d.NOT_REPRODUCED),
        (
            "real",
            {"rule": "decreasing", "limit": None},
            {"additive_error": 1.0},
            d.REPRODUCED,
        ),
        (
            "real",
            {"rule": "decreasing", "limit": None},
            {"additive_error": None},
            d.NO_EVIDENCE,
        ),
        # published values go by case
        ("real", PUBLISHED | {"published": [0.01, 0.0151]}, {}, d.REPRODUCED),
        ("real", PUBLISHED | {"published": [0.0151, 0.01]}, {}, d.NOT_REPRODUCED),
        # recordings that differ mostly from each other
        ("real", UNLESS, {"share": 0.4}, d.REPRODUCED),
        ("real", UNLESS, {"share": 0.51}, d.NO_EVIDENCE),
        ("real", UNLESS, {}, d.NO_EVIDENCE),
        # a test without power; one case refutes a claim on all
        ("real", POWER_OF, powers((0.9, 0.9), (0.005, 0.01)), d.REPRODUCED),
        ("real", POWER_OF, powers((0.9, 0.1), (0.005, 0.01)), d.NO_EVIDENCE),
        ("real", POWER_OF, powers((0.9, 0.1), (0.02, 0.01)), d.NOT_REPRODUCED),
        ("real", POWER_OF, powers((0.1, 0.1), (0.02, 0.02)), d.NO_EVIDENCE),
        # an order whose interval covers zero, or that has none
        ("real", BETWEEN | {"rule": "less"}, BELOW_ZERO, d.REPRODUCED),
        ("real", BETWEEN | {"rule": "less"}, AROUND_ZERO, d.NO_EVIDENCE),
        ("real", BETWEEN | {"rule": "less"}, WITHOUT_ENDS, d.NO_EVIDENCE),
        ("real", BETWEEN | {"rule": "greater"}, BELOW_ZERO, d.NOT_REPRODUCED),
    ],
)
def test_a_verdict_follows_from_rule_numbers_and_recordings(
    recordings, changes, more, expected
):
    result = verdict(recordings, more=more, **changes)
    assert result.verdict == expected
    # then no case holds or fails either
    if (
        {"unless", "rule"} & {*changes}
        and expected == d.NO_EVIDENCE
        and "power" not in changes
    ):
        assert {case.holds for case in result.cases} == {None}


def test_standard_errors_add_in_squares():
    value, *errors = (metric(key) for key in ("e", "se", "ee"))
    changes = {"each": {}, "value": value, "standard_error": errors, "published": 6.0}
    changes |= {"more": {"e": 5.0, "se": 0.3, "ee": 0.4}, "rule": "standard_errors"}
    (case,) = verdict(**changes, limit=2.5).cases
    known = (
        case.distance,
        case.low,
        case.high,
        case.holds,
    )  # the interval is the rule's own
    assert known == pytest.approx((2.0, 3.75, 6.25, True), abs=1e-4)
    assert verdict(**changes, limit=1.5).verdict == d.NOT_REPRODUCED
    # each of them is a number that the claim refers to
    claim = parse_claims([CLAIM | {k: v for k, v in changes.items() if k != "more"}])[0]
    assert {reference.model for reference in claim.references} == {"e", "se", "ee"}


@pytest.mark.parametrize("joints", [("slide",), tuple("abcdefg")])
def test_every_joint_of_an_arm_of_any_size_is_a_case_by_its_own_name(joints):
    numbers = {f"{name}_error": 0.01 for name in joints[:-1]} | {
        f"{joints[-1]}_error": 0.03
    }
    result = verdict("real", ArmNames(joints, ("x",)), EVERY, numbers)
    assert [case.case for case in result.cases] == list(joints)
    assert [case.holds for case in result.cases] == [True] * (len(joints) - 1) + [False]
    assert result.verdict == d.NOT_REPRODUCED
    assert verdict("real", ArmNames((), ()), EVERY)[1:] == (d.NO_EVIDENCE, ())


def test_a_joint_that_the_command_moves_by_less_than_a_hundredth_of_the_greatest_range_is_no_case():
    ranges = zip(JOINTS, (1.0, 0.02, 0.005), strict=True)
    rows = [
        evidence_row("commanded_range", value, joint=joint) for joint, value in ranges
    ]
    assert d.moving_joints(evidence_table(rows), JOINTS) == JOINTS[:2]
    assert d.moving_joints(evidence_table([]), JOINTS) == JOINTS


def test_a_claim_that_singles_out_a_joint_has_evidence_on_the_papers_kind_of_arm_alone():
    changes = {
        "each": {"joint": ["{joint 1}", "{joint 2}"]},
        "value": metric("{joint}_error"),
    }
    changes |= {"numbers": {f"{name}_error": 0.01 for name in JOINTS}}
    here = verdict("real", **changes)
    assert [case.case for case in here.cases] == [
        *JOINTS[:2]
    ] and here.verdict == d.REPRODUCED
    # the same names and numbers, in space
    there = verdict("real", ARM._replace(task=("x", "y", "z")), **changes)
    assert there.verdict == d.NO_EVIDENCE and {case.value for case in there.cases} == {
        None
    }


def test_runs_are_decided_by_whose_recordings_they_are_and_claims_without_recording_once():
    study = CLAIM | {"id": "study", "each": {}, "recording": "none", "rule": "above"}
    study |= {"value": metric("mean")}
    numbers = {"shoulder_error": 0.01, "hip_error": 0.02, "mean": 1.0}
    tables = {"evidence": evidence_of(numbers)}
    known = (
        ("youbot", True, "shoulder"),
        ("ur5", False, "hip"),
        ("lab", False, "shoulder"),
    )
    runs = [
        Run(name, "paper", own, [joint], ["x"], {}, {}, tables)
        for name, own, joint in known
    ]
    decided = d.decide_each(parse_claims([EVERY, study]), runs, ["lab"])
    assert [whose.recordings for whose in decided] == [
        "synthetic",
        "real",
        "paper",
        "none",
    ]
    assert [whose.verdicts[0].cases[0].value for whose in decided[:3]] == [
        0.01,
        0.02,
        0.01,
    ]
    assert [w.verdicts[0].verdict for w in decided[:2]] == [
        d.REPRODUCED,
        d.NOT_REPRODUCED,
    ]
    assert [w.verdicts[1].verdict for w in decided[1::2]] == [
        d.NO_RECORDING,
        d.REPRODUCED,
    ]
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
        **changes | forced | {"threshold": None}, numbers={"wishart": 1, "than": 3}
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


@pytest.mark.parametrize(
    ("correlations", "powers", "expected"),
    [
        ((0.6, 0.6, 0.6), (0.9, 0.9, 0.9), d.WITH_SPEED_LAW),
        # no case tells the model from the law of the speed
        ((0.6, 0.6, 0.6), (0.9, 0.9, 0.1), d.WITH_SPEED_LAW),
        # the law of the speed fails in a case, or is not decided at all
        ((0.6, 0.6, 0.2), (0.9, 0.9, 0.9), d.REPRODUCED),
        ((0.6, 0.6, 0.6), (0.1, 0.1, 0.1), d.REPRODUCED),
    ],
)
def test_a_claim_that_holds_for_the_speed_law_too_has_a_verdict_of_its_own(
    correlations, powers, expected
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
    assert result.verdict == expected
    assert [case.speed_law for case in result.cases] == [*correlations]
