"""Arms from their URDF, planar or in space; the one module that imports Pinocchio."""

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
LINK = "link "  # before the names of links in Pinocchio
FARTHEST = 1e6  # m, of an origin
PLANAR_TOLERANCE = 1e-6  # sine of the angle by which an axis may lean out of the common normal
SHORTEST_LINK = 1e-3  # m; joints nearer than this do not span a chain


@dataclass(frozen=True)
class Arm:
    """A planar chain, and its plane's axes x, normal y and z and origin in the base frame."""

    chain: PlanarChain
    rotation: np.ndarray  # (3, 3) plane axes in the base frame
    # (3,) origin of the plane's coordinates in the base frame, m; O1 lies in the plane y = 0
    translation: np.ndarray

    def to_plane(self, points: np.ndarray) -> np.ndarray:
        """(..., 3) base-frame points (m) → x, y (along the normal) and z of the plane's frame."""
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
        if task == PLANE and robot.length == 1.0 and _three_joints(layout):
            return _planar(layout)
    chain = layout.serial(task, float(robot.length))
    _require_movable(chain, layout.file)
    return chain


def link_chains(robot: Robot, links: Iterable[str], key: str) -> dict[str, SerialChain]:
    """For each of the ``links`` that the option ``key`` names the chain of those joints of the arm
    that move it: its tip is the link's frame, its task the whole pose, in metres and radians, in
    the axes of the arm's base. Raises ConfigError for a link that the arm does not move, and for
    what :func:`describe` refuses.
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
    if not _three_joints(layout):
        message = f"robot.joints: {layout.names} must be three revolute joints with limits"
        raise ConfigError(message, file=layout.file)
    place = _plane_of(layout)
    return Arm(_planar(layout.seen_from(*place)), *place)


def load_arm(
    urdf: str | Path, joints: Sequence[str], tool: str | None, locked: Mapping[str, float]
) -> Arm:
    """The arm of three parallel ``joints`` of a URDF; raises what :func:`arm_of` does."""
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

    def seen_from(self, rotation: np.ndarray, translation: np.ndarray) -> "Layout":
        """The same in the frame with the columns of ``rotation`` as axes and this origin in m."""
        return replace(
            self,
            axes=self.axes @ rotation,
            points=(self.points - translation) @ rotation,
            rotation=rotation.T @ self.rotation,
            position=(self.position - translation) @ rotation,
        )

    def serial(self, task: tuple[str, ...], length: float) -> SerialChain:
        """The chain with the ``task``; each joint's frame has its z axis along the joint, and the x
        axis of the frame before as far as it is across.
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


def _layout(described: Description) -> Layout:
    """The arm in the axes of its base, every other joint of its URDF held."""
    tree, joints = described.tree, described.joints
    names, robot = [joint.name for joint in joints], deepcopy(tree.root)
    for key, elements in {"name": robot.findall("link"), "link": robot.findall("joint/*")}.items():
        for element in elements:
            if key in element.attrib:  # Pinocchio has one set of names of links and joints
                element.set(key, LINK + element.get(key))
    try:
        full = pin.buildModelFromXML(ElementTree.tostring(robot, encoding="unicode"))
        step = np.zeros(full.nv)
        for name, value in described.held.items():
            step[full.joints[full.getJointId(name)].idx_v] = value
        others = [full.getJointId(name) for name in full.names[1:] if name not in names]
        held = pin.integrate(full, pin.neutral(full), step)
        model = pin.buildReducedModel(full, others, held)
    except (ValueError, RuntimeError, IndexError) as error:
        reason = " ".join(str(error).split())[:200]
        message = f"robot.urdf: Pinocchio does not read it ({reason}); check it with check_urdf"
        raise ConfigError(message, file=tree.file) from None
    data = model.createData()
    # one column comes as a vector
    jacobian = pin.computeJointJacobians(model, data, pin.neutral(model)).reshape(6, -1)
    pin.updateFramePlacements(model, data)
    ends = [link for link in (described.tip, described.base) if link is not None]
    ids = [model.getFrameId(LINK + link, pin.FrameType.BODY) for link in ends]
    tip, *base = (data.oMf[number] for number in ids)
    sliding = np.array([joint.kind == "prismatic" for joint in joints])
    # the axis of a joint is its column of the Jacobian, in the root's axes
    axes = np.where(sliding, jacobian[:3], jacobian[3:]).T
    points = np.array([data.oMi[i].translation for i in range(1, model.njoints)])
    for name, length in zip(names, np.linalg.norm(axes, axis=1), strict=True):
        if not (abs(length - 1.0) < 1e-6 and np.abs([*points, tip.translation]).max() < FARTHEST):
            message = f"robot.urdf: the axis of {name} has length {length:.3g}; make it 1, and all "
            message += f"origins less than {FARTHEST:g} m away"
            raise ConfigError(message, file=tree.file)
    limits = [*np.array([joint.range for joint in joints]).T, model.upperVelocityLimit]
    place = tip.rotation.copy(), tip.translation.copy()
    layout = Layout(tree.file, names, sliding, axes, points, *place, np.vstack(limits))
    return layout.seen_from(base[0].rotation, base[0].translation) if base else layout


def _plane_of(layout: Layout) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and origin (3,) in m of the plane in which the tip of ``layout`` moves: y is
    the axis of the first revolute joint, z the frame's z as far as it lies in the plane (the
    frame's y where the plane is horizontal), and the first joint lies in y = 0. ConfigError where a
    joint turns about another direction or slides out of the plane.
    """
    normal = layout.axes[int(np.argmin(layout.sliding))]
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


def _three_joints(layout: Layout) -> bool:
    return len(layout.names) == 3 and bool(
        np.isfinite(layout.limits[:2]).all() and not layout.sliding.any()
    )


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
