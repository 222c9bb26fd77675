"""Paired differences over resampled takes: their intervals cover, and pairing is what makes them
narrow.
"""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.statistics.resampling import (
    bound_quantities,
    resampled_differences,
    spread_quantities,
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


def test_a_spread_that_follows_the_recorded_one_is_told_and_one_that_does_not_exist_has_no_rows():
    rng = np.random.default_rng(2)
    width = np.linspace(0.5, 2.0, STEPS)[:, None] * np.ones(3)
    noise = width * rng.normal(size=(TAKES, STEPS, 3))
    std = {
        "constant": np.full((STEPS, 3), 1.3),
        "following": width,
        "none": np.full((STEPS, 3), np.nan),
    }
    rows = resampled_differences(spread_quantities(std, noise, JOINTS), list(std), TAKES, rng)
    assert "none" not in set(rows["model"])
    rows = rows.set_index(["model", "quantity"])
    assert (
        rows.loc[("following", "relative_error_shoulder"), "high"]
        < 0
        < rows.loc[("following", "correlation_with_recorded_wrist"), "low"]
    )


def test_a_single_take_has_no_interval():
    rows = resampled_differences(
        means({"a": np.ones(1), "b": np.zeros(1)}), ["a", "b"], 1, np.random.default_rng(3)
    )
    assert rows["low"].isna().all() and rows["difference"].iloc[1] == -1


def test_of_few_takes_a_resampling_of_one_alone_is_left_out():
    rng = np.random.default_rng(4)
    noise = rng.normal(size=(2, STEPS, 3))
    std = {"a": np.ones((STEPS, 3)), "b": 0.5 * np.ones((STEPS, 3))}
    rows = resampled_differences(spread_quantities(std, noise, JOINTS), list(std), 2, rng)
    assert np.isfinite(rows.loc[rows["model"] == "b", ["low", "high"]]).all(axis=None)
