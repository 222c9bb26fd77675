"""Arms from their URDF, planar or in space; the one module that imports Pinocchio."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from pipeline.arm.chain import PlanarChain
from pipeline.arm.interface import Chain
from pipeline.arm.serial import SerialChain
from pipeline.arm.urdf import Description, describe, read_urdf
from pipeline.core.columns import PLANE, SPACE
from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Robot

SAMPLES = 64  # poses at which the arm shows what it can move
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


def chain_of(robot: Robot) -> Chain:
    """The chain of the section ``dataset.robot`` and its task.

    Three parallel revolute joints with the whole pose in their plane as the task have closed forms;
    every other arm is a serial chain. Raises ConfigError for what :func:`describe` refuses, joints
    that are no plane's where one is asked for, and a task with rows that the arm cannot move.
    """
    layout = _layout(describe(robot))
    task = tuple(robot.task or (PLANE if robot.plane else SPACE))
    if robot.plane:
        layout = layout.seen_from(*_plane_of(layout))
        if task == PLANE and robot.length == 1.0 and _unlike_three(layout) is None:
            return _planar(layout)
    chain = layout.serial(task, float(robot.length))
    _require_movable(chain, layout.file)
    return chain


def link_chains(robot: Robot, links: Iterable[str], key: str) -> dict[str, SerialChain]:
    """For each of the ``links`` that the option ``key`` names the chain of those joints of the arm
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
        own = replace(robot, joints=joints, tool=link, plane=False, task=["x"])
        chains[link] = _layout(describe(own)).serial(SPACE, 1.0)
    return chains


def arm_of(robot: Robot) -> Arm:
    """The planar chain of the section ``dataset.robot`` and its plane, whatever its task.

    Raises ConfigError for what :func:`describe` refuses, joints of no common plane, and joints that
    are not three revolute ones with limits.
    """
    layout = _layout(describe(robot))
    if why := _unlike_three(layout):
        raise ConfigError(f"robot.joints: {why}", file=layout.file)
    place = _plane_of(layout)
    return Arm(_planar(layout.seen_from(*place)), *place)


def load_arm(
    urdf: str | Path, joints: Sequence[str], tool: str | None, locked: Mapping[str, float]
) -> Arm:
    """The arm of three parallel ``joints`` of a URDF, every other joint locked at ``locked`` (rad;
    0 where not named); raises what :func:`arm_of` does.
    """
    return arm_of(Robot(str(urdf), list(joints), tool, locked=dict(locked), plane=True))


@dataclass(frozen=True)
class Layout:
    """The n joints of an arm at zero, one behind the other, and its tip, in some frame."""

    file: Path  # URDF
    names: Sequence[str]  # of the joints
    sliding: np.ndarray  # (n,) True of a prismatic joint
    axes: np.ndarray  # (n, 3) unit vectors that the joints turn about or slide along
    points: np.ndarray  # (n, 3) one of each axis, m
    rotation: np.ndarray  # (3, 3) of the tip
    position: np.ndarray  # (3,) of the tip, m
    limits: np.ndarray  # (3, n) lower, upper (rad or m), speed (per s); infinite without one

    def seen_from(self, rotation: np.ndarray, translation: np.ndarray) -> Layout:
        """The same in the frame whose axes are the columns of ``rotation`` (3, 3), and whose origin
        is ``translation`` (3,) in m.
        """
        return replace(
            self,
            axes=self.axes @ rotation,
            points=(self.points - translation) @ rotation,
            rotation=rotation.T @ self.rotation,
            position=(self.position - translation) @ rotation,
        )

    def serial(self, task: tuple[str, ...], length: float) -> SerialChain:
        """The chain with the ``task``; each joint's frame has its z axis along the joint, and the x
        axis of the frame before as far as it is across, so that parallel joints have parallel
        frames.
        """
        placements, before, origin = [], np.eye(3), np.zeros(3)
        for axis, point in zip(self.axes, self.points, strict=True):
            across = before[:, 0] if abs(before[:, 0] @ axis) < 0.9 else before[:, 1]
            x = across - axis * (axis @ across)
            x /= np.linalg.norm(x)
            frame = np.stack([x, np.cross(axis, x), axis], axis=1)
            placements.append([*(before.T @ frame).ravel(), *((point - origin) @ before)])
            before, origin = frame, point
        tip = [*(before.T @ self.rotation).ravel(), *((self.position - origin) @ before)]
        return SerialChain(task, length, np.array([*placements, tip]), self.sliding, *self.limits)


def _model(described: Description) -> pin.Model:
    """Pinocchio's model of the arm alone, every other joint of its URDF held."""
    tree, joints = described.tree, [joint.name for joint in described.joints]
    robot = deepcopy(tree.root)
    for key, elements in {"name": robot.findall("link"), "link": robot.findall("joint/*")}.items():
        for element in elements:
            if key in element.attrib:
                element.set(key, tree.model_name(element.get(key)))
    try:
        full = pin.buildModelFromXML(ElementTree.tostring(robot, encoding="unicode"))
        step = np.zeros(full.nv)
        for name, value in described.held.items():
            step[full.joints[full.getJointId(name)].idx_v] = value
        others = [full.getJointId(name) for name in full.names[1:] if name not in joints]
        return pin.buildReducedModel(full, others, pin.integrate(full, pin.neutral(full), step))
    except (ValueError, RuntimeError, IndexError) as error:
        reason = " ".join(str(error).split())[:200]
        message = f"robot.urdf: Pinocchio does not read it ({reason}); check it with check_urdf"
        raise ConfigError(message, file=tree.file) from None


def _layout(described: Description) -> Layout:
    """The arm in the axes of its base."""
    model, tree, joints = _model(described), described.tree, described.joints
    data, zero = model.createData(), pin.neutral(model)
    # one column comes as a vector
    jacobian = pin.computeJointJacobians(model, data, zero).reshape(6, -1)
    pin.updateFramePlacements(model, data)
    ids = [
        model.getFrameId(tree.model_name(link), pin.FrameType.BODY)
        for link in (described.tip, described.base)
        if link is not None
    ]
    tip, *base = (data.oMf[number] for number in ids)
    sliding = np.array([joint.kind == "prismatic" for joint in joints])
    # the axis of a joint is its column of the Jacobian, in the root's axes
    axes = np.where(sliding, jacobian[:3], jacobian[3:]).T
    for joint, length in zip(joints, np.linalg.norm(axes, axis=1), strict=True):
        if not abs(length - 1.0) < 1e-6:
            message = f"robot.urdf: the axis of {joint.name} has length {length:.3g}; make it 1"
            raise ConfigError(message, file=tree.file)
    points = np.array([data.oMi[i].translation for i in range(1, model.njoints)])
    ranges = np.array([joint.range for joint in joints]).T
    limits = np.vstack([ranges, model.upperVelocityLimit])
    names, ends = [joint.name for joint in joints], (tip.rotation.copy(), tip.translation.copy())
    layout = Layout(tree.file, names, sliding, axes, points, *ends, limits)
    return layout.seen_from(base[0].rotation, base[0].translation) if base else layout


def _plane_of(layout: Layout) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and origin (3,) in m of the plane in which the tip of ``layout`` moves: y is
    the axis of the first revolute joint, z the frame's z as far as it lies in the plane (the
    frame's y where the plane is horizontal), and the first joint lies in y = 0. ConfigError where a
    joint turns about another direction or slides out of the plane.
    """
    if layout.sliding.all():
        message = "robot.plane: no joint turns, and there is no plane to turn in; set it to false"
        raise ConfigError(message, file=layout.file)
    normal = layout.axes[~layout.sliding][0]
    normal = normal / np.linalg.norm(normal)
    out_of_line = np.linalg.norm(np.cross(normal, layout.axes), axis=1)
    leaning = np.where(layout.sliding, np.abs(layout.axes @ normal), out_of_line)
    if np.any(leaning > PLANAR_TOLERANCE):
        wrong = np.array(layout.names)[leaning > PLANAR_TOLERANCE]
        message = (
            "robot.joints: the axes are not parallel, so they form no planar chain: "
            f"not to that of {layout.names[int(np.argmin(layout.sliding))]} is {', '.join(wrong)}"
        )
        raise ConfigError(message, file=layout.file, axes=layout.axes.round(4).tolist())
    up = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < 0.99 else np.array([0.0, 1.0, 0.0])
    up = up - normal * (up @ normal)
    up /= np.linalg.norm(up)
    rotation = np.stack([np.cross(normal, up), normal, up], axis=1)
    return rotation, normal * (normal @ layout.points[0])


def _unlike_three(layout: Layout) -> str | None:
    """Message for joints that are not three revolute ones with limits; None for those."""
    unlike = layout.sliding | ~np.isfinite(layout.limits[:2]).all(axis=0)
    wrong = ", ".join(np.array(layout.names)[unlike])
    which = f", which {wrong} is not" if wrong else ""
    message = f"{list(layout.names)} must be three revolute joints with limits{which}"
    return message if wrong or len(unlike) != len(PLANE) else None


def _planar(layout: Layout) -> PlanarChain:
    """The chain of three revolute joints seen in its plane."""
    places = np.vstack([layout.points, layout.position])[:, [0, 2]]
    links = np.diff(places, axis=0)
    lengths = np.hypot(*links.T)
    if np.any(lengths < SHORTEST_LINK):
        message = "robot: joints or tool of the chain lie on one axis"
        raise ConfigError(message, file=layout.file, lengths=lengths.round(4).tolist())
    return PlanarChain(places[0], links, np.sign(layout.axes[:, 1]), *layout.limits)


def _require_movable(chain: SerialChain, file: Path) -> None:
    """Raise ConfigError for rows of the task that the arm cannot move, at spread poses."""
    n = len(chain.lower)
    low, high = (np.clip(limit, -np.pi, np.pi) for limit in (chain.lower, chain.upper))
    spread = np.outer(np.arange(SAMPLES), 2.0 ** (np.arange(1, n + 1) / (n + 1))) % 1.0
    q = low + (high - low) * spread
    still = np.abs(chain.jacobian(q)).max(axis=(0, 2)) <= 1e-9 * chain.scale
    if np.any(still):
        rows = ", ".join(np.array(chain.task)[still])
        raise ConfigError(f"robot.task: the arm cannot move {rows}; leave it out", file=file)
    if chain.singular(q).all():
        found = f"robot.task: the arm moves none of {', '.join(chain.task)} without another"
        raise ConfigError(f"{found}; leave out rows that follow from the others", file=file)
