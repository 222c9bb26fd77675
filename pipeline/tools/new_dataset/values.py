"""Values of a dataset's two files that its recordings state, and values that they suggest."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from itertools import chain, takewhile
from os.path import relpath
from pathlib import Path
from typing import Any

from pipeline.core.options.instruments import AngleUnit, TimeUnit
from pipeline.formats.format import Kind
from pipeline.formats.joints import bag
from pipeline.formats.joints.names import named_like
from pipeline.formats.units import TIME_UNITS, spelled
from pipeline.tools.check.command import get_filled
from pipeline.tools.inspect.finding import ROBOT, Finding, shown
from pipeline.tools.inspect.joints import time_unit, unit_of_angles
from pipeline.tools.inspect.kinds import CAMERA_INFO, DEPTH_TYPES, IMAGE_TYPE, described
from pipeline.tools.new_dataset.layout import Group, RecordingLayout, links_of
from pipeline.tools.new_dataset.template import Values, agreed, asked, chosen, several, text_of

KEYS = ("motion.steps", "joint_log.start", "joint_log.end", "joint_log.rest")  # of the motion
TURN = "[0.0, 6.283185307179586] # rad, [least, greatest]; narrow the full turn, as set up"


def known_values(name: str, layout: RecordingLayout, folder: Path) -> Values:
    """Return the values of dataset ``name`` that the recordings of ``layout`` in ``folder`` and
    their URDF state, by key of the template; ??? with a note where there is a choice.
    """
    takes = [one for group in (*layout.training, *layout.test) for one in group.takes.values()]
    logs = [one for group in layout.movements for one in group.takes.values()]
    trajectories, calibrations, cameras = (
        [_below(folder, one) for one in layout.single.get(kind, [])]
        for kind in (Kind.TRAJECTORY, Kind.CALIBRATION, Kind.INTRINSICS)
    )
    known: Values = {"name": text_of(name), "recordings": text_of(relpath(folder.resolve()))}
    if trajectories or takes:
        known["trajectory"] = chosen(trajectories)
    sections = {
        "mocap": _mocap(layout, takes) if takes else {},
        "encoders": _encoders(layout) if layout.encoders else {},
        "depth": _depth(layout, cameras) if layout.depth else {},
        "force": _force(layout.force, calibrations, folder) if layout.force else {},
        "joint_log": _joint_log(layout.movements, logs) if logs else {},
    }
    for section, values in sections.items():
        known |= {f"{section}.{key}": value for key, value in values.items()}
    rates = [None if one.rate is None else float(f"{one.rate:.4g}") for one in (*takes, *logs)]
    known["motion.rate"] = agreed(rates)
    known["motion.steps"] = agreed(take.facts.get("steps") for take in takes)
    if any(log.suggested.get("rest") == "0" for log in logs):
        known["motion.pose_noise"] = asked()
    if layout.encoders:
        known["measurement"] = ""
    planar = bool(takes and not layout.bodies) or bool(layout.depth)
    return known | _robot(layout.single.get(ROBOT, []), planar)


def _mocap(layout: RecordingLayout, takes: list[Finding]) -> Values:
    values: Values = _parts(layout.training, layout.test)
    if any(take.units.get("length") == "not stated" for take in takes):
        values["unit"] = asked()
    if layout.bodies:
        places = asked("{a: [x, y, z], b: …, c: …}")
        values["markers"] = dict.fromkeys(layout.bodies, places)
        mount = {"position": asked("[x, y, z]"), "rpy": asked("rad")}
        values["bodies"] = {n: {"name": text_of(n), "mount": mount} for n in layout.bodies}
    elif links := links_of(layout.markers):
        place = asked("[x, y, z]")
        values["markers"] = {link: dict.fromkeys(names, place) for link, names in links.items()}
    else:
        names = several(layout.markers) or "none in all takes"
        values["markers"] = asked(f"{{link1: {{name: [x, y, z], …}}, …}}; there are {names}")
    return values


def _parts(training: Sequence[Group], test: Sequence[Group], none: str = "null") -> dict[str, str]:
    """Patterns of both parts, where one group is left to fit to; ``none`` without a test part."""
    if len(training) == 1 and len(test) <= 1:
        held = text_of(test[0].pattern) if test else none
        return {"training": text_of(training[0].pattern), "test": held}
    patterns = ", ".join(text_of(group.pattern) for group in (*training, *test))
    return dict.fromkeys(("training", "test"), asked(f"one of {patterns}"))


def _encoders(layout: RecordingLayout) -> Values:
    """Joint logs that are named as takes of the motion capture."""
    takes = {name for group in layout.training for name in group.named}
    training = [group for group in layout.encoders if takes & {*group.named}]
    test = [group for group in layout.encoders if group not in training]
    finding = next(iter(layout.encoders[0].takes.values()))
    labels = [str(label) for label in finding.facts.get("labels", [])]
    measured = named_like("actual", labels)
    return _parts(training, test, asked()) | {
        "time": text_of(labels[0]) if labels and finding.timed else "0",
        "actual": f"[{several(measured)}]" if measured else asked(f"of {several(labels)}"),
    }


def _depth(layout: RecordingLayout, calibrations: Sequence[str]) -> Values:
    group = max(layout.depth, key=lambda group: len(group.takes))
    takes, (place, first) = list(group.takes.values()), next(iter(group.takes.items()))
    topics = first.facts.get("topics")
    values = {"takes": chosen(text_of(each.pattern) for each in layout.depth)}
    if topics is None:
        key = "index" if first.option == "index" else "frames"
        values[key] = text_of(first.file.relative_to(place).as_posix())
        clouds = first.facts.get("frames_are") == Kind.CLOUD
    else:
        held = {name: topic["type"] for name, topic in topics.items() if topic["messages"]}
        for key, kinds in (("topic", DEPTH_TYPES), ("camera_info", (CAMERA_INFO,))):
            if names := [text_of(name) for name, kind in held.items() if kind in kinds]:
                values[key] = chosen(names)
        clouds = IMAGE_TYPE not in held.values()
    if clouds:
        values["encoding"] = "plain"
    else:
        if calibrations or topics is None:
            values["intrinsics"] = chosen(calibrations)
        for key in ("width", "height"):
            values[key] = agreed(take.facts.get(key) for take in takes)
    if span := first.facts.get("first_values"):
        values["units_per_metre"] = asked(f"the first frame holds {span[0]:g} to {span[1]:g}")
    rates = sorted(take.rate for take in takes if take.rate)
    if rates and topics is None:
        values["rate"] = f"{rates[len(rates) // 2]:.4g} # as the indexes state"
    return values


def _force(logs: Sequence[Finding], calibrations: Sequence[str], folder: Path) -> Values:
    """Configurations, and of the section log format, calibration and each open question."""
    stems = Counter(finding.file.stem for finding in logs)
    configurations = {}
    for finding in logs:
        stem = finding.file.stem
        configurations[stem if stems[stem] == 1 else f"{finding.file.parent.name}_{stem}"] = {
            "file": _below(folder, finding),
            "direction": asked("rad, [first cable, second, …]"),
            "tension": asked("N, [first cable, second, …]"),
            "direction_bounds": TURN,
        }
    values: Values = {"configurations": configurations}
    options = {finding.option for finding in logs}
    if len(options) == 1 and (option := options.pop()):
        values["log.format"] = option
    if len(calibrations) == 1:
        values["log.calibration"] = calibrations[0]
    for question, option in chain.from_iterable(finding.open for finding in logs):
        if option.startswith("dataset.force.log.") and not option.endswith(".format"):
            values.setdefault(option.removeprefix("dataset.force."), asked(question))
    return values


def _joint_log(movements: Sequence[Group], takes: Sequence[Finding]) -> Values:
    first = takes[0]
    values = {"movements": chosen(text_of(group.pattern) for group in movements)}
    tables: Mapping[str, Finding] = first.facts.get("tables", {})
    signals = first.facts.get("signals", {})
    stated = {tuple(take.facts.get("joint_names", ())) for take in takes}
    if first.kind == Kind.JOINTS:
        joints = first.facts.get("joints")
    elif tables:
        values |= _files(tables)
        some = next(iter(tables.values()))
        steps = {table.facts.get("step_of_column_0") for table in tables.values()} - {None}
        step = f"steps by {steps.pop():g}" if len(steps) == 1 else ""
        values["time"] = (f"0 # {step}" if step else "0") if some.timed else asked(step)
        widths = {table.facts.get("columns") for table in tables.values()}
        joints = widths.pop() - 1 if len(widths) == 1 and some.timed else None
        first = some
    else:
        if "signals" not in first.suggested:
            named = [f"{name}: [{several(labels)}]" for name, labels in signals.items()]
            values["signals"] = f"{{{', '.join(named)}}}"
        joints = len(next(iter(signals.values())))
        none = asked("null: the rows follow each other at motion.rate")
        values["time"] = text_of(first.facts["time"]) if "time" in first.facts else none
    values["joints"] = asked(f"{joints} joints" if joints else "")
    if len(stated) == 1 and (names := next(iter(stated))):
        values["joints"] = f"[{several(names)}] # as the logs name them"
    if first.format != bag.FORMAT.name:
        units = {spelled(unit) for unit in first.units.values()}
        for key, known in (("time_unit", TimeUnit), ("angle_unit", AngleUnit)):
            held = units & {*known}
            values[key] = f"{held.pop()} # by the labels" if len(held) == 1 else asked()
    for finding in _each_log(takes):
        for question, option in finding.open:
            key = option.rpartition(".")[2]
            if key in finding.suggested and key not in ("rest", "angle_unit", "time_unit"):
                values[key] = asked(question.rpartition(";")[0])
    return values


def _files(tables: Mapping[str, Finding]) -> dict[str, str]:
    """Files of the measured and commanded angles and of the speed, as their names say."""
    roles = {table.facts["role"]: name for name, table in tables.items() if "role" in table.facts}
    choice = chosen(map(text_of, sorted(tables)))
    files = {"actual": choice, "target": choice, "speed": "null"}
    return files | {role: f"{text_of(name)} # by its name" for role, name in roles.items()}


def _robot(robots: Sequence[Finding], planar: bool) -> Values:
    """The URDF, its planar chain, or its arm in space."""
    facts = robots[0].facts if len(robots) == 1 else {}
    arms, chains = facts.get("arms", []), facts.get("chains", [])
    values = {}
    if len(robots) == 1:
        values["robot.urdf"] = text_of(shown(Path(relpath(robots[0].file.resolve()))))
    if not planar and (not arms or [arms[0]["joints"]] != [one["joints"] for one in chains]):
        if arms:
            values["robot.joints"] = f"[{several(arms[0]['joints'])}] # all that move the last link"
            tips = [arm["tip"] for arm in arms]
            values["robot.tool"] = text_of(tips[0]) if len(tips) == 1 else asked(several(tips))
        return values
    others = facts.get("joints", {}).get("revolute", [])
    values |= {
        "robot.plane": "",
        "robot.joints": asked(f"three parallel ones of {several(others) or 'the URDF'}"),
    }
    if len(chains) == 1:
        joints, tools = chains[0]["joints"], chains[0]["tools"]
        others = [joint for joint in others if joint not in joints]
        values["robot.joints"] = f"[{several(joints)}] # the only three in a row that are parallel"
        values["robot.tool"] = text_of(tools[0]) if len(tools) == 1 else asked(several(tools))
    values["robot.locked"] = asked(several(others)) if others or not chains else "{}"
    return values


def suggested_values(
    layout: RecordingLayout, folder: Path, values: Mapping[str, Any]
) -> tuple[dict[str, str], dict[str, str]]:
    """Return values by key that the recordings of ``layout``, the robot and the other ``values`` of
    the dataset make likely, and remarks by key on what there is to choose from.
    """
    logs = [one for group in layout.movements for one in group.takes.values()]
    tables = [one for one in _each_log(logs) if one.kind == Kind.TABLE]
    found: dict[str, str | None] = {"about.licence": _licence(folder)}
    named = {}  # movement → its log with suggestions
    for group in layout.movements:
        for name, take in group.named.items():
            logs_of = [one for one in _each_log([take]) if one.suggested]
            named[name] = logs_of[0] if logs_of else take
    keys = dict.fromkeys(key for one in named.values() for key in one.suggested)
    found |= {f"joint_log.{key}": _agreement(named, key) for key in keys}
    steps = {one.facts.get("step_of_column_0") for one in tables} - {None}
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
    if logs:
        found["joint_log.movements"] = _pattern(layout, folder)
    urdf, remarks = get_filled(values, "robot.urdf"), {}
    arms = _arms(Path(urdf)) if urdf and not get_filled(values, "robot.plane") else []
    if len({tuple(arm["joints"]) for arm in arms}) == 1:
        joints, tips = arms[0]["joints"], [text_of(arm["tip"]) for arm in arms]
        found["robot.joints"] = f"[{several(joints)}]"
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


def _each_log(takes: Iterable[Finding]) -> list[Finding]:
    """The files of the movements ``takes``."""
    return [one for take in takes for one in (take.facts.get("tables") or {"": take}).values()]


def _licence(folder: Path) -> str | None:
    """The first two lines of a file of licence."""
    for file in sorted(folder.iterdir()):
        if file.is_file() and file.name.lower().startswith(("licence", "license", "copying")):
            lines = file.read_text(errors="replace").split("\n")[:20]
            stated = [" ".join(line.split()) for line in lines if line.strip()]
            return text_of(", ".join(stated[:2])) if stated else None
    return None


def _pattern(layout: RecordingLayout, folder: Path) -> str | None:
    """One pattern of all groups of movements that matches nothing else of their sort."""
    paths = [path for group in layout.movements for path in group.takes]
    pattern = shared_pattern([path.relative_to(folder).as_posix() for path in paths])
    matched = {path for path in folder.glob(pattern) if path.is_dir() == paths[0].is_dir()}
    return text_of(pattern) if matched == {*paths} else None


def shared_pattern(names: Sequence[str]) -> str:
    """Return the names as one pattern: of the parts between underscores those that all have, and a
    star for the differing end of a part; all that follows where nothing of a part is shared.
    """
    parts = []
    for alike in zip(*(name.split("_") for name in names), strict=False):
        letters = takewhile(lambda each: len({*each}) == 1, zip(*alike, strict=False))
        beginning = "".join(each[0] for each in letters)
        parts.append(beginning if len({*alike}) == 1 else f"{beginning}*")
        if not beginning:
            return "_".join(parts)
    return "_".join(parts) + ("*" if len({name.count("_") for name in names}) > 1 else "")


def _agreement(movements: Mapping[str, Finding], key: str) -> str:
    """The value of ``key`` that all ``movements`` suggest, or one of each where they differ."""
    held = {n: one.suggested[key] for n, one in movements.items() if key in one.suggested}
    if len({*held.values()}) == 1:
        return next(iter(held.values()))
    return f"{{{', '.join(f'{text_of(name)}: {value}' for name, value in held.items())}}}"


def _below(folder: Path, finding: Finding) -> str:
    return text_of(shown(finding.file.relative_to(folder)))
