"""Which joints of a URDF are the arm that the options ask for, and what is held."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pipeline.arm.urdf import SINGLE, Joint, Tree, read_urdf, require_range
from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Robot


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
    """The arm of the section ``dataset.robot``.

    Coupled joints (mimic) that are not of the arm are held where those that they follow hold them.
    Raises ConfigError for what :func:`read_urdf` refuses, names that the URDF does not have, joints
    that are not in one chain and in its order, or have not one coordinate, or no limits, or follow
    others, a tip that is not beyond them, and a base that they move.
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
    """Raise ConfigError for a ``joint`` between base and tip that has several coordinates, or is
    coupled to one of the arm's ``joints``, or is one of them and coupled or without limits.
    """
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
