"""Every reading of "LU or QR" once, the run's own first; a claim that lacks evidence under one does
not hold there.
"""

from __future__ import annotations

import pytest

from pipeline.cases.readings import readings, readings_table
from pipeline.verdicts.claims import parse_claims
from pipeline.verdicts.reference import ArmNames

ALL = ["pivoted LU", "QR of J", "QR of Jᵀ (control)"]


def test_the_runs_own_reading_is_first_and_every_other_comes_once(base):
    assert list(readings(base)) == ALL
    assert readings(base)[ALL[0]] == base
    for case in readings(base.with_wishart(ratio_factor=3.0)).values():  # that alone changes
        assert case.models["wishart"].ratio_factor == 3.0
        assert case.models["gaussian"] == base.models["gaussian"]
    redundant = readings(base, ["x", "z"])
    assert list(redundant) == [ALL[1], ALL[0], ALL[2]] and redundant[ALL[1]] == base
    constant = base.with_wishart(decomposition="given", left=[[1.0, 0, 0], [0, 1, 0], [0, 0, 1]])
    assert list(readings(constant)) == ["given", *ALL]


def test_without_a_wishart_model_there_is_no_reading(base):
    base.models.pop("wishart")
    assert readings(base) == {}


@pytest.fixture
def claims():
    """Both matrix models are to be below 1 in a quantity, which the last claim's nobody has."""

    def claim(name: str, stem: str) -> dict:
        return {
            "id": name,
            "where": "Sec. 1",
            "statement": "Both are small.",
            "about": "method",
            "quantity": "size",
            "each": {"model": ["wishart", "gaussian"]},
            "value": {"file": "metrics/motion", "key": "{model}_" + stem},
            "rule": "below",
            "limit": 1.0,
            "reason": "so that it can fail",
        }

    return parse_claims([claim("small", "size"), claim("unheard", "colour")])


def ruled(claims, **values: float) -> tuple[str, str, str]:
    """Verdict on ``small``, its values and the refusal, where the run's own reading has 0.5 of
    both models and another has ``values``.
    """
    own = {"metrics/motion": {"wishart_size": 0.5, "gaussian_size": 0.5}}
    other = {"metrics/motion": {f"{model}_size": value for model, value in values.items()}}
    table = readings_table(
        claims, {"own": (own, []), "other": (other, ["no noise"])}, ArmNames(("a",), ("x",))
    )
    assert list(table["claim"]) == ["small", "small"]  # of the other there is nothing
    assert tuple(table.loc[0, ["holds", "refused"]]) == ("holds", "")
    return tuple(table.iloc[1][["holds", "value", "refused"]])


def test_a_claim_holds_where_its_rule_does_in_every_case(claims):
    assert ruled(claims, wishart=0.4, gaussian=0.2) == ("holds", "wishart: 0.4; gaussian: 0.2", "")
    assert ruled(claims, wishart=1.4, gaussian=0.2)[0] == "fails"


def test_a_claim_that_lacks_a_case_holds_nowhere_and_says_why(claims):
    assert ruled(claims, gaussian=0.2) == ("no evidence", "gaussian: 0.2", "no noise")
    assert ruled(claims) == ("no evidence", "", "no noise")
    # one that fails in what there is fails
    assert ruled(claims, gaussian=1.2) == ("fails", "gaussian: 1.2 ✗", "")
