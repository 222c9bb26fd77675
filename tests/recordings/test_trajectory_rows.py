"""The commanded trajectory as a table: of joint angles the task's steps, and what a redundant arm
is told beside them; of other joints or another grid none.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from made_options import made
from space_arms import LWR4, UR5, motion

from pipeline.arm.commanded import trajectory_table
from pipeline.arm.model import chain_of
from pipeline.core.columns import PLANE, columns, members, spread, values
from pipeline.core.errors import RecordingError
from pipeline.core.options.dataset import Dataset, Motion, Robot
from pipeline.formats.trajectory import write_trajectory
from pipeline.recordings.motion_capture import trajectory_rows

STEPS = 30
PLANAR = Robot(
    "pipeline/arm/ur5.urdf", ["joint_2", "joint_3", "joint_4"], "wrist_centre", plane=True
)


@pytest.fixture
def file(tmp_path):
    t = {"t": np.arange(STEPS + 1) / 100}
    write_trajectory(
        tmp_path / "t.csv", pd.DataFrame(t | spread("q", UR5.joints, motion(STEPS + 1)))
    )
    return tmp_path / "t.csv"


def dataset(robot=UR5, rate: float = 100.0) -> Dataset:
    return made(Dataset, robot=robot, motion=Motion(rate, STEPS))


def test_the_steps_take_the_arm_from_each_commanded_pose_to_the_next(file):
    table, chain, q = trajectory_rows(file, dataset()), chain_of(UR5), motion(STEPS + 1)
    steps = chain.displacement(chain.pose(q[:-1]), chain.pose(q[1:]))
    np.testing.assert_allclose(values(table, "v")[:-1] / 100, steps, atol=1e-12)
    assert members(table, "x") == chain.task and members(table, "u") == ()


def test_an_arm_of_more_joints_than_rows_is_told_its_joints_too(file):
    table = trajectory_rows(file, dataset(replace(UR5, task=["x", "y", "z"])))
    assert values(table, "v").shape == (STEPS + 1, 3)
    np.testing.assert_allclose(
        values(table, "u")[:-1] / 100, np.diff(motion(STEPS + 1), axis=0), atol=1e-12
    )


@pytest.mark.parametrize(
    ("robot", "rate", "words"),
    [(LWR4, 100.0, "the trajectory has the joints joint_1"), (UR5, 50.0, "asks for 31 at 50")],
)
def test_another_arms_or_another_grids_trajectory_is_refused(file, robot, rate, words):
    with pytest.raises(RecordingError, match=words):
        trajectory_rows(file, dataset(robot, rate))


def test_a_trajectory_of_the_plane_leaves_open_what_joints_do_beside_a_smaller_task(tmp_path):
    names = [*columns("x", PLANE), *columns("v", PLANE)]
    rows = pd.DataFrame(dict.fromkeys(names, 0.0), index=range(STEPS + 1))
    write_trajectory(tmp_path / "t.csv", rows.assign(t=np.arange(STEPS + 1) / 100))
    whole = trajectory_rows(tmp_path / "t.csv", dataset(PLANAR))
    assert len(whole) == STEPS + 1
    with pytest.raises(RecordingError, match="export the commanded joints") as refused:
        trajectory_rows(tmp_path / "t.csv", dataset(replace(PLANAR, task=["x", "z"])))
    assert refused.value.evidence["key"] == "dataset.robot.task"


def test_of_pose_and_joints_the_pose_is_the_whole_tasks_and_the_joints_are_a_smaller_ones(tmp_path):
    names, q = PLANAR.joints, motion(STEPS + 1)[:, 1:4]
    chain = chain_of(PLANAR)
    pose = trajectory_table(chain, q, 100.0)
    write_trajectory(tmp_path / "t.csv", pose)
    alone = trajectory_rows(tmp_path / "t.csv", dataset(PLANAR))
    write_trajectory(tmp_path / "t.csv", pose.assign(**spread("q", names, q)))
    beside = trajectory_rows(tmp_path / "t.csv", dataset(PLANAR))
    pd.testing.assert_frame_equal(beside, alone, check_exact=True)
    redundant = trajectory_rows(tmp_path / "t.csv", dataset(replace(PLANAR, task=["x", "z"])))
    assert members(redundant, "v") == ("x", "z")
    np.testing.assert_allclose(values(redundant, "x"), values(alone, "x")[:, :2], atol=1e-9)
    np.testing.assert_allclose(values(redundant, "v"), values(alone, "v")[:, :2], atol=1e-9)
    np.testing.assert_allclose(values(redundant, "u")[:-1] / 100, np.diff(q, axis=0), atol=1e-12)
