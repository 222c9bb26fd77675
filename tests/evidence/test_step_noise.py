"""Noise of a step in logs: known covariances come out, whatever the rate of the rows."""

import numpy as np
import pandas as pd
import pytest
from numpy.random import default_rng

from pipeline.evidence.step_noise import step_noise
from pipeline.models.joint_error.samples import JointRun

NOISE = [[4e-6, 1e-6], [1e-6, 1e-6]]  # rad²


@pytest.fixture(params=[100.0, 500.0])
def rows(request) -> pd.DataFrame:
    """Noise of steps with the covariance NOISE each 10 ms, and of a joint that rests; the first
    half of the run is slow.
    """
    rate, rng, count = request.param, default_rng(3), 20_000
    drawn = rng.multivariate_normal([0, 0], NOISE, count)
    errors = np.repeat(np.cumsum(drawn, axis=0), round(0.01 * rate), axis=0)
    speed = np.repeat([0.1, 0.4], len(errors) // 2) / rate
    command = np.cumsum(np.stack([speed, speed, 0 * speed], axis=1), axis=0)
    measured = command + np.column_stack([errors, rng.normal(0, 1e-3, len(errors))])
    recorded = "run", rate, command, measured, ("a", "b", "rests")
    run = JointRun(*recorded, np.zeros(3), np.zeros(3), 1e-6, "1")
    return step_noise([run]).set_index(["joint", "other", "steps"])


def test_the_noise_of_a_step_has_the_covariance_of_the_drawn_errors(rows):
    covariance = rows["covariance"]

    assert "rests" not in rows.index.get_level_values("joint")
    for pair, expected in ((("a", "a"), 4e-6), (("a", "b"), 1e-6), (("b", "b"), 1e-6)):
        assert covariance[(*pair, "all")] == pytest.approx(expected, rel=0.06)
    # white noise knows of no earlier step, and its size is the same at any speed
    assert abs(rows.loc[("a", "a", "successive"), "correlation"]) < 0.03
    slow, fast = (covariance[("a", "a", half)] for half in ("slow", "fast"))
    assert slow == pytest.approx(fast, rel=0.1)
