"""Values of a dataset's keys that the recordings state or suggest."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from os.path import relpath
from pathlib import Path
from typing import Any

from pipeline.arm.urdf import LIMITED, SINGLE
from pipeline.configuration.datasheet import OPEN, get_filled
from pipeline.core.typed_yaml import parse_yaml
from pipeline.formats.delimited import ANGLE_UNITS, TIME_UNITS, spelled
from pipeline.formats.format import Kind
from pipeline.formats.joints.names import match_joints, states_joints
from pipeline.recordings.commands import UNFILLED, named_joints
from pipeline.tools.inspect.command import describe_file
from pipeline.tools.inspect.finding import ROBOT, Finding, printable_path
from pipeline.tools.new_dataset.layout import Group, RecordingLayout, logs_of, shared_pattern
from pipeline.tools.new_dataset.template import Entry, text_of

KEYS = ("motion.steps", "joint_log.start", "joint_log.end", "joint_log.rest")  # keys of a motion
SPACE = 6  # number of coordinates of a pose
PLACE = f"{OPEN} # [x, y, z]"
NEAR = 0.01  # rad, greatest excess of an angle over a joint's limit
CABLE = {
    "direction": f"{OPEN} # rad, [first cable, second, …]",
    "tension": f"{OPEN} # N, [first cable, second, …]",
    "direction_bounds": "[0.0, 6.283185307179586] # rad, [least, greatest]; narrow it, as set up",
}
UNITS = {"time_unit": TIME_UNITS, "angle_unit": ANGLE_UNITS}
account_of = cache(describe_file)
Entries = dict[str, Entry]


def _suggestion(note: str, value: str | None = None) -> Entry:
    return Entry(value, note, certain=False)


def _one_of(choices: Iterable[str], suggested: str | None = None) -> Entry:
    """Return the only one of the ``choices``, else a note that lists all ``choices``."""
    listed = [*map(text_of, choices)]
    note = f"one of {', '.join(listed)}" * bool(listed)
    return Entry(listed[0]) if len(listed) == 1 else _suggestion(note, suggested)


def _consensus(values: Iterable[float | None]) -> Entry:
    """Return the value that all recordings state, else ???."""
    stated = {*values}
    return Entry(f"{stated.pop():.10g}" if len(stated) == 1 and None not in stated else None)


def _name_list(names: Iterable[str]) -> str:
    return ", ".join(map(text_of, names))


def entries(
    name: str, recorded: RecordingLayout, folder: Path, values: Mapping[str, Any]
) -> Entries:
    """Return key → entry of dataset ``name``, from recordings, URDF and filled-in ``values``."""
    takes, depth = recorded.takes("mocap"), recorded.takes("depth")
    logs, force = logs_of(recorded.takes("joint_log")), recorded.single.get(Kind.FORCE, [])
    trajectories, calibrations, cameras = (
        [printable_path(one.file, folder) for one in recorded.single.get(kind, [])]
        for kind in (Kind.TRAJECTORY, Kind.CALIBRATION, Kind.INTRINSICS)
    )
    links = _links_of(recorded.shared("markers"))
    # rigid bodies track the links if no marker names match three links, and there is no depth
    # camera, which requires a planar arm
    bodies = [] if depth or links else recorded.shared("bodies")
    robots = recorded.single.get(ROBOT, [])
    urdf, facts = _urdf(robots, values)
    robot = _robot(facts, bool(depth or (takes and not bodies)))
    if len(robots) == 1:
        robot.setdefault("robot.urdf", Entry(text_of(Path(relpath(urdf)).as_posix())))
    groups = recorded.groups["joint_log"]
    sections = {
        "mocap": takes and _mocap(recorded, links, bodies),
        "encoders": recorded.groups["encoders"] and _encoders(recorded),
        "depth": depth and _depth(recorded.groups["depth"], cameras),
        "force": force and _force(force, calibrations, folder),
        "joint_log": logs and _joint_log(groups, folder, urdf, robot, facts),
    }
    found = {f"{part}.{key}": one for part in sections for key, one in dict(sections[part]).items()}
    kept = {section for section, known in sections.items() if known} | {"motion"}
    single = [{"": one} for one in (*takes, *force, *depth)]
    for key, entry in _questions([*single, *(group.named for group in groups)]).items():
        known = found.get(key, Entry())
        if key.partition(".")[0] in kept and (known.value is None or not known.certain):
            found[key] = entry
    near = Path(relpath(folder.resolve()))  # in the project or beside it
    place = folder.resolve() if ".." in near.parts[1:] else near
    found |= {"name": Entry(text_of(name)), "recordings": Entry(text_of(str(place)))}
    for file in sorted(folder.glob("*")):
        if re.match("(?i)licen[cs]e|copying", file.name) and file.is_file():
            lines = file.read_text(errors="replace").splitlines()[:20]
            words = [" ".join(line.split()) for line in lines if line.strip()]
            found["about.licence"] = _suggestion("", text_of(", ".join(words[:2])))
    if trajectories or takes:
        found["trajectory"] = _one_of(trajectories)
    if recorded.groups["encoders"]:
        found["measurement"] = Entry("")
    found["motion.rate"] = _rate(takes, logs, get_filled(values, "joint_log.time_unit"))
    found["motion.steps"] = _consensus(take.facts["steps"] for take in takes)
    return found | robot


def _rate(takes: Sequence[Finding], logs: Sequence[Finding], unit: str | None) -> Entry:
    """Return the one rate of all recordings; a suggestion if no log states the unit of times."""
    rates, with_roles = {take.rate for take in takes}, any("role" in log.facts for log in logs)
    for log in logs:
        suggested, step = log.suggested.get("time_unit"), log.facts.get("step_of_time")
        second = TIME_UNITS.get(str(unit or suggested))
        if log.rate:
            rates.add(log.rate * (TIME_UNITS[suggested] / second if suggested and second else 1))
        elif step and second and ("role" in log.facts or not with_roles):
            rates.add(1 / (step * second))
    stated = {f"{rate:.4g}" for rate in rates if rate}
    certain = not any("time_unit" in log.suggested for log in logs)
    return Entry(stated.pop() if len(stated) == 1 else None, certain=certain)


def _questions(groups: Sequence[Mapping[str, Finding]]) -> Entries:
    """Return key → entry of the takes' open questions, with a suggestion for all or per take."""
    notes: dict[str, str] = {}
    values: dict[str, dict[str, str]] = {}
    for name, take in (each for named in groups for each in named.items()):
        for question, option, value in (one for log in logs_of([take]) for one in log.open):
            key = option.removeprefix("dataset.")
            if key not in KEYS:
                notes.setdefault(key, question)
                named = values.setdefault(key, {})
                if value is not None:
                    named.setdefault(name, value)
    found = {}
    for key, named in values.items():
        value = f"{{{', '.join(f'{text_of(name)}: {one}' for name, one in named.items())}}}"
        if len({*named.values()}) < 2:
            value = next(iter(named.values()), None)
        elif key == "motion.pose_noise":
            value = max(named.values(), key=float)
        found[key] = _suggestion(notes[key], value)
    return found


def _links_of(names: list[str]) -> dict[str, list[str]]:
    """Return link → markers, by marker names without the last part; empty unless 3 × 3 markers."""
    links: dict[str, list[str]] = {}
    for name in names:
        link = re.sub(r"[_:. -]*(\d+|[A-Za-z]|[Mm]arker ?\d+)$", "", name)
        links.setdefault(link, []).append(name)
    return links if all(links) and [*map(len, links.values())] == [3, 3, 3] else {}


def _mocap(recorded: RecordingLayout, links: dict[str, list[str]], bodies: list[str]) -> Entries:
    found = _parts(recorded, "mocap", Entry("null"))
    if bodies:
        mount = {"position": PLACE, "rpy": f"{OPEN} # rad"}
        found["markers"] = Entry(dict.fromkeys(bodies, f"{OPEN} # {{a: [x, y, z], b: …, c: …}}"))
        found["bodies"] = Entry({n: {"name": text_of(n), "mount": mount} for n in bodies})
    elif links:
        found["markers"] = Entry({k: dict.fromkeys(names, PLACE) for k, names in links.items()})
    else:
        names = _name_list(recorded.shared("markers")) or "none in all takes"
        found["markers"] = _suggestion(f"{{link1: {{name: [x, y, z], …}}, …}}; there are {names}")
    return found


def _parts(recorded: RecordingLayout, section: str, none: Entry) -> Entries:
    """Return the patterns of training and test part. Takes named as a depth sequence are the test
    part (``none`` without such takes); the others are the training part if they are one group.
    """
    filmed = {name for group in recorded.groups["depth"] for name in group.named}
    groups = recorded.groups[section]
    test = [group.pattern for group in groups if filmed & {*group.named}]
    training = [group.pattern for group in groups if group.pattern not in test]
    if len(training) == 1 and len(test) <= 1:
        return {"training": _one_of(training), "test": _one_of(test) if test else none}
    return dict.fromkeys(("training", "test"), _one_of(group.pattern for group in groups))


def _encoders(recorded: RecordingLayout) -> Entries:
    found = _parts(recorded, "encoders", Entry())
    first = recorded.takes("encoders")[0].facts
    labels = [str(label) for label in first.get("labels", [])]
    found["time"] = Entry(text_of(first["time"]) if "time" in first else "0")
    measured = first.get("signals", {}).get("actual", []) if labels else []
    stated = Entry(f"[{_name_list(measured)}]") if measured else None
    return found | {"actual": stated or _suggestion(f"of {_name_list(labels)}")}


def _depth(groups: Sequence[Group], calibrations: Sequence[str]) -> Entries:
    group = max(groups, key=lambda group: len(group.takes))
    takes, (place, first) = list(group.takes.values()), next(iter(group.takes.items()))
    found = {"takes": _one_of(each.pattern for each in groups)}
    if first.kind == Kind.SEQUENCE:
        key = "index" if first.option == "index" else "frames"
        found[key] = _one_of([first.file.relative_to(place).as_posix()])
        if rates := sorted(take.rate for take in takes if take.rate):
            found["rate"] = Entry(f"{rates[len(rates) // 2]:.4g}", "as the indexes state")
    for key in {"topic", "camera_info"} & first.facts.keys():
        found[key] = _one_of([first.facts[key]])
    if first.facts.get("frames_are") == Kind.CLOUD:
        return found | {"encoding": Entry("plain")}
    if calibrations or first.kind == Kind.SEQUENCE:
        found["intrinsics"] = _one_of(calibrations)
    return found | {k: _consensus(one.facts.get(k) for one in takes) for k in ("width", "height")}


def _force(logs: Sequence[Finding], calibrations: Sequence[str], folder: Path) -> Entries:
    stems, configurations = Counter(finding.file.stem for finding in logs), {}
    for finding in logs:
        stem = finding.file.stem
        name = stem if stems[stem] == 1 else f"{finding.file.parent.name}_{stem}"
        configurations[name] = {"file": text_of(printable_path(finding.file, folder))} | CABLE
    found = {"configurations": Entry(configurations)}
    options = {finding.option for finding in logs}
    for key, stated in (("log.format", options), ("log.calibration", {*calibrations})):
        if len(stated) == 1 and (value := stated.pop()):
            found[key] = Entry(text_of(value))
    return found


def _joint_log(
    movements: Sequence[Group], folder: Path, urdf: str, robot: Entries, facts: Mapping[str, Any]
) -> Entries:
    takes = {path: take for group in movements for path, take in group.takes.items()}
    pattern = shared_pattern([*takes], folder)
    patterns = [group.pattern for group in movements]
    found = {"movements": _one_of(patterns, pattern and text_of(pattern))}
    first = next(iter(takes.values()))
    signals, count = first.facts.get("signals", {}), first.facts.get("joints")
    if tables := first.facts.get("tables", {}):
        choice = _one_of(sorted(tables))
        found |= {"actual": choice, "target": choice, "speed": Entry("null")}
        roles = {table.facts.get("role", ""): name for name, table in tables.items()}
        found |= {role: Entry(text_of(name), "by its name") for role, name in roles.items() if role}
        first = tables[roles.get("target", next(iter(tables)))]
        timed = first.facts.get("timed")
        found["time"] = Entry("0" if timed else None)
        count = first.facts["columns"] - 1 if timed else None
    elif first.kind != Kind.JOINTS:
        if "signals" not in first.suggested:
            named = [f"{name}: [{_name_list(labels)}]" for name, labels in signals.items()]
            found["signals"] = Entry(f"{{{', '.join(named)}}}")
        count = len(next(iter(signals.values())))
        none = _suggestion("null: rows are evenly spaced at motion.rate")
        found["time"] = _one_of([first.facts["time"]]) if "time" in first.facts else none
    named = signals.get("actual", ()) if isinstance(signals, Mapping) else ()
    stated = {tuple(take.facts.get("joint_names", named)) for take in takes.values()}
    arm = robot.get("robot.joints", Entry()).value or ""
    names = [*stated.pop()] if len(stated) == 1 else []
    found["joints"] = _joints(names, count, arm, urdf, facts, first)
    for key, known in UNITS.items():
        own = {spelled(unit) for unit in first.units.values()} & {*known}
        if len(own) == 1:
            found[key] = Entry(own.pop(), "by the labels")
        elif first.kind != Kind.JOINTS or "samples" not in first.facts:
            found[key] = Entry()  # a log that was read asks for the units that it does not state
    return found


def _joints(
    names: Sequence[str], count: int | None, arm: str, urdf: str, facts: Mapping, log: Finding
) -> Entry:
    """Return the joints of the ``count`` columns of a ``log``: by the ``names`` in it, else by the
    positions in the ``arm``, with the ranges and limits that support the positions.
    """
    moving = [joint for kind in SINGLE for joint in facts.get("joints", {}).get(kind, [])]
    order, logs = parse_yaml(arm) if arm else [], log.kind == Kind.JOINTS
    joints = match_joints(names, moving) if moving else []
    if not {*order} <= {*joints}:
        joints = []
    if joints or (logs and names):
        value = f"[{_name_list(joints or names)}]"
        return Entry(value, "as the logs name them", certain=logs or states_joints(names))
    if states_joints(names):
        return _suggestion(f"the logs name, in this order, {_name_list(names)}")
    if not order or count not in (None, len(order)):
        return _suggestion(f"{count} joints" if count else "")
    ends = [*zip(*log.facts.get("range", ()), strict=True)]
    ranges = dict(zip(order, ends, strict=False)) if len(ends) == len(order) else {}
    known = named_joints(urdf, order)
    limited = {joint.name: joint for joint in known if joint and joint.kind in LIMITED}
    beyond = [
        name
        for name, (least, most) in ranges.items()
        if (joint := limited.get(name))
        and not joint.lower - NEAR < least <= most < joint.upper + NEAR
    ]
    places = ", ".join(f"{name} {a:.3g} to {b:.3g}" for name, (a, b) in ranges.items())
    note = f"no name states the joint of a column; in the URDF's order, rad: {places or 'unknown'}"
    note += f"; beyond the limits: {', '.join(beyond) or 'none'}"
    return _suggestion(note, None if beyond else arm)


def _urdf(robots: Sequence[Finding], values: Mapping[str, Any]) -> tuple[str, Mapping[str, Any]]:
    """Return file and facts of the URDF in ``values``, else of the only one of ``robots``."""
    if urdf := get_filled(values, "robot.urdf"):
        return urdf, account_of(Path(urdf)).facts
    return (str(robots[0].file.resolve()), robots[0].facts) if len(robots) == 1 else (UNFILLED, {})


def _robot(facts: Mapping[str, Any], planar: bool) -> Entries:
    """Return the entries of the arm or planar chain in a URDF with these ``facts``."""
    found: Entries = {}
    arms, chains = facts.get("arms", []), facts.get("chains", [])
    if not planar and (not arms or [arms[0]["joints"]] != [one["joints"] for one in chains]):
        if arms:
            joints = arms[0]["joints"]
            found["robot.joints"] = Entry(f"[{_name_list(joints)}]", "all that move the last link")
            found["robot.tool"] = _one_of(arm["tip"] for arm in arms)
            if len(joints) < SPACE:
                found["robot.task"] = _suggestion("", "[x, y, z]" if len(joints) >= 3 else None)
        return found
    others = facts.get("joints", {}).get("revolute", [])
    chain = _suggestion(f"three parallel ones of {_name_list(others) or 'the URDF'}")
    if len(chains) == 1:
        own = chains[0]["joints"]
        chain = Entry(f"[{_name_list(own)}]", "the only three in a row that are parallel")
        found["robot.tool"] = _one_of(chains[0]["tools"])
        others = [joint for joint in others if joint not in own]
    locked = _suggestion(_name_list(others)) if others or not chains else Entry("{}")
    return found | {"robot.plane": Entry(""), "robot.joints": chain, "robot.locked": locked}
