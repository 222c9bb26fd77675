"""URDFs of the three arms against the data sheets that they were made from."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
from space_arms import LWR4, UR5

from pipeline.arm.model import load_arm
from tests.arm.arm_urdfs import JOINTS, LOCKED, YOUBOT

QUARTER = np.pi / 2
# Denavit-Hartenberg values, standard convention: d (m), a (m), twist (rad)
LISTED = {
    "ur5": (
        UR5.urdf,
        (0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823),
        (0.0, -0.425, -0.39225, 0.0, 0.0, 0.0),
        (QUARTER, 0.0, 0.0, QUARTER, -QUARTER, 0.0),
    ),
    "lwr4": (
        LWR4.urdf,
        (0.31, 0.0, 0.4, 0.0, 0.39, 0.0, 0.078),
        (0.0,) * 7,
        (QUARTER, -QUARTER, -QUARTER, QUARTER, QUARTER, -QUARTER, 0.0),
    ),
}


@pytest.mark.parametrize("arm", LISTED)
def test_the_flange_is_where_the_listed_values_put_it(arm):
    urdf, *listed = LISTED[arm]
    model = pin.buildModelFromUrdf(urdf)
    data = model.createData()
    for q in np.random.default_rng(5).uniform(-2, 2, (20, model.nq)):
        frame = np.eye(4)
        for angle, d, a, twist in zip(q, *listed, strict=True):
            c, s, ct, st = np.cos(angle), np.sin(angle), np.cos(twist), np.sin(twist)
            rows = [[c, -s * ct, s * st, a * c], [s, c * ct, -c * st, a * s]]
            frame = frame @ np.array([*rows, [0, st, ct, d], [0, 0, 0, 1]])
        pin.framesForwardKinematics(model, data, q)
        at = data.oMf[model.getFrameId("flange")].homogeneous
        np.testing.assert_allclose(at, frame, atol=1e-12)


def test_the_youbots_urdf_holds_its_data_sheet():
    sheet = {  # xyz in m, rpy in degrees, axis, upper and lower limit in rad
        "arm_joint_1": ((0.024, 0, 0.096), (0, 0, 170), (0, 0, -1), (0, 5.8992)),
        "arm_joint_2": ((0.033, 0, 0.019), (0, -65, 0), (0, 1, 0), (0, 2.7053)),
        "arm_joint_3": ((0, 0, 0.155), (0, 146, 0), (0, 1, 0), (-5.1836, 0)),
        "arm_joint_4": ((0, 0, 0.135), (0, -102.5, 0), (0, 1, 0), (0, 3.5779)),
        "arm_joint_5": ((-0.002, 0, 0.130), (0, 0, 167.5), (0, 0, -1), (0, 5.8469)),
    }
    joints = {joint.get("name"): joint for joint in ElementTree.parse(YOUBOT).iter("joint")}
    for name, (xyz, rpy, axis, limits) in sheet.items():

        def listed(element: str, attribute: str, name: str = name) -> list[float]:
            return [float(x) for x in joints[name].find(element).get(attribute).split()]

        np.testing.assert_allclose(listed("origin", "xyz"), xyz)
        np.testing.assert_allclose(np.rad2deg(listed("origin", "rpy")), rpy, atol=1e-9)
        np.testing.assert_allclose(listed("axis", "xyz"), axis)
        np.testing.assert_allclose([*listed("limit", "lower"), *listed("limit", "upper")], limits)
        np.testing.assert_allclose(listed("limit", "velocity"), np.pi / 2)


def test_planar_chains_have_the_lengths_of_the_experiments():
    chain = load_arm(YOUBOT, JOINTS, "arm_tool", LOCKED).chain
    # the tool is 0.17 m along joint 5, whose axis misses joint 4 by 2 mm
    np.testing.assert_allclose(chain.lengths, [0.155, 0.135, np.hypot(0.17, 0.002)], atol=1e-12)
    chain = load_arm(UR5.urdf, ["joint_2", "joint_3", "joint_4"], "wrist_centre", {}).chain
    np.testing.assert_allclose(chain.lengths, [0.425, 0.39225, 0.09465], atol=1e-12)
    # joint 2 at -90 degrees points the stretched arm upwards
    top = chain.pose(np.array([-np.pi / 2, 0.0, 0.0]))
    assert top[1] == pytest.approx(0.089159 + 0.425 + 0.39225, abs=1e-12)
