"""Values of a dataset's datasheet that its recordings state, by dotted key."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path

from pipeline.core.options.instruments import AngleUnit, TimeUnit
from pipeline.formats.depth.messages import CAMERA_INFO, IMAGE
from pipeline.formats.format import Kind
from pipeline.formats.units import spelled
from pipeline.tools.inspect.bag import DEPTH_TYPES
from pipeline.tools.inspect.finding import Finding
from pipeline.tools.inspect.joints import MEASURED, STATED_BY_TYPE
from pipeline.tools.inspect.layout import Group, Layout, links_of
from pipeline.tools.new_dataset.template import asked
from pipeline.tools.new_dataset.yaml_text import agreed, below_folder, one_of, several, text_of

SHOWN = 12  # recordings that are named although they have no place
TURN = "[0.0, 6.283185307179586] # rad, [least, greatest]; narrow the full turn, as set up"
Values = dict[str, str]
Blocks = dict[str, list[str]]


def recorded_values(layout: Layout, folder: Path) -> tuple[Values, Blocks]:
    """Return the values that the recordings of ``layout`` in ``folder`` state, and the lines that
    stand for marks of the template.
    """
    below = partial(below_folder, folder)
    known, blocks = {}, {}
    trajectories = layout.single.get(Kind.TRAJECTORY, [])
    if trajectories or layout.training or layout.test:
        one = len(trajectories) == 1
        known["trajectory"] = below(trajectories[0]) if one else one_of(map(below, trajectories))
    if layout.training or layout.test:
        known |= _mocap(layout)
    if layout.encoders:
        known |= _encoders(layout)
    if layout.depth:
        known |= _depth(layout, [below(one) for one in layout.single.get(Kind.INTRINSICS, [])])
    if layout.force:
        files = {finding.file: below(finding) for finding in layout.force}
        known |= _force(layout.force, files)
        calibrations = [below(one) for one in layout.single.get(Kind.CALIBRATION, [])]
        blocks["force_log"] = _force_log(layout.force, calibrations)
    if layout.movements:
        values, blocks["joint_log"] = _joint_log(layout.movements)
        known |= values
    if unplaced := [below(finding) for finding in layout.unplaced]:
        more = f" … ({len(unplaced)})" if len(unplaced) > SHOWN else ""
        blocks["unplaced"] = [f"# not placed: {', '.join(unplaced[:SHOWN])}{more}"]
    return known, blocks


def _section(name: str, values: Values) -> Values:
    return {name: ""} | {f"{name}.{key}": value for key, value in values.items()}


def _mocap(layout: Layout) -> Values:
    takes = [take for group in (*layout.training, *layout.test) for take in group.takes.values()]
    values = _parts(layout.training, layout.test)
    if any(take.units.get("length") == "not stated" for take in takes):
        values["unit"] = asked()
    if layout.bodies:
        places = {name: asked("{a: [x, y, z], b: …, c: …}") for name in layout.bodies}
        values["markers"] = _block(2, places)
        mounts = ""
        for name in layout.bodies:
            body = {"name": text_of(name), "mount": ""}
            mount = {"position": asked("[x, y, z]"), "rpy": asked("rad")}
            mounts += f"\n    {text_of(name)}:{_block(3, body)}{_block(4, mount)}"
        values["bodies"] = mounts
    elif links := links_of(layout.markers):
        values["markers"] = "".join(
            f"\n    {text_of(link)}:{_block(3, dict.fromkeys(names, asked('[x, y, z]')))}"
            for link, names in links.items()
        )
    else:
        names = ", ".join(map(text_of, layout.markers)) or "none in all takes"
        values["markers"] = asked(f"{{link1: {{name: [x, y, z], …}}, …}}; there are {names}")
    return _section("mocap", values)


def _block(level: int, values: Values) -> str:
    """Keys and values as lines at a ``level`` of indentation, each after a line end."""
    return "".join(f"\n{'  ' * level}{text_of(k)}: {v}".rstrip() for k, v in values.items())


def _encoders(layout: Layout) -> Values:
    """Joint logs that are named as takes of the motion capture."""
    takes = {name for group in layout.training for name in group.named}
    training = [group for group in layout.encoders if takes & {*group.named}]
    test = [group for group in layout.encoders if not takes & {*group.named}]
    facts = next(iter(layout.encoders[0].takes.values())).facts
    labels = [str(label) for label in facts.get("labels", [])]
    measured = [label for label in labels if any(word in label.lower() for word in MEASURED)]
    timed = labels and facts.get("increasing_columns", [])[:1] == [0]
    values = _parts(training, test) | {"time": text_of(labels[0]) if timed else "0"}
    if values["test"] == "null":
        values["test"] = asked()
    values["actual"] = f"[{several(measured)}]" if measured else asked(f"of {several(labels)}")
    return _section("encoders", values)


def _parts(training: Sequence[Group], test: Sequence[Group]) -> Values:
    """The patterns of both parts, where one group is what there is to fit to."""
    if len(training) == 1 and len(test) <= 1:
        return {
            "training": text_of(training[0].pattern),
            "test": text_of(test[0].pattern) if test else "null",
        }
    patterns = [text_of(group.pattern) for group in (*training, *test)]
    return {"training": one_of(patterns), "test": one_of(patterns)}


def _depth(layout: Layout, calibrations: Sequence[str]) -> Values:
    group = max(layout.depth, key=lambda group: len(group.takes))
    takes, (place, first) = list(group.takes.values()), next(iter(group.takes.items()))
    topics = first.facts.get("topics")
    patterns = [text_of(each.pattern) for each in layout.depth]
    values = {"takes": patterns[0] if len(patterns) == 1 else one_of(patterns)}
    if topics is None:
        key = "index" if first.option == "index" else "frames"
        values[key] = text_of(first.file.relative_to(place).as_posix())
        clouds = first.facts.get("frames_are") == Kind.CLOUD
    else:
        for key, kinds in (("topic", DEPTH_TYPES), ("camera_info", (CAMERA_INFO,))):
            names = [text_of(n) for n, t in topics.items() if t["type"] in kinds and t["messages"]]
            if names:
                values[key] = names[0] if len(names) == 1 else one_of(names)
        clouds = all(t["type"] != IMAGE for t in topics.values() if t["messages"])
    if clouds:
        values["encoding"] = "plain"
    else:
        if calibrations or topics is None:
            one = len(calibrations) == 1
            values["intrinsics"] = calibrations[0] if one else one_of(calibrations)
        for key in ("width", "height"):
            values[key] = agreed(take.facts.get(key) for take in takes)
    if held := first.facts.get("first_values"):
        values["units_per_metre"] = asked(f"the first frame holds {held[0]:g} to {held[1]:g}")
    rates = sorted(take.rate for take in takes if take.rate)
    if rates and topics is None:
        values["rate"] = f"{rates[len(rates) // 2]:.4g} # as the indexes state"
    return _section("depth", values)


def _force(logs: Sequence[Finding], files: dict[Path, str]) -> Values:
    stems = Counter(finding.file.stem for finding in logs)
    configurations = ""
    for finding in logs:
        stem = finding.file.stem
        name = stem if stems[stem] == 1 else f"{finding.file.parent.name}_{stem}"
        each = {
            "file": files[finding.file],
            "direction": asked("rad, [first cable, second, …]"),
            "tension": asked("N, [first cable, second, …]"),
            "direction_bounds": TURN,
        }
        configurations += f"\n    {text_of(name)}:{_block(3, each)}"
    return _section("force", {"configurations": configurations})


def _force_log(logs: Sequence[Finding], calibrations: Sequence[str]) -> list[str]:
    """The section log: format, calibration, and each option that settles an open question."""
    values = {}
    options = {finding.option for finding in logs}
    if len(options) == 1:
        values["format"] = options.pop()
    if len(calibrations) == 1:
        values["calibration"] = calibrations[0]
    questions = {option: question for finding in logs for question, option in finding.open}
    for option, question in sorted(questions.items()):
        if option.startswith("dataset.force.log."):
            key = option.removeprefix("dataset.force.log.")
            if key != "format":
                values.setdefault(key, asked(" ".join(question.split())))
    return ["  log:", *_block(2, values).splitlines()[1:]] if values else []


def _joint_log(movements: list[Group]) -> tuple[Values, list[str]]:
    patterns = [text_of(group.pattern) for group in movements]
    values = {"movements": patterns[0] if len(patterns) == 1 else one_of(patterns)}
    takes = [take for group in movements for take in group.takes.values()]
    facts = takes[0].facts
    if takes[0].kind == Kind.JOINTS:
        stated = {tuple(take.facts.get("joint_names", [])) for take in takes}
        names = next(iter(stated)) if len(stated) == 1 else ()
        values["joints"] = _names(facts.get("joints"), names)
        values |= {} if takes[0].format == STATED_BY_TYPE else _units(takes[0])
        return _section("joint_log", values), _settings(takes)
    if "signals" in facts:
        signals = [f"{name}: [{several(labels)}]" for name, labels in facts["signals"].items()]
        if "signals" not in facts.get("settings", {}):
            values["signals"] = f"{{{', '.join(signals)}}}"
        values["joints"] = _names(len(next(iter(facts["signals"].values()))))
        no_time = asked("null: the rows follow each other at motion.rate")
        values["time"] = text_of(facts["time"]) if "time" in facts else no_time
        return _section("joint_log", values | _units(takes[0])), _settings(takes)
    tables = facts["tables"]
    first = next(iter(tables.values()))
    timed = first.facts.get("increasing_columns", [])[:1] == [0]
    columns = {table.facts.get("columns") for table in tables.values()}
    steps = {table.facts.get("step_of_column_0") for table in tables.values()} - {None}
    step = f" # steps by {steps.pop():g}" if len(steps) == 1 else ""
    values |= _files(tables)
    values["joints"] = _names(columns.pop() - 1 if len(columns) == 1 and timed else None)
    values["time"] = f"0{step}" if timed else asked(step.removeprefix(" # "))
    every = [table for take in takes for table in take.facts["tables"].values()]
    return _section("joint_log", values | _units(first)), _settings(every)


def _files(tables: dict[str, Finding]) -> Values:
    """The files of the measured and commanded angles, by their names and values."""
    pairs = [(t.facts["measured"], name) for name, t in tables.items() if "measured" in t.facts]
    if len(pairs) != 1:
        names = one_of(map(text_of, sorted(tables)))
        return {"actual": names, "target": names, "speed": "null"}
    ((actual, target),) = pairs
    speeds = [name for name, table in tables.items() if table.facts.get("speed_of") == target]
    speed = f"{text_of(speeds[0])} # by its values" if len(speeds) == 1 else "null"
    return {
        "actual": f"{text_of(actual)} # by its name",
        "target": f"{text_of(target)} # by its name",
        "speed": speed,
    }


def _units(table: Finding) -> Values:
    """The units that the labels of a ``table`` state, or ???."""
    stated = {spelled(unit) for unit in table.units.values()}
    values = {}
    for key, units in (("time_unit", TimeUnit), ("angle_unit", AngleUnit)):
        held = stated & {*units}
        values[key] = f"{held.pop()} # by the labels" if len(held) == 1 else asked()
    return values


def _names(joints: int | None, stated: Sequence[str] = ()) -> str:
    if stated:
        return f"[{several(list(stated))}] # as the logs name them"
    return asked(f"{joints} joints" if joints else "")


def _settings(movements: Iterable[Finding]) -> list[str]:
    """The options that settle what was found of measured and commanded angles."""
    questions = {
        option.rpartition(".")[2]: question
        for finding in movements
        for question, option in finding.open
        if option.rpartition(".")[2] in finding.facts.get("settings", {})
    }
    values = {
        key: asked(question.rpartition(";")[0])
        for key, question in sorted(questions.items())
        if key not in ("rest", "angle_unit", "time_unit")  # keys of the template
    }
    return _block(1, values).splitlines()[1:]
