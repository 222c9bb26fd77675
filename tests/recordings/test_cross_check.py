"""What is told of one motion twice is the same motion, or it is refused with what may be wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.arm.commanded import trajectory_table
from pipeline.arm.model import load_arm
from pipeline.core.columns import columns, spread
from pipeline.core.errors import RecordingError
from pipeline.recordings.commands import require_commanded, require_encoders, require_velocities

RATE, JOINTS = 100.0, ["joint_2", "joint_3", "joint_4"]
TIME = np.arange(301) / RATE
POSITIONS, VELOCITIES = (columns(family, ("x", "z", "phi")) for family in "xv")


@pytest.fixture(scope="module")
def chain():
    return load_arm("pipeline/arm/ur5.urdf", JOINTS, "wrist_centre", {}).chain


@pytest.fixture
def q() -> np.ndarray:
    """(301, 3) rad: there and back, from rest to rest."""
    share = (1 - np.cos(2 * np.pi * TIME / TIME[-1])) / 2
    return np.array([-0.2, 1.0, -2.6]) + share[:, None] * [-1.4, 0.5, 1.4]


@pytest.fixture
def trajectory(chain, q) -> pd.DataFrame:
    return trajectory_table(chain, q, RATE)


def later(table: pd.DataFrame, names: list[str], rows: int) -> pd.DataFrame:
    shifted = table[names].shift(rows).bfill()
    return table.assign(**dict(shifted.items()))


def exchanged(table: pd.DataFrame, names: list[str]) -> pd.DataFrame:
    first, second, *_ = names
    return table.assign(**{first: table[second], second: table[first]})


def scaled(table: pd.DataFrame, names: list[str], factor: float) -> pd.DataFrame:
    return table.assign(**{name: factor * table[name] for name in names})


WRONG = {
    "millimetres": lambda table, names: scaled(table, names[:2], 1000),
    "degrees": lambda table, names: scaled(table, names[2:], 180 / np.pi),
    "exchanged": exchanged,
    "a second late": lambda table, names: later(table, names, 100),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_a_command_in_another_unit_order_or_clock_than_the_arm_went_is_refused(
    chain, q, trajectory, wrong
):
    tracked = q + np.random.default_rng(1).normal(0, 5e-3, q.shape)
    require_commanded(tracked, trajectory, chain, "a")
    with pytest.raises(RecordingError, match=r"not on the commanded path.*suspected") as refused:
        require_commanded(tracked, WRONG[wrong](trajectory, POSITIONS), chain, "a")
    assert refused.value.evidence["take"] == "a"


@pytest.mark.parametrize("wrong", WRONG)
def test_velocities_that_do_not_lead_along_the_positions_are_refused(trajectory, wrong):
    require_velocities(trajectory, RATE, Path("t.csv"))
    with pytest.raises(RecordingError, match="do not lead along") as refused:
        require_velocities(WRONG[wrong](trajectory, VELOCITIES), RATE, Path("t.csv"))
    assert refused.value.evidence["file"] == Path("t.csv")


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda table, names: scaled(table, names, 180 / np.pi), "angle_unit"),
        (exchanged, "order of their columns"),
        (lambda table, names: table.assign(t=table["t"] + 1), "when their log starts"),
        (lambda table, names: table.assign(t=table["t"] + 10), "0 of 250 readings"),
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
