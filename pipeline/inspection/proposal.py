"""Datasheet and option file of a new dataset: what its recordings say of themselves, and ??? with a word of what to put there."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

from pipeline.inspection.finding import Finding, shown
from pipeline.inspection.layout import DEPTH_TYPES, Group, Layout

OPEN = "???"  # OmegaConf's mark of a value to come
RESERVED = ("y", "n", "yes", "no", "on", "off", "true", "false", "null")
INVENTORY = """\
# These recordings are read in place: their inventory stands here for them, so that a change of the files reruns what depends on it.
vars: ["dataset.yaml:recordings"]
stages:
  inventory:
    wdir: ../../..
    cmd: python -m pipeline inventory "${{recordings}}" > data/raw/{name}/inventory.csv.partial && mv data/raw/{name}/inventory.csv.partial data/raw/{name}/inventory.csv
    deps: ["${{recordings}}", pipeline/__init__.py, pipeline/stages/inventory.py]
    outs: [data/raw/{name}/inventory.csv: {{cache: false, persist: true}}]
"""  # noqa: E501


def datasheet_file(name: str, recordings: str, found: Layout, folder: Path) -> str:
    """The text of data/raw/NAME/dataset.yaml for what was ``found`` in ``folder``, which is ``recordings`` from the project's root."""
    lines = [
        f"# Datasheet of {name}: what is known of the recordings. Put a value for every ???; every key is explained, with those that these",
        "# recordings may need and that do not stand here, in data/raw/youbot/dataset.yaml. m, rad, s, N.",
        "about:",
        f"  subject: {OPEN} # what was recorded: robot, instruments, motion",
        f"  source: {OPEN} # who recorded it, and where it comes from",
        f"  licence: {OPEN} # on which terms others may use it",
        f"recordings: {_text(recordings)} # every path and pattern below starts there",
    ]
    below = partial(_below, folder)
    trajectories = found.single.get("commanded trajectory", [])
    if len(trajectories) == 1:
        lines.append(f"trajectory: {below(trajectories[0])}")
    elif trajectories or found.training or found.test:
        lines.append(f"trajectory: {_one_of(map(below, trajectories))} # the commanded end-effector: columns t, x, z, phi, vx, vz, vphi")
    if found.training or found.test:
        lines += _mocap(found)
    if found.depth:
        lines += _depth(found, below)
    if found.force:
        lines += _force(found, below)
    if found.movements:
        lines += _joint_log(found.movements)
    if unplaced := [below(finding) for finding in found.unplaced]:
        lines.append(f"# not placed: {', '.join(unplaced[:12])}{f' … ({len(unplaced)})' if len(unplaced) > 12 else ''}")
    return "\n".join(lines) + "\n"


def option_file(name: str, recordings: str, found: Layout, folder: Path) -> str:
    """The text of pipeline/conf/dataset/NAME.yaml: what the analysis does with what was ``found``; see :func:`datasheet_file`."""
    takes = [take for group in (*found.training, *found.test) for take in group.takes.values()]
    robots = found.single.get("URDF", [])
    urdf = _text(f"{recordings}/{shown(robots[0].file.relative_to(folder))}") if len(robots) == 1 else OPEN
    lines = [
        f"# {name}: what the analysis does with the recordings that data/raw/{name}/dataset.yaml describes. Put a value for every ???.",
        f"name: {_text(name)}",
        "robot:",
        f"  urdf: {urdf} # from the project's root",
        f"  joints: {OPEN} # the three parallel joints of the planar chain, base to tip{_known(robots)}",
        f"  tool: {OPEN} # link of the URDF that is the end-effector",
        f"  locked: {OPEN} # rad, joints that are held still: {{joint: angle, …}}, {{}} where all others are at 0",
        "motion:",
        f"  rate: {_agreed(take.rate for take in takes)} # 1/s, of the motion grid",
        f"  steps: {_agreed(take.facts.get('steps') for take in takes)} # M, steps of a take",
    ]
    if takes:
        lines += [
            "mocap:",
            f"  gate: {OPEN} # m, how far a marker may be from where it is predicted to be taken for it (youbot: 0.012)",
            "  max_gap: 20 # frames, longest gap that is interpolated",
        ]
    if found.depth:
        lines += [
            "depth:",
            "  search: 0.5 # s, the clocks' offset is looked for between -search and +search",
            "  workspace: # what of the scene is the arm, in the frame of its plane",
            f"    half_depth: {OPEN} # m, on either side of the plane (youbot: 0.06)",
            f"    girth: {OPEN} # m, how far the arm's surface is from its axes (youbot: 0.05)",
            f"    column_half_width: {OPEN} # m, of what carries the arm (youbot: 0.06)",
            f"    column_top: {OPEN} # m (youbot: -0.015)",
            f"    floor: {OPEN} # m (youbot: 0.0)",
            "    min_pixels: 30 # fewer are no arm",
            "    max_points: 1500 # of a frame that are kept",
        ]
    if found.force:
        lines += [
            "force: # the bounds that are given for the models",
            f"  kappa_bounds: {OPEN} # 1, of the concentration of the directions (the paper: [169.35, 2416.0])",
            f"  tension_std_bounds: {OPEN} # N (the paper: [0.48, 2.27])",
            f"  tension_bounds: {OPEN} # N (the paper: [1.82, 13.89])",
        ]
    if found.movements:
        lines += [
            "joint_log:",
            f"  columns: {OPEN} # which three of the logged joints, from 1, are the chain's",
            f"  start: {OPEN} # rad, commanded angles of the chain at rest before the motion",
            f"  end: {OPEN} # rad, and after it",
            f"  rest: {OPEN} # steps at rest kept on either side, of motion.steps",
            f"  tolerance: {OPEN} # rad, how exactly commands must repeat (ur5: 2.0e-4)",
        ]
    return "\n".join(lines) + "\n"


def _mocap(found: Layout) -> list[str]:
    takes = [take for group in (*found.training, *found.test) for take in group.takes.values()]
    lines = ["mocap:"]
    # which group is which is known where the depth camera saw the one; a single group is what there is to fit to
    training, test = found.training, found.test
    if len(training) == 1 and len(test) <= 1:
        lines += [f"  training: {_text(training[0].pattern)}", f"  test: {_text(test[0].pattern) if test else 'null'}"]
    else:
        patterns = [_text(group.pattern) for group in (*training, *test)]
        lines += [f"  training: {_one_of(patterns)} # takes that the models are fitted to", f"  test: {OPEN} # that they are compared on"]
    if any(take.units.get("length") == "not stated" for take in takes):
        lines.append(f"  unit: {OPEN} # m, cm or mm: the files do not say it")
    lines += [
        "  base: # the arm's base in the motion capture's world",
        f"    position: {OPEN} # m, [x, y, z]",
        f"    rpy: {OPEN} # rad, about the fixed axes x, y, z; Motive's world has y up: [-1.5707963267948966, 0.0, 0.0] turns it",
    ]
    shared = [name for name in takes[0].markers if all(name in take.markers for take in takes)]
    if links := _links(shared):
        lines.append("  markers: # m, in the frame of each segment (z along it, y the normal of the plane); grouped as the names suggest")
        for link, names in links.items():
            lines += [f"    {_text(link)}:", *(f"      {_text(name)}: {OPEN} # [x, y, z]" for name in names)]
    else:
        names = ", ".join(map(_text, shared)) or "none in all takes"
        lines.append(f"  markers: {OPEN} # three links of three markers, {{link1: {{name: [x, y, z], …}}, …}} in m; there are {names}")
    if bodies := [name for name in takes[0].bodies if all(name in take.bodies for take in takes)]:
        lines.append(f"  # bodies: of a link followed by a rigid body, its name; there are {', '.join(map(_text, bodies))}")
    return lines


def _links(names: list[str]) -> dict[str, list[str]] | None:
    """The names by what stands before their last part, where these are three times three."""
    links: dict[str, list[str]] = {}
    for name in names:
        links.setdefault(re.sub(r"[_:. -]*(\d+|[A-Za-z]|[Mm]arker ?\d+)$", "", name), []).append(name)
    return links if len(links) == 3 and all(len(found) == 3 for found in links.values()) and all(links) else None


def _depth(found: Layout, below: Callable[[Finding], str]) -> list[str]:
    group = max(found.depth, key=lambda group: len(group.takes))
    takes = list(group.takes.values())
    place, first = next(iter(group.takes.items()))
    bag = "topics" in first.facts
    lines = ["depth:", f"  takes: {_text(group.pattern)} # one for each test take of the motion capture, of its name"]
    if len(found.depth) > 1:
        lines[1] = f"  takes: {_one_of(_text(group.pattern) for group in found.depth)} # one for each test take, of its name"
    if first.format == "depth sequence with index":
        lines.append(f"  index: {_text(first.file.relative_to(place).as_posix())}")
    elif not bag:
        lines.append(f"  frames: {_text(first.file.relative_to(place).as_posix())}")
    if bag:
        lines += _topics(first)
    clouds = DEPTH_TYPES[0] not in _kinds(first) if bag else "cloud" in first.version
    if not clouds:
        calibrations = [below(finding) for finding in found.single.get("camera intrinsics", [])]
        if calibrations or not bag:
            lines.append(f"  intrinsics: {calibrations[0] if len(calibrations) == 1 else _one_of(calibrations)}")
        lines += [f"  {name}: {_agreed(take.facts.get(name) for take in takes)} # px" for name in ("width", "height")]
    rates = sorted(take.rate for take in takes if take.rate)
    rate = f"{rates[len(rates) // 2]:.4g} # 1/s, as the indexes have it" if rates and not bag else f"{OPEN} # 1/s"
    lines += [
        f"  encoding: {'plain' if clouds else OPEN} # plain (depth), rotated_bits (SUN RGB-D) or disparity (NYU Depth v2)",
        f"  units_per_metre: {OPEN} # 1000 for millimetres, 5000 for TUM RGB-D, 1 for metres{_values(first)}",
        f"  rate: {rate}",
        "  start: null # s on the camera's clock when the motion capture starts, as far as known; null: at its first frame",
        "  clock_offset: null # s still to add to read the motion capture's clock; null: estimated",
        "  camera: # x right, y down, z forward, in the arm's base frame",
        f"    position: {OPEN} # m, [x, y, z]",
        f"    rpy: {OPEN} # rad, about the fixed axes x, y, z",
    ]
    return lines


def _kinds(bag: Finding) -> set[str]:
    return {topic["type"] for topic in bag.facts["topics"].values() if topic["messages"]}


def _topics(bag: Finding) -> list[str]:
    lines = []
    for key, kinds in (("topic", DEPTH_TYPES), ("camera_info", ("sensor_msgs/msg/CameraInfo",))):
        topics = [_text(name) for name, topic in bag.facts["topics"].items() if topic["type"] in kinds and topic["messages"]]
        if topics:
            lines.append(f"  {key}: {topics[0] if len(topics) == 1 else _one_of(topics)}")
    return lines


def _values(finding: Finding) -> str:
    values = finding.facts.get("first_values")
    return f"; the first frame holds {values[0]:g} to {values[1]:g}" if values else ""


def _force(found: Layout, below: Callable[[Finding], str]) -> list[str]:
    lines = ["force:", f"  tare: {OPEN} # s, unloaded at the start of each log", f"  tension_std: {OPEN} # N, of each robot, as identified"]
    lines.append("  configurations:")
    stems = Counter(finding.file.stem for finding in found.force)
    for finding in found.force:
        name = finding.file.stem if stems[finding.file.stem] == 1 else f"{finding.file.parent.name}_{finding.file.stem}"
        lines += [
            f"    {_text(name)}:",
            f"      file: {below(finding)}",
            f"      direction: {OPEN} # rad, mean direction of each cable",
            f"      tension: {OPEN} # N, mean tension of each cable",
            f"      direction_bounds: {OPEN} # rad, [least, greatest]",
        ]
    log = []
    if {finding.format for finding in found.force} == {"ATI Net F/T log"}:
        log.append("    format: netft")
    if len(calibrations := found.single.get("ATI calibration", [])) == 1:
        log.append(f"    calibration: {below(calibrations[0])}")
    # the option that settles what a log leaves open
    for option in sorted({option for finding in found.force for _, option in finding.open if option.startswith("dataset.force.log.")}):
        key = option.removeprefix("dataset.force.log.")
        if key != "format" and not any(line.startswith(f"    {key}:") for line in log):
            question = next(question for finding in found.force for question, other in finding.open if other == option)
            log.append(f"    {key}: {OPEN} # {' '.join(question.split())}")
    return lines + (["  log:", *log] if log else [])


def _joint_log(movements: list[Group]) -> list[str]:
    tables = next(iter(movements[0].takes.values())).facts["tables"]
    names = ", ".join(map(_text, sorted(tables)))
    first = next(iter(tables.values())).facts
    timed = first.get("increasing_columns", [])[:1] == [0]
    columns = {table.facts.get("columns") for table in tables.values()}
    joints = columns.pop() - 1 if len(columns) == 1 and timed else OPEN
    step = f"; it steps by {first['step_of_column_0']:g}" if "step_of_column_0" in first else ""
    patterns = [_text(group.pattern) for group in movements]
    return [
        "joint_log:",
        f"  movements: {patterns[0] if len(patterns) == 1 else _one_of(patterns)}",
        f"  actual: {OPEN} # file of the measured angles in each folder; there are {names}",
        f"  target: {OPEN} # of the commanded angles",
        "  speed: null # of the commanded speeds; null: the step of the commanded angles",
        f"  joints: {joints} # columns after the first",
        f"  time: {0 if timed else OPEN} # column of the time{step}",
        f"  time_unit: {OPEN} # s, ms, us or ns",
        f"  angle_unit: {OPEN} # rad or deg",
    ]


def _known(robots: list[Finding]) -> str:
    """The joints to choose from."""
    if len(robots) != 1:
        return ""
    return f": of {', '.join(map(_text, robots[0].facts['joints'].get('revolute', [])))}"


def _agreed(values: Iterable[float | None]) -> str:
    """The one value that all recordings state, else ???."""
    found = set(values)
    return f"{found.pop():.10g}" if len(found) == 1 and None not in found else OPEN


def _one_of(choices: Iterable[str]) -> str:
    listed = ", ".join(choices)
    return f"{OPEN} # one of {listed}" if listed else OPEN


def _below(folder: Path, finding: Finding) -> str:
    return _text(shown(finding.file.relative_to(folder)))


def _text(text: str) -> str:
    """``text`` as YAML, quoted where it could be read as anything else."""
    plain = re.fullmatch(r"[A-Za-z_][\w./*-]*|\.\.?/[\w./*-]*", text, re.ASCII) and text.lower() not in RESERVED
    return text if plain else json.dumps(text, ensure_ascii=False)
