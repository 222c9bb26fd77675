"""Datasheet of a new dataset: what its recordings say of themselves, and ??? with a word of what to
put there.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from pipeline.core.options.logs import AngleUnit, TimeUnit
from pipeline.formats.format import Kind
from pipeline.formats.units import spelled
from pipeline.tools.inspect.finding import Finding
from pipeline.tools.inspect.joints import STATED_BY_TYPE
from pipeline.tools.inspect.layout import Group, Layout
from pipeline.tools.new_dataset.depth_section import depth_section
from pipeline.tools.new_dataset.mocap_section import encoders_section, mocap_section
from pipeline.tools.new_dataset.yaml_text import OPEN, below_folder, one_of, several, text_of

SHOWN = 12  # recordings that are named although they have no place


def datasheet_file(name: str, recordings: str, layout: Layout, folder: Path) -> str:
    """The text of data/raw/NAME/dataset.yaml for the recordings of ``layout`` in ``folder``, which
    is ``recordings`` from the project's root.
    """
    lines = [
        f"# Datasheet of {name}: what is known of the recordings. Put a value for every ???; every "
        "key, also those that do not stand here,",
        "# is explained in data/raw/README.md. m, rad, s, N.",
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
            "columns t, x, z, phi, vx, vz, vphi; or t and q:JOINT of each joint"
        )
    if layout.training or layout.test:
        lines += mocap_section(layout)
    if layout.encoders:
        lines += encoders_section(layout)
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
        takes = [take for group in movements for take in group.takes.values()]
        stated = {tuple(take.facts.get("joint_names", [])) for take in takes}
        names = next(iter(stated)) if len(stated) == 1 else ()
        bag = movement.format == STATED_BY_TYPE
        units = [] if bag else _units(movement)
        joints = _names(movement.facts.get("joints"), names)
        return [*lines, joints, *units, *_settings(takes)]
    if "signals" in movement.facts:
        signals = [f"{name}: [{several(held)}]" for name, held in movement.facts["signals"].items()]
        return [
            *lines,
            _names(len(next(iter(movement.facts["signals"].values())))),
            *(
                [f"  signals: {{{', '.join(signals)}}} # columns, by their labels"]
                if "signals" not in movement.facts.get("settings", {})
                else []
            ),
            _time(movement),
            *_units(movement),
            *_settings([take for group in movements for take in group.takes.values()]),
        ]
    tables = movement.facts["tables"]
    first = next(iter(tables.values())).facts
    timed = first.get("increasing_columns", [])[:1] == [0]
    columns = {table.facts.get("columns") for table in tables.values()}
    joints = columns.pop() - 1 if len(columns) == 1 and timed else None
    every = [
        table
        for group in movements
        for held in group.takes.values()
        for table in held.facts["tables"].values()
    ]
    # a table of another instrument beside the joints' has steps of its own
    steps = {table.facts.get("step_of_column_0") for table in tables.values()} - {None}
    step = f"; it steps by {steps.pop():g}" if len(steps) == 1 else ""
    return [
        *lines,
        *_signals(tables),
        _names(joints),
        f"  time: {0 if timed else OPEN} # column of the time{step}",
        *_units(next(iter(tables.values()))),
        *_settings(every),
    ]


def _signals(tables: dict[str, Finding]) -> list[str]:
    """Which of the ``tables`` holds which signal, as far as their names and values say it."""
    pairs = [
        (table.facts["measured"], name)
        for name, table in tables.items()
        if "measured" in table.facts
    ]
    if len(pairs) != 1:
        names = ", ".join(map(text_of, sorted(tables)))
        return [
            f"  actual: {OPEN} # file of the measured angles in each folder; there are {names}",
            f"  target: {OPEN} # of the commanded angles",
            "  speed: null # of the commanded speeds; null: the step of the commanded angles",
        ]
    ((actual, target),) = pairs
    speeds = [name for name, table in tables.items() if table.facts.get("speed_of") == target]
    speed = f"{text_of(speeds[0])} # by their values" if len(speeds) == 1 else "null #"
    return [
        f"  actual: {text_of(actual)} # file of the measured angles in each folder, by its name",
        f"  target: {text_of(target)} # of the commanded angles, likewise",
        f"  speed: {speed} of the commanded speeds; null: the step of the commanded angles",
    ]


def _units(table: Finding) -> list[str]:
    """The units that the labels of a ``table`` state, or ???."""
    stated = {spelled(unit) for unit in table.units.values()}
    lines = []
    for key, units in (("time_unit", TimeUnit), ("angle_unit", AngleUnit)):
        named = stated & {*units}
        value = (
            f"{named.pop()} # by the labels"
            if len(named) == 1
            else f"{OPEN} # one of {', '.join(units)}"
        )
        lines.append(f"  {key}: {value}")
    return lines


def _time(movement: Finding) -> str:
    if "time" in movement.facts:
        return f"  time: {text_of(movement.facts['time'])} # column of the time"
    return f"  time: {OPEN} # column of the time; null: the rows follow each other at motion.rate"


def _names(joints: int | None, stated: Sequence[str] = ()) -> str:
    if stated:
        return f"  joints: [{several(list(stated))}] # as the logs name them"
    number = f"the {joints}" if joints else "all"
    return (
        f"  joints: {OPEN} # names of {number} logged joints in their order, those of robot.joints "
        "as the URDF has them"
    )


def _settings(movements: list[Finding]) -> list[str]:
    """The options that settle what was found of measured and commanded angles."""
    asked = {
        option.rpartition(".")[2]: question
        for finding in reversed(movements)
        for question, option in finding.open
        if option.rpartition(".")[2] in finding.facts.get("settings", {})
    }
    return [
        f"  {key}: {OPEN} # {question.rpartition(';')[0]}"
        for key, question in sorted(asked.items())
        if key not in ("rest", "angle_unit", "time_unit")  # asked elsewhere
    ]
