"""Commanded steps and ranges; what is known of one motion twice agrees, or is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.arm.commanded import trajectory_table
from pipeline.arm.model import load_arm
from pipeline.core.columns import columns, spread
from pipeline.core.errors import RecordingError
from pipeline.models.steps import Recorded
from pipeline.recordings.commands import (
    commanded_steps,
    constant_speed,
    require_commanded,
    require_encoders,
    require_velocities,
)
from pipeline.recordings.steps import fitted_ranges

TASK, RATE, JOINTS = ("x", "rz"), 100.0, ["joint_2", "joint_3", "joint_4"]
TIME = np.arange(301) / RATE
POSITIONS, VELOCITIES = (columns(family, ("x", "z", "phi")) for family in "xv")


def test_a_step_leads_from_one_commanded_place_to_the_next_and_joints_stand_behind():
    k, rng = np.arange(6), np.random.default_rng(2)
    speed, joints = rng.normal(size=(6, 2)), rng.normal(size=(6, 3))
    x = np.concatenate([np.zeros((1, 2)), np.cumsum(speed[:-1] / RATE, axis=0)])
    growing = pd.DataFrame({"k": k} | spread("x", TASK, x) | spread("v", TASK, speed))
    steps = commanded_steps(growing, RATE)
    assert steps.shape == (5, 2)
    np.testing.assert_allclose(steps, np.diff(growing[["x:x", "x:rz"]], axis=0), atol=1e-15)
    # the control: without the rate they are velocities
    assert np.abs(commanded_steps(growing, 1.0) - steps).max() > 0.5
    redundant = commanded_steps(growing.assign(**spread("u", ("a", "b", "c"), joints)), RATE)
    np.testing.assert_array_equal(redundant[:, :2], steps)
    np.testing.assert_allclose(redundant[:, 2:], joints[:-1] / RATE, atol=1e-15)


def test_the_steps_of_constant_speed_are_those_between_the_ramps_in_spite_of_noise():
    pace = np.concatenate([np.zeros(10), np.linspace(0, 1, 10), np.ones(40), np.zeros(20)])
    path = np.concatenate([[0.0], np.cumsum(0.01 * pace)])
    noise = 1e-3 * np.random.default_rng(5).standard_normal((100, len(path), 2))
    steady = constant_speed(noise + path[:, None] * [1.0, -1.0])
    assert steady[20:60].all()
    # of the ramp its last steps alone
    assert not steady[:17].any() and not steady[60:].any()


@pytest.fixture(scope="module")
def chain():
    return load_arm("pipeline/arm/ur5.urdf", JOINTS, "wrist_centre", {}).chain


@pytest.fixture
def q() -> np.ndarray:
    """(301, 3) rad: there and back, from rest to rest."""
    share = (1 - np.cos(2 * np.pi * TIME / TIME[-1])) / 2
    return np.array([-0.2, 1.0, -2.6]) + share[:, None] * [-1.4, 0.5, 1.4]


def exchanged(table: pd.DataFrame, names: list[str]) -> pd.DataFrame:
    first, second, *_ = names
    return table.assign(**{first: table[second], second: table[first]})


def scaled(table: pd.DataFrame, names: list[str], factor: float) -> pd.DataFrame:
    return table.assign(**{name: factor * table[name] for name in names})


WRONG = {
    "millimetres": lambda table, names: scaled(table, names[:2], 1000),
    "degrees": lambda table, names: scaled(table, names[2:], 180 / np.pi),
    "exchanged": exchanged,
    "a second late": lambda table, names: table.assign(**table[names].shift(100).bfill()),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_a_path_or_velocities_in_another_unit_order_or_clock_are_refused(chain, q, wrong):
    tracked = q + np.random.default_rng(1).normal(0, 5e-3, q.shape)
    trajectory, spoil = trajectory_table(chain, q, RATE), WRONG[wrong]
    require_commanded(tracked, trajectory, chain, "a")
    with pytest.raises(RecordingError, match=r"not on the commanded path.*suspected") as refused:
        require_commanded(tracked, spoil(trajectory, POSITIONS), chain, "a")
    assert refused.value.evidence["take"] == "a"
    require_velocities(trajectory, RATE, Path("t.csv"))
    with pytest.raises(RecordingError, match="do not lead along") as refused:
        require_velocities(spoil(trajectory, VELOCITIES), RATE, Path("t.csv"))
    assert refused.value.evidence["file"] == Path("t.csv")


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda table, names: scaled(table, names, 180 / np.pi), "angle_unit"),
        (exchanged, "order of their columns"),
        (lambda table, names: table.assign(t=table["t"] + 1), "when their log starts"),
        (lambda table, names: table.assign(t=table["t"] + 10), "0 of 250 readings"),
        (lambda table, names: table.add([0.0, 2 * np.pi, 0.0, 0.0]), "joint_2 [+]1 turns"),
    ],
)
def test_encoders_in_another_unit_order_or_clock_than_what_was_tracked_are_refused(q, wrong, words):
    tracked = pd.DataFrame({"t": TIME} | spread("q", JOINTS, q))
    times = np.arange(250) / 83.3
    held = np.stack([np.interp(times, TIME, angle) for angle in q.T], axis=1)
    readings = pd.DataFrame({"t": times} | spread("q", JOINTS, held + 2e-3))
    require_encoders(tracked, readings, JOINTS, "a")
    with pytest.raises(RecordingError, match=words):
        require_encoders(tracked, wrong(readings, columns("q", JOINTS)), JOINTS, "a")


def test_every_quantity_has_the_ends_of_its_values(chain):
    q = np.array([[[0.1, 1.2, 0.3], [0.2, 1.6, 0.3]], [[0.0, 1.4, 0.5], [0.2, 1.5, 0.4]]])
    v = np.array([[0.001, 0.0, 0.01], [-0.002, 0.0, 0.02]])
    recorded = Recorded(chain, q, v, np.zeros_like(q), ("a", "b", "c"))
    rows = fitted_ranges(recorded, 100.0).set_index(["quantity", "name"])
    assert rows.loc[("speed", "x"), ["least", "greatest", "unit"]].tolist() == [-0.2, 0.1, "m/s"]
    # the pose after the last step counts, as it was measured too
    last = q[:, -1] + np.matvec(np.linalg.inv(chain.jacobian(q[:, -1])), v[-1])
    both = np.concatenate([q.reshape(-1, 3), last])
    assert rows.loc[("pose", "b"), "greatest"] == both[:, 1].max()
    assert rows.loc[("pose", "b"), "least"] == both[:, 1].min()
    norms = np.linalg.norm(np.linalg.inv(chain.jacobian(q)), axis=(-2, -1))
    np.testing.assert_allclose(rows.loc[("condition", "‖J⁺‖"), "greatest"], norms.max())
