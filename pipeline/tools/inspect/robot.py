"""What a robot's description or a dataset's datasheet says of itself."""

from __future__ import annotations

import re
from pathlib import Path
from xml.parsers import expat

from pipeline.core import datasheet as datasheets
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.formats.format import Head
from pipeline.tools.inspect.finding import DATASHEET, ROBOT, Finding


def urdf(file: Path) -> Finding:
    """A robot's URDF: its joints by type, and which three of them are a planar chain that ends in
    which link.
    """
    elements: list[tuple[str, dict[str, str]]] = []  # type and attributes of each joint
    links: list[str] = []
    followed: set[str | None] = set()  # links that others follow
    depth = 0

    def start(name: str, values: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth == 1:
            robot.append(values.get("name", ""))
        if depth == 2 and name == "joint":
            elements.append((values.get("type", ""), values))
        if depth == 2 and name == "link":
            links.append(values.get("name", ""))
        if depth == 3 and name == "parent":
            followed.add(values.get("link"))

    def end(_: str) -> None:
        nonlocal depth
        depth -= 1

    def refuse(*_: object) -> None:
        raise RecordingError("the URDF declares a document type or entities, which no robot needs")

    robot: list[str] = []
    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler, parser.StartDoctypeDeclHandler = (
        start,
        end,
        refuse,
    )
    try:
        parser.Parse(file.read_bytes(), True)
    except expat.ExpatError as error:
        raise RecordingError(
            f"this is no XML ({expat.ErrorString(error.code)})", line=error.lineno
        ) from None
    except (LookupError, ValueError) as error:
        raise RecordingError(
            f"the encoding that the XML announces cannot be read ({error}); save it as UTF-8",
            line=1,
        ) from None
    joints = {
        kind: [values.get("name", "") for other, values in elements if other == kind]
        for kind in dict.fromkeys(type_ for type_, _ in elements)
    }
    finding = Finding(
        file, "URDF", ROBOT, facts={"robot": robot[0], "joints": joints, "links": links}
    )
    if len(joints.get("revolute", [])) < 3:
        finding.stops.append(
            "fewer than three revolute joints with limits: no planar chain of three"
        )
        return finding
    ends = [link for link in links if link not in followed]
    finding.facts["chains"] = chains = _chains(file, joints["revolute"], ends)
    if not chains:
        finding.stops.append(
            "no three revolute joints in a row have parallel axes and a last link beyond them: "
            "no planar chain of three"
        )
    elif len(chains) > 1:
        finding.open.append(("which three parallel joints are the chain", "dataset.robot.joints"))
    elif len(chains[0]["tools"]) > 1:
        finding.open.append(("which link is the end-effector", "dataset.robot.tool"))
    return finding


def _chains(file: Path, joints: list[str], ends: list[str]) -> list[dict[str, list[str]]]:
    """The planar chains of the URDF: three ``joints`` in the order of the file, and those of the
    last links that the third one moves.
    """
    from pipeline.arm.model import load_arm

    def moves(chain: list[str], tool: str) -> bool:
        try:
            load_arm(file, chain, tool, {})
        except ConfigError as error:
            if error.message.startswith("robot.urdf"):
                raise RecordingError(error.message) from None
            return False
        return True

    triples = [joints[first : first + 3] for first in range(len(joints) - 2)]
    chains = [
        {"joints": chain, "tools": [tool for tool in ends if moves(chain, tool)]}
        for chain in triples
    ]
    return [chain for chain in chains if chain["tools"]]


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
