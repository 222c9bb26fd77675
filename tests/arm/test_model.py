"""The planar chain taken out of a URDF, against Pinocchio's kinematics of the whole robot in space.

Three arms: the youBot's, one in an oblique plane with a joint turned round, and one that lies flat.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

from pipeline.arm.model import load_arm
from pipeline.errors import ConfigError

YOUBOT = Path("pipeline/arm/youbot.urdf")
JOINTS = ["arm_joint_2", "arm_joint_3", "arm_joint_4"]
LOCKED = {"arm_joint_1": 2.4, "arm_joint_5": 0.7}  # rad, away from the poses that the experiment holds them at


def urdf(axes: tuple[str, str, str], *, base: str = "0 0 0", kinds: tuple[str, str, str] = ("revolute",) * 3) -> str:
    """A chain a, b, c of three joints about ``axes`` on a base turned by ``base`` (roll, pitch, yaw), with a tool beyond."""
    lines = ['<robot name="test"><link name="root"/><link name="base"/>']
    lines += [f'<joint name="foot" type="fixed"><parent link="root"/><child link="base"/><origin xyz="0.1 -0.2 0.3" rpy="{base}"/></joint>']
    below = "base"
    for name, axis, kind, place in zip("abc", axes, kinds, ("0.02 0.05 0.1", "0.1 0.03 0.2", "-0.05 0.02 0.15"), strict=True):
        limit = '<limit lower="-2" upper="1.5" velocity="1.2" effort="1"/>' if kind != "continuous" else ""
        lines.append(
            f'<link name="link_{name}"/><joint name="{name}" type="{kind}"><parent link="{below}"/><child link="link_{name}"/>'
            f'<origin xyz="{place}" rpy="0 0 0"/><axis xyz="{axis}"/>{limit}</joint>'
        )
        below = f"link_{name}"
    lines.append('<link name="tool"/><joint name="grip" type="fixed"><parent link="link_c"/><child link="tool"/>')
    lines.append('<origin xyz="0.1 -0.04 0.12" rpy="0.3 0 0"/></joint></robot>')
    return "\n".join(lines)


@pytest.fixture(scope="module", params=["youbot", "oblique", "flat"])
def robot(request, tmp_path_factory):
    """The arm as :func:`load_arm` takes it from its URDF, and Pinocchio's model of the whole robot with what it needs to run it."""
    if request.param == "youbot":
        file, joints, tool, locked = YOUBOT, JOINTS, "arm_tool", LOCKED
    else:
        oblique, flat = (("0 1 0", "0 -1 0", "0 1 0"), "0.4 0.2 -0.3"), (("0 0 1", "0 0 1", "0 0 -1"), "0 0 0.5")
        axes, base = oblique if request.param == "oblique" else flat
        file = tmp_path_factory.mktemp("urdf") / f"{request.param}.urdf"
        file.write_text(urdf(axes, base=base))
        joints, tool, locked = ["a", "b", "c"], "tool", {}
    return load_arm(file, joints, tool, locked), pin.buildModelFromUrdf(str(file)), joints, tool, locked


def in_space(robot, q: np.ndarray) -> tuple[pin.SE3, np.ndarray]:
    """Placement of the tool in the base frame and its Jacobian (6, 3), both of the whole robot at joint angles ``q`` of the chain."""
    _, model, joints, tool, locked = robot
    data, full = model.createData(), pin.neutral(model)
    for name, angle in [*locked.items(), *zip(joints, q, strict=True)]:
        full[model.joints[model.getJointId(name)].idx_q] = angle
    frame = model.getFrameId(tool)
    columns = [model.joints[model.getJointId(name)].idx_v for name in joints]
    jacobian = pin.computeFrameJacobian(model, data, full, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)[:, columns]
    pin.framesForwardKinematics(model, data, full)
    return data.oMf[frame].copy(), jacobian


def poses(chain, count: int = 30) -> np.ndarray:
    return np.random.default_rng(1).uniform(chain.lower, chain.upper, (count, 3))


def test_the_pose_is_where_the_tool_of_the_whole_robot_is(robot):
    arm = robot[0]
    start, _ = in_space(robot, np.zeros(3))
    across = arm.to_plane(start.translation)[1]
    for q in poses(arm.chain):
        x, z, phi = arm.chain.pose(q)
        tool, _ = in_space(robot, q)
        np.testing.assert_allclose(arm.to_base(np.array([x, across, z])), tool.translation, atol=1e-12)
        turn = pin.AngleAxis(phi, arm.rotation[:, 1]).toRotationMatrix()
        np.testing.assert_allclose(turn @ start.rotation, tool.rotation, atol=1e-12)


def test_the_jacobian_is_the_whole_robots_seen_in_the_plane(robot):
    arm = robot[0]
    for q in poses(arm.chain):
        _, jacobian = in_space(robot, q)
        linear, angular = arm.rotation.T @ jacobian[:3], arm.rotation.T @ jacobian[3:]
        np.testing.assert_allclose(np.vstack([linear[[0, 2]], angular[1]]), arm.chain.jacobian(q), atol=1e-12)
        # and nothing of the motion leaves the plane
        np.testing.assert_allclose(np.vstack([linear[1], angular[[0, 2]]]), 0, atol=1e-12)


def test_joints_lie_where_the_whole_robots_lie(robot):
    arm, model, joints, *_ = robot
    data, full = model.createData(), pin.neutral(model)
    q = poses(arm.chain, 1)[0]
    for name, angle in [*robot[4].items(), *zip(joints, q, strict=True)]:
        full[model.joints[model.getJointId(name)].idx_q] = angle
    pin.forwardKinematics(model, data, full)
    places = np.array([data.oMi[model.getJointId(name)].translation for name in joints])
    np.testing.assert_allclose(arm.to_plane(places)[:, [0, 2]], arm.chain.points(q)[:3], atol=1e-12)
    assert abs(arm.to_plane(places)[0, 1]) < 1e-12


def test_the_planes_axes_are_right_handed_with_z_as_far_up_as_it_can_be(robot):
    rotation = robot[0].rotation
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) > 0
    flat = abs(rotation[2, 1]) > 0.99
    assert rotation[1 if flat else 2, 2] > 0.5
    # the horizontal axis has nothing of the vertical
    assert abs(rotation[1 if flat else 2, 0]) < 1e-12


def test_points_go_to_the_plane_and_back(robot):
    points = np.random.default_rng(2).normal(size=(4, 5, 3))
    np.testing.assert_allclose(robot[0].to_base(robot[0].to_plane(points)), points, atol=1e-14)
    assert robot[0].to_plane(points[0, 0]).shape == (3,)


def test_a_joint_turned_round_has_sign_minus_one(tmp_path):
    file = tmp_path / "robot.urdf"
    file.write_text(urdf(("0 1 0", "0 -1 0", "0 1 0")))
    assert load_arm(file, ["a", "b", "c"], "tool", {}).chain.signs.tolist() == [1, -1, 1]


def test_a_locked_joint_turns_the_plane_and_leaves_the_chain_as_it_is():
    here, there = (load_arm(YOUBOT, JOINTS, "arm_tool", LOCKED | {"arm_joint_1": angle}) for angle in (0.3, 1.3))
    turned = pin.AngleAxis(-1.0, np.array([0.0, 0.0, 1.0])).toRotationMatrix()  # joint 1 turns about −z
    np.testing.assert_allclose(there.rotation, turned @ here.rotation, atol=1e-12)
    np.testing.assert_allclose(there.chain.links, here.chain.links, atol=1e-12)


def test_a_joint_without_limits_can_be_locked(tmp_path):
    file = tmp_path / "robot.urdf"
    turntable = '<link name="ground"/><joint name="turntable" type="continuous"><parent link="ground"/><child link="root"/>'
    file.write_text(urdf(("0 1 0",) * 3).replace('<link name="root"/>', f'{turntable}<axis xyz="0 0 1"/></joint><link name="root"/>'))
    still, turned = (load_arm(file, ["a", "b", "c"], "tool", {"turntable": angle}) for angle in (0.0, 0.8))
    turn = pin.AngleAxis(0.8, np.array([0.0, 0.0, 1.0])).toRotationMatrix()
    np.testing.assert_allclose(turned.rotation, turn @ still.rotation, atol=1e-12)


def test_the_youbots_urdf_holds_its_data_sheet():
    sheet = {  # xyz in m, rpy in degrees, axis, upper and lower limit in rad
        "arm_joint_1": ((0.024, 0, 0.096), (0, 0, 170), (0, 0, -1), (0, 5.8992)),
        "arm_joint_2": ((0.033, 0, 0.019), (0, -65, 0), (0, 1, 0), (0, 2.7053)),
        "arm_joint_3": ((0, 0, 0.155), (0, 146, 0), (0, 1, 0), (-5.1836, 0)),
        "arm_joint_4": ((0, 0, 0.135), (0, -102.5, 0), (0, 1, 0), (0, 3.5779)),
        "arm_joint_5": ((-0.002, 0, 0.130), (0, 0, 167.5), (0, 0, -1), (0, 5.8469)),
    }
    joints = {joint.get("name"): joint for joint in ElementTree.parse(YOUBOT).iter("joint")}

    def numbers(name: str, element: str, attribute: str) -> list[float]:
        return [float(number) for number in joints[name].find(element).get(attribute).split()]

    for name, (xyz, rpy, axis, limits) in sheet.items():
        np.testing.assert_allclose(numbers(name, "origin", "xyz"), xyz)
        np.testing.assert_allclose(np.rad2deg(numbers(name, "origin", "rpy")), rpy, atol=1e-9)
        np.testing.assert_allclose(numbers(name, "axis", "xyz"), axis)
        np.testing.assert_allclose([*numbers(name, "limit", "lower"), *numbers(name, "limit", "upper")], limits)
        np.testing.assert_allclose(numbers(name, "limit", "velocity"), np.pi / 2)


def test_the_youbots_chain_has_the_lengths_of_the_experiment():
    chain = load_arm(YOUBOT, JOINTS, "arm_tool", LOCKED).chain
    # the tool is 0.17 m along joint 5, whose axis misses joint 4 by 2 mm
    np.testing.assert_allclose(chain.lengths, [0.155, 0.135, np.hypot(0.17, 0.002)], atol=1e-12)
    assert chain.lower.tolist() == [0.0, -5.1836, 0.0]
    assert chain.upper.tolist() == [2.7053, 0.0, 3.5779]
    np.testing.assert_allclose(chain.max_speed, np.pi / 2)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"urdf": "nowhere.urdf"}, "no such file"),
        ({"joints": ["arm_joint_2", "arm_joint_3", "elbow"]}, "no joint 'elbow' in the URDF; it has .'arm_joint_1'"),
        ({"locked": {"elbow": 0.0}}, "robot.locked: no joint 'elbow'"),
        ({"locked": {"arm_joint_3": 0.0}}, "arm_joint_3 cannot be locked"),
        ({"tool": "hand"}, "no frame 'hand'"),
        ({"tool": "arm_link_3"}, "'arm_link_3' does not move with the last joint"),
        ({"tool": "arm_link_4"}, "lie on one axis"),
        ({"joints": ["arm_joint_3", "arm_joint_2", "arm_joint_4"]}, "in the order of the chain"),
        ({"joints": ["arm_joint_2", "arm_joint_3"]}, "must be three in a row"),
        ({"joints": ["arm_joint_1", "arm_joint_2", "arm_joint_3"], "locked": {}}, "not parallel"),
    ],
)
def test_a_chain_that_the_urdf_does_not_hold_is_refused(change, said):
    given = {"urdf": YOUBOT, "joints": JOINTS, "tool": "arm_tool", "locked": {}} | change
    with pytest.raises(ConfigError, match=said) as refused:
        load_arm(**given)
    assert refused.value.evidence["file"] == given["urdf"]


@pytest.mark.parametrize("kind", ["prismatic", "continuous"])
@pytest.mark.parametrize("place", [0, 1])
def test_a_joint_that_is_no_revolute_with_limits_is_refused(tmp_path, kind, place):
    kinds = ["revolute"] * 3
    kinds[place] = kind
    file = tmp_path / "robot.urdf"
    file.write_text(urdf(("0 1 0",) * 3, kinds=tuple(kinds)))
    with pytest.raises(ConfigError, match="must be revolute joints with limits"):
        load_arm(file, ["a", "b", "c"], "tool", {})


def test_joints_on_two_branches_are_refused(tmp_path):
    file = tmp_path / "robot.urdf"
    file.write_text(urdf(("0 1 0",) * 3).replace('<parent link="link_b"/>', '<parent link="link_a"/>'))
    with pytest.raises(ConfigError, match="three in a row"):
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
    expected, found = (load_arm(file, ["a", "b", "c"], "tool", {}).chain for file in (plain, shared))
    np.testing.assert_array_equal(found.links, expected.links)
