"""What is no arm, or no task of it, is refused with one message that says what to do."""

from __future__ import annotations

import pytest

from pipeline.arm.model import chain_of
from pipeline.arm.urdf import MOST_JOINTS
from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Robot
from tests.arm.arm_urdfs import LIMIT, jn, joint, robot_text


def chain(count: int, *, kind: str = "revolute", inside: str = LIMIT) -> list[str]:
    """Joints j1 to j``count`` one behind the other, about z and x in turn."""
    axes = ('<axis xyz="0 0 1"/>', '<axis xyz="1 0 0"/>')
    origin = '<origin xyz="0.1 0.2 0.3" rpy="0 0 0"/>'
    return [
        joint(f"j{i + 1}", kind, f"l{i}", f"l{i + 1}", origin + axes[i % 2] + inside)
        for i in range(count)
    ]


def fixed(name: str, parent: str, child: str) -> str:
    """A joint between links that there are."""
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="fixed">{ends}</joint>'


TWO = chain(2)
MIMIC = LIMIT + '<mimic joint="j1"/>'


@pytest.mark.parametrize(
    ("text", "options", "said"),
    [
        ("<robot", {}, r"robot\.urdf: this is no URDF"),
        ("<robot name='a'/>", {}, "one link that no joint holds, and this one none"),
        ("<?xml version='1.0' encoding='klingon'?><robot/>", {}, "no URDF .unknown encoding"),
        ('<!DOCTYPE r [<!ENTITY a "a">]><robot name="&a;"/>', {}, "document type or entities"),
        (robot_text(*TWO, TWO[0]), {}, "two joints are named 'j1'"),
        (robot_text(*TWO, fixed("back", "l2", "l0")), {}, "links form a loop.*back, j1, j2"),
        (robot_text(*TWO, fixed("again", "l0", "l2")), {}, "links form a loop.*again, j2 .file"),
        (robot_text(*TWO, '<link name="lone"/>'), {}, r"this one l0, lone .file"),
        (robot_text(*TWO, fixed("far", "l2", "moon")), {}, "far joins the link 'moon'"),
        (robot_text(*chain(2, inside="")), {}, "joint j1 has no limits.*or the type continuous"),
        (robot_text(*chain(2, inside='<limit lower="-1" upper="1"/>')), {}, "j1 has no limits"),
        (robot_text(*chain(2, inside='<limit velocity="1" effort="1"/>')), {}, "j1 has no limits"),
        (
            robot_text(*chain(2, inside=LIMIT.replace("-2.5", "x"))),
            {},
            "the joint j1 has .x. as lower of its limit",
        ),
        (robot_text(*chain(2)).replace("0 0 1", "0 0 0"), {}, "the axis of j1 has length 0"),
        (robot_text(TWO[0], *chain(2, inside=MIMIC)[1:]), {}, r"j2 is coupled to j1 \(mimic\)"),
        (
            robot_text(*TWO, joint("j3", "floating", "l2", "l3")),
            {},
            "j3 before the tip is floating",
        ),
        (robot_text(*TWO, joint("j3", "planar", "l2", "l3")), {"joints": jn(3)}, "j3 is planar"),
        (robot_text(*TWO), {"joints": ["j1", "elbow"]}, r"no joint 'elbow'.*it has \['j1', 'j2'\]"),
        (robot_text(*TWO), {"joints": ["j2", "j1"]}, "in the order of the chain"),
        (robot_text(*TWO), {"tool": "l1"}, "'l1' does not move with the last joint"),
        (robot_text(*TWO), {"tool": "hand"}, "robot.tool: no frame 'hand'"),
        (robot_text(*TWO), {"base": "floor"}, "robot.base: no frame 'floor'"),
        (robot_text(*TWO), {"base": "l1"}, "robot.base: 'l1' moves with j1"),
        (robot_text(*TWO), {"locked": {"j1": 0.0}}, "j1 cannot be locked"),
        (robot_text(*TWO), {"locked": {"elbow": 0.0}}, "robot.locked: no joint 'elbow'"),
        (robot_text(*chain(4)), {"joints": ["j1", "j2"], "tool": "l1"}, "'l1' does not move"),
        (robot_text(*TWO), {"plane": True, "task": ["x", "z"]}, "axes are not parallel.*j1 is j2"),
    ],
)
def test_what_is_no_arm_is_refused(tmp_path, text, options, said):
    file = tmp_path / "robot.urdf"
    file.write_text(text)
    robot = Robot(**({"urdf": str(file), "joints": jn(2), "task": ["x", "z"]} | options))
    with pytest.raises(ConfigError, match=said) as refused:
        chain_of(robot)
    assert refused.value.evidence["file"] == file


def test_two_last_links_are_named_where_none_is_chosen(tmp_path):
    file = tmp_path / "robot.urdf"
    file.write_text(
        robot_text(*TWO, joint("a", "fixed", "l2", "left"), joint("b", "fixed", "l2", "right"))
    )
    with pytest.raises(ConfigError, match=r"name one of \['left', 'right'\]"):
        chain_of(Robot(str(file), jn(2), task=["x", "z"]))


@pytest.mark.parametrize("count", [MOST_JOINTS + 1])
def test_a_urdf_of_more_joints_than_can_be_gone_through_is_refused(tmp_path, count):
    file = tmp_path / "robot.urdf"
    file.write_text(robot_text(*chain(count)))
    with pytest.raises(ConfigError, match=f"more than {MOST_JOINTS} joints"):
        chain_of(Robot(str(file), jn(2), task=["x", "z"]))


def test_rows_that_the_arm_cannot_move_are_named(tmp_path):
    file = tmp_path / "robot.urdf"
    file.write_text(robot_text(*chain(3)).replace("1 0 0", "0 0 1"))
    with pytest.raises(ConfigError, match="cannot move z, rx; leave"):
        chain_of(Robot(str(file), jn(3), task=["z", "x", "rx"]))
    assert chain_of(Robot(str(file), jn(3), task=["y", "x", "rz"])).task == ("y", "x", "rz")


def test_rows_that_follow_from_each_other_are_refused(tmp_path):
    file = tmp_path / "robot.urdf"
    # two sliding joints in one plane, seen in axes that lean against it
    text = (
        robot_text(*chain(2, kind="prismatic"))
        .replace("0 0 1", "0.6 0.8 0")
        .replace("1 0 0", "0.8 0.6 0")
    )
    file.write_text(text)
    with pytest.raises(ConfigError, match="cannot move z"):
        chain_of(Robot(str(file), jn(2), task=["z", "x"]))
    file.write_text(text.replace("0.8 0.6 0", "-0.6 -0.8 0"))
    with pytest.raises(ConfigError, match="none of x, y without another"):
        chain_of(Robot(str(file), jn(2), task=["x", "y"]))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"task": ["x", "yaw"]}, "must name rows of x, y, z, rx, ry, rz, each once"),
        ({"task": ["x", "x"]}, "each once"),
        ({"task": []}, "must name rows"),
        ({"task": ["x", "y"], "plane": True}, "must name rows of x, z, phi"),
        ({"joints": jn(5)}, "6 rows are more than 5 joints"),
        ({"joints": jn(2), "plane": True}, "3 rows are more than 2 joints"),
        ({"joints": []}, "joints: list should have at least 1 item"),
        ({"joints": ["j1"] * 6}, "joints: must name each joint once"),
        ({"length": 0.0}, "length: input should be greater than 0, got 0.0"),
        ({"length": float("nan")}, "length: input should be a finite number, got nan"),
    ],
)
def test_options_that_no_arm_has_are_refused_by_their_key(options, said):
    with pytest.raises(ConfigError, match=said) as refused:
        Robot(**({"urdf": "robot.urdf", "joints": jn(6)} | options))
    assert refused.value.evidence["key"] in ("task", "joints", "length")
