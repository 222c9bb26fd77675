"""The UR5's URDF against the Denavit-Hartenberg values it was made from, and the planar chain
against Pinocchio.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from pipeline.arm.model import load_arm

URDF = Path(__file__).parents[2] / "pipeline/arm/ur5.urdf"
JOINTS = ["joint_2", "joint_3", "joint_4"]
D = (0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823)  # m
A = (0.0, -0.425, -0.39225, 0.0, 0.0, 0.0)  # m
TWIST = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)
POSES = np.random.default_rng(5).uniform(-3, 3, (20, 6))


def dh(q: np.ndarray) -> list[np.ndarray]:
    """Frames 1 to 6 after Denavit and Hartenberg, standard convention, in the base frame."""
    frames, frame = [], np.eye(4)
    for angle, d, a, twist in zip(q, D, A, TWIST, strict=True):
        c, s, ct, st = np.cos(angle), np.sin(angle), np.cos(twist), np.sin(twist)
        frame = frame @ np.array(
            [[c, -s * ct, s * st, a * c], [s, c * ct, -c * st, a * s], [0, st, ct, d], [0, 0, 0, 1]]
        )
        frames.append(frame)
    return frames


@pytest.fixture(scope="module")
def full():
    model = pin.buildModelFromUrdf(str(URDF))
    return model, model.createData()


def placement(full, q, frame) -> pin.SE3:
    model, data = full
    pin.forwardKinematics(model, data, q)
    return pin.updateFramePlacement(model, data, model.getFrameId(frame)).copy()


def test_the_flange_is_where_the_listed_values_put_it(full):
    for q in POSES:
        np.testing.assert_allclose(placement(full, q, "flange").homogeneous, dh(q)[5], atol=1e-12)


def test_the_wrist_centre_moves_in_the_plane_of_the_chain_whatever_the_other_joints_do(full):
    for q in POSES:
        arm = load_arm(URDF, JOINTS, "wrist_centre", {"joint_1": q[0]})
        at = arm.to_plane(placement(full, q, "wrist_centre").translation)
        np.testing.assert_allclose(arm.chain.pose(q[1:4])[:2], at[[0, 2]], atol=1e-12)
        # beside the plane through joint 2 by the offset of joint 4 alone
        assert abs(at[1]) == pytest.approx(D[3], abs=1e-12)
        other = q + np.array([0, 0, 0, 0, 1.0, -2.0])
        moved = {
            name: placement(full, other, name).translation - placement(full, q, name).translation
            for name in ("wrist_centre", "flange")
        }
        np.testing.assert_allclose(moved["wrist_centre"], 0, atol=1e-12)
        # the control: the flange does leave its place
        assert np.linalg.norm(moved["flange"]) > 0.01


def test_the_chain_jacobian_is_pinocchio_s_seen_in_the_plane(full):
    model, data = full
    for q in POSES:
        arm = load_arm(URDF, JOINTS, "wrist_centre", {"joint_1": q[0]})
        jacobian = pin.computeFrameJacobian(
            model, data, q, model.getFrameId("wrist_centre"), pin.LOCAL_WORLD_ALIGNED
        )[:, 1:4]
        x, normal, z = arm.rotation.T
        planar = np.stack([x @ jacobian[:3], z @ jacobian[:3], normal @ jacobian[3:]])
        np.testing.assert_allclose(arm.chain.jacobian(q[1:4]), planar, atol=1e-12)


def test_the_order_and_sense_of_the_joints_are_the_controller_s():
    chain = load_arm(URDF, JOINTS, "wrist_centre", {}).chain
    np.testing.assert_allclose(chain.lengths, [-A[1], -A[2], D[4]], atol=1e-12)
    # joint 2 at -90 degrees points the stretched arm upwards
    top = chain.pose(np.array([-np.pi / 2, 0.0, 0.0]))
    assert top[1] == pytest.approx(D[0] - A[1] - A[2], abs=1e-12)
    assert np.all(np.abs(chain.lower) == 2 * np.pi) and np.all(chain.upper == 2 * np.pi)
