"""Every rule passes a true model and refutes a false one, with draws of takes and the intervals of
the pipeline; without power it decides nothing, and many true cases of few takes are not refuted.
"""

import numpy as np
import pandas as pd
import pytest

from pipeline.statistics.curves import (
    ModelledNoise,
    constant_noise_variation,
    following_tests,
    variation,
)
from pipeline.statistics.takes import paired_difference, percentile_interval
from pipeline.verdicts.rules import LEVEL, RULES, Rule, decide_cases, holm, standard_errors

COLUMNS = "value than difference low high standard_error threshold power control".split()
COLUMNS += "published tolerance limit margin yardstick distance".split()
REPEATS, STEPS, JOINTS = 60, 80, ("elbow", "wrist")


def table(*cases: dict) -> pd.DataFrame:
    """Table of a rule with a row for each case; what a case lacks is NaN."""
    return pd.DataFrame([{**dict.fromkeys(COLUMNS, np.nan), **case} for case in cases])


def decided(rule: str, *cases: dict) -> list[bool | None]:
    rows = table(*cases)
    return decide_cases(RULES[rule], rows, pd.Series(True, rows.index))


def mean_of(values: np.ndarray) -> dict:
    """Mean of takes with its interval."""
    value, low, high, error = paired_difference(values, np.zeros(len(values)))
    return {"value": value, "low": low, "high": high, "standard_error": error}


def difference_of(values: np.ndarray, **others: float) -> dict:
    of_mean = mean_of(values)
    return of_mean | {"difference": of_mean["value"], **others}


def noise(rng: np.random.Generator, wave: float, takes: int = 40) -> np.ndarray:
    """(takes, STEPS, 2) noise whose standard deviation varies by ``wave`` over time."""
    return curve(wave) * rng.standard_normal((takes, STEPS, 2))


def curve(wave: float) -> np.ndarray:
    return (1 + wave * np.sin(np.linspace(0, 4 * np.pi, STEPS)))[:, None] * np.ones(2)


def varied(rng: np.random.Generator, wave: float) -> list[dict]:
    taken = noise(rng, wave)
    limits = constant_noise_variation(taken, rng)
    found = [variation(own) for own in taken.std(axis=0, ddof=1).T]
    return [{"value": x, "threshold": y, "limit": 0.25} for x, y in zip(found, limits, strict=True)]


def followed(rng: np.random.Generator, wave: float) -> list[dict]:
    model = ModelledNoise(curve(0.6) ** 2, np.zeros(2), np.zeros((1, STEPS, 2)))
    steady = np.zeros(STEPS, dtype=bool)
    rows = following_tests(model, noise(rng, wave), steady, JOINTS, rng)
    named = {"correlation": "value", "limit": "threshold"}
    return rows.rename(columns=named)[["value", "threshold", "power"]].to_dict("records")


def means(rng: np.random.Generator, *centres: float) -> list[dict]:
    return [{"value": rng.normal(centre, 0.1, 2000).mean()} for centre in centres]


def greatest(rng: np.random.Generator, centre: float) -> dict:
    maxima = centre + rng.gumbel(0, 0.01, 20)
    low, high = percentile_interval(maxima)
    return {"value": maxima[0], "low": low, "high": high, "published": 0.25, "tolerance": 0.005}


# rule → cases of a true and of a false claim, from draws
DRAWN = {
    "within_relative": (
        lambda rng: [mean_of(rng.normal(1, 0.2, 20)) | {"published": 1.0, "tolerance": 0.2}],
        lambda rng: [mean_of(rng.normal(1, 0.2, 20)) | {"published": 0.5, "tolerance": 0.2}],
    ),
    "within_absolute": (
        lambda rng: [mean_of(rng.normal(-1, 0.2, 20)) | {"published": -1.0, "tolerance": 0.2}],
        lambda rng: [mean_of(rng.normal(-1, 0.2, 20)) | {"published": 0.0, "tolerance": 0.2}],
    ),
    "below": (
        lambda rng: [mean_of(rng.normal(0.8, 0.2, 20)) | {"yardstick": 1.0}],
        lambda rng: [mean_of(rng.normal(1.2, 0.2, 20)) | {"yardstick": 1.0}],
    ),
    "above": (
        lambda rng: [mean_of(rng.normal(1.2, 0.2, 20)) | {"yardstick": 1.0}],
        lambda rng: [mean_of(rng.normal(0.8, 0.2, 20)) | {"yardstick": 1.0}],
    ),
    "varies": (lambda rng: varied(rng, 0.6), lambda rng: varied(rng, 0.0)),
    "follows": (lambda rng: followed(rng, 0.6), lambda rng: followed(rng, 0.0)),
    "less": (
        lambda rng: [difference_of(rng.normal(-0.5, 0.5, 20), margin=0.05)],
        lambda rng: [difference_of(rng.normal(0.5, 0.5, 20), margin=0.05)],
    ),
    "greater": (
        lambda rng: [difference_of(rng.normal(0.5, 0.5, 20), margin=0.05)],
        lambda rng: [difference_of(rng.normal(-0.5, 0.5, 20), margin=0.05)],
    ),
    "decreasing": (lambda rng: means(rng, 3, 2, 1), lambda rng: means(rng, 1, 2, 3)),
    "equivalent": (
        lambda rng: [difference_of(rng.normal(0, 0.1, 20), than=1.0, tolerance=0.2)],
        lambda rng: [difference_of(rng.normal(0.4, 0.1, 20), than=1.0, tolerance=0.2)],
    ),
    "interval_contains": (lambda rng: [greatest(rng, 0.25)], lambda rng: [greatest(rng, 0.35)]),
    "standard_errors": (
        lambda rng: [{"value": 1.0, "distance": rng.normal(0, 1), "limit": 2.638}],
        lambda rng: [{"value": 1.0, "distance": rng.normal(6, 1), "limit": 2.638}],
    ),
}


@pytest.mark.parametrize("rule", RULES)
def test_a_rule_passes_a_true_model_and_refutes_a_false_one(rule):
    rng, right, wrong = np.random.default_rng(7), [], []
    for _ in range(12 if rule == "follows" else REPEATS):
        true, false = (cases(rng) for cases in DRAWN[rule])
        right.append(decided(rule, *true))
        wrong.append(decided(rule, *false))
    assert np.mean([all(cases) for cases in right]) > 0.75
    assert np.mean([False in cases for cases in right]) <= LEVEL + 0.05
    assert np.mean([False in cases for cases in wrong]) > 0.75
    assert np.mean([all(cases) for cases in wrong]) <= LEVEL + 0.05


def test_a_difference_below_the_margin_and_a_wide_interval_decide_nothing():
    sharp = {"low": -1.01e-8, "high": -0.99e-8, "value": 0.0, "difference": -1e-8}
    assert decided("less", sharp) == [True] and decided("greater", sharp) == [False]
    assert decided("less", sharp | {"margin": 1e-6}) == [None]
    wide = {"low": -0.5, "high": 0.6, "difference": 0.05, "value": 0.05, "than": 1.0}
    assert decided("equivalent", wide | {"tolerance": 0.2}) == [None]
    # a greatest value whose interval, which is skew, straddles the limit
    assert decided("below", {"value": 0.21, "low": 0.20, "high": 0.26, "yardstick": 0.25}) == [None]
    assert decided("below", {"value": 0.21, "low": 0.20, "high": 0.23, "yardstick": 0.25}) == [True]


def test_a_limit_that_a_control_without_the_effect_passes_has_no_power():
    case = {"value": 0.0009, "yardstick": 0.02}
    assert decided("below", case) == [True]
    assert decided("below", case | {"control": 0.0008}) == [None]
    assert decided("below", case | {"control": 0.03}) == [True]
    assert decided("below", {"value": 0.03, "control": 0.001, "yardstick": 0.02}) == [None]


def test_no_rule_decides_without_its_numbers():
    for name in RULES:
        rows = table({})
        assert decide_cases(RULES[name], rows, pd.Series(False, rows.index)) == [None]


def test_one_of_many_true_cases_of_few_takes_is_not_refuted_by_chance():
    rng, corrected, single = np.random.default_rng(3), [], []
    for _ in range(400):  # 12 cases of 4 takes, in which the claim is just true
        cases = [difference_of(rng.normal(0.0, 1.0, 4)) for _ in range(12)]
        corrected.append(False in decided("less", *cases))
        single.append(any(False in decided("less", case) for case in cases))
    assert np.mean(corrected) <= LEVEL + 4 * np.sqrt(LEVEL * (1 - LEVEL) / 400)
    assert np.mean(single) > 0.2  # control: uncorrected


def test_holm_rejects_in_order_and_stops_at_the_first_that_passes():
    assert list(holm(np.array([0.041, 0.013, 0.022, *[0.9] * 9]))) == [False] * 12
    assert list(holm(np.array([0.02, 0.001, 0.015]))) == [False, True, False]
    assert list(holm(np.array([0.01, 0.001, 0.01]))) == [True, True, True]


@pytest.mark.parametrize("takes", [4, 20, 1000])
def test_the_degrees_of_freedom_follow_from_interval_and_error(takes):
    case = mean_of(np.random.default_rng(takes).normal(0, 1, takes))
    error, degrees = standard_errors(table(case))
    assert error[0] == pytest.approx(case["standard_error"])
    assert degrees[0] == takes - 1 or (takes == 1000 and degrees[0] >= 150)


def test_every_rule_is_explained():
    assert all(isinstance(rule, Rule) and rule.words for rule in RULES.values())
    assert {*DRAWN} == {*RULES}
