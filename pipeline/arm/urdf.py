"""Tree of links and joints in a URDF, and the joints of it that are the arm of the options."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Robot

# Pinocchio recurses and ends the process past some thousands of joints; a humanoid has some eighty
MOST_JOINTS = 250
FARTHEST = 1e6  # m or rad, of an origin or an axis: squares of it stay finite
LIMITED = ("revolute", "prismatic")  # kinds of joints with one coordinate and limits
SINGLE = (*LIMITED, "continuous")  # with one coordinate
KINDS = (*SINGLE, "fixed", "floating", "planar")
ROOT = "universe"  # how Pinocchio names what the robot stands on
XACRO = "a xacro: expand it with xacro {} > arm.urdf"
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
    limits: dict[str, float]  # lower, upper (rad or m), velocity, effort
    follows: str | None = None  # the joint that it is coupled to (mimic): multiplier·q + offset
    multiplier: float = 1.0
    offset: float = 0.0

    @property
    def range(self) -> tuple[float, float]:
        """The least and the greatest coordinate, rad or m: infinite of a continuous joint."""
        if self.kind == "continuous":
            return -math.inf, math.inf
        return self.limits.get("lower", 0.0), self.limits.get("upper", 0.0)


@dataclass
class Tree:
    """Links of a robot, and its joints by name, in the order of the file."""

    file: Path
    name: str  # of the robot
    links: list[str]
    joints: dict[str, Joint]

    def model_name(self, link: str) -> str:
        """Name of ``link`` in Pinocchio's model, where links and joints share one set of names."""
        while link in self.joints or link == ROOT:
            link = f"link {link}"
            while link in self.links:
                link = f"link {link}"
        return link

    @property
    def ends(self) -> list[str]:
        """The links that no other follows."""
        followed = {joint.parent for joint in self.joints.values()}
        return [link for link in self.links if link not in followed]

    def above(self, link: str) -> list[Joint]:
        """The joints from the root to ``link``; one more than there are where they form a loop."""
        by_child = {joint.child: joint for joint in self.joints.values()}
        result: list[Joint] = []
        while link in by_child and len(result) <= len(self.joints):
            result.append(by_child[link])
            link = by_child[link].parent
        return result[::-1]

    def link(self, name: str, key: str) -> str:
        """The link ``name``, or the one that the joint of this name moves; raises ConfigError for
        the option ``key`` where there is neither.
        """
        if name not in self.links and name not in self.joints:
            raise ConfigError(f"{key}: no frame {name!r} in the URDF", file=self.file)
        return name if name in self.links else self.joints[name].child


def read_urdf(file: Path) -> Tree:
    """Return the tree that ``file`` describes; ConfigError for a file that is no URDF, and for
    links and joints that are no tree.
    """
    line = None
    try:
        root = ElementTree.parse(file).getroot()
        words = [part.tag for part in root.iter()]
        words += [word for part in root.findall("joint/*") for word in part.attrib.values()]
        if any("xacro" in word or "$" in word for word in words):
            message = XACRO.format(file.name)
        elif words.count("joint") > MOST_JOINTS:
            message = f"more than {MOST_JOINTS} joints; take out what does not belong to the arm"
        else:
            tree = _tree(file, root)
            if (message := next(_tree_faults(tree, root), None)) is None:
                return tree
    except FileNotFoundError:
        message = "no such file; name one from the project's root"
    except OSError as error:
        message = f"the file cannot be read ({error.strerror})"
    except ElementTree.ParseError as error:
        message, line = f"this is no URDF ({error.msg})", error.position[0]
        message = XACRO.format(file.name) if "unbound prefix" in error.msg else message
    except (LookupError, ValueError) as error:  # an encoding; a number
        message = f"this is no URDF ({error}); is it XML in UTF-8?"
    raise ConfigError(f"robot.urdf: {message}", file=file, line=line) from None


def _tree(file: Path, root: ElementTree.Element) -> Tree:
    joints = {}
    for element in root.findall("joint"):
        name, kind = element.get("name", ""), element.get("type", "")
        parts = {part.tag: part.attrib for part in element}

        def number(part: str, key: str, text: str, name: str = name) -> float:
            try:
                value = float(text)
            except ValueError:
                found = f"the joint {name} has {text[:80]!r} as {key} of its {part}"
                raise ValueError(f"{found}, which must be a number") from None
            if key in ("xyz", "rpy") and not abs(value) <= FARTHEST:
                raise ValueError(f"{name} has {text[:80]} m or rad in its {part}")
            return value

        for part, values in parts.items():
            for key in {"xyz", "rpy"} & {*values}:
                for word in values[key].split():
                    number(part, key, word)
        known = {"lower", "upper", "velocity", "effort"} & {*parts.get("limit", {})}
        limits = {key: number("limit", key, parts["limit"][key]) for key in known}
        ends = [parts.get(end, {}).get("link", "") for end in ("parent", "child")]
        coupling = ()
        if (
            kind in SINGLE and (mimic := parts.get("mimic")) is not None
        ):  # some fixed joints have it
            numbers = (("multiplier", "1"), ("offset", "0"))
            values = [number("mimic", key, mimic.get(key, usual)) for key, usual in numbers]
            coupling = (mimic.get("joint", ""), *values)
        joints[name] = Joint(name, kind, *ends, limits, *coupling)
    links = [element.get("name", "") for element in root.findall("link")]
    return Tree(file, root.get("name", ""), links, joints)


def _tree_faults(tree: Tree, root: ElementTree.Element) -> Iterator[str]:
    """Faults of the links and joints, the most telling first."""
    joints, links = tree.joints.values(), Counter(tree.links)
    names = Counter(element.get("name", "") for element in root.findall("joint"))
    for what, counted in (("links", links), ("joints", names)):
        yield from (f"two {what} are named {name!r}" for name, n in counted.items() if n > 1)
    for name, kind, *ends in (joint[:4] for joint in joints):
        if kind not in KINDS:
            yield f"the joint {name} is of the type {kind!r}; there are {', '.join(KINDS)}"
        if name == ROOT:
            yield f"the joint {name} has a name that Pinocchio needs for {ROOT}"
        missing = [link for link in ends if link not in links]
        yield from (
            f"{name} joins the link {link!r}, which the URDF does not have" for link in missing
        )
    for joint in joints:
        if joint.kind in LIMITED and not {"velocity", "effort"} <= {*joint.limits}:
            yield NO_LIMITS.format(joint.name)
    children = Counter(joint.child for joint in joints)
    closing = [
        joint.name
        for joint in joints
        if children[joint.child] > 1 or len(tree.above(joint.child)) > len(joints)
    ]
    if closing:
        yield (
            "links form a loop, which a URDF cannot hold; leave out one of the joints "
            + ", ".join(sorted(closing))
        )
    if len(roots := [link for link in tree.links if link not in children]) != 1:
        found = ", ".join(roots[:5]) or "none"
        yield f"a robot has one link that no joint holds, and this one {found}"


class Description(NamedTuple):
    """An arm in the tree of a URDF."""

    tree: Tree
    joints: list[Joint]  # base to tip
    base: str | None  # link; None for the root
    tip: str  # link
    held: dict[str, float]  # rad or m, of the other joints; 0 where not named


def describe(robot: Robot) -> Description:
    """Return the arm of the section ``dataset.robot``; coupled joints (mimic) that are not of the
    arm are held where the joints that they follow hold them.

    Raises ConfigError for names that the URDF does not have, and for joints, tip and base that are
    no chain of joints of one coordinate each.
    """
    tree, locked = read_urdf(Path(robot.urdf)), dict(robot.locked)
    if (fault := next(_name_faults(tree, robot), None)) is None:
        tip = _tip(tree, robot.joints[-1], robot.tool)
        base = None if robot.base is None else tree.link(robot.base, "robot.base")
        if (fault := next(_chain_faults(tree, robot, tip, base), None)) is None:
            held = {
                name: joint.multiplier * locked.get(joint.follows, 0.0) + joint.offset
                for name, joint in tree.joints.items()
                if joint.follows is not None
            }
            joints = [tree.joints[name] for name in robot.joints]
            return Description(tree, joints, base, tip, held | locked)
    raise ConfigError(f"robot.{fault}", file=tree.file)


def _tip(tree: Tree, last: str, tool: str | None) -> str:
    """The link of the option ``tool``, or the only one beyond the joint ``last`` that no other
    follows.
    """
    if tool is not None:
        return tree.link(tool, "robot.tool")
    ends = [link for link in tree.ends if last in [joint.name for joint in tree.above(link)]]
    if len(ends) != 1:
        message = (
            f"robot.tool: the URDF ends in more than one link beyond {last}; name one of {ends}"
        )
        raise ConfigError(message, file=tree.file)
    return ends[0]


def _name_faults(tree: Tree, robot: Robot) -> Iterator[str]:
    """Names of the options that are no joints of one coordinate."""
    movable = sorted(name for name, joint in tree.joints.items() if joint.kind != "fixed")
    for key, wanted in (("joints", robot.joints), ("locked", robot.locked)):
        for name in wanted:
            if name not in movable:
                yield f"{key}: no joint {name!r} in the URDF; it has {movable}"
            elif (kind := tree.joints[name].kind) not in SINGLE:
                yield f"{key}: {name} is {kind}; a joint must be one of {', '.join(SINGLE)}"
    if both := sorted({*robot.joints} & {*robot.locked}):
        yield f"locked: {', '.join(both)} cannot be locked, being of robot.joints"


def _chain_faults(tree: Tree, robot: Robot, tip: str, base: str | None) -> Iterator[str]:
    """Faults of the way from the base to the tip."""
    joints, above = robot.joints, tree.above(tip)
    on = [joint.name for joint in above if joint.name in joints]
    if joints[-1] not in on:
        yield f"tool: {tip!r} does not move with the last joint of the chain, {joints[-1]}"
    if apart := [name for name in joints if name not in on]:
        yield f"joints: {', '.join(apart)} does not move {tip!r}; name joints of one chain"
    if joints != on:
        yield f"joints: {joints} must stand in the order of the chain {on}"
    below_base = tree.above(base) if base else []
    if moving := [joint.name for joint in below_base if joint.name in joints]:
        yield f"base: {robot.base!r} moves with {moving[-1]}; name a link before the arm"
    for joint in (joint for joint in above if joint not in below_base):
        if joint.kind not in (*SINGLE, "fixed"):
            yield (
                f"joints: the joint {joint.name} before the tip is {joint.kind}; name a link "
                "beyond it as robot.base, or put joints of one coordinate in its place"
            )
        if joint.follows is not None and {joint.name, joint.follows} & {*joints}:
            yield (
                f"joints: {joint.name} is coupled to {joint.follows} (mimic), and the tip moves "
                "with it; an arm of joints that move by themselves is needed"
            )
        lower, upper = joint.range
        if joint.name in joints and joint.kind in LIMITED and not 0 < upper - lower < math.inf:
            yield "urdf: " + NO_LIMITS.format(joint.name)
