"""Descriptions that hold no planar chain of limited revolute joints are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.arm.model import load_arm
from pipeline.core.errors import ConfigError
from tests.arm.example_urdf import JOINTS, YOUBOT, urdf


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"urdf": "nowhere.urdf"}, "no such file"),
        (
            {"joints": ["arm_joint_2", "arm_joint_3", "elbow"]},
            "no joint 'elbow' in the URDF; it has .'arm_joint_1'",
        ),
        ({"locked": {"elbow": 0.0}}, "robot.locked: no joint 'elbow'"),
        ({"locked": {"arm_joint_3": 0.0}}, "arm_joint_3 cannot be locked"),
        ({"tool": "hand"}, "no frame 'hand'"),
        ({"tool": "arm_link_3"}, "'arm_link_3' does not move with the last joint"),
        ({"tool": "arm_link_4"}, "lie on one axis"),
        ({"joints": ["arm_joint_3", "arm_joint_2", "arm_joint_4"]}, "in the order of the chain"),
        ({"joints": ["arm_joint_1", "arm_joint_2", "arm_joint_3"], "locked": {}}, "not parallel"),
    ],
)
def test_a_chain_that_the_urdf_does_not_hold_is_refused(change, said):
    arguments = {"urdf": YOUBOT, "joints": JOINTS, "tool": "arm_tool", "locked": {}} | change
    with pytest.raises(ConfigError, match=said) as refused:
        load_arm(**arguments)
    assert refused.value.evidence["file"] == Path(arguments["urdf"])


@pytest.mark.parametrize("kind", ["prismatic", "continuous"])
@pytest.mark.parametrize("place", [0, 1])
def test_a_joint_that_is_no_revolute_with_limits_is_refused(tmp_path, kind, place):
    kinds = ["revolute"] * 3
    kinds[place] = kind
    file = tmp_path / "robot.urdf"
    file.write_text(urdf(("0 1 0",) * 3, kinds=tuple(kinds)))
    with pytest.raises(ConfigError, match="three revolute joints with limits"):
        load_arm(file, ["a", "b", "c"], "tool", {})


def test_joints_on_two_branches_are_refused(tmp_path):
    file = tmp_path / "robot.urdf"
    file.write_text(
        urdf(("0 1 0",) * 3).replace('<parent link="link_b"/>', '<parent link="link_a"/>')
    )
    with pytest.raises(ConfigError, match="b does not move 'tool'"):
        load_arm(file, ["a", "b", "c"], "tool", {})


def test_a_file_that_is_no_urdf_is_refused(tmp_path):
    file = tmp_path / "robot.urdf"
    file.write_text("<robot")
    with pytest.raises(ConfigError, match=r"robot\.urdf"):
        load_arm(file, JOINTS, "arm_tool", {})


def test_a_tool_is_the_link_of_that_name_where_a_joint_has_it_too(tmp_path):
    plain, shared = tmp_path / "plain.urdf", tmp_path / "shared.urdf"
    plain.write_text(urdf(("0 0 1",) * 3))
    # of the joint at the foot of the chain, which no tool can be
    shared.write_text(urdf(("0 0 1",) * 3).replace('name="foot"', 'name="tool"'))
    expected, chain = (
        load_arm(file, ["a", "b", "c"], "tool", {}).chain for file in (plain, shared)
    )
    np.testing.assert_array_equal(chain.links, expected.links)
