"""Paired differences over resampled takes: their intervals cover, and pairing is what makes them
narrow.
"""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.statistics.resampling import (
    NO_NOISE,
    bound_quantities,
    mean_error_comparison,
    resampled_differences,
    share_between,
    spread_comparison,
)

TAKES, STEPS = 40, 100
JOINTS = ("shoulder", "elbow", "wrist")


def means(values: dict[str, np.ndarray]):
    return lambda model, takes: {"mean": float(values[model][takes].mean())}


def test_the_interval_of_a_mean_is_students_and_the_first_model_has_none():
    rng = np.random.default_rng(0)
    common = rng.normal(size=TAKES)
    values = {"a": common, "b": common + 0.3 + 0.1 * rng.normal(size=TAKES)}
    rows = resampled_differences(means(values), ["a", "b"], TAKES, rng).set_index("model")
    assert rows.loc["a", ["difference", "low", "high"]].isna().all()
    paired = values["b"] - values["a"]
    half = 2.02 * paired.std(ddof=1) / np.sqrt(TAKES)
    assert rows.loc["b", "difference"] == pytest.approx(paired.mean())
    assert rows.loc["b", "high"] - rows.loc["b", "low"] == pytest.approx(2 * half, rel=0.3)
    # control: unpaired takes would leave an interval ten times as wide
    unpaired = {"a": common, "b": np.roll(values["b"], 7)}
    wide = (
        resampled_differences(means(unpaired), ["a", "b"], TAKES, rng).set_index("model").loc["b"]
    )
    assert wide["high"] - wide["low"] > 5 * half


def test_the_interval_covers_the_true_difference_about_as_often_as_it_says():
    covered = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        values = {"a": rng.normal(size=TAKES), "b": rng.normal(0.2, 1.0, TAKES)}
        row = (
            resampled_differences(means(values), ["a", "b"], TAKES, rng).set_index("model").loc["b"]
        )
        covered.append(row["low"] <= 0.2 <= row["high"])
    assert 0.83 < np.mean(covered) <= 1


def test_a_bound_that_follows_the_error_is_told_from_one_that_does_not():
    rng = np.random.default_rng(1)
    width = np.linspace(0.5, 2.0, STEPS)[:, None] * np.ones(3)
    error = {
        model: width * rng.normal(size=(TAKES, STEPS, 3)) for model in ("constant", "following")
    }
    bound = {
        "constant": np.full((TAKES, STEPS, 3), 1.3) + 0.01 * rng.random((TAKES, STEPS, 3)),
        "following": np.tile(width, (TAKES, 1, 1)),
    }
    rows = resampled_differences(
        bound_quantities(error, bound, JOINTS), list(error), TAKES, rng
    ).set_index(["model", "quantity"])
    assert rows.loc[("following", "correlation_of_bound_with_error_elbow"), "low"] > 0.5
    assert rows.loc[("following", "relative_error_of_bound_elbow"), "high"] < 0


def noise_of(std: np.ndarray, takes: int, seed: int) -> np.ndarray:
    """(takes, STEPS, 3) normal noise with the standard deviations ``std`` (STEPS, 3)."""
    return std * np.random.default_rng(seed).normal(size=(takes, STEPS, 3))


RAMP = np.linspace(0.2, 2.0, STEPS)[:, None] * np.array([1.0, 1.0, 0.5])
FLAT = np.sqrt(np.mean(RAMP**2, axis=0)) * np.ones((STEPS, 3))
MEASUREMENT = np.full(3, 0.01)


@pytest.mark.parametrize("level", [0.1, 1.0, 10.0])
def test_errors_are_compared_at_one_level_and_the_true_model_has_the_least(level):
    noise = noise_of(np.sqrt(RAMP**2 + MEASUREMENT), TAKES, 2)
    motion = {"flat": level * FLAT**2, "ramp": RAMP**2, "even": np.mean(RAMP**2, 1)[:, None]}
    motion["even"] = level * motion["even"] * np.ones(3)
    table = spread_comparison(motion, MEASUREMENT, noise, JOINTS)
    rows = table.set_index(["model", "rival", "joint", "rival_joint"])
    ramp = rows.loc[("ramp", "flat", "elbow", "elbow")]
    assert ramp["high"] < 0 and ramp["error"] < 0.2 < ramp["rival_error"]
    assert rows.loc[("ramp", NO_NOISE, "elbow", "elbow"), "rival_error"] == 1
    # a model with one variance for all joints has the greater error in the joint with the least
    assert rows.loc[("even", "even", "elbow", "wrist"), "high"] < 0
    # the first model has no difference to itself, nor the last joint
    assert ("flat", "flat", "elbow", "elbow") not in rows.index
    assert ("ramp", "ramp", "wrist", "wrist") not in rows.index


def test_two_equal_models_and_noise_without_a_course_leave_intervals_that_cover_zero():
    noise = noise_of(FLAT, 4, 5)
    motion = {"flat": FLAT**2, "same": 2 * FLAT**2}
    table = spread_comparison(motion, 0 * MEASUREMENT, noise, JOINTS)
    same = table[(table["model"] == "same") & (table["rival"] == "flat")]
    assert np.allclose(same[["difference", "low", "high"]], 0)


def test_the_error_of_a_biased_mean_varies_more_and_an_order_by_chance_is_not_decided():
    noise, course = noise_of(FLAT, TAKES, 7), np.sin(np.linspace(0, 3, STEPS))[:, None]
    error = {"plain": noise, "again": noise_of(FLAT, TAKES, 8), "biased": noise + course}
    rows = mean_error_comparison(error).set_index(["model", "rival"])
    assert rows.loc[("plain", "biased"), "high"] < 0 < rows.loc[("biased", "plain"), "low"]
    chance = rows.loc[("plain", "again")]
    assert chance["low"] < 0 < chance["high"]


@pytest.mark.parametrize(
    ("groups", "offset", "least", "greatest"),
    [
        ("aabb", 0.0, 0.25, 0.42),  # (groups − 1)/(takes − 1) = 1/3
        ("aabb", 5.0, 0.9, 1.0),
        ("aaaa", 5.0, 0.0, 0.0),
        ("abcd", 5.0, 0.0, 0.0),
    ],
)
def test_what_lies_between_recordings_is_their_share_of_the_variance(
    groups, offset, least, greatest
):
    noise = noise_of(FLAT, 4, 10)
    noise[2:] += offset
    assert least <= share_between(noise, groups) <= greatest


def test_a_single_take_has_no_interval():
    rows = resampled_differences(
        means({"a": np.ones(1), "b": np.zeros(1)}), ["a", "b"], 1, np.random.default_rng(3)
    )
    assert rows["low"].isna().all() and rows["difference"].iloc[1] == -1


def test_two_takes_have_no_interval_and_three_have_one():
    motion = {"a": FLAT**2, "b": RAMP**2}
    for takes, finite in ((2, False), (3, True)):
        rows = spread_comparison(motion, MEASUREMENT, noise_of(FLAT, takes, 4), JOINTS)
        assert np.isfinite(rows[["low", "high"]]).all(axis=None) == finite
        assert np.isfinite(rows["difference"]).all()


def test_the_interval_of_a_difference_covers_its_mean_about_as_often_as_it_says():
    """Between two models of other courses over time, for as few as four takes."""
    motion, inside, found = {"flat": FLAT**2, "ramp": RAMP**2}, [], []
    for seed in range(80):
        table = spread_comparison(motion, MEASUREMENT, noise_of(FLAT, 4, seed), JOINTS)
        found.append(
            table.query("model == 'ramp' and rival == 'flat' and joint == 'elbow'").iloc[0]
        )
    middle = np.mean([row["difference"] for row in found])
    inside = [row["low"] <= middle <= row["high"] for row in found]
    assert 0.85 < np.mean(inside)
