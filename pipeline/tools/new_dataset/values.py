"""Values of a dataset's two files that its recordings state, and values that they make likely.

A value is YAML as text, with ` # note` behind it or not, or a mapping of names to values.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from os.path import relpath
from pathlib import Path
from typing import Any

from pipeline.core.datasheet import OPEN
from pipeline.core.options.instruments import AngleUnit, TimeUnit
from pipeline.formats.depth.messages import CAMERA_INFO, IMAGE
from pipeline.formats.format import Kind
from pipeline.formats.joints import bag
from pipeline.formats.joints.names import named_like
from pipeline.formats.units import TIME_UNITS, spelled
from pipeline.tools.check.command import get_filled
from pipeline.tools.inspect.finding import ROBOT, Finding, shown
from pipeline.tools.inspect.joints import time_unit, unit_of_angles
from pipeline.tools.inspect.kinds import DEPTH_TYPES, described
from pipeline.tools.new_dataset.layout import (
    Group,
    RecordingLayout,
    in_groups,
    links_of,
    logs_of,
    shared_pattern,
)

KEYS = ("motion.steps", "joint_log.start", "joint_log.end", "joint_log.rest")  # of the motion
TURN = "[0.0, 6.283185307179586] # rad, [least, greatest]; narrow the full turn, as set up"
SPACE = 6  # rows of a pose
PLACE = f"{OPEN} # [x, y, z]"
RESERVED = ("y", "n", "yes", "no", "on", "off", "true", "false", "null")
Values = dict[str, Any]  # by dotted key of the template


def _asked(note: str = "") -> str:
    return f"{OPEN} # {note}" if note else OPEN


def _one_of(choices: Iterable[str]) -> str:
    """The only one of the ``choices``, else ??? and what there is to choose from."""
    listed = [*choices]
    return listed[0] if len(listed) == 1 else _asked(f"one of {', '.join(listed)}" * bool(listed))


def _agreed(values: Iterable[float | None]) -> str:
    """The one value that all recordings state, else ???."""
    stated = {*values}
    return f"{stated.pop():.10g}" if len(stated) == 1 and None not in stated else OPEN


def _several(names: Iterable[str]) -> str:
    return ", ".join(map(text_of, names))


def text_of(text: str) -> str:
    """Return ``text`` as YAML, quoted where it could be read as anything else."""
    plain = re.fullmatch(r"[A-Za-z_][\w./*-]*|\.\.?/[\w./*-]*", text, re.ASCII)
    return text if plain and text.lower() not in RESERVED else json.dumps(text, ensure_ascii=False)


def path_text(finding: Finding, folder: Path) -> str:
    """Return the path of a recording below ``folder`` as YAML."""
    return text_of(shown(finding.file, folder))


def known_values(name: str, recorded: RecordingLayout, folder: Path) -> Values:
    """Return the values of dataset ``name`` that the recordings in ``folder`` and their URDF state,
    by key of the template; ??? with a note where there is a choice.
    """
    takes, logs = recorded.takes, in_groups(recorded.movements)
    trajectories, calibrations, cameras = (
        [path_text(one, folder) for one in recorded.single.get(kind, [])]
        for kind in (Kind.TRAJECTORY, Kind.CALIBRATION, Kind.INTRINSICS)
    )
    known: Values = {"name": text_of(name), "recordings": text_of(relpath(folder.resolve()))}
    if trajectories or takes:
        known["trajectory"] = _one_of(trajectories)
    sections = {
        "mocap": _mocap(recorded, takes) if takes else {},
        "encoders": _encoders(recorded) if recorded.encoders else {},
        "depth": _depth(recorded, cameras) if recorded.depth else {},
        "force": _force(recorded.force, calibrations, folder) if recorded.force else {},
        "joint_log": _joint_log(recorded.movements, logs) if logs else {},
    }
    known |= {f"{part}.{key}": value for part, of in sections.items() for key, value in of.items()}
    rates = [None if one.rate is None else float(f"{one.rate:.4g}") for one in (*takes, *logs)]
    known["motion.rate"] = _agreed(rates)
    known["motion.steps"] = _agreed(take.facts.get("steps") for take in takes)
    if any(log.suggested.get("rest") == "0" for log in logs):
        known["motion.pose_noise"] = OPEN
    if recorded.encoders:
        known["measurement"] = ""
    planar = bool(takes and not recorded.bodies) or bool(recorded.depth)
    return known | _robot(recorded.single.get(ROBOT, []), planar)


def _mocap(recorded: RecordingLayout, takes: list[Finding]) -> Values:
    values: Values = _parts(recorded.training, recorded.test, "null")
    if any(take.units.get("length") == "not stated" for take in takes):
        values["unit"] = OPEN
    if recorded.bodies:
        values["markers"] = dict.fromkeys(recorded.bodies, _asked("{a: [x, y, z], b: …, c: …}"))
        mount = {"position": PLACE, "rpy": _asked("rad")}
        values["bodies"] = {n: {"name": text_of(n), "mount": mount} for n in recorded.bodies}
    elif links := links_of(recorded.markers):
        values["markers"] = {link: dict.fromkeys(names, PLACE) for link, names in links.items()}
    else:
        names = _several(recorded.markers) or "none in all takes"
        values["markers"] = _asked(f"{{link1: {{name: [x, y, z], …}}, …}}; there are {names}")
    return values


def _parts(training: Sequence[Group], test: Sequence[Group], none: str) -> Values:
    """Patterns of both parts, where one group is left to fit to; ``none`` without a test part."""
    if len(training) == 1 and len(test) <= 1:
        tested = text_of(test[0].pattern) if test else none
        return {"training": text_of(training[0].pattern), "test": tested}
    patterns = _several(group.pattern for group in (*training, *test))
    return dict.fromkeys(("training", "test"), _asked(f"one of {patterns}"))


def _encoders(recorded: RecordingLayout) -> Values:
    takes = {name for group in recorded.training for name in group.named}
    training = [group for group in recorded.encoders if takes & {*group.named}]
    test = [group for group in recorded.encoders if group not in training]
    finding = in_groups(recorded.encoders)[0]
    labels = [str(label) for label in finding.facts.get("labels", [])]
    measured = named_like("actual", labels)
    return _parts(training, test, OPEN) | {
        "time": text_of(labels[0]) if labels and finding.timed else "0",
        "actual": f"[{_several(measured)}]" if measured else _asked(f"of {_several(labels)}"),
    }


def _depth(recorded: RecordingLayout, calibrations: Sequence[str]) -> Values:
    group = max(recorded.depth, key=lambda group: len(group.takes))
    takes, (place, first) = list(group.takes.values()), next(iter(group.takes.items()))
    topics = first.facts.get("topics")
    values = {"takes": _one_of(text_of(each.pattern) for each in recorded.depth)}
    if topics is None:
        key = "index" if first.option == "index" else "frames"
        values[key] = text_of(first.file.relative_to(place).as_posix())
        clouds = first.facts.get("frames_are") == Kind.CLOUD
        if rates := sorted(take.rate for take in takes if take.rate):
            values["rate"] = f"{rates[len(rates) // 2]:.4g} # as the indexes state"
    else:
        types = {name: topic["type"] for name, topic in topics.items() if topic["messages"]}
        for key, kinds in (("topic", DEPTH_TYPES), ("camera_info", (CAMERA_INFO,))):
            if names := [text_of(name) for name, kind in types.items() if kind in kinds]:
                values[key] = _one_of(names)
        clouds = IMAGE not in types.values()
    if clouds:
        values["encoding"] = "plain"
    else:
        if calibrations or topics is None:
            values["intrinsics"] = _one_of(calibrations)
        values |= {k: _agreed(one.facts.get(k) for one in takes) for k in ("width", "height")}
    if span := first.facts.get("first_values"):
        values["units_per_metre"] = _asked(f"the first frame holds {span[0]:g} to {span[1]:g}")
    return values


def _force(logs: Sequence[Finding], calibrations: Sequence[str], folder: Path) -> Values:
    """Configurations, and of the section log format, calibration and each open question."""
    stems, configurations = Counter(finding.file.stem for finding in logs), {}
    for finding in logs:
        stem = finding.file.stem
        configurations[stem if stems[stem] == 1 else f"{finding.file.parent.name}_{stem}"] = {
            "file": path_text(finding, folder),
            "direction": _asked("rad, [first cable, second, …]"),
            "tension": _asked("N, [first cable, second, …]"),
            "direction_bounds": TURN,
        }
    values: Values = {"configurations": configurations}
    options = {finding.option for finding in logs}
    if len(options) == 1 and (option := options.pop()):
        values["log.format"] = option
    if len(calibrations) == 1:
        values["log.calibration"] = calibrations[0]
    for question, option in (each for finding in logs for each in finding.open):
        if option.startswith("dataset.force.log.") and not option.endswith(".format"):
            values.setdefault(option.removeprefix("dataset.force."), _asked(question))
    return values


def _joint_log(movements: Sequence[Group], takes: Sequence[Finding]) -> Values:
    first = takes[0]
    values = {"movements": _one_of(text_of(group.pattern) for group in movements)}
    tables: Mapping[str, Finding] = first.facts.get("tables", {})
    signals, joints = first.facts.get("signals", {}), first.facts.get("joints")
    stated = {tuple(take.facts.get("joint_names", ())) for take in takes}
    if tables:
        choice = _one_of(map(text_of, sorted(tables)))
        values |= {"actual": choice, "target": choice, "speed": "null"}
        for name, table in tables.items():
            if "role" in table.facts:
                values[table.facts["role"]] = f"{text_of(name)} # by its name"
        first = next(iter(tables.values()))
        widths = {table.facts.get("columns") for table in tables.values()}
        values["time"] = "0" if first.timed else OPEN
        joints = widths.pop() - 1 if len(widths) == 1 and first.timed else None
    elif first.kind != Kind.JOINTS:
        if "signals" not in first.suggested:
            named = [f"{name}: [{_several(labels)}]" for name, labels in signals.items()]
            values["signals"] = f"{{{', '.join(named)}}}"
        joints = len(next(iter(signals.values())))
        none = _asked("null: the rows follow each other at motion.rate")
        values["time"] = text_of(first.facts["time"]) if "time" in first.facts else none
    values["joints"] = _asked(f"{joints} joints" if joints else "")
    if len(stated) == 1 and (names := next(iter(stated))):
        values["joints"] = f"[{_several(names)}] # as the logs name them"
    if first.format != bag.FORMAT.name:
        units = {spelled(unit) for unit in first.units.values()}
        for key, known in (("time_unit", TimeUnit), ("angle_unit", AngleUnit)):
            own = units & {*known}
            values[key] = f"{own.pop()} # by the labels" if len(own) == 1 else OPEN
    for question, option in (each for finding in logs_of(takes) for each in finding.open):
        key = option.rpartition(".")[2]
        if key not in ("rest", "angle_unit", "time_unit") and "; suggested is " in question:
            values[key] = _asked(question.rpartition(";")[0])
    return values


def _robot(robots: Sequence[Finding], planar: bool) -> Values:
    """The URDF, its planar chain, or its arm in space."""
    facts = robots[0].facts if len(robots) == 1 else {}
    arms, chains, values = facts.get("arms", []), facts.get("chains", []), {}
    if len(robots) == 1:
        values["robot.urdf"] = text_of(shown(Path(relpath(robots[0].file.resolve()))))
    if not planar and (not arms or [arms[0]["joints"]] != [one["joints"] for one in chains]):
        if arms:
            joints = f"[{_several(arms[0]['joints'])}] # all that move the last link"
            tips = _one_of(text_of(arm["tip"]) for arm in arms)
            values |= {"robot.joints": joints, "robot.tool": tips}
            if len(arms[0]["joints"]) < SPACE:
                values["robot.task"] = OPEN
        return values
    others = facts.get("joints", {}).get("revolute", [])
    joints = _asked(f"three parallel ones of {_several(others) or 'the URDF'}")
    if len(chains) == 1:
        own = chains[0]["joints"]
        joints = f"[{_several(own)}] # the only three in a row that are parallel"
        values["robot.tool"] = _one_of(map(text_of, chains[0]["tools"]))
        others = [joint for joint in others if joint not in own]
    locked = _asked(_several(others)) if others or not chains else "{}"
    return values | {"robot.plane": "", "robot.joints": joints, "robot.locked": locked}


def suggested_values(
    recorded: RecordingLayout, folder: Path, values: Mapping[str, Any]
) -> tuple[dict[str, str], dict[str, str]]:
    """Return values by key that the recordings, the robot and the other ``values`` of the dataset
    make likely, and remarks by key on what there is to choose from.
    """
    logs = in_groups(recorded.movements)
    tables = [one for one in logs_of(logs) if one.kind == Kind.TABLE]
    found: dict[str, str | None] = {}
    for file in sorted(folder.iterdir(), reverse=True):
        if file.is_file() and re.match("(?i)licen[cs]e|copying", file.name):
            lines = [
                " ".join(line.split()) for line in file.read_text(errors="replace").split("\n")
            ]
            if stated := [*filter(None, lines[:20])][:2]:
                found["about.licence"] = text_of(", ".join(stated))
    # movement → suggestions of the first of its logs that has some
    named = {
        name: next((one.suggested for one in logs_of([take]) if one.suggested), {})
        for group in recorded.movements
        for name, take in group.named.items()
    }
    for key in dict.fromkeys(key for own in named.values() for key in own):
        each = {name: own[key] for name, own in named.items() if key in own}
        differing = ", ".join(f"{text_of(name)}: {value}" for name, value in each.items())
        alike = len({*each.values()}) == 1
        found[f"joint_log.{key}"] = next(iter(each.values())) if alike else f"{{{differing}}}"
    steps = {one.facts.get("step_of_time") for one in tables} - {None}
    units = {time_unit(step) for step in steps}
    if len(units) == 1:
        found.setdefault("joint_log.time_unit", units.pop())
    if greatest := max((one.facts.get("greatest", 0.0) for one in tables), default=0.0):
        found.setdefault("joint_log.angle_unit", unit_of_angles(greatest))
    unit = get_filled(values, "joint_log.time_unit")
    rates = {one.rate for one in logs if one.rate}
    rates |= {1 / (step * TIME_UNITS[unit]) for step in steps if unit}
    meant = {f"{rate:.4g}" for rate in rates}
    found["motion.rate"] = meant.pop() if len(meant) == 1 else None
    noise = [log.facts["noise"] for log in logs if "noise" in log.facts]
    found["motion.pose_noise"] = f"{max(noise):.1e}" if noise else None
    if paths := [path for group in recorded.movements for path in group.takes]:
        # one pattern of all groups of movements, if it matches nothing else of their sort
        pattern = shared_pattern([path.relative_to(folder).as_posix() for path in paths])
        matched = {path for path in folder.glob(pattern) if path.is_dir() == paths[0].is_dir()}
        found["joint_log.movements"] = text_of(pattern) if matched == {*paths} else None
    urdf, remarks = get_filled(values, "robot.urdf"), {}
    arms = _arms(Path(urdf)) if urdf and not get_filled(values, "robot.plane") else []
    if len({tuple(arm["joints"]) for arm in arms}) == 1:
        joints, tips = arms[0]["joints"], [text_of(arm["tip"]) for arm in arms]
        found["robot.joints"] = f"[{_several(joints)}]"
        found["robot.task"] = "[x, y, z]" if 3 <= len(joints) < SPACE else None
        logged = {one.facts["joints"] for one in logs if "joints" in one.facts}
        signals = [one.facts.get("signals") for one in tables]
        logged |= {len(held) for each in signals if each for held in each.values()}
        logged |= {one.facts["columns"] - 1 for one in tables if "signals" not in one.facts}
        if logged <= {len(joints)}:
            found["joint_log.joints"] = found["robot.joints"]
        if len(tips) == 1:
            found["robot.tool"] = tips[0]
        else:
            remarks["robot.tool"] = f"one of {', '.join(tips)}"
    suggested = {key: value for key, value in found.items() if value and key not in KEYS}
    return suggested, remarks | {key: f"suggested is {v}" for key, v in suggested.items()}


@cache
def _arms(urdf: Path) -> list[dict[str, Any]]:
    return described(urdf).facts.get("arms", [])
