"""Verdicts and numbers in words: what stands beside what, and what fails is marked."""

from __future__ import annotations

from pipeline.verdicts.claims import parse_claims
from pipeline.verdicts.decision import Decided, decide
from pipeline.verdicts.reference import ArmNames
from pipeline.verdicts.wording import (
    case_text,
    number,
    side_by_side,
)

TEXTS = {key: f"the {key}" for key in ("where", "statement", "quantity", "reason")} | {
    "stage": "score"
}
SPREAD = TEXTS | {
    "id": "spread",
    "about": "method",
    "rule": "less",
    "each": {"joint": "every"},
    "unit": "rad",
    "value": {"file": "m", "key": "{joint}"},
    "than": {"file": "m", "key": "b"},
}
SIGMA = TEXTS | {
    "id": "sigma",
    "about": "method",
    "rule": "standard_errors",
    "limit": 2.5,
    "published": 7.0,
    "value": {"file": "m", "key": "e"},
    "standard_error": {"file": "m", "key": "se"},
}
ROBOT = TEXTS | {
    "id": "robot",
    "about": "robots",
    "rule": "above",
    "limit": 0.5,
    "value": {"file": "m", "key": "lost"},
}
CLAIMS = parse_claims([SPREAD, SIGMA, ROBOT])
EVIDENCE = {"m": {"a1": 0.12345, "a2": 0.6789, "b": 0.5, "e": 6.0, "se": 0.25}}
ARM = ArmNames(("a1", "a2"), ("x", "z"))


def decided(recordings: str, dataset: str, evidence: dict) -> Decided:
    return Decided(dataset, recordings, decide(CLAIMS, evidence, recordings, ARM))


YOUBOT = decided("synthetic", "youbot", EVIDENCE)
UR5 = decided("real", "ur5", {"m": {"a1": 0.25, "a2": 0.3, "b": 0.5, "lost": 0.75}})


def test_values_comparisons_intervals_and_failures_are_shown():
    spread, sigma, robot = YOUBOT.verdicts
    assert [case_text(case) for case in spread.cases] == [
        "a1: 0.1235 against 0.5",
        "a2: 0.6789 against 0.5 ✗",
    ]
    assert [case_text(case) for case in sigma.cases] == ["6 [5.51, 6.49] ✗"]
    assert [case_text(case) for case in robot.cases] == ["–"]


def test_datasets_stand_side_by_side_by_what_a_claim_is_about():
    ((claim, verdicts),) = side_by_side([YOUBOT, UR5], "robots")
    assert claim.id == "robot"
    assert [verdict.verdict for verdict in verdicts] == [
        "no evidence in this dataset",
        "reproduced",
    ]
    assert side_by_side([YOUBOT, UR5], "specimen") == []


def test_numbers_have_four_digits_and_counts_all_of_theirs():
    assert [number(x) for x in (0.287649, 2.5e-5, 32000.0, 0.0, float("nan"))] == [
        "0.2876",
        "2.5e-05",
        "32,000",
        "0",
        "–",
    ]
