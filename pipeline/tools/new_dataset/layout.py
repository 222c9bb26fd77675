"""Takes, sequences and logs of a folder, in groups that match one pattern."""

import glob
import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from os.path import commonprefix
from pathlib import Path
from typing import NamedTuple

from pipeline.formats.format import Kind
from pipeline.recordings.inventory import take_name
from pipeline.tools.inspect.command import DEPTH_TYPES
from pipeline.tools.inspect.finding import ROBOT, Finding

# kinds with one recording per dataset (FORCE: per configuration)
SINGLE = (Kind.TRAJECTORY, Kind.INTRINSICS, Kind.CALIBRATION, Kind.FORCE, ROBOT)


class Group(NamedTuple):
    """Recordings whose paths differ in one number, by path and by take name."""

    pattern: str
    takes: dict[Path, Finding]
    named: dict[str, Finding]


class RecordingLayout(NamedTuple):
    """Takes in a folder by section (mocap, encoders, depth, joint_log), other files by kind."""

    groups: dict[str, list[Group]]
    single: dict[str, list[Finding]]
    unplaced: list[Finding]

    def takes(self, section: str) -> list[Finding]:
        """Return all takes of a section."""
        return [take for group in self.groups[section] for take in group.takes.values()]

    def shared(self, fact: str) -> list[str]:
        """Return the names (``fact`` is markers or bodies) that all motion-capture takes have."""
        lists = [take.facts[fact] for take in self.takes("mocap")]
        return [name for name in lists[0] if all(name in names for names in lists)] if lists else []


def layout(findings: list[Finding], folder: Path) -> RecordingLayout:
    """Return the recordings in ``folder`` by kind, and takes in groups that match one pattern."""
    of: dict[str, list[Finding]] = defaultdict(list)
    for one in findings:
        if one.facts or not one.stops:  # its reader did not refuse it
            of[one.kind].append(one)
    motion = {one.file: one for one in of[Kind.MOTION] if "markers" in one.facts}
    names, filmed = {path.stem for path in motion}, {}
    for one in of[Kind.SEQUENCE]:
        # take folder: named as a motion-capture take, else the folder of the index
        parents = list(one.file.parents)[:3]
        filmed[next((each for each in parents if each.name in names), parents[0])] = one
    for one in of[Kind.BAG]:
        if {kind for kind, _ in one.facts.get("topics", {}).values()} & {*DEPTH_TYPES}:
            filmed[one.file] = one
    logs = of[Kind.JOINTS] + [one for one in of[Kind.TABLE] if one.facts.get("timed")]
    encoders = {one.file: one for one in logs if one.file.stem in names}
    movements = {one.file: one for one in of[Kind.JOINTS] if one.file not in encoders}
    # copies of tables as arrays of one signal are no logs
    if not (motion or any("signals" in one.facts for one in of[Kind.JOINTS])):
        movements = _movements(of[Kind.TABLE], folder) or movements
    sections = {"mocap": motion, "encoders": encoders, "depth": filmed, "joint_log": movements}
    single = {kind: of[kind] for kind in SINGLE if of[kind]}
    placed = {one.file for kind in single.values() for one in kind}
    placed |= {one.file for takes in sections.values() for one in logs_of(takes.values())}
    groups = {section: _groups(takes, folder) for section, takes in sections.items()}
    return RecordingLayout(groups, single, [one for one in findings if one.file not in placed])


def logs_of(takes: Iterable[Finding]) -> list[Finding]:
    """Return the files of the movements ``takes``, one or several per movement."""
    return [one for take in takes for one in (take.facts.get("tables") or {"": take}).values()]


def _groups(recorded: dict[Path, Finding], folder: Path) -> list[Group]:
    """Return the groups of recordings by path pattern; a single group if every pattern would match
    one recording and a shared pattern matches all.
    """
    patterns: dict[str, dict[Path, Finding]] = {}
    for path, finding in recorded.items():
        patterns.setdefault(_pattern(path.relative_to(folder)), {})[path] = finding
    if len(patterns) == len(recorded) > 1 and (one := shared_pattern([*recorded], folder)):
        patterns = {one: recorded}
    return [
        Group(pattern, takes, {take_name(path, folder, pattern): t for path, t in takes.items()})
        for pattern, takes in sorted(patterns.items())
    ]


def _pattern(path: Path) -> str:
    """Return the path as a glob with a star for its last number."""
    suffix = "" if path.suffix[1:].isdigit() else path.suffix
    name = path.as_posix().removesuffix(suffix)
    if parts := re.fullmatch(r"(.*?)(\d+)(\D*)", name, re.DOTALL):
        return f"{glob.escape(parts[1])}*{glob.escape(parts[3] + suffix)}"
    return glob.escape(path.as_posix())


def shared_pattern(paths: Sequence[Path], folder: Path) -> str | None:
    """Return one glob for all ``paths``; None if it also matches other files or folders."""
    names = [glob.escape(path.relative_to(folder).as_posix()) for path in paths]
    names = [re.sub(r"\d+", "*", name) for name in names]
    start = commonprefix(names)  # noqa: RUF071 - letter by letter
    rests = [name[len(start) :] for name in names]
    end = commonprefix([rest[::-1] for rest in rests])[::-1]  # noqa: RUF071
    pattern = (f"{start}*{end}" if any(rests) else start).replace("**", "*")
    matched = {path for path in folder.glob(pattern) if path.is_dir() == paths[0].is_dir()}
    return pattern if matched == {*paths} else None


def _movements(tables: list[Finding], folder: Path) -> dict[Path, Finding]:
    """Return tables with measured and commanded angles, else folders with tables of equal names."""
    whole, folders = {}, {}
    for one in tables:
        guessed = {*re.findall("(actual|target): ", one.suggested.get("signals", ""))}
        if {"actual", "target"} <= {*one.facts.get("signals", ())} | guessed:
            whole[one.file] = one
        if one.file.parent != folder:
            folders.setdefault(one.file.parent, {})[one.file.name] = one
    alike = Counter(tuple(sorted(names)) for names in folders.values() if len(names) > 1)
    names = alike.most_common(1)[0][0] if alike else None
    return whole or {
        path: Finding(path, "movement", Kind.TABLE, facts={"tables": inside})
        for path, inside in folders.items()
        if tuple(sorted(inside)) == names
    }
