"""The only door to Pinocchio: an arm from its URDF, and the planar chain that its free joints
form.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from pipeline.arm.chain import PlanarChain
from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Robot

PLANAR_TOLERANCE = 1e-6  # sine of the angle by which an axis may lean out of the common normal
SHORTEST_LINK = 1e-3  # m; joints nearer than this do not span a chain


@dataclass(frozen=True)
class Arm:
    """A planar chain and where its plane lies: ``rotation`` has the plane's x, normal y and z as
    columns, in the base frame.
    """

    chain: PlanarChain
    rotation: np.ndarray  # (3, 3) plane axes in the base frame
    # (3,) origin of the plane's coordinates in the base frame, m; O1 lies in the plane y = 0
    translation: np.ndarray

    def to_plane(self, points: np.ndarray) -> np.ndarray:
        """(..., 3) base-frame points (m) → coordinates (x, y, z) of the plane's frame, y along the
        normal.
        """
        return (points - self.translation) @ self.rotation

    def to_base(self, points: np.ndarray) -> np.ndarray:
        """(..., 3) points of the plane's frame (m) → base frame."""
        return points @ self.rotation.T + self.translation


def arm_of(robot: Robot) -> Arm:
    """The arm that the section ``dataset.robot`` describes; raises what :func:`load_arm` does."""
    return load_arm(robot.urdf, robot.joints, robot.tool, robot.locked)


def load_arm(
    urdf: str | Path, joints: Sequence[str], tool: str, locked: Mapping[str, float]
) -> Arm:
    """Lock every other joint of the URDF at ``locked`` (rad; 0 where not named) and read off the
    chain of its three ``joints``.

    The plane's y axis is the first joint's axis, its z axis the base's z as far as it lies in the
    plane (the base's y where the plane is horizontal). Raises ConfigError for a file that is no
    URDF, unknown names, joints that are not parallel revolutes one after the other, or a tool not
    beyond them.
    """
    if not Path(urdf).is_file():
        raise ConfigError("robot.urdf: no such file", file=urdf)
    try:
        full = pin.buildModelFromUrdf(str(urdf))
    except ValueError as error:
        raise ConfigError(f"robot.urdf: {error}", file=urdf) from None
    names = set(full.names[1:])
    for key, wanted in (("robot.joints", joints), ("robot.locked", locked)):
        for name in wanted:
            if name not in names:
                raise ConfigError(
                    f"{key}: no joint {name!r} in the URDF; it has {sorted(names)}", file=urdf
                )
    if _frame(full, tool) is None:
        raise ConfigError(f"robot.tool: no frame {tool!r} in the URDF", file=urdf)
    if both := sorted(set(joints) & set(locked)):
        raise ConfigError(
            f"robot.locked: {', '.join(both)} cannot be locked, being of robot.joints", file=urdf
        )
    model = _held(full, joints, locked)
    if list(model.names[1:]) != list(joints) or list(model.parents[1:]) != [0, 1, 2]:
        raise ConfigError(
            f"robot.joints: {list(joints)} must be three in a row, in the order of the chain "
            f"{list(model.names[1:])}",
            file=urdf,
        )
    if model.frames[_frame(model, tool)].parentJoint != 3:
        raise ConfigError(
            f"robot.tool: {tool!r} does not move with the last joint of the chain", file=urdf
        )
    data = model.createData()
    zero = pin.neutral(model)
    pin.forwardKinematics(model, data, zero)
    pin.updateFramePlacements(model, data)
    # the angular rows of a revolute joint's Jacobian column are its axis in the base frame
    axes = pin.computeJointJacobians(model, data, zero)[3:].T
    # a sliding joint has no axis, one without limits two coordinates
    sliding = len(axes) == 3 and np.linalg.norm(axes, axis=1) < 0.5
    if model.nq != 3 or np.any(sliding):
        wrong = [name for i, name in enumerate(joints) if model.joints[i + 1].nq != 1 or sliding[i]]
        raise ConfigError(
            f"robot.joints: {list(joints)} must be revolute joints with limits, which "
            f"{', '.join(wrong)} is not",
            file=urdf,
        )
    normal = axes[0] / np.linalg.norm(axes[0])
    leaning = np.linalg.norm(np.cross(normal, axes), axis=1) > PLANAR_TOLERANCE
    if np.any(leaning):
        wrong = ", ".join(name for name, leans in zip(joints, leaning, strict=True) if leans)
        message = (
            "robot.joints: the axes are not parallel, so they form no planar chain: "
            f"not to that of {joints[0]} is {wrong}"
        )
        raise ConfigError(message, file=urdf, axes=axes.round(4).tolist())
    up = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < 0.99 else np.array([0.0, 1.0, 0.0])
    up = up - normal * (up @ normal)
    up /= np.linalg.norm(up)
    rotation = np.stack([np.cross(normal, up), normal, up], axis=1)
    placements = [data.oMi[i].translation for i in range(1, 4)] + [
        data.oMf[_frame(model, tool)].translation
    ]
    offset = normal * (normal @ placements[0])
    planar = (np.array(placements) - offset) @ rotation[:, [0, 2]]
    links = np.diff(planar, axis=0)
    if np.any(np.hypot(*links.T) < SHORTEST_LINK):
        raise ConfigError(
            "robot: joints or tool of the chain lie on one axis",
            file=urdf,
            lengths=np.hypot(*links.T).round(4).tolist(),
        )
    chain = PlanarChain(
        origin=planar[0],
        links=links,
        signs=np.sign(axes @ normal),
        lower=model.lowerPositionLimit.copy(),
        upper=model.upperPositionLimit.copy(),
        max_speed=model.upperVelocityLimit.copy(),
    )
    return Arm(chain, rotation, offset)


def torques(robot: Robot, q: np.ndarray, speed: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
    """(N, n) N·m that the motors of the ``robot``'s joints give at ``q`` (N, n) in rad for
    ``speed`` (N, n) in rad/s and ``acceleration`` (N, n) in rad/s², gravity included, by the masses
    in its URDF.
    """
    model = _held(pin.buildModelFromUrdf(str(robot.urdf)), robot.joints, robot.locked)
    data = model.createData()
    return np.array(
        [pin.rnea(model, data, *row) for row in zip(q, speed, acceleration, strict=True)]
    )


def greatest_torques(robot: Robot) -> np.ndarray:
    """(n,) N·m that the motors of the ``robot``'s joints give at most, by its URDF."""
    model = _held(pin.buildModelFromUrdf(str(robot.urdf)), robot.joints, robot.locked)
    return model.upperEffortLimit.copy()


def _held(full: pin.Model, joints: Sequence[str], locked: Mapping[str, float]) -> pin.Model:
    """``full`` with every joint but ``joints`` held at ``locked`` (rad; 0 where not named)."""
    held = np.zeros(full.nv)
    for name, angle in locked.items():
        held[full.joints[full.getJointId(name)].idx_v] = angle
    q = pin.integrate(full, pin.neutral(full), held)
    others = [full.getJointId(name) for name in full.names[1:] if name not in joints]
    return pin.buildReducedModel(full, others, q)


def _frame(model: pin.Model, name: str) -> int | None:
    """The frame of the link or joint ``name``: of the link where, as in many URDFs, a joint has the
    same name; None where neither has.
    """
    for kind in (pin.FrameType.BODY, pin.FrameType.FIXED_JOINT, pin.FrameType.JOINT):
        if model.existFrame(name, kind):
            return model.getFrameId(name, kind)
    return None
