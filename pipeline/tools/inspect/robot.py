"""Account of a robot's URDF: joints by type, arms in space and planar chains."""

from __future__ import annotations

from typing import Any

from pipeline.arm.model import load_arm
from pipeline.arm.urdf import SINGLE, read_urdf
from pipeline.core.errors import ConfigError
from pipeline.tools.inspect.finding import Finding


def urdf(finding: Finding) -> None:
    """Add to ``finding`` the joints, the last link that most joints of one coordinate move
    (``arms``, joints from base to tip), and every three joints in a row that are a planar chain
    with the links it ends in (``chains``). ConfigError as :func:`pipeline.arm.urdf.read_urdf`.
    """
    tree = read_urdf(finding.file)
    joints: dict[str, list[str]] = {}
    for joint in tree.joints.values():
        joints.setdefault(joint.kind, []).append(joint.name)
    arms: list[dict[str, Any]] = []
    for end in tree.ends:
        moving = [joint for joint in tree.above(end) if joint.kind in SINGLE]
        # a joint that follows another (mimic) has no coordinate of its own
        arms.append({"joints": [j.name for j in moving if j.follows is None], "tip": end})
    most = max((len(arm["joints"]) for arm in arms), default=0)
    arms = [arm for arm in arms if most and len(arm["joints"]) == most]
    refused: list[str] = []

    def moves(chain: list[str], tool: str) -> bool:
        try:
            load_arm(finding.file, chain, tool, {})
        except ConfigError as error:
            refused.extend([error.message] if error.message.startswith("robot.urdf") else [])
            return False
        return True

    turning, chains = joints.get("revolute", []), []
    for chain in (turning[first : first + 3] for first in range(len(turning) - 2)):
        if tools := [tool for tool in tree.ends if moves(chain, tool)]:
            chains.append({"joints": chain, "tools": tools})
    finding.facts |= {"robot": tree.name, "joints": joints, "arms": arms, "chains": chains}
    if refused and chains:
        finding.facts["chains_refused"] = refused[0]
    elif refused:
        finding.stops.append(refused[0])
    if not (arms or chains):
        finding.stops.append("no joint of one coordinate moves a last link: no arm")
    elif len(chains) > 1:
        finding.ask("which three parallel joints are the chain", "dataset.robot.joints")
    elif len(chains[0]["tools"] if chains else arms) > 1:
        finding.ask("which link is the end-effector", "dataset.robot.tool")
