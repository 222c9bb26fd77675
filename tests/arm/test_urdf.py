"""The arm that the options ask for: base and tip named or found; joints held, coupled, endless."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from space_arms import LWR4, link_poses
from space_arms import UR5 as ARM

from pipeline.arm.chain import PlanarChain
from pipeline.arm.model import chain_of, link_chains
from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Robot
from pipeline.core.task import SPACE
from tests.arm.arm_urdfs import LIMIT, UR5, YOUBOT, by_pinocchio, jn, joint, origin, robot_text

PLACE = origin(pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.5, 0.8), np.array([0.1, 0.2, 0.3])))
MIMIC = '<mimic joint="j1" multiplier="-2" offset="0.1"/>'


def moving(name: str, kind: str, parent: str, child: str, axis: str = "0 0.6 0.8", more: str = ""):
    limit = LIMIT if kind in ("revolute", "prismatic") else ""
    return joint(name, kind, parent, child, f'{PLACE}<axis xyz="{axis}"/>{limit}{more}')


@pytest.fixture
def file(tmp_path):
    """Writes a URDF and tells where."""

    def write(*joints: str) -> str:
        (tmp_path / "robot.urdf").write_text(robot_text(*joints))
        return str(tmp_path / "robot.urdf")

    return write


def agrees(robot: Robot, tip: str) -> bool:
    """Whether the arm is the one in Pinocchio's model of the whole robot."""
    chain = chain_of(robot)
    low, high = (np.clip(limit, -4, 4) for limit in (chain.lower, chain.upper))
    q = np.random.default_rng(1).uniform(low, high, (20, len(low)))
    places, jacobians = by_pinocchio(robot, tip, q)
    return np.allclose(chain.pose(q), places, rtol=0, atol=1e-12) and np.allclose(
        chain.jacobian(q), jacobians, rtol=0, atol=1e-12
    )


def test_locked_joints_before_between_and_behind_are_held_where_they_are_named():
    names = [f"arm_joint_{j}" for j in (1, 3, 4)]
    locked = {"arm_joint_2": 1.1, "arm_joint_5": 0.4}
    robot = Robot(str(YOUBOT), names, locked=locked, task=["x", "y", "z"])
    assert agrees(robot, "arm_tool")
    assert not agrees(Robot(str(YOUBOT), names, task=["x", "y", "z"]), "arm_link_5")


def test_the_task_has_the_axes_of_the_base_that_is_named(file):
    urdf = file(
        joint("foot", "fixed", "l0", "plinth", PLACE),
        moving("j1", "revolute", "plinth", "l1"),
        moving("j2", "revolute", "l1", "l2", "1 0 0"),
        joint("side", "fixed", "l0", "desk", PLACE.replace("0.3", "0.4")),
    )
    for base in (None, "plinth", "desk"):
        assert agrees(Robot(urdf, jn(2), base=base, task=["y", "rz"]), "l2")
    robots = [Robot(urdf, jn(2), base=base, task=["y", "rz"]) for base in (None, "plinth")]
    first, second = (chain_of(robot).pose(np.zeros(2)) for robot in robots)
    assert not np.allclose(first, second)


def test_the_tip_is_the_only_last_link_beyond_the_joints_or_the_one_that_is_named(file):
    urdf = file(
        moving("j1", "revolute", "l0", "l1"),
        moving("j2", "revolute", "l1", "l2", "1 0 0"),
        joint("hand", "fixed", "l2", "palm", PLACE),
        moving("finger", "prismatic", "palm", "nail"),
        joint("lamp", "fixed", "l1", "bulb", PLACE),
    )
    two = {"urdf": urdf, "joints": jn(2), "task": ["x", "rz"]}
    assert agrees(Robot(**two), "nail")
    assert agrees(Robot(**two, locked={"finger": 0.3}), "nail")
    assert agrees(Robot(**two, tool="palm"), "palm")
    assert agrees(Robot(**two, tool="hand"), "palm")  # by the joint that holds it


def test_a_continuous_joint_has_no_limits_and_counts_its_turns(file):
    urdf = file(
        moving("j1", "continuous", "l0", "l1"), moving("j2", "revolute", "l1", "l2", "1 0 0")
    )
    robot = Robot(urdf, jn(2), task=["x", "rz"])
    chain = chain_of(robot)
    assert agrees(robot, "l2")
    assert (chain.lower[0], chain.upper[0], chain.max_speed[0]) == (-np.inf, np.inf, np.inf)
    far = np.array([[200.0, 1.0], [np.nan, 1.0]])
    assert chain.within_limits(far).tolist() == [True, False]


def test_a_continuous_joint_is_held_where_it_is_locked(file):
    urdf = file(
        moving("j1", "continuous", "l0", "l1"), moving("j2", "revolute", "l1", "l2", "1 0 0")
    )
    assert agrees(Robot(urdf, ["j2"], locked={"j1": 0.7}, task=["rz"]), "l2")


def test_a_tool_is_the_link_of_that_name_where_a_joint_has_it_too(tmp_path):
    poses = []
    for foot in ("foot", "tool"):  # a joint at the foot of the chain, which no tool can be
        (tmp_path / f"{foot}.urdf").write_text(
            robot_text(
                joint(foot, "fixed", "l0", "plinth", PLACE),
                moving("j1", "revolute", "plinth", "l1"),
                joint("hand", "fixed", "l1", "tool", PLACE),
            )
        )
        robot = Robot(str(tmp_path / f"{foot}.urdf"), ["j1"], tool="tool", task=["x"])
        poses.append(chain_of(robot).pose(np.array([[0.3], [1.0]])))
    np.testing.assert_array_equal(*poses)


def test_coupled_joints_are_held_where_those_that_they_follow_are_held(file):
    urdf = file(
        moving("j1", "revolute", "l0", "l1"),
        moving("j2", "revolute", "l1", "l2", "1 0 0"),
        moving("coupled", "revolute", "l2", "l3", "0 1 0", MIMIC),
        moving("j3", "revolute", "l3", "l4", "1 0 0"),
    )
    held = chain_of(Robot(urdf, ["j2", "j3"], locked={"j1": 0.4}, task=["x", "rz"]))
    expected = Robot(urdf, ["j2", "j3"], locked={"j1": 0.4, "coupled": 0.1 - 0.8}, task=["x", "rz"])
    q = np.random.default_rng(1).uniform(-1, 1, (5, 2))
    np.testing.assert_allclose(held.pose(q), by_pinocchio(expected, "l4", q)[0], atol=1e-12)


def test_a_finger_that_follows_another_does_not_matter_behind_the_tip(file):
    urdf = file(
        moving("j1", "revolute", "l0", "l1"),
        moving("right", "prismatic", "l1", "r"),
        moving("left", "prismatic", "l1", "l", more=MIMIC.replace("j1", "right")),
    )
    assert agrees(Robot(urdf, ["j1"], tool="l1", task=["ry"]), "l1")


def test_a_fixed_joint_follows_no_other_whatever_its_description_says(file):
    urdf = file(
        moving("j1", "revolute", "l0", "l1"), joint("hand", "fixed", "l1", "l2", PLACE + MIMIC)
    )
    assert agrees(Robot(urdf, ["j1"], task=["x"]), "l2")


def test_the_rows_of_a_task_come_in_their_order_and_default_to_all():
    joints = [f"joint_{j}" for j in range(1, 7)]
    whole, part = (
        chain_of(Robot(str(UR5), joints, "flange", task=task)) for task in (None, ["rz", "x"])
    )
    assert (whole.task, part.task) == (SPACE, ("rz", "x"))
    q = np.random.default_rng(2).uniform(-1, 1, (4, 6))
    np.testing.assert_array_equal(part.jacobian(q), whole.jacobian(q)[:, [5, 0]])


def test_closed_forms_serve_the_whole_pose_in_a_plane_of_three_joints_alone():
    three = {"urdf": str(UR5), "joints": ["joint_2", "joint_3", "joint_4"], "tool": "wrist_centre"}
    assert isinstance(chain_of(Robot(**three, plane=True)), PlanarChain)
    for other in ({"length": 0.3}, {"task": ["x", "phi", "z"]}, {"task": ["phi"]}):
        assert not isinstance(chain_of(Robot(**three, plane=True, **other)), PlanarChain)
    two = Robot(str(UR5), ["joint_2", "joint_3"], "wrist_1", plane=True, task=["x", "z"])
    assert chain_of(two).jacobian(np.zeros(2)).shape == (2, 2)


def test_joints_that_slide_in_the_plane_are_of_it(file):
    urdf = file(
        moving("j1", "revolute", "l0", "l1", "0 0 1"),
        moving("j2", "prismatic", "l1", "l2", "1 0 0").replace(PLACE, origin(pin.SE3.Identity())),
        joint("grip", "fixed", "l2", "tip", PLACE),
    )
    chain = chain_of(Robot(urdf, jn(2), plane=True, task=["x", "z"]))
    q = np.array([[0.2, 0.5], [-0.3, 0.9]])
    assert np.ptp(chain.pose(q)[:, 1]) < 1e-12


@pytest.mark.parametrize(
    ("robot", "links"),
    [(ARM, ["shoulder", "forearm", "wrist_2", "flange"]), (LWR4, ["link_2", "link_5", "flange"])],
)
def test_a_links_frame_lies_where_pinocchio_has_it(robot, links):
    q = np.random.default_rng(1).uniform(-2, 2, (50, len(robot.joints)))
    for link, chain in link_chains(robot, links, "key").items():
        pose = chain.pose(q[:, : len(chain.lower)])
        rotation, position = link_poses(robot, link, q)
        np.testing.assert_allclose(pose[:, :3], position, atol=1e-12)
        np.testing.assert_allclose(pose[:, 3:].reshape(-1, 3, 3), rotation, atol=1e-12)


def test_held_joints_are_no_joints_of_the_chain():
    held = replace(ARM, joints=ARM.joints[2:], locked={"joint_2": -0.7}, task=["x", "z"])
    (chain,) = link_chains(held, ["wrist_1"], "key").values()
    q = np.random.default_rng(1).uniform(-2, 2, (5, 2))
    whole = np.hstack([np.tile([0.0, -0.7], (5, 1)), q, np.zeros((5, 2))])
    np.testing.assert_allclose(
        chain.pose(q)[:, :3], link_poses(ARM, "wrist_1", whole)[1], atol=1e-12
    )


@pytest.mark.parametrize(
    ("link", "words"), [("elbow", "no frame 'elbow'"), ("base", "no joint of the arm moves 'base'")]
)
def test_a_link_that_the_arm_does_not_move_is_refused(link, words):
    with pytest.raises(ConfigError, match=words):
        link_chains(ARM, ["forearm", link], "key")
