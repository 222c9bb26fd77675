"""The robot that new-dataset proposes: planar or in space, its joints by trajectory, names in the
logs or positions.
"""

import re
import shutil
from pathlib import Path

import joint_kinds
import numpy as np
import pandas as pd
import pytest
from new_datasets import UR5, run, unfilled, write_takes, written
from source_code import ROOT

from pipeline.configuration import datasheet
from pipeline.formats.trajectory import write_trajectory
from pipeline.tools.new_dataset.robot import movable_joints, urdf_facts

SIX_JOINTS = [f"joint_{number}" for number in range(1, 7)]  # of the UR5
PARALLEL = SIX_JOINTS[1:4]


def write_command(file: Path, joints: list[str], rows: list[str]) -> None:
    """Write a commanded trajectory of 21 steps with columns of these joints and task rows."""
    columns = [f"q:{joint}" for joint in joints]
    columns += [f"{family}:{row}" for family in ("x", "v") for row in rows]
    commanded = pd.DataFrame(0.0, index=range(21), columns=["t", *columns])
    commanded["t"] = np.arange(21) / 100
    write_trajectory(file, commanded)


@pytest.mark.parametrize(
    ("urdf", "joints", "rows", "planar"),
    [
        ("ur5", SIX_JOINTS, [], False),
        ("ur5", [], ["x", "z", "phi"], True),
        ("ur5", None, None, False),  # a chain of three of its six joints is parallel
        ("lwr4", None, None, False),
    ],
)
def test_an_arm_with_markers_is_planar_only_if_its_joints_or_its_trajectory_say_so(
    root,
    tmp_path,
    urdf,
    joints,
    rows,
    planar,
):
    takes = tmp_path / "takes"
    write_takes(takes, "fit_1", "fit_2")
    shutil.copy(ROOT / f"pipeline/arm/{urdf}.urdf", takes / "arm.urdf")
    if joints is not None:
        write_command(takes / "command.csv", joints, rows)
    run("lab", "--from", takes)
    robot = written()[1]["robot"]
    assert robot.get("plane", False) is planar
    expected = 3 if planar else {"ur5": 6, "lwr4": 7}[urdf]
    assert len(robot["joints"]) == expected


def test_facts_of_a_urdf_are_of_the_file_in_the_current_folder(tmp_path, monkeypatch):
    joints = {}
    for arm in ("ur5", "lwr4"):
        (tmp_path / arm).mkdir()
        shutil.copy(ROOT / f"pipeline/arm/{arm}.urdf", tmp_path / arm / "arm.urdf")
        monkeypatch.chdir(tmp_path / arm)
        joints[arm] = len(movable_joints(urdf_facts("arm.urdf")))
    assert joints == {"ur5": 6, "lwr4": 7}


def test_the_joints_are_those_that_the_trajectory_commands(root, tmp_path):
    write_takes(tmp_path / "takes", "fit_1")
    shutil.copy(UR5, tmp_path / "takes/arm.urdf")
    write_command(tmp_path / "takes/command.csv", SIX_JOINTS[:5], [])
    run("lab", "--from", tmp_path / "takes")
    assert written()[1]["robot"]["joints"] == SIX_JOINTS[:5]


@pytest.mark.parametrize("exists", [True, False])
def test_a_planar_proposal_becomes_an_arm_in_space_by_one_command(
    root,
    tmp_path,
    exists,
):
    takes = tmp_path / "takes"
    write_takes(takes, "fit_1")
    shutil.copy(UR5, takes / "arm.urdf")
    write_command(takes / "command.csv", [], ["x", "z", "phi"])
    in_space = ["robot.plane=false", f"robot.joints=[{', '.join(SIX_JOINTS)}]"]
    options = ["--set", in_space[0], "--set", in_space[1]]
    if exists:
        run("lab", "--from", takes)
        robot = written()[1]["robot"]
        assert robot["joints"] == PARALLEL and robot["locked"] == "???"
        run("lab", *options)
        # no joint is left to lock
        assert written()[1]["robot"]["locked"] == {}
    else:
        run("lab", "--from", takes, *options)
    robot = written()[1]["robot"]
    assert robot["plane"] is False and robot["joints"] == SIX_JOINTS
    assert "robot.locked" not in unfilled()


UR_JOINTS = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]
NAMELESS = {  # labels of the measured and commanded angles: joints that are suggested, and a note
    "numbers": (joint_kinds.labels_of("q_#,q_cmd_#"), UR_JOINTS, "beyond the limits: none"),
    "other words": ([f"{signal}_{joint}" for signal in ("q", "q_cmd")
                     for joint in "hip knee ankle heel toe sole".split()], None,
                    "the logs name, in this order, hip, knee, ankle, heel, toe, sole"),
}  # fmt: skip


def named_urdf(file: Path, limit: float = 6.3) -> None:
    """A UR5 whose joints have the names of UR's drivers, with a ``limit`` of the elbow."""
    text = UR5.read_text()
    for number, joint in enumerate(UR_JOINTS, start=1):
        text = text.replace(f'"joint_{number}"', f'"{joint}_joint"')
    file.write_text(
        re.sub('(?s)(elbow_joint.*?upper=)"[^"]*"', rf'\1"{limit}"', text, count=1),
    )


@pytest.mark.parametrize("kind", [k for k in joint_kinds.KINDS if k.number in ("19", "20")
                                  and not k.stops], ids=lambda kind: kind.number)  # fmt: skip
def test_joints_follow_the_names_in_the_logs_whatever_the_order_of_the_urdf(
    root,
    tmp_path,
    kind,
):
    (tmp_path / "logs").mkdir()
    kind.make(tmp_path / "logs")
    named_urdf(tmp_path / "logs/arm.urdf")
    run("lab", "--from", tmp_path / "logs", "--suggested", "--set", "robot.tool=flange")
    assert written()[0]["joint_log"]["joints"] == [
        f"{joint}_joint" for joint in sorted(UR_JOINTS)
    ]


@pytest.mark.parametrize("labels", NAMELESS)
def test_without_names_the_limits_support_the_positions_and_other_names_contradict_them(
    root,
    tmp_path,
    labels,
):
    columns, joints, note = NAMELESS[labels]
    (tmp_path / "logs").mkdir()
    head = ["time", *columns]
    joint_kinds.write(tmp_path / "logs/log.csv", head, *joint_kinds.motion())
    named_urdf(tmp_path / "logs/arm.urdf")
    run("lab", "--from", tmp_path / "logs", "--suggested", "--set", "robot.tool=flange")
    expected = [f"{joint}_joint" for joint in joints] if joints else "???"
    assert written()[0]["joint_log"]["joints"] == expected
    assert note in datasheet.path_of("lab").read_text()
    # control: angles beyond a limit of the joint at their position
    named_urdf(tmp_path / "logs/arm.urdf", limit=0.2)
    run(
        "other",
        "--from",
        tmp_path / "logs",
        "--suggested",
        "--set",
        "robot.tool=flange",
    )
    assert written("other")[0]["joint_log"]["joints"] == "???"
