"""Takes, sequences and logs of a folder in groups that one pattern names."""

import glob
import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from itertools import takewhile
from pathlib import Path
from typing import NamedTuple

from pipeline.formats.format import Kind
from pipeline.recordings.inventory import take_name
from pipeline.tools.inspect.finding import ROBOT, Finding
from pipeline.tools.inspect.kinds import DEPTH_TYPES

# kinds of which one recording serves the whole dataset, but for FORCE: one a configuration
SINGLE = (Kind.TRAJECTORY, Kind.INTRINSICS, Kind.CALIBRATION, Kind.FORCE, ROBOT)


class Group(NamedTuple):
    """Recordings whose paths differ in one number: pattern, and file or folder of each take."""

    pattern: str
    takes: dict[Path, Finding]
    folder: Path

    @property
    def named(self) -> dict[str, Finding]:
        """The takes by the names that the stages give them."""
        return {take_name(path, self.folder, self.pattern): t for path, t in self.takes.items()}


class RecordingLayout(NamedTuple):
    """Takes of a folder by section (mocap, encoders, depth, joint_log), other files by kind."""

    groups: dict[str, list[Group]]
    single: dict[str, list[Finding]]
    unplaced: list[Finding]

    def takes(self, section: str) -> list[Finding]:
        """Return all takes of a section."""
        return [take for group in self.groups[section] for take in group.takes.values()]

    def shared(self, section: str, fact: str) -> list[str]:
        """Return the names of a list of facts that all takes of a section have."""
        lists = [take.facts[fact] for take in self.takes(section)]
        return [name for name in lists[0] if all(name in names for names in lists)] if lists else []


def logs_of(takes: Iterable[Finding]) -> list[Finding]:
    """Return the files of the movements ``takes``, one or several of each."""
    return [one for take in takes for one in (take.facts.get("tables") or {"": take}).values()]


def layout(findings: list[Finding], folder: Path) -> RecordingLayout:
    """Return the recordings in ``folder`` by what they are and how their names belong together."""
    of: dict[str, list[Finding]] = defaultdict(list)
    for one in findings:
        of[one.kind].append(one)
    motion = {one.file: one for one in of[Kind.MOTION] if "markers" in one.facts}  # is not refused
    names, filmed = {path.stem for path in motion}, {}
    for one in of[Kind.SEQUENCE]:
        # the folder with the name of a take of motion capture, else where the index lies
        parents = list(one.file.parents)[:3]
        filmed[next((each for each in parents if each.name in names), parents[0])] = one
    for one in of[Kind.BAG]:
        if {kind for kind, _ in one.facts.get("topics", {}).values()} & {*DEPTH_TYPES}:
            filmed[one.file] = one
    logs = of[Kind.JOINTS] + [one for one in of[Kind.TABLE] if one.facts.get("timed")]
    beside = {one.file: one for one in logs if one.file.stem in names}
    movements = {one.file: one for one in of[Kind.JOINTS] if one.file not in beside}
    if not (motion or of[Kind.JOINTS]):
        movements = _movements(of[Kind.TABLE], folder)
    sections = {"mocap": motion, "encoders": beside, "depth": filmed, "joint_log": movements}
    single = {kind: of[kind] for kind in SINGLE if of[kind]}
    placed = [one for held in single.values() for one in held]
    placed += [one for held in sections.values() for one in logs_of(held.values())]
    files = {one.file for one in placed}
    groups = {section: _groups(held, folder) for section, held in sections.items()}
    return RecordingLayout(groups, single, [one for one in findings if one.file not in files])


def _groups(recorded: dict[Path, Finding], folder: Path) -> list[Group]:
    """Recordings by the pattern of their paths; in one group if one pattern names single ones."""
    patterns: dict[str, dict[Path, Finding]] = {}
    for path, finding in recorded.items():
        patterns.setdefault(_pattern(path.relative_to(folder)), {})[path] = finding
    if len(patterns) == len(recorded) > 1 and (one := shared_pattern([*recorded], folder)):
        return [Group(one, recorded, folder)]
    return [Group(pattern, takes, folder) for pattern, takes in sorted(patterns.items())]


def _pattern(path: Path) -> str:
    """A glob with a star for the last number in the name, or in the nearest folder with one."""
    suffix = "" if path.suffix[1:].isdigit() else path.suffix
    name = path.as_posix().removesuffix(suffix)
    if parts := re.fullmatch(r"(.*?)(\d+)(\D*)", name, re.DOTALL):
        return f"{glob.escape(parts[1])}*{glob.escape(parts[3] + suffix)}"
    return glob.escape(path.as_posix())


def shared_pattern(paths: Sequence[Path], folder: Path) -> str | None:
    """Return one pattern of the ``paths``, None if it matches others of their sort too."""

    def alike(names: list[str]) -> str:
        letters = takewhile(lambda each: len({*each}) == 1, zip(*names, strict=False))
        return "".join(each[0] for each in letters)

    names = [glob.escape(path.relative_to(folder).as_posix()) for path in paths]
    names = [re.sub(r"\d+", "*", name) for name in names]
    start = alike(names)
    rests = [name[len(start) :] for name in names]
    pattern = f"{start}*{alike([rest[::-1] for rest in rests])[::-1]}" if any(rests) else start
    pattern = pattern.replace("**", "*")
    matched = {path for path in folder.glob(pattern) if path.is_dir() == paths[0].is_dir()}
    return pattern if matched == {*paths} else None


def _movements(tables: list[Finding], folder: Path) -> dict[Path, Finding]:
    """Tables of measured and commanded angles, else folders of tables of the same names."""
    whole, held = {}, {}
    for one in tables:
        guessed = {"target"} if "signals" in one.suggested else set()
        if {"actual", "target"} <= {*one.facts.get("signals", ())} | guessed:
            whole[one.file] = one
        if one.file.parent != folder:
            held.setdefault(one.file.parent, {})[one.file.name] = one
    alike = Counter(tuple(sorted(names)) for names in held.values() if len(names) > 1)
    names = alike.most_common(1)[0][0] if alike else None
    return whole or {
        path: Finding(path, "movement", Kind.TABLE, facts={"tables": inside})
        for path, inside in held.items()
        if tuple(sorted(inside)) == names
    }
