"""Datasheet of a new dataset: what its recordings say of themselves, and ??? with a word of what to
put there.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from pipeline.formats.format import Kind
from pipeline.tools.inspect.finding import Finding
from pipeline.tools.inspect.layout import Group, Layout
from pipeline.tools.new_dataset.depth_section import depth_section
from pipeline.tools.new_dataset.yaml_text import OPEN, below_folder, one_of, text_of

SHOWN = 12  # recordings that are named although they have no place


def datasheet_file(name: str, recordings: str, layout: Layout, folder: Path) -> str:
    """The text of data/raw/NAME/dataset.yaml for the recordings of ``layout`` in ``folder``, which
    is ``recordings`` from the project's root.
    """
    lines = [
        f"# Datasheet of {name}: what is known of the recordings. Put a value for every ???; "
        "every key is explained, with those that these",
        "# recordings may need and that do not stand here, in data/raw/youbot/dataset.yaml. m, "
        "rad, s, N.",
        "about:",
        f"  subject: {OPEN} # what was recorded: robot, instruments, motion",
        f"  source: {OPEN} # who recorded it, and where it comes from",
        f"  licence: {OPEN} # on which terms others may use it",
        f"recordings: {text_of(recordings)} # every path and pattern below starts there",
    ]
    below = partial(below_folder, folder)
    trajectories = layout.single.get(Kind.TRAJECTORY, [])
    if len(trajectories) == 1:
        lines.append(f"trajectory: {below(trajectories[0])}")
    elif trajectories or layout.training or layout.test:
        lines.append(
            f"trajectory: {one_of(map(below, trajectories))} # the commanded end-effector: "
            "columns t, x, z, phi, vx, vz, vphi"
        )
    if layout.training or layout.test:
        lines += _mocap(layout)
    if layout.depth:
        lines += depth_section(layout, below)
    if layout.force:
        lines += _force(layout, below)
    if layout.movements:
        lines += _joint_log(layout.movements)
    if unplaced := [below(finding) for finding in layout.unplaced]:
        lines.append(
            f"# not placed: {', '.join(unplaced[:SHOWN])}"
            + (f" … ({len(unplaced)})" if len(unplaced) > SHOWN else "")
        )
    return "\n".join(lines) + "\n"


def _mocap(layout: Layout) -> list[str]:
    takes = [take for group in (*layout.training, *layout.test) for take in group.takes.values()]
    lines = ["mocap:"]
    # which group is which is known where the depth camera saw the one; a single group is what there
    # is to fit to
    training, test = layout.training, layout.test
    if len(training) == 1 and len(test) <= 1:
        lines += [
            f"  training: {text_of(training[0].pattern)}",
            f"  test: {text_of(test[0].pattern) if test else 'null'}",
        ]
    else:
        patterns = [text_of(group.pattern) for group in (*training, *test)]
        lines += [
            f"  training: {one_of(patterns)} # takes that the models are fitted to",
            f"  test: {OPEN} # that they are compared on",
        ]
    if any(take.units.get("length") == "not stated" for take in takes):
        lines.append(f"  unit: {OPEN} # m, cm or mm: the files do not say it")
    lines += [
        "  base: # the arm's base in the motion capture's world",
        f"    position: {OPEN} # m, [x, y, z], of the base frame of the URDF: by markers on the "
        "base, or a probe at its bolts",
        f"    rpy: {OPEN} # rad, about the fixed axes x, y, z, likewise; Motive's world has y "
        "up: [-1.5707963267948966, 0.0, 0.0] turns it",
    ]
    shared = [name for name in takes[0].markers if all(name in take.markers for take in takes)]
    if links := _links(shared):
        lines.append(
            "  markers: # m, from the joint at each segment's start (z along it, y the normal of "
            "the plane), by callipers; grouped by name"
        )
        for link, names in links.items():
            lines += [
                f"    {text_of(link)}:",
                *(f"      {text_of(name)}: {OPEN} # [x, y, z]" for name in names),
            ]
    else:
        names = ", ".join(map(text_of, shared)) or "none in all takes"
        lines.append(
            f"  markers: {OPEN} # three links of three markers, "
            f"{{link1: {{name: [x, y, z], …}}, …}} in m; there are {names}"
        )
    if bodies := [name for name in takes[0].bodies if all(name in take.bodies for take in takes)]:
        lines.append(
            "  # bodies: of a link followed by a rigid body, its name; there are "
            f"{', '.join(map(text_of, bodies))}"
        )
    return lines


def _links(names: list[str]) -> dict[str, list[str]] | None:
    """The names by what stands before their last part, where these are three times three."""
    links: dict[str, list[str]] = {}
    for name in names:
        links.setdefault(re.sub(r"[_:. -]*(\d+|[A-Za-z]|[Mm]arker ?\d+)$", "", name), []).append(
            name
        )
    return (
        links
        if len(links) == 3 and all(len(markers) == 3 for markers in links.values()) and all(links)
        else None
    )


def _force(layout: Layout, below: Callable[[Finding], str]) -> list[str]:
    lines = [
        "force:",
        f"  tare: {OPEN} # s, unloaded at the start of each log, by the protocol of the "
        "measurement",
        f"  tension_std: {OPEN} # N, [first robot, second, …]: spread of each one's tension, "
        "from pulling at the transducer alone",
    ]
    lines.append("  configurations:")
    stems = Counter(finding.file.stem for finding in layout.force)
    for finding in layout.force:
        name = (
            finding.file.stem
            if stems[finding.file.stem] == 1
            else f"{finding.file.parent.name}_{finding.file.stem}"
        )
        lines += [
            f"    {text_of(name)}:",
            f"      file: {below(finding)}",
            f"      direction: {OPEN} # rad, [first cable, second, …]: mean direction of each, "
            "from x of the transducer, as set up",
            f"      tension: {OPEN} # N, [first cable, second, …]: mean tension of each, as "
            "commanded",
            "      direction_bounds: [0.0, 6.283185307179586] # rad, [least, greatest]; narrow "
            "the full turn, as set up",
        ]
    log = []
    options = {finding.option for finding in layout.force}
    if len(options) == 1:
        log.append(f"    format: {options.pop()}")
    if len(calibrations := layout.single.get(Kind.CALIBRATION, [])) == 1:
        log.append(f"    calibration: {below(calibrations[0])}")
    # the option that settles what a log leaves open
    for option in sorted(
        {
            option
            for finding in layout.force
            for _, option in finding.open
            if option.startswith("dataset.force.log.")
        }
    ):
        key = option.removeprefix("dataset.force.log.")
        if key != "format" and not any(line.startswith(f"    {key}:") for line in log):
            question = next(
                question
                for finding in layout.force
                for question, other in finding.open
                if other == option
            )
            log.append(f"    {key}: {OPEN} # {' '.join(question.split())}")
    return lines + (["  log:", *log] if log else [])


def _joint_log(movements: list[Group]) -> list[str]:
    patterns = [text_of(group.pattern) for group in movements]
    lines = [
        "joint_log:",
        f"  movements: {patterns[0] if len(patterns) == 1 else one_of(patterns)}",
    ]
    movement = next(iter(movements[0].takes.values()))
    if movement.kind == Kind.JOINTS:
        lines.append(_names(movement.facts.get("joints")))
        takes = {path.stem: take for group in movements for path, take in group.takes.items()}
        return [*lines, *_settings(takes)]
    tables = movement.facts["tables"]
    names = ", ".join(map(text_of, sorted(tables)))
    first = next(iter(tables.values())).facts
    timed = first.get("increasing_columns", [])[:1] == [0]
    columns = {table.facts.get("columns") for table in tables.values()}
    joints = columns.pop() - 1 if len(columns) == 1 and timed else None
    step = f"; it steps by {first['step_of_column_0']:g}" if "step_of_column_0" in first else ""
    return [
        *lines,
        f"  actual: {OPEN} # file of the measured angles in each folder; there are {names}",
        f"  target: {OPEN} # of the commanded angles",
        "  speed: null # of the commanded speeds; null: the step of the commanded angles",
        _names(joints),
        f"  time: {0 if timed else OPEN} # column of the time{step}",
        f"  time_unit: {OPEN} # s, ms, us or ns",
        f"  angle_unit: {OPEN} # rad or deg",
        *_settings(
            {
                path.name: table
                for group in movements
                for path, held in group.takes.items()
                for table in held.facts["tables"].values()
                if "settings" in table.facts
            }
        ),
    ]


def _names(joints: int | None) -> str:
    number = f"the {joints}" if joints else "all"
    return (
        f"  joints: {OPEN} # names of {number} logged joints in their order, those of robot.joints "
        "as the URDF has them"
    )


def _settings(movements: Mapping[str, Finding]) -> list[str]:
    """The options that settle what was found of measured and commanded angles, each with the value
    that is suggested, or that of each movement where they differ.
    """
    suggested: dict[str, dict[str, str]] = {}
    for name, finding in movements.items():
        for key, value in finding.facts.get("settings", {}).items():
            suggested.setdefault(key, {})[name] = value
    lines = []
    for key, values in suggested.items():
        if key in ("rest", "angle_unit"):  # asked elsewhere
            continue
        each = ", ".join(f"{text_of(name)}: {value}" for name, value in values.items())
        value = f"{{{each}}}" if len(set(values.values())) > 1 else next(iter(values.values()))
        lines.append(f"  {key}: {OPEN} # by the angles themselves it is {value}")
    return lines
