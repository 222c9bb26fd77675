"""The numbers behind the claims on filter and sensor, under the joints' own names."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.statistics.joint_scores import (
    bound_scores,
    filter_metrics,
    filter_scores,
    sensor_scores,
    spread_scores,
)

JOINTS = ("shoulder", "elbow", "wrist")


def test_every_filter_and_joint_has_the_scores_of_its_own_errors_and_bounds():
    rng = np.random.default_rng(7)
    error = {model: rng.normal(0.0, 0.01, (6, 20, 3)) for model in ("additive", "wishart")}
    bound = {model: rng.uniform(0.005, 0.02, (6, 20, 3)) for model in error}
    metrics = filter_metrics(filter_scores(error, bound, JOINTS, np.ones(19, dtype=bool)))
    expected = bound_scores(error["wishart"][..., 1], bound["wishart"][..., 1])
    assert {name: metrics[f"wishart_elbow_{name}"] for name in expected} == expected
    assert len(metrics) == 2 * 3 * (len(expected) + 1)
    # control: another joint has others
    assert metrics["wishart_wrist_rms_error_rad"] != expected["rms_error_rad"]


def test_a_bias_that_is_nothing_is_about_one_standard_error_and_a_real_one_is_many():
    rng = np.random.default_rng(8)
    takes, frames = 50, 400
    variance = np.full((frames, 3), 0.02**2)
    chance = rng.normal(0.0, 0.02 / np.sqrt(takes), (frames, 3))
    scores = sensor_scores(chance + np.array([0.0, 0.03, 0.0]), variance, takes, JOINTS)
    assert scores["kinect_bias_shoulder_over_standard_error"] == pytest.approx(1, abs=0.1)
    assert scores["kinect_bias_elbow_over_standard_error"] == pytest.approx(
        0.03 / 0.02 * np.sqrt(takes), rel=0.05
    )
    assert scores["kinect_bias_elbow_variation_over_standard_error"] == pytest.approx(1, abs=0.1)
    assert (
        scores["kinect_std_wrist_rms_rad"] == pytest.approx(0.02)
        and scores["kinect_std_wrist_variation"] == 0
    )


def test_a_bound_that_collapses_in_every_take_varies_infinitely():
    bound = np.full((3, 5), 0.01)
    assert bound_scores(bound, bound)["bound_greatest_over_least"] == 1
    bound[:, 2] = 0.0
    assert bound_scores(np.full((3, 5), 0.01), bound)["bound_greatest_over_least"] == np.inf


def test_what_follows_the_ramps_alone_does_not_follow_at_constant_speed():
    steps = np.arange(60)
    ramp, steady = np.minimum(steps, 20.0), steps > 20
    std = {"recorded": (ramp + np.sin(steps))[:, None], "wishart": (ramp - np.sin(steps))[:, None]}
    scores = spread_scores(std, {}, ["hip"], steady)
    assert scores["wishart_std_hip_correlation_with_recorded"] > 0.9
    assert scores["wishart_std_hip_correlation_with_recorded_at_constant_speed"] < -0.9
    with_start = {name: np.vstack([[[1.0]], values])[None] for name, values in std.items()}
    error, bound = {"m": with_start["recorded"]}, {"m": with_start["wishart"]}
    (row,) = filter_scores(error, bound, ["hip"], steady).to_dict("records")
    assert row["correlation_of_bound_with_error"] > 0.9
    assert row["correlation_of_bound_with_error_at_constant_speed"] < -0.9
