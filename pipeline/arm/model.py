"""Planar and spatial chains of the arms in URDF files."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy import ndarray

from pipeline.arm.chain import Chain, PlanarChain, SerialChain
from pipeline.arm.urdf import Tree, describe, read_urdf
from pipeline.core.columns import PLANE, SPACE
from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Robot

SAMPLES = 64  # poses at which the rows of the task are tested
# prefix of the names of links in a reduced model, whose joints may have the same names
LINK = "link "
# greatest sine of the angle between an axis and the plane's normal
PLANAR_TOLERANCE = 1e-6
SHORTEST_LINK = 1e-3  # m, of a planar chain


@dataclass(frozen=True)
class Arm:
    """A planar chain, and the frame of its plane (x, normal y, z) in the base frame."""

    chain: PlanarChain
    rotation: ndarray  # (3, 3) axes of the plane in the base frame, in columns
    # (3,) origin of the plane in the base frame, m; O1 lies in y = 0
    translation: ndarray

    def to_plane(self, points: ndarray) -> ndarray:
        """(..., 3) coordinates in the plane's frame of ``points`` (..., 3) in the base frame, m."""
        return (points - self.translation) @ self.rotation

    def to_base(self, points: ndarray) -> ndarray:
        """(..., 3) coordinates in the base frame of ``points`` (..., 3) in the plane's, m."""
        return points @ self.rotation.T + self.translation


def chain_of(robot: Robot) -> Chain:
    """Return the chain of the options ``dataset.robot``: planar if three parallel revolute joints
    move the whole pose in their plane, else serial. Raises ConfigError as :func:`describe`, for
    axes that have no common ``plane``, and for task rows that the arm cannot move.
    """
    layout = layout_of(robot)
    task = tuple(robot.task or (PLANE if robot.plane else SPACE))
    if robot.plane:
        layout = layout.in_frame(*_plane_of(layout))
        if task == PLANE and robot.length == 1.0 and layout.is_planar_arm:
            return _planar(layout)
    chain = layout.serial(task, float(robot.length))
    _require_movable(chain, layout.file)
    return chain


def _require_movable(chain: Chain, file: Path) -> None:
    """Raise ConfigError for task rows that the arm cannot move at any of SAMPLES poses, a Kronecker
    sequence within its limits.
    """
    n = len(chain.lower)
    low = np.clip(chain.lower, -np.pi, np.pi)
    high = np.clip(chain.upper, -np.pi, np.pi)
    irrational = 2.0 ** (np.arange(1, n + 1) / (n + 1))
    shares = np.outer(np.arange(SAMPLES), irrational) % 1.0
    q = low + (high - low) * shares
    if not chain.singular(q).all():
        return
    greatest = np.abs(chain.scaled_jacobian(q)).max(axis=(0, 2))
    still = np.array(chain.task)[greatest <= 1e-9]
    rows = ", ".join(still)
    if not rows:
        rows = f"{', '.join(chain.task)} independently of each other"
    message = f"robot.task: the arm cannot move {rows}; remove task rows"
    raise ConfigError(message, file=file)


def link_chains(robot: Robot, links: Iterable[str], key: str) -> dict[str, SerialChain]:
    """Return for each of ``links`` (named by the option ``key``) the chain of joints that moves it.
    The task is the whole pose of the link in the base frame, in m and rad. Raises ConfigError for a
    link that the arm does not move, and as :func:`describe`.
    """
    tree = read_urdf(Path(robot.urdf))
    chains = {}
    for link in links:
        above = tree.above(tree.link(link, key))
        joints = [name for name in robot.joints if name in above]
        if not joints:
            raise ConfigError(
                f"{key}: no joint of the arm moves {link!r}",
                file=tree.file,
            )
        to_link = replace(robot, joints=joints, tool=link, plane=False, task=["x"])
        chains[link] = layout_of(to_link, tree).serial(SPACE, 1.0)
    return chains


def arm_of(robot: Robot) -> Arm:
    """Planar chain of the options ``dataset.robot`` and its plane. Raises ConfigError as
    :func:`describe`, and if the joints are not three parallel revolute joints with limits.
    """
    layout = layout_of(robot)
    if not layout.is_planar_arm:
        message = f"robot.joints: {layout.names} must be three revolute joints"
        raise ConfigError(f"{message} with limits", file=layout.file)
    place = _plane_of(layout)
    return Arm(_planar(layout.in_frame(*place)), *place)


def planar_tools(tree: Tree, joints: list[str]) -> list[str]:
    """Return the last links that can be the tool of a planar chain of three ``joints``; raises
    ConfigError as :func:`arm_of` where none can.
    """
    tools = []
    fault = ConfigError("robot.joints: not one chain", file=tree.file)
    for end in tree.ends:
        if [name for name in tree.above(end) if name in joints] != joints:
            continue
        try:
            layout = layout_of(Robot(str(tree.file), joints, end, plane=True), tree)
            _planar(layout.in_frame(*_plane_of(layout)))
            tools.append(end)
        except ConfigError as error:
            fault = error
    if not tools:
        raise fault
    return tools


@dataclass(frozen=True)
class Layout:
    """The n joints of an arm at zero angles, base to tip, and the tip's pose, in one frame."""

    file: Path  # URDF
    names: Sequence[str]  # of the joints
    sliding: ndarray  # (n,) True for a prismatic joint
    axes: ndarray  # (n, 3) unit vectors of the joints' axes
    points: ndarray  # (n, 3) a point of each axis, m
    rotation: ndarray  # (3, 3) of the tip
    position: ndarray  # (3,) of the tip, m
    # (3, n) lower, upper (rad or m), speed (per s); infinite without one
    limits: ndarray

    def in_frame(self, rotation: ndarray, translation: ndarray) -> "Layout":
        """Layout in the frame at ``translation``, m, with the columns of ``rotation`` as axes."""
        return replace(
            self,
            axes=self.axes @ rotation,
            points=(self.points - translation) @ rotation,
            rotation=rotation.T @ self.rotation,
            position=(self.position - translation) @ rotation,
        )

    def serial(self, task: tuple[str, ...], length: float) -> SerialChain:
        """Chain for ``task``: z of a joint's frame is the axis, x the previous x projected."""
        frames = []
        previous = np.eye(3)
        for axis in self.axes:
            slanted = abs(previous[:, 0] @ axis) < 0.9
            across = previous[:, 0] if slanted else previous[:, 1]
            x = across - axis * (axis @ across)
            x /= np.linalg.norm(x)
            previous = np.stack([x, np.cross(axis, x), axis], axis=1)
            frames.append(previous)

        placements = []
        previous = np.eye(3)
        origin = np.zeros(3)
        points = [*self.points, self.position]
        for frame, point in zip([*frames, self.rotation], points, strict=True):
            turn = previous.T @ frame
            shift = (point - origin) @ previous
            placements.append(np.append(turn, shift))
            previous = frame
            origin = point
        return SerialChain(
            task,
            length,
            np.array(placements),
            self.sliding,
            *self.limits,
        )

    @property
    def is_planar_arm(self) -> bool:
        """True for three revolute joints with limits."""
        limited = bool(np.isfinite(self.limits[:2]).all())
        return limited and len(self.names) == 3 and not self.sliding.any()


@lru_cache(maxsize=1)
def _reduced_model(
    tree: Tree,
    names: tuple[str, ...],
    held: tuple[tuple[str, float], ...],
) -> tuple[pin.Model, pin.Data]:
    """Model of the joints ``names`` with all other joints fixed, at zero or where they are
    ``held``, and its placements and Jacobian at zero angles: one for all tips of these joints.
    """
    full = tree.model.copy()
    for frame in full.frames:
        if frame.type == pin.FrameType.BODY:
            frame.name = LINK + frame.name
    step = np.zeros(full.nv)
    for name, value in held:
        step[full.joints[full.getJointId(name)].idx_v] = value
    outside = [full.getJointId(name) for name in full.names[1:] if name not in names]
    held_pose = pin.integrate(full, pin.neutral(full), step)
    model = pin.buildReducedModel(full, outside, held_pose)
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    pin.updateFramePlacements(model, data)
    return model, data


def layout_of(robot: Robot, tree: Tree | None = None) -> Layout:
    """Layout of the arm in the base frame; all other joints of the URDF, its ``tree`` if read, are
    fixed. Raises ConfigError as :func:`describe`, and for an axis that is not a unit vector.
    """
    tree, base, tip, held = describe(robot, tree)
    names = robot.joints
    model, data = _reduced_model(tree, tuple(names), tuple(held.items()))
    jacobian = data.J.reshape(6, -1)  # a single column is a vector in Pinocchio
    joints = [tree.joints[name] for name in names]
    sliding = np.array([joint.kind == "prismatic" for joint in joints])
    # a joint's column of the Jacobian is its axis in the root's frame
    axes = np.where(sliding, jacobian[:3], jacobian[3:]).T
    for name, length in zip(names, np.linalg.norm(axes, axis=1), strict=True):
        if not abs(length - 1.0) < 1e-6:
            message = f"robot.urdf: the axis of {name} has length {length:.3g}"
            raise ConfigError(f"{message}; make it 1", file=tree.file)
    points = np.array([data.oMi[i].translation for i in range(1, model.njoints)])
    lower = [joint.lower for joint in joints]
    upper = [joint.upper for joint in joints]

    def placement(link: str) -> pin.SE3:
        return data.oMf[model.getFrameId(LINK + link, pin.FrameType.BODY)]

    tip_pose = placement(tip)
    layout = Layout(
        file=tree.file,
        names=names,
        sliding=sliding,
        axes=axes,
        points=points,
        rotation=tip_pose.rotation.copy(),
        position=tip_pose.translation.copy(),
        limits=np.array([lower, upper, model.upperVelocityLimit]),
    )
    if base is None:
        return layout
    root = placement(base)
    return layout.in_frame(root.rotation, root.translation)


def _plane_of(layout: Layout) -> tuple[ndarray, ndarray]:
    """Rotation (3, 3) and origin (3,) in m of the plane in which the tip of ``layout`` moves. y is
    parallel to the axis of the first revolute joint, O1 lies in y = 0, and z is the projection of
    the frame's z axis (y axis in a horizontal plane). Raises ConfigError without a common plane.
    """
    first = int(np.argmin(layout.sliding))
    axis = layout.axes[first]
    normal = axis / np.linalg.norm(axis)
    out_of_line = np.linalg.norm(np.cross(normal, layout.axes), axis=1)
    along = np.abs(layout.axes @ normal)
    sines = np.where(layout.sliding, along, out_of_line)
    leaning = np.array(layout.names)[sines > PLANAR_TOLERANCE]
    if leaning.size:
        raise ConfigError(
            f"robot.joints: the axes of {', '.join(leaning)} are not parallel to "
            f"{layout.names[first]}; a planar chain needs parallel axes",
            file=layout.file,
            axes=layout.axes.round(4).tolist(),
        )
    up = np.array([0.0, 0.0, 1.0])
    if abs(normal[2]) >= 0.99:  # of a horizontal plane
        up = np.array([0.0, 1.0, 0.0])
    up = up - normal * (up @ normal)
    up /= np.linalg.norm(up)
    rotation = np.stack([np.cross(normal, up), normal, up], axis=1)
    return rotation, normal * (normal @ layout.points[0])


def _planar(layout: Layout) -> PlanarChain:
    """Planar chain of a ``layout`` in the frame of its plane."""
    points = np.vstack([layout.points, layout.position])
    places = points[:, [0, 2]]
    links = np.diff(places, axis=0)
    lengths = np.hypot(*links.T)
    if lengths.min() < SHORTEST_LINK:
        message = "robot: joints or tool of the chain lie on one axis"
        raise ConfigError(message, file=layout.file, lengths=lengths.round(4).tolist())
    signs = np.sign(layout.axes[:, 1])
    return PlanarChain(places[0], links, signs, *layout.limits)
