"""Tree of links and joints in a URDF, and the joints of it that are the arm of the options."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from pipeline.core.bounds import read_whole
from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Robot

# Pinocchio recurses and ends the process past some thousands of joints; a humanoid has some eighty
MOST_JOINTS = 250
FARTHEST = 1e6  # m or rad, of an origin or an axis: squares of it stay finite
LIMITED = ("revolute", "prismatic")  # kinds of joints with one coordinate and limits
SINGLE = (*LIMITED, "continuous")  # with one coordinate
KINDS = (*SINGLE, "fixed", "floating", "planar")
ROOT = "universe"  # name in Pinocchio of what the robot stands on
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


class Tree(NamedTuple):
    """Links of a robot, and its joints by name, in the order of the file."""

    file: Path
    root: ElementTree.Element
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
    file, line = Path(file), None
    try:
        content = read_whole(file)
        if b"<!DOCTYPE" in content.replace(b"\0", b""):  # also with two bytes a letter
            raise ValueError("a document type, whose entities may grow without end; take it out")
        tree = _tree(file, ElementTree.fromstring(content))
        if (message := next(_tree_faults(tree), None)) is None:
            return tree
    except FileNotFoundError:
        message = "no such file; name one from the project's root"
    except OSError as error:
        message = f"the file cannot be read ({error.strerror})"
    except ElementTree.ParseError as error:
        message, line = f"this is no URDF ({error.msg})", error.position[0]
        message = XACRO.format(file.name) if "unbound prefix" in error.msg else message
    except (LookupError, ValueError) as error:  # an encoding; a number
        message = f"this is no URDF ({error})"
    raise ConfigError(f"robot.urdf: {message}", file=file, line=line) from None


def _tree(file: Path, root: ElementTree.Element) -> Tree:
    words = [part.tag for part in root.iter()]
    values = [word for part in root.findall("joint/*") for word in part.attrib.values()]
    if any("xacro" in word or "$" in word for word in words + values):
        raise ValueError(XACRO.format(file.name))
    if words.count("joint") > MOST_JOINTS:
        message = f"more than {MOST_JOINTS} joints; take out what does not belong to the arm"
        raise ValueError(message)
    joints = {joint.name: joint for joint in map(_joint, root.findall("joint"))}
    return Tree(file, root, [link.get("name", "") for link in root.findall("link")], joints)


def _joint(element: ElementTree.Element) -> Joint:
    name, kind = element.get("name", ""), element.get("type", "")
    parts = {part.tag: part.attrib for part in element}

    def number(part: str, key: str, text: str) -> float:
        most = FARTHEST if key in ("xyz", "rpy") else math.inf
        try:
            if abs(value := float(text)) <= most:
                return value
        except ValueError:
            pass
        found = f"the joint {name} has {text[:80]!r} as {key} of its {part}"
        raise ValueError(f"{found}, which must be a number, of {most:g} at most")

    for part, key in product(parts, ("xyz", "rpy")):
        for word in parts[part].get(key, "").split():
            number(part, key, word)
    limits = {
        key: number("limit", key, text)
        for key, text in parts.get("limit", {}).items()
        if key in ("lower", "upper", "velocity", "effort")
    }
    ends = [parts.get(end, {}).get("link", "") for end in ("parent", "child")]
    if kind not in SINGLE or "mimic" not in parts:  # some fixed joints have it
        return Joint(name, kind, *ends, limits)
    mimic = {"joint": "", "multiplier": "1", "offset": "0"} | parts["mimic"]
    coupling = (number("mimic", key, mimic[key]) for key in ("multiplier", "offset"))
    return Joint(name, kind, *ends, limits, mimic["joint"], *coupling)


def _tree_faults(tree: Tree) -> Iterator[str]:
    """Faults of the links and joints, the most telling first."""
    joints, links = tree.joints.values(), Counter(tree.links)
    names = Counter(element.get("name", "") for element in tree.root.findall("joint"))
    for what, counted in (("links", links), ("joints", names)):
        yield from (f"two {what} are named {name!r}" for name, n in counted.items() if n > 1)
    for name, kind, *ends in (joint[:4] for joint in joints):
        if kind not in KINDS:
            yield f"the joint {name} is of the type {kind!r}; there are {', '.join(KINDS)}"
        if name == ROOT:
            yield f"the joint {name} has a name that Pinocchio needs for {ROOT}"
        missing = (link for link in ends if link not in links)
        yield from (
            f"{name} joins the link {end!r}, which the URDF does not have" for end in missing
        )
    for joint in joints:
        if joint.kind in LIMITED and not {"velocity", "effort"} <= {*joint.limits}:
            yield NO_LIMITS.format(joint.name)
    children = Counter(joint.child for joint in joints)
    if closing := sorted(
        joint.name
        for joint in joints
        if children[joint.child] > 1 or len(tree.above(joint.child)) > len(joints)
    ):
        loop = "links form a loop, which a URDF cannot hold; leave out one of the joints"
        yield f"{loop} {', '.join(closing)}"
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
    if (fault := next(_arm_faults(tree, robot), None)) is not None:
        raise ConfigError(f"robot.{fault}", file=tree.file)
    followers = (joint for joint in tree.joints.values() if joint.follows is not None)
    held = {
        joint.name: joint.multiplier * locked.get(joint.follows, 0.0) + joint.offset
        for joint in followers
    }
    joints, ends = (
        [tree.joints[name] for name in robot.joints],
        (_base(tree, robot), _tip(tree, robot)),
    )
    return Description(tree, joints, *ends, held | locked)


def _base(tree: Tree, robot: Robot) -> str | None:
    return None if robot.base is None else tree.link(robot.base, "robot.base")


def _tip(tree: Tree, robot: Robot) -> str:
    """The link of the option ``tool``, or the only one beyond the joints that no other follows."""
    if robot.tool is not None:
        return tree.link(robot.tool, "robot.tool")
    last = robot.joints[-1]
    ends = [link for link in tree.ends if last in [joint.name for joint in tree.above(link)]]
    if len(ends) == 1:
        return ends[0]
    message = f"robot.tool: the URDF ends in more than one link beyond {last}; name one of {ends}"
    raise ConfigError(message, file=tree.file)


def _arm_faults(tree: Tree, robot: Robot) -> Iterator[str]:
    """Faults of the names of the options, then of the way from the base to the tip."""
    joints, movable = robot.joints, sorted(n for n, j in tree.joints.items() if j.kind != "fixed")
    for key, wanted in (("joints", joints), ("locked", robot.locked)):
        for name in wanted:
            if name not in movable:
                yield f"{key}: no joint {name!r} in the URDF; it has {movable}"
            elif (kind := tree.joints[name].kind) not in SINGLE:
                yield f"{key}: {name} is {kind}; a joint must be one of {', '.join(SINGLE)}"
    if both := sorted({*joints} & {*robot.locked}):
        yield f"locked: {', '.join(both)} cannot be locked, being of robot.joints"
    tip, base = _tip(tree, robot), _base(tree, robot)
    above, below_base = tree.above(tip), tree.above(base) if base else []
    on = [joint.name for joint in above if joint.name in joints]
    if joints[-1] not in on:
        yield f"tool: {tip!r} does not move with the last joint of the chain, {joints[-1]}"
    if apart := [name for name in joints if name not in on]:
        yield f"joints: {', '.join(apart)} does not move {tip!r}; name joints of one chain"
    if joints != on:
        yield f"joints: {joints} must stand in the order of the chain {on}"
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
            yield f"urdf: {NO_LIMITS.format(joint.name)}"
