"""Robot of a URDF file as Pinocchio's model, and the configured arm in the robot.

Links, joints, their placements and limits are Pinocchio's. The XML is read for what Pinocchio does
not give: a file's size, syntax errors with their line, entities, macros of xacro, joints without
limits in an error, and the couplings of joints (mimic), which the model leaves out.
"""

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryFile
from typing import NamedTuple
from xml.etree import ElementTree

import pinocchio as pin

from pipeline.core.bounds import read_whole, require
from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Robot

LIMITED = ("revolute", "prismatic")  # kinds of joints with one coordinate and limits
SINGLE = (*LIMITED, "continuous")  # with one coordinate
XACRO = "a xacro: expand it with xacro {} > arm.urdf"
# an entity's text may be used any number of times: a small file can fill the memory
ENTITIES = (
    "it declares entities, which are not read: write their texts where they are used"
)
NO_LIMITS = (
    "the joint {} has no limits; give it <limit lower upper velocity effort>, or the type "
    "continuous"
)
UNCONNECTED = "{} of its {} links are below the root: connect all links by joints"


class Joint(NamedTuple):
    """Joint of a URDF with its limits, which are infinite where the file states none."""

    name: str
    kind: str  # as in the URDF
    lower: float = -math.inf  # rad or m
    upper: float = math.inf
    speed: float = math.inf  # rad/s or m/s


class Coupling(NamedTuple):
    """Joint ``follows`` to which a joint is coupled: multiplier·q + offset."""

    follows: str
    multiplier: float
    offset: float  # rad or m


@dataclass(frozen=True, eq=False)
class Tree:
    """Links and joints of a URDF file."""

    file: Path
    name: str  # of the robot
    model: pin.Model  # of all joints, without couplings
    couplings: dict[str, Coupling]  # by coupled joint of one coordinate

    @cached_property
    def bodies(self) -> dict[str, pin.Frame]:
        """Links in Pinocchio's order: link → frame."""
        bodies = {}
        for frame in self.model.frames:
            if frame.type == pin.FrameType.BODY:
                bodies[frame.name] = frame
        return bodies

    @cached_property
    def children(self) -> dict[str, str]:
        """Joint → link that the joint moves or holds."""
        children = {}
        for link, frame in self.bodies.items():
            joint = self.model.frames[frame.parentFrame]
            if joint.name != "universe":
                children[joint.name] = link
        return children

    @cached_property
    def joints(self) -> dict[str, Joint]:
        """Joints by name, in Pinocchio's order."""
        joints = {}
        for name in self.children:
            movable = self.model.existJointName(name)
            joints[name] = self._movable(name) if movable else Joint(name, "fixed")
        return joints

    def _movable(self, name: str) -> Joint:
        """Return the joint ``name`` of Pinocchio's model."""
        model = self.model
        joint = model.joints[model.getJointId(name)]
        if joint.nv > 1:
            return Joint(name, "planar" if joint.nv == 3 else "floating")
        speed = float(model.upperVelocityLimit[joint.idx_v])
        if joint.nq == 2:  # cosine and sine
            return Joint(name, "continuous", speed=speed)
        sliding = joint.shortname().startswith("JointModelP")
        return Joint(
            name,
            kind="prismatic" if sliding else "revolute",
            lower=float(model.lowerPositionLimit[joint.idx_q]),
            upper=float(model.upperPositionLimit[joint.idx_q]),
            speed=speed,
        )

    @cached_property
    def ends(self) -> list[str]:
        """Links without child joints."""
        inner = set()
        for frame in self.bodies.values():
            joint = self.model.frames[frame.parentFrame]
            inner.add(self.model.frames[joint.parentFrame].name)
        return [link for link in self.bodies if link not in inner]

    def above(self, link: str) -> list[str]:
        """Movable joints from the root to ``link``."""
        path = self.model.supports[self.bodies[link].parentJoint]
        return [self.model.names[i] for i in path if i > 0]

    def link(self, name: str, key: str) -> str:
        """Link ``name``, or the link that a joint ``name`` moves; else ConfigError for ``key``."""
        if name in self.bodies:
            return name
        if name not in self.children:
            raise ConfigError(f"{key}: no frame {name!r} in the URDF", file=self.file)
        return self.children[name]


def read_urdf(file: Path) -> Tree:
    """Return the tree in ``file``; raises ConfigError if it is not a URDF file."""
    file = Path(file)
    try:
        return _tree(file, _root(file))
    except OSError as error:
        reason = error.strerror
        line = None
        message = f"cannot be read ({reason}); state its path from the project's root"
    except ElementTree.ParseError as error:
        message = f"this is not a URDF file ({error.msg})"
        line = error.position[0]
        if "unbound prefix" in error.msg:
            message = XACRO.format(file.name)
    except (LookupError, ValueError) as error:  # of an encoding or the content
        message = f"this is not a URDF file ({error})"
        line = None
    raise ConfigError(f"robot.urdf: {message}", file=file, line=line) from None


def _root(file: Path) -> ElementTree.Element:
    """Return the root element of ``file``; raises ValueError where it has entities or macros."""
    content = read_whole(file)
    if b"<!ENTITY" in content.replace(b"\0", b""):  # zeros of UTF-16
        raise ValueError(ENTITIES)
    root = ElementTree.fromstring(content)
    words = [element.tag for element in root.iter()]
    for element in root.findall("joint/*"):
        words += element.attrib.values()
    if any("xacro" in word or "$" in word for word in words):
        raise ValueError(XACRO.format(file.name))
    return root


def _tree(file: Path, root: ElementTree.Element) -> Tree:
    """Return the tree below ``root``; raises ValueError where it is not one tree."""
    joints = root.findall("joint")
    require("joints", len(joints), "joints", file)
    for joint in joints:
        limit = joint.find("limit")
        stated = set() if limit is None else limit.keys()
        if joint.get("type") in LIMITED and not {"velocity", "effort"} <= {*stated}:
            raise ValueError(NO_LIMITS.format(joint.get("name")))
    model = _model_of(ElementTree.tostring(root, encoding="unicode"))
    tree = Tree(file, root.get("name", ""), model, _couplings(joints))
    links = len(root.findall("link"))
    if len(tree.bodies) != links:
        raise ValueError(UNCONNECTED.format(len(tree.bodies), links))
    return tree


def _model_of(text: str) -> pin.Model:
    """Return Pinocchio's model of the URDF ``text``; raises ValueError with the first message of
    the URDF parser, which prints its messages on standard error.
    """
    with TemporaryFile() as messages:
        standard_error = os.dup(2)
        os.dup2(messages.fileno(), 2)
        try:
            return pin.buildModelFromXML(text)
        except (ValueError, RuntimeError) as error:
            reason = str(error)
        finally:
            os.dup2(standard_error, 2)
            os.close(standard_error)
        messages.seek(0)
        first = messages.readline().decode(errors="replace")
    reason = first.removeprefix("Error:").strip().rstrip(".") or reason
    raise ValueError(f"{reason[:300]}; correct it: check_urdf shows the same fault")


def _couplings(joints: list[ElementTree.Element]) -> dict[str, Coupling]:
    """Return the couplings of ``joints``, which Pinocchio has accepted, by the coupled joint."""
    couplings = {}
    for joint in joints:
        mimic = joint.find("mimic")
        # some fixed joints have a mimic element
        if mimic is None or joint.get("type") not in SINGLE:
            continue
        couplings[joint.get("name", "")] = Coupling(
            follows=mimic.get("joint", ""),
            multiplier=float(mimic.get("multiplier", "1")),
            offset=float(mimic.get("offset", "0")),
        )
    return couplings


class Description(NamedTuple):
    """An arm in the tree of a URDF."""

    tree: Tree
    base: str | None  # link; None for the root
    tip: str  # link
    # coordinates of joints outside the arm, rad or m; 0 if absent
    held: dict[str, float]


def describe(robot: Robot, tree: Tree | None = None) -> Description:
    """Return the arm of the options ``dataset.robot``, in its ``tree`` if read. Coupled joints
    (mimic) outside the arm follow their coupling. Raises ConfigError for names missing in the URDF,
    and if joints, tip and base do not form a chain of joints with one coordinate each.
    """
    tree = tree or read_urdf(Path(robot.urdf))
    _require_joints(tree, robot)
    tip = _tip(tree, robot)
    base = None
    if robot.base is not None:
        base = tree.link(robot.base, "robot.base")
    for fault in _arm_faults(tree, robot, base, tip):
        raise ConfigError(f"robot.{fault}", file=tree.file)
    held = {}
    for name, coupling in tree.couplings.items():
        followed = robot.locked.get(coupling.follows, 0.0)
        held[name] = coupling.multiplier * followed + coupling.offset
    return Description(tree, base, tip, held | robot.locked)


def _require_joints(tree: Tree, robot: Robot) -> None:
    """Raise ConfigError for a name in the options that is no joint of one coordinate."""
    joints = tree.joints.values()
    movable = sorted(joint.name for joint in joints if joint.kind in SINGLE)
    for key, names in {"joints": robot.joints, "locked": robot.locked}.items():
        unknown = [name for name in names if name not in movable]
        if unknown:
            raise ConfigError(
                f"robot.{key}: no joint {unknown[0]!r} of one coordinate in the URDF; it has "
                f"{movable}",
                file=tree.file,
            )


def _tip(tree: Tree, robot: Robot) -> str:
    """Return the link of the tool: the one that is stated, or the only end beyond the last joint;
    raises ConfigError for several.
    """
    if robot.tool is not None:
        return tree.link(robot.tool, "robot.tool")
    last = robot.joints[-1]
    ends = [end for end in tree.ends if last in tree.above(end)]
    if len(ends) != 1:
        raise ConfigError(
            f"robot.tool: the URDF ends in more than one link beyond {last}; name one of {ends}",
            file=tree.file,
        )
    return ends[0]


def _arm_faults(tree: Tree, robot: Robot, base: str | None, tip: str) -> Iterator[str]:
    """Yield the faults of the joints between the base and the tip."""
    joints = robot.joints
    above = tree.above(tip)
    below_base = tree.above(base) if base else []
    both = sorted({*joints} & {*robot.locked})
    if both:
        yield f"locked: {', '.join(both)} cannot be locked, as robot.joints names it"
    moving_tip = [name for name in above if name in joints]
    if joints != moving_tip:
        yield (
            f"joints: {joints} must be one chain from base to tip; the joints that move {tip!r} "
            f"are {moving_tip}: name them in this order, or another robot.tool"
        )
    moving_base = [name for name in below_base if name in joints]
    if moving_base:
        yield (
            f"base: {robot.base!r} moves with {moving_base[-1]}; name a link before the arm"
        )
    for name in above:
        if name not in below_base:
            yield from _joint_faults(tree, name, joints)


def _joint_faults(tree: Tree, name: str, joints: list[str]) -> Iterator[str]:
    """Yield the faults of the joint ``name`` between base and tip of the arm of ``joints``."""
    joint = tree.joints[name]
    if joint.kind not in SINGLE:
        yield (
            f"joints: the joint {name} before the tip is {joint.kind}; name a link beyond it as "
            "robot.base, or replace it by joints of one coordinate"
        )
    coupling = tree.couplings.get(name)
    if coupling is not None and {name, coupling.follows} & {*joints}:
        yield (
            f"joints: {name} is coupled to {coupling.follows} (mimic) and moves the tip; the "
            "joints of an arm must move independently"
        )
    finite = 0 < joint.upper - joint.lower < math.inf
    if name in joints and joint.kind in LIMITED and not finite:
        yield f"urdf: {NO_LIMITS.format(name)}"
