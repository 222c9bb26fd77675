"""Values of a dataset's keys that the recordings state or suggest."""

import re
from collections import Counter, defaultdict
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
from pipeline.tools.new_dataset.layout import (
    PlacedTake,
    RecordingLayout,
    shared_pattern,
)
from pipeline.tools.new_dataset.template import Entry, text_of

KEYS = (
    "motion.steps",
    "joint_log.start",
    "joint_log.end",
    "joint_log.rest",
)  # keys of a motion
SPACE = 6  # number of coordinates of a pose
PLACE = f"{OPEN} # [x, y, z]"
NEAR = 0.01  # rad, greatest excess of an angle over a joint's limit
CABLE = {
    "direction": f"{OPEN} # rad, [first cable, second, …]",
    "tension": f"{OPEN} # N, [first cable, second, …]",
    "direction_bounds": "[0.0, 6.283185307179586] # rad, [least, greatest]; narrow it, as set up",
}
EVEN = Entry("null", "null: rows are evenly spaced at motion.rate", certain=False)
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


def _consensus(takes: Iterable[PlacedTake], fact: str) -> Entry:
    """Return the number that all recordings state, else ???."""
    stated = {take.finding.facts.get(fact) for take in takes}
    return Entry(
        f"{stated.pop():.10g}" if len(stated) == 1 and None not in stated else None
    )


def _name_list(names: Iterable[str]) -> str:
    return ", ".join(map(text_of, names))


def entries(
    name: str, recorded: RecordingLayout, folder: Path, values: Mapping[str, Any]
) -> Entries:
    """Return key → entry of dataset ``name``, from recordings, URDF and filled-in ``values``."""
    takes, depth = recorded.of("mocap"), recorded.of("depth")
    logs = [log for take in recorded.of("joint_log") for log in take.files]
    force, robots = (recorded.single.get(kind, []) for kind in (Kind.FORCE, ROBOT))
    trajectories, calibrations, cameras = (
        [printable_path(one.file, folder) for one in recorded.single.get(kind, [])]
        for kind in (Kind.TRAJECTORY, Kind.CALIBRATION, Kind.INTRINSICS)
    )
    links = _links_of(recorded.shared("markers"))
    # rigid bodies track the links if no marker names match three links, and there is no depth
    # camera, which requires a planar arm
    bodies = [] if depth or links else recorded.shared("bodies")
    only = str(robots[0].file.resolve()) if len(robots) == 1 else UNFILLED
    urdf = get_filled(values, "robot.urdf") or only
    facts = {} if urdf == UNFILLED else account_of(Path(urdf)).facts
    robot = _robot(facts, bool(depth or (takes and not bodies)))
    if only != UNFILLED:
        robot["robot.urdf"] = Entry(text_of(Path(relpath(urdf)).as_posix()))
    found = {
        "mocap": takes and _mocap(recorded, links, bodies),
        "encoders": recorded.of("encoders") and _encoders(recorded),
        "depth": depth and _depth(depth, recorded.patterns("depth"), cameras),
        "force": force and _force(force, calibrations, folder),
        "joint_log": logs and _joint_log(recorded, folder, urdf, robot, facts),
        "motion": {
            "rate": _rate(takes, logs, get_filled(values, "joint_log.time_unit"))
        },
    }
    found = {
        f"{part}.{k}": one
        for part, known in found.items()
        for k, one in dict(known).items()
    }
    kept, asked = {key.partition(".")[0] for key in found}, _questions(recorded)
    for key in asked:
        known = found.get(key, Entry())
        if key.partition(".")[0] in kept and (known.value is None or not known.certain):
            found[key] = asked[key]
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
    if recorded.of("encoders"):
        found["measurement"] = Entry("")
    return found | {"motion.steps": _consensus(takes, "steps")} | robot


def _rate(
    takes: Sequence[PlacedTake], logs: Sequence[Finding], unit: str | None
) -> Entry:
    """Return the one rate of all recordings; a suggestion if no log states the unit of times."""
    rates = {take.finding.rate for take in takes}
    with_roles = any("role" in log.facts for log in logs)
    for log in logs:
        suggested, step = log.suggested.get("time_unit"), log.facts.get("step_of_time")
        second = TIME_UNITS.get(str(unit or suggested))
        if log.rate:
            rates.add(
                log.rate
                * (TIME_UNITS[suggested] / second if suggested and second else 1)
            )
        elif step and second and ("role" in log.facts or not with_roles):
            rates.add(1 / (step * second))
    stated = {f"{rate:.4g}" for rate in rates if rate}
    certain = not any("time_unit" in log.suggested for log in logs)
    return Entry(stated.pop() if len(stated) == 1 else None, certain=certain)


def _questions(recorded: RecordingLayout) -> Entries:
    """Return key → entry of the open questions, with a suggestion for all or per movement."""
    asking = [
        (take.name if take.section == "joint_log" else "", log)
        for take in recorded.takes
        for log in take.files * (take.section != "encoders")
    ]
    notes: dict[str, str] = {}
    suggested: dict[str, dict[str, str]] = defaultdict(dict)
    for name, log in asking + [
        ("", one) for one in recorded.single.get(Kind.FORCE, [])
    ]:
        for question, option, value in log.open:
            key = option.removeprefix("dataset.")
            notes.setdefault(key, question)
            if value is not None:
                suggested[key].setdefault(name, value)
    found = {}
    for key in [key for key in notes if key not in KEYS]:
        values = suggested[key]
        if key == "motion.pose_noise" and values:
            value = max(values.values(), key=float)
        elif len({*values.values()}) > 1:
            value = f"{{{', '.join(f'{text_of(name)}: {one}' for name, one in values.items())}}}"
        else:
            value = next(iter(values.values()), None)
        found[key] = _suggestion(notes[key], value)
    return found


def _links_of(names: list[str]) -> dict[str, list[str]]:
    """Return link → markers, by marker names without the last part; empty unless 3 × 3 markers."""
    links: dict[str, list[str]] = defaultdict(list)
    for name in names:
        links[re.sub(r"[_:. -]*(\d+|[A-Za-z]|[Mm]arker ?\d+)$", "", name)].append(name)
    return links if all(links) and [*map(len, links.values())] == [3, 3, 3] else {}


def _mocap(
    recorded: RecordingLayout, links: dict[str, list[str]], bodies: list[str]
) -> Entries:
    found = _parts(recorded, "mocap", Entry("null"))
    if bodies:
        mount = {"position": PLACE, "rpy": f"{OPEN} # rad"}
        found["markers"] = Entry(
            dict.fromkeys(bodies, f"{OPEN} # {{a: [x, y, z], b: …, c: …}}")
        )
        found["bodies"] = Entry(
            {n: {"name": text_of(n), "mount": mount} for n in bodies}
        )
    elif links:
        found["markers"] = Entry(
            {k: dict.fromkeys(names, PLACE) for k, names in links.items()}
        )
    else:
        names = _name_list(recorded.shared("markers")) or "none in all takes"
        found["markers"] = _suggestion(
            f"{{link1: {{name: [x, y, z], …}}, …}}; there are {names}"
        )
    return found


def _parts(recorded: RecordingLayout, section: str, none: Entry) -> Entries:
    """Return the patterns of training and test part. Takes named as a depth sequence are the test
    part (``none`` without such takes); the others are the training part if they are one group.
    """
    filmed, patterns = (
        {take.name for take in recorded.of("depth")},
        recorded.patterns(section),
    )
    test = {take.pattern for take in recorded.of(section) if take.name in filmed}
    training = [pattern for pattern in patterns if pattern not in test]
    if len(training) == 1 and len(test) <= 1:
        return {"training": _one_of(training), "test": _one_of(test) if test else none}
    return dict.fromkeys(("training", "test"), _one_of(patterns))


def _encoders(recorded: RecordingLayout) -> Entries:
    facts = recorded.of("encoders")[0].finding.facts
    labels = [str(label) for label in facts.get("labels", [])]
    measured = facts.get("signals", {}).get("actual", []) if labels else []
    of = _suggestion(f"of {_name_list(labels)}")
    return _parts(recorded, "encoders", Entry()) | {
        "time": Entry(text_of(facts["time"]) if "time" in facts else "0"),
        "actual": Entry(f"[{_name_list(measured)}]") if measured else of,
    }


def _depth(
    takes: Sequence[PlacedTake], patterns: Sequence[str], cameras: Sequence[str]
) -> Entries:
    found = {"takes": _one_of(patterns)}
    ((pattern, _),) = Counter(take.pattern for take in takes).most_common(1)
    takes = [take for take in takes if take.pattern == pattern]
    place, first = takes[0].path, takes[0].finding
    if first.kind == Kind.SEQUENCE:
        key = "index" if first.option == "index" else "frames"
        found[key] = _one_of([first.file.relative_to(place).as_posix()])
        if rates := sorted(take.finding.rate for take in takes if take.finding.rate):
            found["rate"] = Entry(
                f"{rates[len(rates) // 2]:.4g}", "as the indexes state"
            )
    for key in {"topic", "camera_info"} & first.facts.keys():
        found[key] = _one_of([first.facts[key]])
    if first.facts.get("frames_are") == Kind.CLOUD:
        return found | {"encoding": Entry("plain")}
    if cameras or first.kind == Kind.SEQUENCE:
        found["intrinsics"] = _one_of(cameras)
    return found | {key: _consensus(takes, key) for key in ("width", "height")}


def _force(
    logs: Sequence[Finding], calibrations: Sequence[str], folder: Path
) -> Entries:
    stems, configurations = Counter(finding.file.stem for finding in logs), {}
    for finding in logs:
        stem = finding.file.stem
        name = stem if stems[stem] == 1 else f"{finding.file.parent.name}_{stem}"
        configurations[name] = {
            "file": text_of(printable_path(finding.file, folder))
        } | CABLE
    found = {"configurations": Entry(configurations)}
    options = {finding.option for finding in logs}
    for key, stated in (("log.format", options), ("log.calibration", {*calibrations})):
        if len(stated) == 1 and (value := stated.pop()):
            found[key] = Entry(text_of(value))
    return found


def _joint_log(
    recorded: RecordingLayout,
    folder: Path,
    urdf: str,
    robot: Entries,
    facts: Mapping[str, Any],
) -> Entries:
    takes = recorded.of("joint_log")
    pattern = shared_pattern([take.path for take in takes], folder)
    found = {
        "movements": _one_of(
            recorded.patterns("joint_log"), pattern and text_of(pattern)
        )
    }
    first = takes[0].finding
    signals, count = first.facts.get("signals", {}), first.facts.get("joints")
    if tables := first.facts.get("tables", {}):
        found |= _files_of_signals(first, tables)
        roles = {table.facts.get("role", ""): table for table in tables.values()}
        first = roles.get("target", next(iter(tables.values())))
        timed = bool(first.facts.get("timed"))
        found.setdefault("time", Entry("0") if timed else EVEN)
        count = first.facts["columns"] - timed
    elif first.kind != Kind.JOINTS:
        guessed = parse_yaml(first.suggested.get("signals", "null"))
        if guessed is None and signals:
            lists = [
                f"{name}: [{_name_list(labels)}]" for name, labels in signals.items()
            ]
            found["signals"] = Entry(f"{{{', '.join(lists)}}}")
        named = guessed or signals  # or advice in words
        columns = named.get("actual", ()) if isinstance(named, Mapping) else ()
        count = len(columns) or None
        clock = first.facts.get("time")
        if clock is None:
            found["time"] = EVEN
        else:
            found["time"] = Entry(text_of(clock))
    named = signals.get("actual", ()) if isinstance(signals, Mapping) else ()
    named = [label for label in named if isinstance(label, str)]
    stated = {(*take.finding.facts.get("joint_names", named),) for take in takes}
    moving = [
        joint for kind in SINGLE for joint in facts.get("joints", {}).get(kind, [])
    ]
    arm = robot.get("robot.joints", Entry()).value
    names = stated.pop() if len(stated) == 1 else ()
    found["joints"] = _joints(names, count, arm, urdf, moving, first)
    for key, known in UNITS.items():
        own = {spelled(unit) for unit in first.units.values()} & {*known}
        if len(own) == 1:
            found[key] = Entry(own.pop(), "by the labels")
        elif first.kind != Kind.JOINTS or "samples" not in first.facts:
            found[key] = (
                Entry()
            )  # a log that was read asks for the units that it does not state
    return found


def _files_of_signals(movement: Finding, tables: Mapping[str, Finding]) -> Entries:
    """Return role → entry of the words or files of the signals of a ``movement`` of ``tables``."""
    if words := movement.facts.get("words"):
        found = {
            role: Entry(text_of(word), "by its name") for role, word in words.items()
        }
        return {"speed": Entry("null")} | found
    choice = _one_of(sorted(tables))
    return {"actual": choice, "target": choice, "speed": Entry("null")}


def _joints(
    names: Sequence[str],
    count: int | None,
    arm: str | None,
    urdf: str,
    moving: Sequence[str],
    log: Finding,
) -> Entry:
    """Return the joints of the ``count`` columns of a ``log``: by the ``names`` in it, else by the
    positions in the ``arm`` (YAML), with the ranges and limits that support the positions.
    """
    order, is_log = parse_yaml(arm or "[]"), log.kind == Kind.JOINTS
    joints = match_joints(names, moving) if moving else []
    joints = joints if {*order} <= {*joints} else []
    if joints or (is_log and names):
        value = f"[{_name_list(joints or names)}]"
        return Entry(value, "as the logs name them", is_log or states_joints(names))
    if states_joints(names):
        return _suggestion(f"the logs name, in this order, {_name_list(names)}")
    if not order or count not in (None, len(order)):
        return _suggestion(f"{count} joints" if count else "")
    ends = [*zip(*log.facts.get("range", ()), strict=True)]
    ends = ends if len(ends) == len(order) else []
    places = ", ".join(
        f"{n} {a:.3g} to {b:.3g}" for n, (a, b) in zip(order, ends, strict=False)
    )
    beyond = [
        joint.name
        for joint, (least, most) in zip(named_joints(urdf, order), ends, strict=False)
        if joint and joint.kind in LIMITED
        if not joint.lower - NEAR < least <= most < joint.upper + NEAR
    ]
    note = f"no name states the joint of a column; in the URDF's order, rad: {places or 'unknown'}"
    note += f"; beyond the limits: {', '.join(beyond) or 'none'}"
    return _suggestion(note, None if beyond else arm)


def _robot(facts: Mapping[str, Any], planar: bool) -> Entries:
    """Return the entries of the arm or planar chain in a URDF with these ``facts``."""
    arms, chains = facts.get("arms", []), facts.get("chains", [])
    if not planar and (
        not arms or [arms[0]["joints"]] != [one["joints"] for one in chains]
    ):
        if not arms:
            return {}
        joints = arms[0]["joints"]
        found = {
            "robot.joints": Entry(
                f"[{_name_list(joints)}]", "all that move the last link"
            )
        }
        if len(joints) < SPACE:
            found["robot.task"] = _suggestion(
                "", "[x, y, z]" if len(joints) >= 3 else None
            )
        return found | {"robot.tool": _one_of(arm["tip"] for arm in arms)}
    found, others = (
        {"robot.plane": Entry("")},
        facts.get("joints", {}).get("revolute", []),
    )
    chain = _suggestion(f"three parallel ones of {_name_list(others) or 'the URDF'}")
    if len(chains) == 1:
        own = chains[0]["joints"]
        chain = Entry(
            f"[{_name_list(own)}]", "the only three in a row that are parallel"
        )
        found["robot.tool"] = _one_of(chains[0]["tools"])
        others = [joint for joint in others if joint not in own]
    locked = _suggestion(_name_list(others)) if others or not chains else Entry("{}")
    return found | {"robot.joints": chain, "robot.locked": locked}
