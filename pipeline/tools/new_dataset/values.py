"""Values of a dataset's keys that the recordings state or suggest."""

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from os.path import relpath
from pathlib import Path
from typing import Any

from pipeline.arm.urdf import LIMITED
from pipeline.configuration.datasheet import OPEN, get_filled
from pipeline.core.typed_yaml import parse_yaml
from pipeline.formats.delimited import ANGLE_UNITS, TIME_UNITS, spelled
from pipeline.formats.format import Kind
from pipeline.formats.joints.names import match_joints, states_joints
from pipeline.recordings.commands import named_joints
from pipeline.tools.inspect.finding import Finding, printable_path
from pipeline.tools.new_dataset.layout import (
    PlacedTake,
    RecordingLayout,
    shared_pattern,
)
from pipeline.tools.new_dataset.robot import (
    movable_joints,
    robot_entries,
    urdf_facts,
    urdf_of,
)
from pipeline.tools.new_dataset.template import (
    Entries,
    Entry,
    choice_of,
    list_of_names,
    suggestion,
    text_of,
)

# keys of a motion
KEYS = (
    "motion.steps",
    "joint_log.start",
    "joint_log.end",
    "joint_log.rest",
)
PLACE = f"{OPEN} # [x, y, z]"
NEAR = 0.01  # rad, greatest excess of an angle over a joint's limit
CABLE = {
    "direction": f"{OPEN} # rad, [first cable, second, …]",
    "tension": f"{OPEN} # N, [first cable, second, …]",
    "direction_bounds": "[0.0, 6.283185307179586] # rad, [least, greatest]; narrow it, as set up",
}
EVEN = suggestion("null: rows are evenly spaced at motion.rate", "null")
UNITS = {"time_unit": TIME_UNITS, "angle_unit": ANGLE_UNITS}
LICENCE_FILE = re.compile("licen[cs]e|copying", re.IGNORECASE)
LICENCE_LINES = 20  # of a file of terms, among which its title is
MARKER_NUMBER = re.compile(r"[_:. -]*(\d+|[A-Za-z]|[Mm]arker ?\d+)$")


def entries(
    name: str,
    recorded: RecordingLayout,
    folder: Path,
    values: Mapping[str, Any],
) -> Entries:
    """Return key → entry of dataset ``name``, from recordings, URDF and filled-in ``values``."""
    urdf = urdf_of(recorded, values)
    robot = robot_entries(recorded, urdf, values)
    takes = recorded.of("mocap")
    logs = _logs(recorded)
    sections: dict[str, Entries] = {}
    if takes:
        sections["mocap"] = _mocap(recorded)
    if recorded.of("encoders"):
        sections["encoders"] = _encoders(recorded)
    if recorded.of("depth"):
        sections["depth"] = _depth(recorded, folder)
    if Kind.FORCE in recorded.single:
        sections["force"] = _force(recorded, folder)
    if logs:
        sections["joint_log"] = _joint_log(recorded, folder, urdf, robot)
    time_unit = get_filled(values, "joint_log.time_unit")
    sections["motion"] = {"rate": _rate(takes, logs, time_unit)}
    proposed: Entries = {}
    for section, of_section in sections.items():
        for key, entry in of_section.items():
            proposed[f"{section}.{key}"] = entry
    for key, question in _questions(recorded).items():
        entry = proposed.get(key, Entry())
        settled = entry.certain and entry.value is not None
        if key.partition(".")[0] in sections and not settled:
            proposed[key] = question

    proposed["name"] = Entry(text_of(name))
    proposed["recordings"] = Entry(text_of(_place_of(folder)))
    if terms := _first_lines_of_terms(folder):
        proposed["about.licence"] = suggestion("", text_of(terms))
    trajectories = recorded.names(Kind.TRAJECTORY, folder)
    if trajectories or takes:
        proposed["trajectory"] = choice_of(trajectories)
    if recorded.of("encoders"):
        proposed["measurement"] = Entry("")
    proposed["motion.steps"] = _consensus(takes, "steps")
    return proposed | robot


def _place_of(folder: Path) -> str:
    """Return the path of a ``folder`` in the project or beside it, else the absolute path."""
    near = Path(relpath(folder.resolve()))
    return str(folder.resolve() if ".." in near.parts[1:] else near)


def _first_lines_of_terms(folder: Path) -> str:
    """Return the first two lines of the last file of terms in the ``folder``; "" without one."""
    terms = ""
    for file in sorted(folder.glob("*")):
        if LICENCE_FILE.match(file.name) and file.is_file():
            lines = file.read_text(errors="replace").splitlines()[:LICENCE_LINES]
            lines = [" ".join(line.split()) for line in lines if line.strip()]
            terms = ", ".join(lines[:2])
    return terms


def _logs(recorded: RecordingLayout) -> list[Finding]:
    """Return the findings of all files of the joint logs."""
    return [log for take in recorded.of("joint_log") for log in take.files]


def _consensus(takes: Iterable[PlacedTake], fact: str) -> Entry:
    """Return the number that all recordings state, else ???."""
    stated = {take.finding.facts.get(fact) for take in takes}
    if len(stated) != 1 or None in stated:
        return Entry()
    return Entry(f"{stated.pop():.10g}")


def _rate(
    takes: Sequence[PlacedTake],
    logs: Sequence[Finding],
    unit: str | None,
) -> Entry:
    """Return the one rate of all recordings, with times in the filled-in ``unit``, else in the
    suggested one; a suggestion if no log and no person states the unit of times.
    """
    rates = {take.finding.rate for take in takes}
    with_roles = any("role" in log.facts for log in logs)
    guessed = False
    for log in logs:
        suggested = log.suggested.get("time_unit")
        guessed = guessed or (suggested is not None and unit is None)
        second = TIME_UNITS.get(str(unit or suggested))
        step = log.facts.get("step_of_time")
        if log.rate and suggested and second:
            rates.add(log.rate * (TIME_UNITS[suggested] / second))
        elif log.rate:
            rates.add(log.rate)
        elif step and second and ("role" in log.facts or not with_roles):
            rates.add(1 / (step * second))
    stated = {f"{rate:.4g}" for rate in rates if rate}
    value = stated.pop() if len(stated) == 1 else None
    return Entry(value, certain=not guessed)


def _questions(recorded: RecordingLayout) -> Entries:
    """Return key → entry of the open questions, with a suggestion for all or per movement."""
    notes: dict[str, str] = {}
    suggested: dict[str, dict[str, str]] = defaultdict(dict)
    for movement, finding in _asking(recorded):
        for question in finding.open:
            key = question.option.removeprefix("dataset.")
            notes.setdefault(key, question.question)
            if question.suggested is not None:
                suggested[key].setdefault(movement, question.suggested)
    questions = {}
    for key, note in notes.items():
        if key not in KEYS:
            value = _common_suggestion(key, suggested[key])
            questions[key] = suggestion(note, value)
    return questions


def _asking(recorded: RecordingLayout) -> Iterator[tuple[str, Finding]]:
    """Yield the findings with questions, each with the movement of a joint log, or ""."""
    for take in recorded.takes:
        movement = take.name if take.section == "joint_log" else ""
        if take.section != "encoders":
            for log in take.files:
                yield movement, log
    for log in recorded.single.get(Kind.FORCE, []):
        yield "", log


def _common_suggestion(key: str, by_movement: Mapping[str, str]) -> str | None:
    """Return the value suggested for ``key``: the same for all movements, else one for each."""
    if not by_movement:
        return None
    if key == "motion.pose_noise":
        return max(by_movement.values(), key=float)
    if len({*by_movement.values()}) == 1:
        return next(iter(by_movement.values()))
    pairs = [f"{text_of(name)}: {value}" for name, value in by_movement.items()]
    return f"{{{', '.join(pairs)}}}"


def _mocap(recorded: RecordingLayout) -> Entries:
    """Return the entries of motion capture. Rigid bodies track the links if no names of markers
    state three links, and there is no depth camera, which requires a planar arm.
    """
    mocap = _training_and_test(recorded, "mocap", Entry("null"))
    names = recorded.shared("markers")
    bodies = recorded.shared("bodies")
    if links := _markers_by_link(names):
        places = {link: dict.fromkeys(links[link], PLACE) for link in links}
        mocap["markers"] = Entry(places)
    elif bodies and not recorded.of("depth"):
        mount = {"position": PLACE, "rpy": f"{OPEN} # rad"}
        corners = f"{OPEN} # {{a: [x, y, z], b: …, c: …}}"
        mocap["markers"] = Entry(dict.fromkeys(bodies, corners))
        mounts = {body: {"name": text_of(body), "mount": mount} for body in bodies}
        mocap["bodies"] = Entry(mounts)
    else:
        there = list_of_names(names) or "none in all takes"
        note = f"{{link1: {{name: [x, y, z], …}}, …}}; there are {there}"
        mocap["markers"] = suggestion(note)
    return mocap


def _markers_by_link(names: Iterable[str]) -> dict[str, list[str]]:
    """Return link → markers, by marker names without the last part; empty unless 3 × 3 markers."""
    links: dict[str, list[str]] = defaultdict(list)
    for name in names:
        link = MARKER_NUMBER.sub("", name)
        links[link].append(name)
    if "" in links:
        return {}
    counts = [len(markers) for markers in links.values()]
    return links if counts == [3, 3, 3] else {}


def _training_and_test(
    recorded: RecordingLayout,
    section: str,
    without_test: Entry,
) -> Entries:
    """Return the patterns of training and test part. Takes named as a depth sequence are the test
    part (``without_test`` if there are none); the others are the training part if one group.
    """
    filmed = {take.name for take in recorded.of("depth")}
    test = {take.pattern for take in recorded.of(section) if take.name in filmed}
    patterns = recorded.patterns(section)
    training = [pattern for pattern in patterns if pattern not in test]
    if len(training) != 1 or len(test) > 1:
        return dict.fromkeys(("training", "test"), choice_of(patterns))
    return {
        "training": choice_of(training),
        "test": choice_of(test) if test else without_test,
    }


def _encoders(recorded: RecordingLayout) -> Entries:
    """Return the entries of the controller's logs, by the first of them."""
    facts = recorded.of("encoders")[0].finding.facts
    encoders = _training_and_test(recorded, "encoders", Entry())
    encoders["time"] = Entry(text_of(facts.get("time", 0)))
    labels = [str(label) for label in facts.get("labels", [])]
    measured = facts.get("signals", {}).get("actual", [])
    if labels and measured:
        encoders["actual"] = Entry(f"[{list_of_names(measured)}]")
    else:
        encoders["actual"] = suggestion(f"of {list_of_names(labels)}")
    return encoders


def _depth(recorded: RecordingLayout, folder: Path) -> Entries:
    """Return the entries of the depth camera, by the first take of the most frequent pattern."""
    takes = recorded.of("depth")
    ((usual, _),) = Counter(take.pattern for take in takes).most_common(1)
    takes = [take for take in takes if take.pattern == usual]
    place = takes[0].path
    first = takes[0].finding
    depth = {"takes": choice_of(recorded.patterns("depth"))}
    if first.kind == Kind.SEQUENCE:
        key = "index" if first.option == "index" else "frames"
        depth[key] = choice_of([first.file.relative_to(place).as_posix()])
        rates = sorted(take.finding.rate for take in takes if take.finding.rate)
        if rates:
            median = rates[len(rates) // 2]
            depth["rate"] = Entry(f"{median:.4g}", "as the indexes state")
    for key in ("topic", "camera_info"):
        if key in first.facts:
            depth[key] = choice_of([first.facts[key]])
    if first.facts.get("frames_are") == Kind.CLOUD:
        depth["encoding"] = Entry("plain")
        return depth
    cameras = recorded.names(Kind.INTRINSICS, folder)
    if cameras or first.kind == Kind.SEQUENCE:
        depth["intrinsics"] = choice_of(cameras)
    for key in ("width", "height"):
        depth[key] = _consensus(takes, key)
    return depth


def _force(recorded: RecordingLayout, folder: Path) -> Entries:
    """Return the entries of the force logs, one configuration of cables each."""
    logs = recorded.single[Kind.FORCE]
    stems = Counter(log.file.stem for log in logs)
    configurations = {}
    for log in logs:
        stem = log.file.stem
        name = stem if stems[stem] == 1 else f"{log.file.parent.name}_{stem}"
        file = text_of(printable_path(log.file, folder))
        configurations[name] = {"file": file, **CABLE}
    force = {"configurations": Entry(configurations)}
    options = {log.option for log in logs}
    calibrations = {*recorded.names(Kind.CALIBRATION, folder)}
    for key, stated in (("log.format", options), ("log.calibration", calibrations)):
        if len(stated) == 1 and (value := stated.pop()):
            force[key] = Entry(text_of(value))
    return force


def _joint_log(
    recorded: RecordingLayout,
    folder: Path,
    urdf: str,
    robot: Entries,
) -> Entries:
    """Return the entries of the joint logs, by the first of them."""
    takes = recorded.of("joint_log")
    first = takes[0].finding
    pattern = shared_pattern([take.path for take in takes], folder)
    suggested_pattern = text_of(pattern) if pattern else None
    movements = choice_of(recorded.patterns("joint_log"), suggested_pattern)
    joint_log: Entries = {"movements": movements}
    signals = first.facts.get("signals", {})
    count = first.facts.get("joints")
    if tables := first.facts.get("tables"):
        joint_log |= _files_of_signals(first)
        by_role = {table.facts.get("role"): table for table in tables.values()}
        first = by_role.get("target", next(iter(tables.values())))
        timed = bool(first.facts.get("timed"))
        joint_log.setdefault("time", Entry("0") if timed else EVEN)
        count = first.facts["columns"] - timed
    elif first.kind != Kind.JOINTS:
        guessed = parse_yaml(first.suggested.get("signals", "null"))
        if guessed is None and signals:
            joint_log["signals"] = Entry(_yaml_of_lists(signals))
        columns = guessed or signals  # or advice in words
        measured = columns.get("actual", ()) if isinstance(columns, Mapping) else ()
        count = len(measured) or None
        clock = first.facts.get("time")
        joint_log["time"] = EVEN if clock is None else Entry(text_of(clock))
    names = _stated_names(takes, signals)
    joint_log["joints"] = _logged_joints(names, count, robot, urdf, first)
    return joint_log | _stated_units(first)


def _yaml_of_lists(lists: Mapping[str, Iterable[str]]) -> str:
    """Return name → names as a YAML mapping of lists in one line."""
    texts = [f"{name}: [{list_of_names(names)}]" for name, names in lists.items()]
    return f"{{{', '.join(texts)}}}"


def _files_of_signals(movement: Finding) -> Entries:
    """Return role → entry of the words or files of the signals of a ``movement`` of tables."""
    files = {"speed": Entry("null")}
    if words := movement.facts.get("words"):
        for role, word in words.items():
            files[role] = Entry(text_of(word), "by its name")
    else:
        file = choice_of(sorted(movement.facts["tables"]))
        files |= {"actual": file, "target": file}
    return files


def _stated_names(takes: Iterable[PlacedTake], signals: Any) -> tuple[str, ...]:
    """Return the names of the joints that all logs state, else the labels of the measured angles
    of all logs; empty if they differ.
    """
    measured = signals.get("actual", ()) if isinstance(signals, Mapping) else ()
    labels = [label for label in measured if isinstance(label, str)]
    stated = {(*take.finding.facts.get("joint_names", labels),) for take in takes}
    return stated.pop() if len(stated) == 1 else ()


def _stated_units(log: Finding) -> Entries:
    """Return the units of time and angle by the labels of a ``log``, else ???. A log that was read
    asks for the units that it does not state.
    """
    stated_units: Entries = {}
    was_read = log.kind == Kind.JOINTS and "samples" in log.facts
    for key, units in UNITS.items():
        stated = {spelled(unit) for unit in log.units.values()} & {*units}
        if len(stated) == 1:
            stated_units[key] = Entry(stated.pop(), "by the labels")
        elif not was_read:
            stated_units[key] = Entry()
    return stated_units


def _logged_joints(
    names: Sequence[str],
    count: int | None,
    robot: Entries,
    urdf: str,
    log: Finding,
) -> Entry:
    """Return the joints of the ``count`` columns of a ``log``: by the ``names`` in it, else by the
    positions in the arm of the entries ``robot``, with the ranges that support the positions.
    """
    arm = robot.get("robot.joints", Entry()).value
    order = parse_yaml(arm or "[]")
    movable = movable_joints(urdf_facts(urdf))
    joints = match_joints(names, movable) if movable else []
    if not {*order} <= {*joints}:
        joints = []
    is_log = log.kind == Kind.JOINTS
    if joints or (is_log and names):
        value = f"[{list_of_names(joints or names)}]"
        return Entry(value, "as the logs name them", is_log or states_joints(names))
    if states_joints(names):
        return suggestion(f"the logs name, in this order, {list_of_names(names)}")
    if not order or count not in (None, len(order)):
        return suggestion(f"{count} joints" if count else "")
    return _joints_by_position(arm, order, urdf, log)


def _joints_by_position(
    arm: str,
    order: Sequence[str],
    urdf: str,
    log: Finding,
) -> Entry:
    """Return the joints of the ``arm`` (YAML of ``order``) as a suggestion, with the range of each
    column of a ``log``; without the suggestion if a range is beyond the limits in the ``urdf``.
    """
    ranges = [*zip(*log.facts.get("range", ()), strict=True)]
    if len(ranges) != len(order):
        ranges = []
    places = []
    beyond = []
    joints = named_joints(urdf, order)
    for name, joint, (least, greatest) in zip(order, joints, ranges, strict=False):
        places.append(f"{name} {least:.3g} to {greatest:.3g}")
        if joint is None or joint.kind not in LIMITED:
            continue
        if least <= joint.lower - NEAR or greatest >= joint.upper + NEAR:
            beyond.append(name)
    note = (
        "no name states the joint of a column; in the URDF's order, rad: "
        f"{', '.join(places) or 'unknown'}; beyond the limits: {', '.join(beyond) or 'none'}"
    )
    return suggestion(note, None if beyond else arm)
