"""Scores of posteriors and predictions by take, for any number of joints."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.statistics.take_scores import compared, posterior_scores, prediction_scores

JOINTS = ("hip", "knee")
TAKES, STEPS = 30, 200


def normal_errors(std: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return std * rng.normal(size=(TAKES, STEPS, len(std)))


def test_an_honest_posterior_covers_as_it_says_in_every_joint_and_a_narrow_one_does_not():
    std = np.array([0.01, 0.03])
    error = normal_errors(std, np.random.default_rng(1))
    laws = {
        name: posterior_scores(
            error, np.tile(np.diag((share * std) ** 2), (TAKES, STEPS, 1, 1)), JOINTS
        )
        for name, share in {"honest": 1.0, "narrow": 0.5}.items()
    }
    assert {refused for _, refused in laws.values()} == {None}
    honest, narrow = (scores for scores, _ in laws.values())
    for joint, rms in zip(JOINTS, std, strict=True):
        assert honest[f"rms_error_{joint}_rad"].mean() == pytest.approx(rms, rel=0.02)
        assert honest[f"coverage_of_one_sigma_{joint}"].mean() == pytest.approx(0.683, abs=0.02)
        assert narrow[f"coverage_of_one_sigma_{joint}"].mean() < 0.42
    assert honest["nees"].mean() == pytest.approx(len(JOINTS), rel=0.05)
    table = compared({"honest": honest, "narrow": narrow}, "honest").set_index(["model", "score"])
    assert table.loc[("narrow", "log_score"), "high"] < 0


def test_predictions_are_scored_by_the_names_of_their_joints():
    rng = np.random.default_rng(2)
    z = normal_errors(np.ones(2), rng)
    flat = np.zeros((TAKES, STEPS))
    steps = {"log_density": flat, "energy": flat, "nees": (z**2).sum(axis=-1), "z": z}
    scores = prediction_scores(steps | {"log_determinant": flat}, JOINTS, moving=False)
    assert [name for name in scores if name.startswith("coverage_of_one_sigma_")] == [
        "coverage_of_one_sigma_hip",
        "coverage_of_one_sigma_knee",
    ]
    # with the band of two joints; that of three would hold none
    assert scores["share_of_steps_with_nees_in_its_95_percent_band"] > 0.85
