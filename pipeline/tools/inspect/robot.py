"""What a robot's description or a dataset's datasheet says of itself."""

from __future__ import annotations

import re
from pathlib import Path

from pipeline.arm.urdf import SINGLE, Tree, read_urdf
from pipeline.core import datasheet as datasheets
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.formats.format import Head
from pipeline.tools.inspect.finding import DATASHEET, ROBOT, Finding


def urdf(file: Path) -> Finding:
    """A robot's URDF: its joints by type, which of them move which last link, and which three are a
    planar chain that ends in which.
    """
    try:
        tree = read_urdf(file)
    except ConfigError as error:
        raise RecordingError(error.message, line=error.evidence.get("line")) from None
    joints: dict[str, list[str]] = {}
    for joint in tree.joints.values():
        joints.setdefault(joint.kind, []).append(joint.name)
    finding = Finding(
        file, "URDF", ROBOT, facts={"robot": tree.name, "joints": joints, "links": tree.links}
    )
    finding.facts["arms"] = arms = _arms(tree)
    chains, refused = _chains(file, joints.get("revolute", []), tree.ends)
    finding.facts["chains"] = chains
    if refused and not chains:
        finding.stops.append(refused[0])
    elif refused:
        finding.facts["chains_refused"] = refused[0]
    if not (arms or chains):
        finding.stops.append("no joint of one coordinate moves a last link: no arm")
    elif len(chains) > 1:
        finding.open.append(("which three parallel joints are the chain", "dataset.robot.joints"))
    elif len(chains[0]["tools"] if chains else arms) > 1:
        finding.open.append(("which link is the end-effector", "dataset.robot.tool"))
    return finding


def _arms(tree: Tree) -> list[dict[str, list[str] | str]]:
    """Of each last link that joints of one coordinate move, which follow no other, these joints,
    base to tip; only those with the most.
    """
    arms = []
    for end in tree.ends:
        above = [joint for joint in tree.above(end) if joint.kind in SINGLE]
        arms.append({"joints": [j.name for j in above if j.follows is None], "tip": end})
    most = max((len(arm["joints"]) for arm in arms), default=0)
    return [arm for arm in arms if most and len(arm["joints"]) == most]


def _chains(
    file: Path, joints: list[str], ends: list[str]
) -> tuple[list[dict[str, list[str]]], list[str]]:
    """The planar chains of the URDF: three ``joints`` in the order of the file, and those of the
    last links that the third one moves; and why the URDF is refused with others, as for a joint
    without limits that is no part of these.
    """
    from pipeline.arm.model import load_arm

    refused: list[str] = []

    def moves(chain: list[str], tool: str) -> bool:
        try:
            load_arm(file, chain, tool, {})
        except ConfigError as error:
            if error.message.startswith("robot.urdf"):
                refused.append(error.message)
            return False
        return True

    triples = [joints[first : first + 3] for first in range(len(joints) - 2)]
    chains = [
        {"joints": chain, "tools": [tool for tool in ends if moves(chain, tool)]}
        for chain in triples
    ]
    return [chain for chain in chains if chain["tools"]], refused


def is_datasheet(head: Head) -> bool:
    """Whether a file begins like the datasheet of a dataset."""
    return head.file.name == "dataset.yaml" or (
        head.suffix in (".yaml", ".yml")
        and re.search(r"(?m)^recordings:", head.text or "") is not None
    )


def datasheet(file: Path) -> Finding:
    """A datasheet: what is still to be filled in."""
    finding = Finding(file, "datasheet", DATASHEET)
    unfilled = datasheets.unfilled(file)
    if not unfilled:
        datasheets.read(file)
    finding.open += [
        ("to be filled in: there is ??? for a value", f"dataset.{key}") for key in unfilled
    ]
    return finding
