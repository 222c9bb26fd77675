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
        f"  urdf: {urdf} # from the project's root; those of the youBot and the UR5 are in pipeline/arm",
        *_chain(robots),
        "motion:",
        f"  rate: {_agreed(take.rate for take in takes)} # 1/s, of the motion grid",
        f"  steps: {_agreed(take.facts.get('steps') for take in takes)} # M, steps of a take",
    ]
    if takes:
        lines += [
            "mocap:",
            "  gate: 0.012 # m, how far a marker may be from where it is predicted to be taken for it: under half of what parts two",
            "  max_gap: 20 # frames, longest gap that is interpolated",
        ]
    if found.depth:
        lines += [
            "depth:",
            "  search: 0.5 # s, the clocks' offset is looked for between -search and +search",
            "  workspace: # what of the scene is the arm, in the frame of its plane; these are a youBot's: measure yours with a ruler",
            "    half_depth: 0.06 # m, half of the arm's thickness across its plane, and the sensor's noise",
            "    girth: 0.05 # m, how far the arm's surface is from the lines between its joints",
            "    column_half_width: 0.06 # m, half of the width of what carries the first joint of the chain, along the plane",
            "    column_top: -0.015 # m, its upper end above that joint (negative: below)",
            "    floor: 0.0 # m, height of what the arm stands on, in its base frame",
            "    min_pixels: 30 # fewer are no arm",
            "    max_points: 1500 # of a frame that are kept",
        ]
    if found.force:
        lines += [
            "force: # [least, greatest] that are given for the models: what your robots and their identification allow",
            f"  kappa_bounds: {OPEN} # 1, of the concentration of the directions (the paper: [169.35, 2416.0])",
            f"  tension_std_bounds: {OPEN} # N, of the spread of a robot's tension (the paper: [0.48, 2.27])",
            f"  tension_bounds: {OPEN} # N, of the mean tensions (the paper: [1.82, 13.89])",
        ]
    if found.movements:
        lines += [
            "joint_log:",
            f"  columns: {OPEN} # [a, b, c]: which three of the logged joints, from 1, are robot.joints, by the controller's manual",
            f"  start: {OPEN} # rad, [a, b, c]: commanded angles of the chain at rest before the motion, as in the log of the commands",
            f"  end: {OPEN} # rad, [a, b, c]: and after it",
            f"  rest: {OPEN} # steps at rest kept on either side, of motion.steps: at most half of the shortest pause between two motions",
            "  tolerance: 2.0e-4 # rad, how exactly commands must repeat: a UR5's repeat to 1.3e-4",
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
        f"    position: {OPEN} # m, [x, y, z], of the base frame of the URDF: by markers on the base, or a probe at its bolts",
        f"    rpy: {OPEN} # rad, about the fixed axes x, y, z, likewise; Motive's world has y up: [-1.5707963267948966, 0.0, 0.0] turns it",
    ]
    shared = [name for name in takes[0].markers if all(name in take.markers for take in takes)]
    if links := _links(shared):
        lines.append(
            "  markers: # m, from the joint at each segment's start (z along it, y the normal of the plane), by callipers; grouped by name"
        )
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
        f"  encoding: {'plain' if clouds else OPEN} # by the recorder's manual: plain, rotated_bits (SUN RGB-D), disparity (NYU)",
        f"  units_per_metre: {OPEN} # by its manual: 1000 for millimetres, 5000 for TUM RGB-D, 1 for metres{_values(first)}",
        f"  rate: {rate}",
        "  start: null # s on the camera's clock when the motion capture starts, as far as known; null: at its first frame",
        "  clock_offset: null # s still to add to read the motion capture's clock; null: estimated",
        "  camera: # x right, y down, z forward, in the arm's base frame",
        f"    position: {OPEN} # m, [x, y, z], by a hand-eye calibration",
        f"    rpy: {OPEN} # rad, about the fixed axes x, y, z, likewise",
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
    lines = [
        "force:",
        f"  tare: {OPEN} # s, unloaded at the start of each log, by the protocol of the measurement",
        f"  tension_std: {OPEN} # N, [first robot, second, …]: spread of each one's tension, from pulling at the transducer alone",
    ]
    lines.append("  configurations:")
    stems = Counter(finding.file.stem for finding in found.force)
    for finding in found.force:
        name = finding.file.stem if stems[finding.file.stem] == 1 else f"{finding.file.parent.name}_{finding.file.stem}"
        lines += [
            f"    {_text(name)}:",
            f"      file: {below(finding)}",
            f"      direction: {OPEN} # rad, [first cable, second, …]: mean direction of each, from x of the transducer, as set up",
            f"      tension: {OPEN} # N, [first cable, second, …]: mean tension of each, as commanded",
            "      direction_bounds: [0.0, 6.283185307179586] # rad, [least, greatest]; narrow the full turn, as set up",
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


def _chain(robots: list[Finding]) -> list[str]:
    """Joints, tool and locked joints of the robot, as far as its URDF leaves no choice."""
    facts = robots[0].facts if len(robots) == 1 else {}
    others, chains = facts.get("joints", {}).get("revolute", []), facts.get("chains", [])
    if len(chains) != 1:
        joints = f"{OPEN} # the three parallel joints of the planar chain, base to tip: of {_several(others) or 'the URDF'}"
        tool = f"{OPEN} # link of the URDF that is the end-effector"
    else:
        joints, tools = chains[0]["joints"], chains[0]["tools"]
        others = [joint for joint in others if joint not in joints]
        joints = f"[{_several(joints)}] # base to tip: the only three in a row that are parallel"
        tool = f"{_text(tools[0])} # the only last link beyond them" if len(tools) == 1 else f"{OPEN} # end-effector: {_several(tools)}"
    locked = f"{OPEN} # rad, {{joint: angle, …}}: how {_several(others) or 'the others'} are held; {{}} where all are at 0"
    return [f"  joints: {joints}", f"  tool: {tool}", f"  locked: {locked if others or not chains else '{} # no other joint turns'}"]


def _several(names: list[str]) -> str:
    return ", ".join(map(_text, names))


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
