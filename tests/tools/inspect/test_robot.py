"""What is said of a robot's URDF: its joints, its planar chain, and what is open of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.tools.inspect.examine import inspect


@pytest.fixture
def urdf(zoo) -> Path:
    return zoo / "three.urdf"


def test_robots_say_their_joints_and_chain(urdf):
    (robot,) = inspect(urdf)
    assert robot.facts["joints"] == {"revolute": ["j1", "j2", "j3"], "fixed": ["j4"]}
    assert robot.facts["chains"] == [{"joints": ["j1", "j2", "j3"], "tools": ["tip"]}]
    assert not robot.open


def test_a_robot_without_a_planar_chain_is_an_arm_all_the_same(tmp_path, urdf):
    (tmp_path / "bent.urdf").write_text(urdf.read_text().replace('xyz="0 1 0"', 'xyz="1 0 0"', 1))
    (one,) = inspect(tmp_path / "bent.urdf")
    assert one.facts["arms"] == [{"joints": ["j1", "j2", "j3"], "tip": "tip"}]
    assert not one.facts["chains"] and not one.stops


def test_a_joint_without_limits_would_stop_the_analysis(tmp_path, urdf):
    (tmp_path / "endless.urdf").write_text(urdf.read_text().replace("<limit", "<no", 1))
    (one,) = inspect(tmp_path / "endless.urdf")
    assert "robot.urdf" in one.stops[0]


def test_of_several_last_links_those_count_that_most_joints_move():
    (one,) = inspect(Path("pipeline/arm/ur5.urdf"))
    arms = {arm["tip"]: arm["joints"] for arm in one.facts["arms"]}
    assert arms["flange"] == [f"joint_{j}" for j in range(1, 7)]
    assert {len(joints) for joints in arms.values()} == {6}


def test_a_robot_of_two_last_links_asks_which_is_the_tool(tmp_path, urdf):
    text = urdf.read_text()
    fixed = (
        '<link name="{child}"/><joint name="{joint}" type="fixed"><parent '
        'link="{parent}"/><child link="{child}"/>{at}</joint>'
    )
    other = fixed.format(parent="c", child="probe", joint="j5", at='<origin xyz="0 0 0.1"/>')
    other += fixed.format(parent="probe", child="needle", joint="j6", at="")
    (tmp_path / "two.urdf").write_text(text.replace("</robot>", f"{other}</robot>"))
    (one,) = inspect(tmp_path / "two.urdf")
    assert [option for _, option in one.open] == ["dataset.robot.tool"]
    assert set(one.facts["chains"][0]["tools"]) == {"tip", "needle"}
    (tmp_path / "two.urdf").write_text(
        text.replace("</robot>", f"{other}</robot>").replace("j6", "needle")
    )
    (one,) = inspect(tmp_path / "two.urdf")
    assert set(one.facts["chains"][0]["tools"]) == {"tip", "needle"}, (
        "of a link and a joint of one name the link is meant"
    )
