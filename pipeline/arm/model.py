"""Arms from their URDF; the one module that imports Pinocchio."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from pipeline.arm.chain import TASK, PlanarChain
from pipeline.arm.interface import Chain
from pipeline.arm.layout import Layout, planar_chain, plane_of, unlike_three
from pipeline.arm.serial import SerialChain
from pipeline.arm.urdf import Description, Tree, describe, read_urdf
from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Robot
from pipeline.core.task import SPACE

SAMPLES = 64  # poses at which the arm shows what it can move


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


def chain_of(robot: Robot) -> Chain:
    """The chain of the section ``dataset.robot`` and its task.

    Three parallel revolute joints with the whole pose in their plane as the task have closed forms;
    every other arm is a serial chain. Raises ConfigError for what :func:`describe` and
    :func:`plane_of` refuse, and for a task with rows that the arm cannot move.
    """
    described = describe(robot)
    layout = _layout(described)
    task = tuple(robot.task or (TASK if robot.plane else SPACE))
    if robot.plane:
        layout = layout.seen_from(*plane_of(layout, described.file))
        if task == TASK and robot.length == 1.0 and unlike_three(layout) is None:
            return planar_chain(layout, described.file)
    chain = _serial(layout, task, float(robot.length))
    _require_movable(chain, described.file)
    return chain


def link_chains(robot: Robot, links: Iterable[str], key: str) -> dict[str, SerialChain]:
    """Of each of the ``links`` that the option ``key`` names the chain of those joints of the arm
    that move it: its tip is the link's frame, its task the whole pose, in metres and radians, in
    the axes of the arm's base.

    Raises ConfigError for a link that the URDF does not have or that the arm does not move, and
    for what :func:`describe` refuses.
    """
    tree, chains = read_urdf(Path(robot.urdf)), {}
    for link in links:
        above = [joint.name for joint in tree.above(tree.link(link, key))]
        joints = [name for name in robot.joints if name in above]
        if not joints:
            raise ConfigError(f"{key}: no joint of the arm moves {link!r}", file=tree.file)
        described = describe(replace(robot, joints=joints, tool=link, plane=False, task=["x"]))
        chains[link] = _serial(_layout(described), SPACE, 1.0)
    return chains


def _serial(layout: Layout, task: tuple[str, ...], length: float) -> SerialChain:
    return SerialChain(
        task=task,
        length=length,
        placements=layout.placements(),
        sliding=layout.sliding,
        lower=layout.lower,
        upper=layout.upper,
        max_speed=layout.max_speed,
    )


def arm_of(robot: Robot) -> Arm:
    """The planar chain of the section ``dataset.robot`` and its plane, whatever its task.

    Raises ConfigError for what :func:`describe` and :func:`plane_of` refuse, and for joints that
    are not three revolute ones with limits.
    """
    described = describe(robot)
    layout = _layout(described)
    if why := unlike_three(layout):
        raise ConfigError(f"robot.joints: {why}", file=described.file)
    rotation, translation = plane_of(layout, described.file)
    chain = planar_chain(layout.seen_from(rotation, translation), described.file)
    return Arm(chain, rotation, translation)


def load_arm(
    urdf: str | Path, joints: Sequence[str], tool: str | None, locked: Mapping[str, float]
) -> Arm:
    """The arm of three parallel ``joints`` of a URDF, every other joint locked at ``locked`` (rad;
    0 where not named); raises what :func:`arm_of` does.
    """
    return arm_of(Robot(str(urdf), list(joints), tool, locked=dict(locked), plane=True))


def _model(described: Description) -> pin.Model:
    """Pinocchio's model of the arm alone, every other joint of its URDF held; its links have the
    names of :meth:`pipeline.arm.urdf.Tree.model_name`.
    """
    joints = [joint.name for joint in described.joints]
    try:
        full = pin.buildModelFromXML(_renamed(described.tree))
        step = np.zeros(full.nv)
        for name, value in described.held.items():
            step[full.joints[full.getJointId(name)].idx_v] = value
        others = [full.getJointId(name) for name in full.names[1:] if name not in joints]
        return pin.buildReducedModel(full, others, pin.integrate(full, pin.neutral(full), step))
    except (ValueError, RuntimeError, IndexError) as error:
        reason = " ".join(str(error).split())[:200]
        message = f"robot.urdf: Pinocchio does not read it ({reason}); check it with check_urdf"
        raise ConfigError(message, file=described.file) from None


def _renamed(tree: Tree) -> str:
    """Text of the URDF with its links under their names in the model."""
    robot = ElementTree.parse(tree.file).getroot()
    for key, elements in {"name": robot.findall("link"), "link": robot.findall("joint/*")}.items():
        for element in elements:
            if key in element.attrib:
                element.set(key, tree.model_name(element.get(key)))
    return ElementTree.tostring(robot, encoding="unicode")


def _layout(described: Description) -> Layout:
    """The arm in the axes of its base."""
    model, joints = _model(described), described.joints
    data, zero = model.createData(), pin.neutral(model)
    # one column comes as a vector
    jacobian = pin.computeJointJacobians(model, data, zero).reshape(6, -1)
    pin.updateFramePlacements(model, data)
    sliding = np.array([joint.kind == "prismatic" for joint in joints])
    # a joint's column of the Jacobian is the axis it turns about or slides along, in the root's
    # axes
    axes = np.where(sliding, jacobian[:3], jacobian[3:]).T
    for joint, length in zip(joints, np.linalg.norm(axes, axis=1), strict=True):
        if not abs(length - 1.0) < 1e-6:
            message = f"robot.urdf: the axis of {joint.name} has length {length:.3g}; make it 1"
            raise ConfigError(message, file=described.file)
    tip = data.oMf[model.getFrameId(described.tree.model_name(described.tip), pin.FrameType.BODY)]
    lower, upper = np.array([joint.range for joint in joints]).T
    layout = Layout(
        names=tuple(joint.name for joint in joints),
        sliding=sliding,
        axes=axes,
        points=np.array([data.oMi[i].translation for i in range(1, model.njoints)]),
        rotation=tip.rotation.copy(),
        position=tip.translation.copy(),
        lower=lower.copy(),
        upper=upper.copy(),
        max_speed=model.upperVelocityLimit.copy(),
    )
    if described.base is None:
        return layout
    base = data.oMf[model.getFrameId(described.tree.model_name(described.base), pin.FrameType.BODY)]
    return layout.seen_from(base.rotation, base.translation)


def _require_movable(chain: SerialChain, file: Path) -> None:
    """Raise ConfigError where the arm cannot move a row of the task at any of :data:`SAMPLES` poses
    spread evenly over its limits, or not all of its rows at once.
    """
    n = len(chain.lower)
    low, high = (np.clip(limit, -np.pi, np.pi) for limit in (chain.lower, chain.upper))
    spread = np.outer(np.arange(SAMPLES), 2.0 ** (np.arange(1, n + 1) / (n + 1))) % 1.0
    q = low + (high - low) * spread
    still = np.abs(chain.jacobian(q)).max(axis=(0, 2)) <= 1e-9 * chain.scale
    if np.any(still):
        rows = ", ".join(name for name, rests in zip(chain.task, still, strict=True) if rests)
        raise ConfigError(f"robot.task: the arm cannot move {rows}; leave it out", file=file)
    if chain.singular(q).all():
        raise ConfigError(
            f"robot.task: the arm moves none of {', '.join(chain.task)} without another; leave out "
            "rows that follow from the others",
            file=file,
        )
