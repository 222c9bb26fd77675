"""What a robot's description or a dataset's datasheet says of itself."""

from __future__ import annotations

from pathlib import Path
from xml.parsers import expat

from pipeline import datasheet as datasheets
from pipeline.errors import RecordingError
from pipeline.inspection.finding import Finding


def urdf(file: Path) -> Finding:
    """A robot's URDF: its joints by type. Whether three of them are a planar chain is seen when they are named."""
    found: list[tuple[str, dict[str, str]]] = []
    links: list[str] = []
    depth = 0

    def start(name: str, values: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth == 1:
            robot.append(values.get("name", ""))
        if depth == 2 and name == "joint":
            found.append((values.get("type", ""), values))
        if depth == 2 and name == "link":
            links.append(values.get("name", ""))

    def end(_: str) -> None:
        nonlocal depth
        depth -= 1

    def refuse(*_: object) -> None:
        raise RecordingError("the URDF declares a document type or entities, which no robot needs")

    robot: list[str] = []
    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler, parser.StartDoctypeDeclHandler = start, end, refuse
    try:
        parser.Parse(file.read_bytes(), True)
    except expat.ExpatError as error:
        raise RecordingError(f"this is no XML ({expat.ErrorString(error.code)})", line=error.lineno) from None
    joints = {kind: [values.get("name", "") for other, values in found if other == kind] for kind in dict.fromkeys(k for k, _ in found)}
    finding = Finding(file, "URDF", facts={"robot": robot[0], "joints": joints, "links": links})
    if len(joints.get("revolute", [])) < 3:
        finding.stops.append("fewer than three revolute joints with limits: no planar chain of three")
    else:
        finding.open.append(("which three parallel joints are the chain, and which link the tool", "dataset.robot.joints, .tool"))
    return finding


def datasheet(file: Path) -> Finding:
    """A datasheet: what is still to be filled in."""
    finding = Finding(file, "datasheet")
    unfilled = datasheets.unfilled(file)
    if not unfilled:
        datasheets.read(file)
    finding.open += [("to be filled in: there is ??? for a value", f"dataset.{key}") for key in unfilled]
    return finding
