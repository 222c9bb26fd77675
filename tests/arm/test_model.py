"""The planar chain taken out of a URDF, against Pinocchio's kinematics of the whole robot in space.

Three arms: the youBot's, one in an oblique plane with a joint turned round, and one that lies flat.
"""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

from pipeline.arm.model import load_arm
from tests.arm.example_urdf import JOINTS, LOCKED, YOUBOT, urdf


@pytest.fixture(scope="module", params=["youbot", "oblique", "flat"])
def robot(request, tmp_path_factory):
    """The arm as :func:`load_arm` takes it from its URDF, and Pinocchio's model of the whole robot
    with what it needs to run it.
    """
    if request.param == "youbot":
        file, joints, tool, locked = YOUBOT, JOINTS, "arm_tool", LOCKED
    else:
        oblique, flat = (
            (("0 1 0", "0 -1 0", "0 1 0"), "0.4 0.2 -0.3"),
            (("0 0 1", "0 0 1", "0 0 -1"), "0 0 0.5"),
        )
        axes, base = oblique if request.param == "oblique" else flat
        file = tmp_path_factory.mktemp("urdf") / f"{request.param}.urdf"
        file.write_text(urdf(axes, base=base))
        joints, tool, locked = ["a", "b", "c"], "tool", {}
    return (
        load_arm(file, joints, tool, locked),
        pin.buildModelFromUrdf(str(file)),
        joints,
        tool,
        locked,
    )


def in_space(robot, q: np.ndarray) -> tuple[pin.SE3, np.ndarray]:
    """Placement of the tool in the base frame and its Jacobian (6, 3), both of the whole robot at
    joint angles ``q`` of the chain.
    """
    _, model, joints, tool, locked = robot
    data, full = model.createData(), pin.neutral(model)
    for name, angle in [*locked.items(), *zip(joints, q, strict=True)]:
        full[model.joints[model.getJointId(name)].idx_q] = angle
    frame = model.getFrameId(tool)
    columns = [model.joints[model.getJointId(name)].idx_v for name in joints]
    jacobian = pin.computeFrameJacobian(
        model, data, full, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    )[:, columns]
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
        np.testing.assert_allclose(
            arm.to_base(np.array([x, across, z])), tool.translation, atol=1e-12
        )
        turn = pin.AngleAxis(phi, arm.rotation[:, 1]).toRotationMatrix()
        np.testing.assert_allclose(turn @ start.rotation, tool.rotation, atol=1e-12)


def test_the_jacobian_is_the_whole_robots_seen_in_the_plane(robot):
    arm = robot[0]
    for q in poses(arm.chain):
        _, jacobian = in_space(robot, q)
        linear, angular = arm.rotation.T @ jacobian[:3], arm.rotation.T @ jacobian[3:]
        np.testing.assert_allclose(
            np.vstack([linear[[0, 2]], angular[1]]), arm.chain.jacobian(q), atol=1e-12
        )
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
    here, there = (
        load_arm(YOUBOT, JOINTS, "arm_tool", LOCKED | {"arm_joint_1": angle})
        for angle in (0.3, 1.3)
    )
    # joint 1 turns about −z
    turned = pin.AngleAxis(-1.0, np.array([0.0, 0.0, 1.0])).toRotationMatrix()
    np.testing.assert_allclose(there.rotation, turned @ here.rotation, atol=1e-12)
    np.testing.assert_allclose(there.chain.links, here.chain.links, atol=1e-12)


def test_a_joint_without_limits_can_be_locked(tmp_path):
    file = tmp_path / "robot.urdf"
    turntable = (
        '<link name="ground"/><joint name="turntable" type="continuous"><parent '
        'link="ground"/><child link="root"/>'
    )
    file.write_text(
        urdf(("0 1 0",) * 3).replace(
            '<link name="root"/>', f'{turntable}<axis xyz="0 0 1"/></joint><link name="root"/>'
        )
    )
    still, turned = (
        load_arm(file, ["a", "b", "c"], "tool", {"turntable": angle}) for angle in (0.0, 0.8)
    )
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
        np.testing.assert_allclose(
            [*numbers(name, "limit", "lower"), *numbers(name, "limit", "upper")], limits
        )
        np.testing.assert_allclose(numbers(name, "limit", "velocity"), np.pi / 2)


def test_the_youbots_chain_has_the_lengths_of_the_experiment():
    chain = load_arm(YOUBOT, JOINTS, "arm_tool", LOCKED).chain
    # the tool is 0.17 m along joint 5, whose axis misses joint 4 by 2 mm
    np.testing.assert_allclose(chain.lengths, [0.155, 0.135, np.hypot(0.17, 0.002)], atol=1e-12)
    assert chain.lower.tolist() == [0.0, -5.1836, 0.0]
    assert chain.upper.tolist() == [2.7053, 0.0, 3.5779]
    np.testing.assert_allclose(chain.max_speed, np.pi / 2)
