"""The commanded steps: velocity over the rate, one a step, in the order of the task's rows."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from pipeline.arm.chain import TASK
from pipeline.core.columns import columns
from pipeline.recordings.commands import commanded_steps, constant_speed, task_columns

RATE = 50.0


@pytest.fixture
def trajectory() -> pd.DataFrame:
    """A motion as its file has it: a pose that grows by what the velocity says."""
    k = np.arange(6)
    speed = np.random.default_rng(2).normal(size=(6, 3))
    pose = np.concatenate([np.zeros((1, 3)), np.cumsum(speed[:-1] / RATE, axis=0)])
    named = dict(zip(TASK, pose.T, strict=True))
    named |= dict(zip((f"v{row}" for row in TASK), speed.T, strict=True))
    return pd.DataFrame({"comment": "", "k": k, "t": k / RATE} | named)


def test_the_rows_of_the_task_become_families_of_columns(trajectory):
    table = task_columns(trajectory)
    assert list(table) == ["k", "t", *columns("x", TASK), *columns("v", TASK)]
    assert table["v:phi"].tolist() == trajectory["vphi"].tolist()


def test_a_step_leads_from_one_commanded_pose_to_the_next(trajectory):
    steps = commanded_steps(task_columns(trajectory), RATE)
    poses = trajectory[list(TASK)].to_numpy()
    assert steps.shape == (5, 3)
    np.testing.assert_allclose(steps, np.diff(poses, axis=0), atol=1e-15)
    # the control: without the rate they are velocities
    assert np.abs(commanded_steps(task_columns(trajectory), 1.0) - steps).max() > 0.5


def test_the_steps_of_constant_speed_are_those_between_the_ramps_in_spite_of_noise():
    pace = np.concatenate([np.zeros(10), np.linspace(0, 1, 10), np.ones(40), np.zeros(20)])
    path = np.concatenate([[0.0], np.cumsum(0.01 * pace)])
    noise = 1e-3 * np.random.default_rng(5).standard_normal((100, len(path), 2))
    steady = constant_speed(noise + path[:, None] * [1.0, -1.0])
    assert steady[20:60].all()
    # of the ramp its last steps alone
    assert not steady[:17].any() and not steady[60:].any()
