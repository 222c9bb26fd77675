"""Tree of links and joints of a URDF file, and the configured arm in the tree."""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

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


class Joint(NamedTuple):
    """A joint between the links ``parent`` and ``child``."""

    name: str
    kind: str
    parent: str
    child: str
    lower: float  # rad or m; infinite for a continuous joint
    upper: float
    # as in the URDF: lower, upper (rad or m), velocity, effort
    limits: dict[str, float]
    # joint to which it is coupled (mimic): multiplier·q + offset
    follows: str | None = None
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, eq=False)
class Tree:
    """Links of a robot, and its joints by name, in the order of the file."""

    file: Path
    root: ElementTree.Element
    links: list[str]
    joints: dict[str, Joint]

    @cached_property
    def ends(self) -> list[str]:
        """Links without child joints."""
        followed = {joint.parent for joint in self.joints.values()}
        return [link for link in self.links if link not in followed]

    @cached_property
    def by_child(self) -> dict[str, Joint]:
        """Link → joint that moves it."""
        return {joint.child: joint for joint in self.joints.values()}

    def above(self, link: str) -> list[Joint]:
        """Joints from the root to ``link``."""
        result: list[Joint] = []
        while link in self.by_child:
            result.append(self.by_child[link])
            link = result[-1].parent
        return result[::-1]

    def link(self, name: str, key: str) -> str:
        """Link ``name``, or the link that a joint ``name`` moves; else ConfigError for ``key``."""
        if name not in self.links and name not in self.joints:
            raise ConfigError(f"{key}: no frame {name!r} in the URDF", file=self.file)
        return name if name in self.links else self.joints[name].child


def read_urdf(file: Path) -> Tree:
    """Return the tree in ``file``; raises ConfigError if it is not a URDF file."""
    file = Path(file)
    try:
        content = read_whole(file)
        if b"<!ENTITY" in content.replace(b"\0", b""):  # zeros of UTF-16
            raise ValueError(ENTITIES)
        root = ElementTree.fromstring(content)
        if not _has_macros(root):
            return _tree(file, root)
        message, line = XACRO.format(file.name), None
    except OSError as error:
        reason, line = error.strerror, None
        message = f"cannot be read ({reason}); state its path from the project's root"
    except ElementTree.ParseError as error:
        message, line = f"this is not a URDF file ({error.msg})", error.position[0]
        if "unbound prefix" in error.msg:
            message = XACRO.format(file.name)
    except (LookupError, ValueError) as error:  # of an encoding or a number
        message, line = f"this is not a URDF file ({error})", None
    raise ConfigError(f"robot.urdf: {message}", file=file, line=line) from None


def _has_macros(root: ElementTree.Element) -> bool:
    """Return whether xacro has not yet replaced its macros and variables."""
    words = [element.tag for element in root.iter()]
    for element in root.findall("joint/*"):
        words += element.attrib.values()
    return any("xacro" in word or "$" in word for word in words)


def _tree(file: Path, root: ElementTree.Element) -> Tree:
    """Return the tree below ``root``; raises ValueError where it is not one tree."""
    elements = root.findall("joint")
    require("joints", len(elements), "joints", file)
    joints = [_joint(element) for element in elements]
    links = [link.get("name", "") for link in root.findall("link")]
    _require_tree(links, joints)
    return Tree(file, root, links, {joint.name: joint for joint in joints})


def _require_tree(links: list[str], joints: list[Joint]) -> None:
    """Raise ValueError where the ``joints`` do not make one tree of all ``links``."""
    children = [joint.child for joint in joints]
    fault = ""
    for names in (links, [joint.name for joint in joints], children):
        repeated = [name for name, count in Counter(names).items() if count > 1]
        if repeated:
            fault = f"the name {repeated[0]!r} occurs twice, or the link has two joints above it"
            break
    ends = {joint.parent for joint in joints} | {*children}
    missing = sorted(ends - {*links})
    roots = [link for link in links if link not in children]
    if not fault and missing:
        fault = f"joints name the link {missing[0]!r}, which the file lacks"
    elif not fault and links and len(roots) != 1:
        fault = (
            f"{len(roots)} root links ({', '.join(roots[:5])}), where a tree has one"
        )
    elif not fault and len(links) > len(joints) + 1:
        fault = "links form a loop"
    if fault:
        raise ValueError(f"{fault}: connect all links by joints")


def _joint(element: ElementTree.Element) -> Joint:
    name, kind = element.get("name", ""), element.get("type", "")
    attributes = {child.tag: child.attrib for child in element}
    mimic = attributes.get("mimic", {})
    try:
        limits = {
            key: float(value) for key, value in attributes.get("limit", {}).items()
        }
        multiplier = float(mimic.get("multiplier", "1"))
        offset = float(mimic.get("offset", "0"))
        if any(map(math.isnan, (*limits.values(), multiplier, offset))):
            raise ValueError("nan is no number")
    except ValueError as error:
        raise ValueError(f"limit or mimic of the joint {name}: {error}") from None
    if kind in LIMITED and not {"velocity", "effort"} <= {*limits}:
        raise ValueError(NO_LIMITS.format(name))
    lower, upper = limits.get("lower", 0.0), limits.get("upper", 0.0)
    if kind == "continuous":
        lower, upper = -math.inf, math.inf
    return Joint(
        name=name,
        kind=kind,
        parent=attributes.get("parent", {}).get("link", ""),
        child=attributes.get("child", {}).get("link", ""),
        lower=lower,
        upper=upper,
        limits=limits,
        # some fixed joints have a mimic element
        follows=mimic.get("joint") if kind in SINGLE else None,
        multiplier=multiplier,
        offset=offset,
    )


class Description(NamedTuple):
    """An arm in the tree of a URDF."""

    tree: Tree
    joints: list[Joint]  # base to tip
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
    joints = tree.joints
    _require_joints(tree, robot)
    tip = _tip(tree, robot)
    base = None if robot.base is None else tree.link(robot.base, "robot.base")
    for fault in _arm_faults(tree, robot, base, tip):
        raise ConfigError(f"robot.{fault}", file=tree.file)
    held = {}
    for joint in joints.values():
        if joint.follows is not None:
            followed = robot.locked.get(joint.follows, 0.0)
            held[joint.name] = joint.multiplier * followed + joint.offset
    chain = [joints[name] for name in robot.joints]
    return Description(tree, chain, base, tip, held | robot.locked)


def _require_joints(tree: Tree, robot: Robot) -> None:
    """Raise ConfigError for a name in the options that is no joint of one coordinate."""
    movable = sorted(n for n, joint in tree.joints.items() if joint.kind in SINGLE)
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
    ends = [end for end in tree.ends if tree.joints[last] in tree.above(end)]
    if len(ends) != 1:
        raise ConfigError(
            f"robot.tool: the URDF ends in more than one link beyond {last}; name one of {ends}",
            file=tree.file,
        )
    return ends[0]


def _arm_faults(tree: Tree, robot: Robot, base: str | None, tip: str) -> Iterator[str]:
    """Yield the faults of the joints between the base and the tip."""
    joints, above = robot.joints, tree.above(tip)
    below_base = tree.above(base) if base else []
    both = sorted({*joints} & {*robot.locked})
    if both:
        yield f"locked: {', '.join(both)} cannot be locked, as robot.joints names it"
    moving_tip = [joint.name for joint in above if joint.name in joints]
    if joints != moving_tip:
        yield (
            f"joints: {joints} must be one chain from base to tip; the joints that move {tip!r} "
            f"are {moving_tip}: name them in this order, or another robot.tool"
        )
    moving_base = [joint.name for joint in below_base if joint.name in joints]
    if moving_base:
        yield (
            f"base: {robot.base!r} moves with {moving_base[-1]}; name a link before the arm"
        )
    for joint in above:
        if joint not in below_base:
            yield from _joint_faults(joint, joints)


def _joint_faults(joint: Joint, joints: list[str]) -> Iterator[str]:
    """Yield the faults of a ``joint`` between base and tip of the arm of ``joints``."""
    if joint.kind not in (*SINGLE, "fixed"):
        yield (
            f"joints: the joint {joint.name} before the tip is {joint.kind}; name a link beyond "
            "it as robot.base, or replace it by joints of one coordinate"
        )
    if joint.follows is not None and {joint.name, joint.follows} & {*joints}:
        yield (
            f"joints: {joint.name} is coupled to {joint.follows} (mimic) and moves the tip; the "
            "joints of an arm must move independently"
        )
    finite = 0 < joint.upper - joint.lower < math.inf
    if joint.name in joints and joint.kind in LIMITED and not finite:
        yield f"urdf: {NO_LIMITS.format(joint.name)}"
