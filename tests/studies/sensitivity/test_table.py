"""The table of verdicts says what changed against the base case, and nothing else."""

from __future__ import annotations

import numpy as np

from pipeline.cases.verdict import decided
from pipeline.studies.sensitivity.table import sensitivity_table
from pipeline.verdicts.claims import parse_claims
from pipeline.verdicts.reference import ArmNames

COMMON = {
    "where": "Sec. 4",
    "statement": "Less.",
    "about": "method",
    "quantity": "x",
    "rule": "below",
    "reason": "so",
    "stage": "score",
}
CLAIMS = parse_claims(
    [
        COMMON
        | {
            "id": "small",
            "each": {"joint": "every"},
            "value": {"file": "metrics/a", "key": "{joint}"},
            "limit": 1.0,
        },
        COMMON | {"id": "elsewhere", "value": {"file": "metrics/wrench", "key": "x"}, "limit": 1.0},
    ]
)


def table(**variations: dict[str, float]):
    rows = {
        (name, "v"): decided(CLAIMS, {"metrics/a": values}, ArmNames(("q1", "q2"), ("x", "z")))
        for name, values in variations.items()
    }
    return sensitivity_table(rows)


def test_a_case_that_comes_out_otherwise_is_marked_and_only_that():
    rows = table(
        base={"q1": 0.5, "q2": 0.6}, same={"q1": 0.9, "q2": 0.1}, other={"q1": 0.5, "q2": 1.5}
    )
    assert rows.loc[rows["changed"], ["setting", "case", "holds"]].to_numpy().tolist() == [
        ["other", "q2", "fails"]
    ]
    assert rows.groupby("setting")["verdict"].first().to_dict() == {
        "base": "holds",
        "same": "holds",
        "other": "fails",
    }


def test_a_verdict_is_by_the_cases_on_which_there_is_evidence():
    rows = table(base={"q1": 0.5, "q2": 0.6}, gap={"q1": 0.5}, none={}, gap_and_failure={"q1": 2.0})
    words = rows.groupby("setting")["verdict"].first().to_dict()
    assert words == {
        "base": "holds",
        "gap": "holds",
        "none": "no evidence",
        "gap_and_failure": "fails",
    }
    assert rows.query("setting == 'gap'")["changed"].tolist() == [False, True]
    assert np.isnan(rows.query("setting == 'gap'")["value"].iloc[1])


def test_a_claim_on_which_no_variation_says_anything_is_left_out():
    assert set(table(base={"q1": 0.5, "q2": 0.6})["claim"]) == {"small"}
