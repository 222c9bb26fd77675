"""Tree of links and joints in a URDF, and the joints of it that are the arm of the options."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from pipeline.core.bounds import read_whole
from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Robot

LIMITED = ("revolute", "prismatic")  # kinds of joints with one coordinate and limits
SINGLE = (*LIMITED, "continuous")  # with one coordinate
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

    @property
    def ends(self) -> list[str]:
        """The links that no other follows."""
        followed = {joint.parent for joint in self.joints.values()}
        return [link for link in self.links if link not in followed]

    def above(self, link: str) -> list[Joint]:
        """The joints from the root to ``link``."""
        by_child = {joint.child: joint for joint in self.joints.values()}
        result: list[Joint] = []
        while link in by_child and len(result) < len(self.joints):  # links may form a loop
            result.append(by_child[link])
            link = by_child[link].parent
        return result[::-1]

    def link(self, name: str, key: str) -> str:
        """The link ``name``, or the one that this joint moves; else ConfigError for ``key``."""
        if name not in self.links and name not in self.joints:
            raise ConfigError(f"{key}: no frame {name!r} in the URDF", file=self.file)
        return name if name in self.links else self.joints[name].child


def read_urdf(file: Path) -> Tree:
    """Return the tree that ``file`` describes; ConfigError for a file that is no URDF."""
    file, line = Path(file), None
    try:
        root = ElementTree.fromstring(read_whole(file))
        parts = root.findall("joint/*")
        words = [part.tag for part in root.iter()]
        words += [word for part in parts for word in part.attrib.values()]
        if not any("xacro" in word or "$" in word for word in words):
            joints = {joint.name: joint for joint in map(_joint, root.findall("joint"))}
            links = [link.get("name", "") for link in root.findall("link")]
            return Tree(file, root, links, joints)
        message = XACRO.format(file.name)
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


def _joint(element: ElementTree.Element) -> Joint:
    name, kind = element.get("name", ""), element.get("type", "")
    parts = {part.tag: part.attrib for part in element}
    mimic = {"joint": None, "multiplier": "1", "offset": "0"} | parts.get("mimic", {})
    try:
        limits = {key: float(value) for key, value in parts.get("limit", {}).items()}
        coupling = [float(mimic[key]) for key in ("multiplier", "offset")]
    except ValueError as error:
        raise ValueError(f"limit or mimic of the joint {name}: {error}") from None
    ends = [parts.get(end, {}).get("link", "") for end in ("parent", "child")]
    follows = mimic["joint"] if kind in SINGLE else None  # some fixed joints have it
    if kind in LIMITED and not {"velocity", "effort"} <= {*limits}:
        raise ValueError(NO_LIMITS.format(name))
    return Joint(name, kind, *ends, limits, follows, *coupling)


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
    names, joints = robot.joints, tree.joints
    for key, name in [("joints", name) for name in names] + [("locked", name) for name in locked]:
        if name not in joints or joints[name].kind not in SINGLE:
            movable = sorted(name for name, joint in joints.items() if joint.kind in SINGLE)
            message = f"robot.{key}: no joint {name!r} of one coordinate in the URDF"
            raise ConfigError(f"{message}; it has {movable}", file=tree.file)
    if robot.tool is not None:
        tip = tree.link(robot.tool, "robot.tool")
    else:
        ends = [end for end in tree.ends if joints[names[-1]] in tree.above(end)]
        if len(ends) != 1:
            message = f"the URDF ends in more than one link beyond {names[-1]}; name one of {ends}"
            raise ConfigError(f"robot.tool: {message}", file=tree.file)
        tip = ends[0]
    base = None if robot.base is None else tree.link(robot.base, "robot.base")
    if (fault := next(_arm_faults(tree, robot, base, tip), None)) is not None:
        raise ConfigError(f"robot.{fault}", file=tree.file)
    followers = (joint for joint in joints.values() if joint.follows is not None)
    held = {
        joint.name: joint.multiplier * locked.get(joint.follows, 0.0) + joint.offset
        for joint in followers
    }
    return Description(tree, [joints[name] for name in names], base, tip, held | locked)


def _arm_faults(tree: Tree, robot: Robot, base: str | None, tip: str) -> Iterator[str]:
    """Faults of the way from the base to the tip."""
    joints, below_base = robot.joints, tree.above(base) if base else []
    above = tree.above(tip)
    on = [joint.name for joint in above if joint.name in joints]
    if both := sorted({*joints} & {*robot.locked}):
        yield f"locked: {', '.join(both)} cannot be locked, being of robot.joints"
    if joints != on:
        yield (
            f"joints: {joints} must be the joints of one chain from base to tip; those that move "
            f"{tip!r} are {on}: name them in this order, or another robot.tool"
        )
    if moving := [joint.name for joint in below_base if joint.name in joints]:
        yield f"base: {robot.base!r} moves with {moving[-1]}; name a link before the arm"
    for joint in (joint for joint in above if joint not in below_base):
        lower, upper = joint.range
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
        if joint.name in joints and joint.kind in LIMITED and not 0 < upper - lower < math.inf:
            yield f"urdf: {NO_LIMITS.format(joint.name)}"
