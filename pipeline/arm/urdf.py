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
NO_LIMITS = "the joint {} has no limits; give it <limit lower upper velocity effort>, or the type "
NO_LIMITS += "continuous"


class Joint(NamedTuple):
    """A joint between the links ``parent`` and ``child``."""

    name: str
    kind: str
    parent: str
    child: str
    lower: float  # rad or m; infinite for a continuous joint
    upper: float
    limits: dict[
        str, float
    ]  # as in the URDF: lower, upper (rad or m), velocity, effort
    follows: str | None = (
        None  # joint to which it is coupled (mimic): multiplier·q + offset
    )
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
    file, line = Path(file), None
    try:
        content = read_whole(file)
        if b"<!ENTITY" in content.replace(b"\0", b""):  # zeros of UTF-16
            raise ValueError(ENTITIES)
        root = ElementTree.fromstring(content)
        parts = root.findall("joint/*")
        words = [part.tag for part in root.iter()]
        words += [word for part in parts for word in part.attrib.values()]
        if not any("xacro" in word or "$" in word for word in words):
            require("joints", len(elements := root.findall("joint")), "joints", file)
            joints = [*map(_joint, elements)]
            links = [link.get("name", "") for link in root.findall("link")]
            _require_tree(links, joints)
            return Tree(file, root, links, {joint.name: joint for joint in joints})
        message = XACRO.format(file.name)
    except OSError as error:
        message = (
            f"cannot be read ({error.strerror}); state its path from the project's root"
        )
    except ElementTree.ParseError as error:
        message, line = f"this is not a URDF file ({error.msg})", error.position[0]
        message = XACRO.format(file.name) if "unbound prefix" in error.msg else message
    except (LookupError, ValueError) as error:  # of an encoding or a number
        message = f"this is not a URDF file ({error})"
    raise ConfigError(f"robot.urdf: {message}", file=file, line=line) from None


def _require_tree(links: list[str], joints: list[Joint]) -> None:
    """Raise ValueError where the ``joints`` do not make one tree of all ``links``."""
    children, names = (
        [joint.child for joint in joints],
        [joint.name for joint in joints],
    )
    counts = (
        each for listed in (links, names, children) for each in Counter(listed).items()
    )
    twice = next((name for name, count in counts if count > 1), None)
    unknown = min(
        {name for joint in joints for name in joint[2:4]} - {*links}, default=None
    )
    roots = [link for link in links if link not in {*children}]
    faults = {
        f"the name {twice!r} occurs twice, or the link has two joints above it": twice
        is not None,
        f"joints name the link {unknown!r}, which the file lacks": unknown is not None,
        f"{len(roots)} root links ({', '.join(roots[:5])}), where a tree has one": links
        and len(roots) != 1,
        "links form a loop": len(links) > len(joints) + 1,
    }
    for fault in (fault for fault, found in faults.items() if found):
        raise ValueError(f"{fault}: connect all links by joints")


def _joint(element: ElementTree.Element) -> Joint:
    name, kind = element.get("name", ""), element.get("type", "")
    parts = {part.tag: part.attrib for part in element}
    mimic = {"joint": None, "multiplier": "1", "offset": "0"} | parts.get("mimic", {})
    try:
        limits = {key: float(value) for key, value in parts.get("limit", {}).items()}
        coupling = [float(mimic[key]) for key in ("multiplier", "offset")]
        if any(map(math.isnan, (*limits.values(), *coupling))):
            raise ValueError("nan is no number")
    except ValueError as error:
        raise ValueError(f"limit or mimic of the joint {name}: {error}") from None
    ends = [parts.get(end, {}).get("link", "") for end in ("parent", "child")]
    follows = (
        mimic["joint"] if kind in SINGLE else None
    )  # some fixed joints have a mimic element
    if kind in LIMITED and not {"velocity", "effort"} <= {*limits}:
        raise ValueError(NO_LIMITS.format(name))
    lower, upper = limits.get("lower", 0.0), limits.get("upper", 0.0)
    if kind == "continuous":
        lower, upper = -math.inf, math.inf
    return Joint(name, kind, *ends, lower, upper, limits, follows, *coupling)


class Description(NamedTuple):
    """An arm in the tree of a URDF."""

    tree: Tree
    joints: list[Joint]  # base to tip
    base: str | None  # link; None for the root
    tip: str  # link
    held: dict[
        str, float
    ]  # coordinates of joints outside the arm, rad or m; 0 if absent


def describe(robot: Robot, tree: Tree | None = None) -> Description:
    """Return the arm of the options ``dataset.robot``, in its ``tree`` if read. Coupled joints
    (mimic) outside the arm follow their coupling. Raises ConfigError for names missing in the URDF,
    and if joints, tip and base do not form a chain of joints with one coordinate each.
    """
    tree, locked, last = (
        tree or read_urdf(Path(robot.urdf)),
        robot.locked,
        robot.joints[-1],
    )
    joints = tree.joints
    movable = sorted(name for name, joint in joints.items() if joint.kind in SINGLE)
    for key, names in {"joints": robot.joints, "locked": locked}.items():
        if unknown := [name for name in names if name not in movable]:
            message = (
                f"robot.{key}: no joint {unknown[0]!r} of one coordinate in the URDF"
            )
            raise ConfigError(f"{message}; it has {movable}", file=tree.file)
    if robot.tool is None:
        ends = [end for end in tree.ends if joints[last] in tree.above(end)]
        if len(ends) != 1:
            message = (
                f"the URDF ends in more than one link beyond {last}; name one of {ends}"
            )
            raise ConfigError(f"robot.tool: {message}", file=tree.file)
    tip = ends[0] if robot.tool is None else tree.link(robot.tool, "robot.tool")
    base = None if robot.base is None else tree.link(robot.base, "robot.base")
    if (fault := next(_arm_faults(tree, robot, base, tip), None)) is not None:
        raise ConfigError(f"robot.{fault}", file=tree.file)
    held = {
        joint.name: joint.multiplier * locked.get(joint.follows, 0.0) + joint.offset
        for joint in joints.values()
        if joint.follows is not None
    }
    return Description(
        tree, [joints[name] for name in robot.joints], base, tip, held | locked
    )


def _arm_faults(tree: Tree, robot: Robot, base: str | None, tip: str) -> Iterator[str]:
    """Yield the faults of the joints between the base and the tip."""
    joints, above, below_base = (
        robot.joints,
        tree.above(tip),
        tree.above(base) if base else [],
    )
    on = [joint.name for joint in above if joint.name in joints]
    if both := sorted({*joints} & {*robot.locked}):
        yield f"locked: {', '.join(both)} cannot be locked, as robot.joints names it"
    if joints != on:
        fault = f"joints: {joints} must be one chain from base to tip; the joints that move {tip!r}"
        yield f"{fault} are {on}: name them in this order, or another robot.tool"
    if moving := [joint.name for joint in below_base if joint.name in joints]:
        yield f"base: {robot.base!r} moves with {moving[-1]}; name a link before the arm"
    for joint in (joint for joint in above if joint not in below_base):
        if joint.kind not in (*SINGLE, "fixed"):
            fault = f"joints: the joint {joint.name} before the tip is {joint.kind}; name a link"
            yield f"{fault} beyond it as robot.base, or replace it by joints of one coordinate"
        if joint.follows is not None and {joint.name, joint.follows} & {*joints}:
            fault = f"joints: {joint.name} is coupled to {joint.follows} (mimic) and moves the tip"
            yield f"{fault}; the joints of an arm must move independently"
        finite = 0 < joint.upper - joint.lower < math.inf
        if joint.name in joints and joint.kind in LIMITED and not finite:
            yield f"urdf: {NO_LIMITS.format(joint.name)}"
