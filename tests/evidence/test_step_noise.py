"""Noise of a step in logs: known covariances come out, whatever the rate of the rows."""

import numpy as np
import pytest

from pipeline.evidence.step_noise import step_noise
from pipeline.models.joint_error.samples import JointRun


@pytest.mark.parametrize("rate", [100.0, 500.0])
def test_the_noise_of_a_step_has_the_covariance_of_the_drawn_errors(rate):
    rng, count = np.random.default_rng(3), 20_000
    drawn = rng.multivariate_normal([0, 0], [[4e-6, 1e-6], [1e-6, 1e-6]], count)
    every = round(0.01 * rate)
    errors = np.repeat(np.cumsum(drawn, axis=0), every, axis=0)
    speed = np.where(np.arange(len(errors)) < len(errors) // 2, 0.1, 0.4) / rate
    command = np.cumsum(np.stack([speed, speed, 0 * speed], axis=1), axis=0)
    rested = np.column_stack([errors, rng.normal(0, 1e-3, len(errors))])
    run = JointRun(
        "run", rate, command, command + rested, ("a", "b", "rests"),
        np.zeros(3), np.zeros(3), 1e-6, "1",
    )  # fmt: skip
    rows = step_noise([run]).set_index(["joint", "other", "steps"])

    assert "rests" not in rows.index.get_level_values("joint")

    covariance = rows["covariance"]
    for pair, expected in ((("a", "a"), 4e-6), (("a", "b"), 1e-6), (("b", "b"), 1e-6)):
        assert covariance[(*pair, "all")] == pytest.approx(expected, rel=0.06)

    # white noise knows of no earlier step, and its size is the same at any speed
    assert abs(rows.loc[("a", "a", "successive"), "correlation"]) < 0.03

    slow, fast = (covariance[("a", "a", half)] for half in ("slow", "fast"))
    assert slow == pytest.approx(fast, rel=0.1)
