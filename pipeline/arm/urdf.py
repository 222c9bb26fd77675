"""Tree of links and joints in a URDF, and the joints of it that are the arm of the options."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.parsers import expat

from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Robot

# Pinocchio recurses and ends the process past some thousands of joints; a humanoid has some eighty
MOST_JOINTS = 250
FARTHEST = 1e6  # m or rad, of an origin or an axis: squares of it stay finite
LIMITED = ("revolute", "prismatic")  # kinds of joints with one coordinate and limits
SINGLE = (*LIMITED, "continuous")  # with one coordinate
KINDS = (*SINGLE, "fixed", "floating", "planar")
ROOT = "universe"  # how Pinocchio names what the robot stands on


@dataclass
class Joint:
    name: str
    kind: str
    parent: str = ""  # links
    child: str = ""
    follows: str | None = None  # the joint that it is coupled to (mimic): multiplier·q + offset
    multiplier: float = 1.0
    offset: float = 0.0
    limits: dict[str, float] | None = None  # lower, upper (rad or m), velocity, effort

    @property
    def range(self) -> tuple[float, float]:
        """The least and the greatest coordinate, rad or m: none of a continuous joint."""
        if self.kind == "continuous":
            return -math.inf, math.inf
        limits = self.limits or {}
        return limits.get("lower", 0.0), limits.get("upper", 0.0)


@dataclass
class Tree:
    """Links of a robot, and its joints by name, in the order of the file."""

    file: Path
    name: str = ""  # of the robot
    links: list[str] = field(default_factory=list)
    joints: dict[str, Joint] = field(default_factory=dict)

    def model_name(self, link: str) -> str:
        """Name of ``link`` in Pinocchio's model, whose links and joints share one set of names; a
        URDF lets a link and a joint share theirs.
        """
        taken = {*self.joints, ROOT}
        if link not in taken:
            return link
        free = f"link {link}"
        while free in taken or free in self.links:
            free = f"link {free}"
        return free

    @property
    def ends(self) -> list[str]:
        """The links that no other follows."""
        followed = {joint.parent for joint in self.joints.values()}
        return [link for link in self.links if link not in followed]

    def above(self, link: str) -> list[Joint]:
        """The joints from the root to ``link``."""
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
        if name in self.links:
            return name
        if name in self.joints:
            return self.joints[name].child
        raise ConfigError(f"{key}: no frame {name!r} in the URDF", file=self.file)


def read_urdf(file: Path) -> Tree:
    """Return the tree that ``file`` describes; ConfigError for a file that is no URDF, and for
    links and joints that are no tree.
    """
    if not file.is_file():
        raise ConfigError("robot.urdf: no such file; name one from the project's root", file=file)
    tree, reader = Tree(file), expat.ParserCreate()
    path: list[str] = []

    def start(element: str, values: dict[str, str]) -> None:
        path.append(element)
        _take(tree, path, values)

    def refuse(*_: object) -> None:
        raise ValueError("it declares a document type or entities, which no robot needs")

    reader.StartElementHandler, reader.EndElementHandler = start, lambda _: path.pop()
    reader.StartDoctypeDeclHandler = refuse
    try:
        with file.open("rb") as stream:
            reader.ParseFile(stream)
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        raise ConfigError(
            f"robot.urdf: this is no URDF ({reason})", file=file, line=error.lineno
        ) from None
    except OSError as error:
        message = f"robot.urdf: the file cannot be read ({error.strerror})"
        raise ConfigError(message, file=file) from None
    except (LookupError, ValueError) as error:
        raise ConfigError(
            f"robot.urdf: this is no URDF ({error}); is it XML in UTF-8?", file=file
        ) from None
    _require_tree(tree)
    return tree


def _take(tree: Tree, path: list[str], values: dict[str, str]) -> None:
    """Note the element that ``path`` leads to."""
    if path[-1].startswith("xacro:") or (
        len(path) <= 3 and any("${" in value or "$(" in value for value in values.values())
    ):
        name = tree.file.name
        raise ConfigError(
            f"robot.urdf: a xacro: expand it with xacro {name} > arm.urdf", file=tree.file
        )
    match path:
        case ["robot"]:
            tree.name = values.get("name", "")
        case ["robot", "link"]:
            tree.links.append(values.get("name", ""))
        case ["robot", "joint"]:
            if len(tree.joints) == MOST_JOINTS:
                raise ConfigError(
                    f"robot.urdf: more than {MOST_JOINTS} joints; take out what does not belong to "
                    "the arm",
                    file=tree.file,
                )
            name, kind = values.get("name", ""), values.get("type", "")
            if name in tree.joints:
                raise ConfigError(f"robot.urdf: two joints are named {name!r}", file=tree.file)
            if kind not in KINDS or name == ROOT:
                wrong = f"is of the type {kind!r}; there are {', '.join(KINDS)}"
                wrong = f"has a name that Pinocchio needs for {ROOT}" if name == ROOT else wrong
                raise ConfigError(f"robot.urdf: the joint {name} {wrong}", file=tree.file)
            tree.joints[name] = Joint(name, kind)
        case ["robot", "joint", part]:
            _take_part(tree, part, values)


def _take_part(tree: Tree, part: str, values: dict[str, str]) -> None:
    """Note the element ``part`` of the last joint."""
    joint: Any = tree.joints[[*tree.joints][-1]]

    def number(name: str, text: str) -> float:
        try:
            return float(text)
        except ValueError:
            raise ConfigError(
                f"robot.urdf: the joint {joint.name} has {text[:80]!r} as {name} of its {part}, "
                "which must be a number",
                file=tree.file,
            ) from None

    for name in ("xyz", "rpy"):
        for word in values.get(name, "").split():
            if not abs(number(name, word)) <= FARTHEST:
                raise ValueError(f"{joint.name} has {word[:80]} m or rad in its {part}")
    if part in ("parent", "child"):
        setattr(joint, part, values.get("link", ""))
    elif part == "limit":
        known = {"lower", "upper", "velocity", "effort"} & {*values}
        joint.limits = {name: number(name, values[name]) for name in known}
    elif part == "mimic" and joint.kind in SINGLE:  # some fixed joints say so too
        joint.follows = values.get("joint", "")
        joint.multiplier = number("multiplier", values.get("multiplier", "1"))
        joint.offset = number("offset", values.get("offset", "0"))


def _require_tree(tree: Tree) -> None:
    """Raise ConfigError where the links are no tree or a joint lacks the limits of its kind."""
    if twice := [name for name in tree.links if tree.links.count(name) > 1]:
        raise ConfigError(f"robot.urdf: two links are named {twice[0]!r}", file=tree.file)
    for joint in tree.joints.values():
        for link in (joint.parent, joint.child):
            if link not in tree.links:
                raise ConfigError(
                    f"robot.urdf: {joint.name} joins the link {link!r}, which the URDF does not "
                    "have",
                    file=tree.file,
                )
        if joint.kind in LIMITED and not {"velocity", "effort"} <= {*(joint.limits or {})}:
            raise _without_limits(joint, tree.file)
    children = [joint.child for joint in tree.joints.values()]
    closing = {
        joint.name
        for joint in tree.joints.values()
        if children.count(joint.child) > 1 or len(tree.above(joint.child)) > len(tree.joints)
    }
    if closing:
        raise ConfigError(
            "robot.urdf: links form a loop, which a URDF cannot hold; leave out one of the joints "
            f"{', '.join(sorted(closing))}",
            file=tree.file,
        )
    roots = [link for link in tree.links if link not in children]
    if len(roots) != 1:
        raise ConfigError(
            "robot.urdf: a robot has one link that no joint holds, and this one "
            f"{', '.join(roots[:5]) or 'none'}",
            file=tree.file,
        )


def require_range(joint: Joint, file: Path) -> None:
    """Raise ConfigError for a joint whose limits leave it no way, or an endless one."""
    lower, upper = joint.range
    if joint.kind in LIMITED and not 0 < upper - lower < math.inf:
        raise _without_limits(joint, file)


def _without_limits(joint: Joint, file: Path) -> ConfigError:
    return ConfigError(
        f"robot.urdf: the joint {joint.name} has no limits; give it <limit lower upper velocity "
        "effort>, or the type continuous",
        file=file,
    )


@dataclass(frozen=True)
class Description:
    """An arm in the tree of a URDF."""

    tree: Tree
    joints: list[Joint]  # base to tip
    base: str | None  # link; None for the root
    tip: str  # link
    held: dict[str, float]  # rad or m, of the other joints; 0 where not named

    @property
    def file(self) -> Path:
        """The URDF."""
        return self.tree.file


def describe(robot: Robot) -> Description:
    """Return the arm of the section ``dataset.robot``; coupled joints (mimic) that are not of the
    arm are held where those that they follow hold them.

    Raises ConfigError for names that the URDF does not have, and for joints, tip and base that are
    no chain of joints of one coordinate each.
    """
    tree = read_urdf(Path(robot.urdf))
    joints, locked, file = list(robot.joints), dict(robot.locked), tree.file
    names = sorted(name for name, joint in tree.joints.items() if joint.kind != "fixed")
    for key, wanted in (("robot.joints", joints), ("robot.locked", locked)):
        for name in wanted:
            if name not in names:
                message = f"{key}: no joint {name!r} in the URDF; it has {names}"
                raise ConfigError(message, file=file)
            if (kind := tree.joints[name].kind) not in SINGLE:
                raise ConfigError(
                    f"{key}: {name} is {kind}; a joint must be one of {', '.join(SINGLE)}",
                    file=file,
                )
    if both := sorted(set(joints) & set(locked)):
        raise ConfigError(
            f"robot.locked: {', '.join(both)} cannot be locked, being of robot.joints", file=file
        )
    tip = _tip(tree, joints[-1], robot.tool)
    above = tree.above(tip)
    _require_row(joints, [joint.name for joint in above if joint.name in joints], tip, file)
    base = None if robot.base is None else tree.link(robot.base, "robot.base")
    below_base = tree.above(base) if base else []
    if moving := [joint.name for joint in below_base if joint.name in joints]:
        message = f"robot.base: {robot.base!r} moves with {moving[-1]}; name a link before the arm"
        raise ConfigError(message, file=file)
    for joint in above:
        if joint not in below_base:
            _require_single(joint, joints, file)
    held = {
        name: joint.multiplier * locked.get(joint.follows, 0.0) + joint.offset
        for name, joint in tree.joints.items()
        if joint.follows is not None
    }
    return Description(tree, [tree.joints[name] for name in joints], base, tip, held | locked)


def _tip(tree: Tree, last: str, tool: str | None) -> str:
    """The link of the option ``tool``, or the only one beyond the joint ``last`` that no other
    follows.
    """
    if tool is not None:
        return tree.link(tool, "robot.tool")
    ends = [link for link in tree.ends if last in [joint.name for joint in tree.above(link)]]
    if len(ends) != 1:
        raise ConfigError(
            f"robot.tool: the URDF ends in more than one link beyond {last}; name one of {ends}",
            file=tree.file,
        )
    return ends[0]


def _require_row(joints: list[str], on: list[str], tip: str, file: Path) -> None:
    """Raise ConfigError where the ``joints`` are not those ``on`` the way to the ``tip``."""
    if joints[-1] not in on:
        raise ConfigError(
            f"robot.tool: {tip!r} does not move with the last joint of the chain, {joints[-1]}",
            file=file,
        )
    if apart := [name for name in joints if name not in on]:
        raise ConfigError(
            f"robot.joints: {', '.join(apart)} does not move {tip!r}; name joints of one chain",
            file=file,
        )
    if joints != on:
        raise ConfigError(
            f"robot.joints: {joints} must stand in the order of the chain {on}", file=file
        )


def _require_single(joint: Joint, joints: list[str], file: Path) -> None:
    """Raise ConfigError for a ``joint`` between base and tip that the arm cannot have."""
    if joint.kind not in (*SINGLE, "fixed"):
        raise ConfigError(
            f"robot.joints: the joint {joint.name} before the tip is {joint.kind}; name a link "
            "beyond it as robot.base, or put joints of one coordinate in its place",
            file=file,
        )
    if joint.follows is not None and (joint.name in joints or joint.follows in joints):
        raise ConfigError(
            f"robot.joints: {joint.name} is coupled to {joint.follows} (mimic), and the tip moves "
            "with it; an arm of joints that move by themselves is needed",
            file=file,
        )
    if joint.name in joints:
        require_range(joint, file)
