"""The commanded steps: velocity over the rate, one a step, in the order of the task's rows, and of
a redundant arm the joints' own.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from pipeline.core.columns import spread
from pipeline.recordings.commands import commanded_steps, constant_speed

RATE = 50.0
TASK = ("x", "rz")


@pytest.fixture
def trajectory() -> pd.DataFrame:
    """A motion that grows by what the velocity says."""
    k = np.arange(6)
    speed = np.random.default_rng(2).normal(size=(6, 2))
    x = np.concatenate([np.zeros((1, 2)), np.cumsum(speed[:-1] / RATE, axis=0)])
    families = spread("x", TASK, x) | spread("v", TASK, speed)
    return pd.DataFrame({"k": k, "t": k / RATE} | families)


def test_a_step_leads_from_one_commanded_place_to_the_next(trajectory):
    steps = commanded_steps(trajectory, RATE)
    assert steps.shape == (5, 2)
    np.testing.assert_allclose(steps, np.diff(trajectory[["x:x", "x:rz"]], axis=0), atol=1e-15)
    # the control: without the rate they are velocities
    assert np.abs(commanded_steps(trajectory, 1.0) - steps).max() > 0.5


def test_the_commanded_joint_steps_of_a_redundant_arm_stand_behind_them(trajectory):
    speeds = np.random.default_rng(3).normal(size=(6, 3))
    redundant = trajectory.assign(**spread("u", ("a", "b", "c"), speeds))
    steps = commanded_steps(redundant, RATE)
    np.testing.assert_array_equal(steps[:, :2], commanded_steps(trajectory, RATE))
    np.testing.assert_allclose(steps[:, 2:], speeds[:-1] / RATE, atol=1e-15)


def test_the_steps_of_constant_speed_are_those_between_the_ramps_in_spite_of_noise():
    pace = np.concatenate([np.zeros(10), np.linspace(0, 1, 10), np.ones(40), np.zeros(20)])
    path = np.concatenate([[0.0], np.cumsum(0.01 * pace)])
    noise = 1e-3 * np.random.default_rng(5).standard_normal((100, len(path), 2))
    steady = constant_speed(noise + path[:, None] * [1.0, -1.0])
    assert steady[20:60].all()
    # of the ramp its last steps alone
    assert not steady[:17].any() and not steady[60:].any()
