"""Values of the section robot that URDF, commanded trajectory and instruments determine."""

from collections.abc import Mapping
from functools import cache
from os.path import relpath
from pathlib import Path
from typing import Any

from pipeline.arm.urdf import SINGLE
from pipeline.configuration.datasheet import get_filled, get_nested
from pipeline.formats.format import Kind
from pipeline.recordings.commands import UNFILLED
from pipeline.tools.inspect.command import describe_file
from pipeline.tools.inspect.finding import ROBOT
from pipeline.tools.new_dataset.layout import RecordingLayout
from pipeline.tools.new_dataset.template import (
    Entries,
    Entry,
    choice_of,
    list_of_names,
    suggestion,
    text_of,
)

POSE_ROWS = 6  # number of coordinates of a pose in space
CHAIN_JOINTS = "the only three in a row that are parallel"
ARM_JOINTS = "all that move the last link"
COMMANDED_JOINTS = "the columns of the commanded trajectory"

# key of the cache: the absolute path, since one relative path is another file in another folder
describe_urdf = cache(describe_file)


def urdf_of(recorded: RecordingLayout, values: Mapping[str, Any]) -> str:
    """Return the path of the URDF: the filled-in one, else the only one among the recordings."""
    filled = get_filled(values, "robot.urdf")
    if filled:
        return filled
    robots = recorded.single.get(ROBOT, [])
    return str(robots[0].file.resolve()) if len(robots) == 1 else UNFILLED


def urdf_facts(urdf: str) -> dict[str, Any]:
    """Return joints by kind, arms and planar chains of a ``urdf``; nothing if it is unfilled."""
    if urdf == UNFILLED:
        return {}
    return describe_urdf(Path(urdf).resolve()).facts


def movable_joints(facts: Mapping[str, Any]) -> list[str]:
    """Return the revolute, continuous and prismatic joints of a URDF with these ``facts``."""
    by_kind = facts.get("joints", {})
    return [joint for kind in SINGLE for joint in by_kind.get(kind, [])]


def robot_entries(
    recorded: RecordingLayout,
    urdf: str,
    values: Mapping[str, Any],
) -> Entries:
    """Return the entries of the section robot: the arm or planar chain in a ``urdf``."""
    facts = urdf_facts(urdf)
    if is_planar(recorded, facts, values):
        robot = _planar_chain(facts)
    else:
        robot = _arm_in_space(recorded, facts, values)
    if len(recorded.single.get(ROBOT, [])) == 1:
        robot["robot.urdf"] = Entry(text_of(Path(relpath(urdf)).as_posix()))
    return robot


def is_planar(
    recorded: RecordingLayout,
    facts: Mapping[str, Any],
    values: Mapping[str, Any],
) -> bool:
    """Return whether the task is in a plane: as stated, as a depth camera requires it, as the
    trajectory is commanded, or as the URDF's only arm is three parallel joints.
    """
    stated = get_filled(values, "robot.plane")
    if stated is not None:
        return bool(stated)
    if recorded.of("depth"):
        return True
    trajectories = recorded.single.get(Kind.TRAJECTORY, [])
    if trajectories:
        rows = [trajectory.facts.get("commanded_rows") for trajectory in trajectories]
        return all(rows)
    chains = [chain["joints"] for chain in facts.get("chains", [])]
    arms = facts.get("arms", [])
    return bool(arms) and chains == [arms[0]["joints"]]


def _planar_chain(facts: Mapping[str, Any]) -> Entries:
    """Return the entries of three parallel joints; all other joints are locked."""
    chains = facts.get("chains", [])
    turning = facts.get("joints", {}).get("revolute", [])
    chain: Entries = {"robot.plane": Entry("")}
    if len(chains) == 1:
        joints = chains[0]["joints"]
        chain["robot.joints"] = Entry(f"[{list_of_names(joints)}]", CHAIN_JOINTS)
        chain["robot.tool"] = choice_of(chains[0]["tools"])
        turning = [joint for joint in turning if joint not in joints]
    else:
        parallel = f"three parallel ones of {list_of_names(turning) or 'the URDF'}"
        chain["robot.joints"] = suggestion(parallel)
    if turning or not chains:
        chain["robot.locked"] = suggestion(list_of_names(turning))
    else:
        chain["robot.locked"] = Entry("{}")
    return chain


def _arm_in_space(
    recorded: RecordingLayout,
    facts: Mapping[str, Any],
    values: Mapping[str, Any],
) -> Entries:
    """Return the entries of the joints that move the last link, or that the trajectory commands."""
    arms = facts.get("arms", [])
    if not arms:
        return {}
    movable = movable_joints(facts)
    joints = arms[0]["joints"]
    note = ARM_JOINTS
    for trajectory in recorded.single.get(Kind.TRAJECTORY, []):
        commanded = trajectory.facts.get("commanded_joints", [])
        if commanded and {*commanded} <= {*movable}:
            joints = commanded
            note = COMMANDED_JOINTS
    in_space = {"robot.joints": Entry(f"[{list_of_names(joints)}]", note)}
    in_space["robot.tool"] = choice_of(arm["tip"] for arm in arms)
    chosen = get_filled(values, "robot.joints") or joints
    if len(chosen) < POSE_ROWS:
        task = "[x, y, z]" if len(chosen) >= 3 else None
        in_space["robot.task"] = suggestion("", task)
    if get_nested(values, "robot.locked") is not None:  # proposed as planar before
        locked = [joint for joint in movable if joint not in chosen]
        in_space["robot.locked"] = (
            suggestion(list_of_names(locked)) if locked else Entry("{}")
        )
    return in_space
