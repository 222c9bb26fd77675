"""URDFs of planar arms and of arms of any joints, and Pinocchio's kinematics of the whole robot."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

from pipeline.core.columns import SPACE
from pipeline.core.options.dataset import Robot

UR5 = Path("pipeline/arm/ur5.urdf")
YOUBOT = Path("pipeline/arm/youbot.urdf")
JOINTS = ["arm_joint_2", "arm_joint_3", "arm_joint_4"]
# rad, away from the poses that the experiment holds them at
LOCKED = {"arm_joint_1": 2.4, "arm_joint_5": 0.7}
LIMIT = '<limit lower="-2.5" upper="2.5" velocity="1.5" effort="10"/>'


def origin(place: pin.SE3) -> str:
    """The URDF's element of a placement."""
    angles = pin.rpy.matrixToRpy(place.rotation)
    xyz, rpy = (
        " ".join(repr(float(x)) for x in row) for row in (place.translation, angles)
    )
    return f'<origin xyz="{xyz}" rpy="{rpy}"/>'


def joint(name: str, kind: str, parent: str, child: str, inside: str = "") -> str:
    """The URDF's elements of a link and of the joint that moves it."""
    return (
        f'<link name="{child}"/><joint name="{name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{child}"/>{inside}</joint>'
    )


def robot_text(*joints: str) -> str:
    """A URDF of the root l0 and ``joints``."""
    return f'<robot name="test"><link name="l0"/>{"".join(joints)}</robot>'


def random_text(kinds: Sequence[str], rng: np.random.Generator) -> str:
    """A URDF of joints j1, j2, … of ``kinds`` placed and pointing anywhere, and a tip beyond."""
    places = [
        pin.SE3(
            pin.Quaternion(*(x := rng.normal(size=4)) / np.linalg.norm(x)),
            rng.normal(size=3) / 4,
        )
        for _ in range(len(kinds) + 1)
    ]
    axes = rng.normal(size=(len(kinds), 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    joints = []
    for i, (kind, axis) in enumerate(zip(kinds, axes.tolist(), strict=True)):
        inside = f'{origin(places[i])}<axis xyz="{" ".join(map(repr, axis))}"/>{LIMIT}'
        joints.append(joint(f"j{i + 1}", kind, f"l{i}", f"l{i + 1}", inside))
    return robot_text(
        *joints,
        joint("grip", "fixed", f"l{len(kinds)}", "tip", origin(places[-1])),
    )


def jn(count: int) -> list[str]:
    """The joints' names of such a URDF."""
    return [f"j{i + 1}" for i in range(count)]


def by_pinocchio(
    robot: Robot,
    tip: str,
    poses: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Poses (N, 12) of the link ``tip`` of the whole robot at ``poses`` (N, n) of its joints in the
    axes of its base, and the task's rows of its Jacobian (N, m, n).
    """
    model = pin.buildModelFromUrdf(str(robot.urdf))
    data = model.createData()
    zero = pin.neutral(model)
    frame = model.getFrameId(tip, pin.FrameType.BODY)
    columns = [model.joints[model.getJointId(name)].idx_v for name in robot.joints]
    held = np.zeros(model.nv)
    for name, value in robot.locked.items():
        held[model.joints[model.getJointId(name)].idx_v] = value
    rows = [SPACE.index(name) for name in robot.task or SPACE]
    units = np.where(np.array(rows) < 3, 1.0, robot.length)
    places = []
    jacobians = []
    for pose in poses:
        step = held.copy()
        step[columns] = pose
        q = pin.integrate(model, zero, step)
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        base = (
            data.oMf[model.getFrameId(robot.base, pin.FrameType.BODY)]
            if robot.base
            else pin.SE3.Identity()
        )
        place = base.actInv(data.oMf[frame])
        places.append([*place.translation, *place.rotation.ravel()])
        world = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        world = world.reshape(6, -1)[:, columns]  # one column comes as a vector
        in_base = np.vstack([base.rotation.T @ world[:3], base.rotation.T @ world[3:]])
        jacobians.append(in_base[rows] * units[:, None])
    return np.array(places), np.array(jacobians)


def stack(*joints: tuple[str, str, str, str, str, str, str]) -> str:
    """A URDF of joints: name, kind, parent, child, xyz, rpy and axis of each."""
    texts = []
    for name, kind, parent, child, xyz, rpy, axis in joints:
        inside = f'<origin xyz="{xyz}" rpy="{rpy}"/>' + (
            f'<axis xyz="{axis}"/>' if axis else ""
        )
        limited = kind in ("revolute", "prismatic")
        texts.append(joint(name, kind, parent, child, inside + LIMIT * limited))
    return robot_text(*texts)


def urdf(axes: tuple[str, str, str], base: str) -> str:
    """A chain a, b, c of three joints about ``axes`` on a base turned by ``base`` (roll, pitch,
    yaw), with a tool beyond.
    """
    return stack(
        ("foot", "fixed", "l0", "base", "0.1 -0.2 0.3", base, ""),
        ("a", "revolute", "base", "link_a", "0.02 0.05 0.1", "0 0 0", axes[0]),
        ("b", "revolute", "link_a", "link_b", "0.1 0.03 0.2", "0 0 0", axes[1]),
        ("c", "revolute", "link_b", "link_c", "-0.05 0.02 0.15", "0 0 0", axes[2]),
        ("grip", "fixed", "link_c", "tool", "0.1 -0.04 0.12", "0.3 0 0", ""),
    )


def gantry() -> str:
    """A URDF of a carriage (slides), turret (about z), shoulder (−x), telescope (slides), elbow
    (+x), plate (fixed), wrist (+x), gripper (slides) and mount (fixed).
    """
    return stack(
        ("carriage", "prismatic", "l0", "slide", "0 0 0.2", "0 0 0", "0 1 0"),
        ("turret", "revolute", "slide", "tower", "0.1 0 0.3", "0 0 0", "0 0 1"),
        ("shoulder", "revolute", "tower", "upper", "0.05 0 0.1", "0.3 0 0", "-1 0 0"),
        ("telescope", "prismatic", "upper", "rod", "0.02 0 0.2", "0 0 0", "0 0 1"),
        ("elbow", "revolute", "rod", "fore", "-0.03 0.01 0.1", "0 0 0", "1 0 0"),
        ("plate", "fixed", "fore", "bracket", "0 0 0.15", "0 0 0", ""),
        ("wrist", "revolute", "bracket", "hand", "0 0 0.1", "-0.2 0 0", "1 0 0"),
        ("gripper", "prismatic", "hand", "finger", "0 0.02 0.1", "0 0 0", "0 1 0"),
        ("mount", "fixed", "hand", "flange", "0.04 0.03 0.12", "0 0.4 0", ""),
    )
