"""Takes, sequences and logs of a folder in groups that one pattern names."""

from __future__ import annotations

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

# kinds of which one recording serves the whole dataset
SINGLE = (Kind.TRAJECTORY, Kind.INTRINSICS, Kind.CALIBRATION, ROBOT)


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
    """The recordings of one folder, by what they are."""

    training: list[Group]  # takes of motion capture that no depth sequence has the name of
    test: list[Group]  # those that one has
    depth: list[Group]  # sequences or bags of a depth camera, by take
    force: list[Finding]
    encoders: list[Group]  # joint logs of the names of takes of motion capture
    movements: list[Group]  # other joint logs, else folders of tables with the same names
    single: dict[str, list[Finding]]  # by kind, those of SINGLE
    unplaced: list[Finding]

    @property
    def takes(self) -> list[Finding]:
        """All takes of motion capture."""
        return in_groups([*self.training, *self.test])

    @property
    def markers(self) -> list[str]:
        """Markers that all takes of motion capture have."""
        names = dict.fromkeys(name for take in self.takes for name in take.markers)
        return [name for name in names if all(name in take.markers for take in self.takes)]

    @property
    def bodies(self) -> list[str]:
        """Rigid bodies that all takes of motion capture have, where they are what follows the
        links: no markers are named by three links, and no depth camera looks at a planar arm.
        """
        names = dict.fromkeys(name for take in self.takes for name in take.bodies)
        alike = [name for name in names if all(name in take.bodies for take in self.takes)]
        return [] if self.depth or links_of(self.markers) else alike


def in_groups(groups: Iterable[Group]) -> list[Finding]:
    """Return the takes of all ``groups``."""
    return [take for group in groups for take in group.takes.values()]


def logs_of(takes: Iterable[Finding]) -> list[Finding]:
    """Return the files of the movements ``takes``, one or several of each."""
    return [one for take in takes for one in (take.facts.get("tables") or {"": take}).values()]


def links_of(names: list[str]) -> dict[str, list[str]] | None:
    """Return link → markers by their names without the last part, if three times three."""
    links: dict[str, list[str]] = {}
    for name in names:
        link = re.sub(r"[_:. -]*(\d+|[A-Za-z]|[Mm]arker ?\d+)$", "", name)
        links.setdefault(link, []).append(name)
    return links if all(links) and [*map(len, links.values())] == [3, 3, 3] else None


def layout(findings: list[Finding], folder: Path) -> RecordingLayout:
    """Return the recordings in ``folder`` by what they are and how their names belong together."""
    of: dict[str, list[Finding]] = defaultdict(list)
    for one in findings:
        of[one.kind].append(one)
    motion, joints, tables = (of[kind] for kind in (Kind.MOTION, Kind.JOINTS, Kind.TABLE))
    names, filmed = {one.file.stem for one in motion}, {}
    for one in findings:
        types = {topic["type"] for topic in one.facts.get("topics", {}).values()}
        if one.kind == Kind.SEQUENCE:
            # the folder with the name of a take of motion capture, else where the index lies
            parents = list(one.file.parents)[:3]
            filmed[next((each for each in parents if each.name in names), parents[0])] = one
        elif types & {*DEPTH_TYPES}:
            filmed[one.file] = one
    depth, groups = _groups(filmed, folder), _groups({one.file: one for one in motion}, folder)
    tested = {name for group in depth for name in group.named}
    test = [group for group in groups if tested & {*group.named}]
    logs = [*joints, *(one for one in tables if one.timed)]
    beside = {one.file: one for one in logs if one.file.stem in names}
    movements = {one.file: one for one in joints if one.file not in beside}
    if not (motion or joints):
        movements = _movements(tables, folder)
    single = {kind: of[kind] for kind in SINGLE if of[kind]}
    placed = [*motion, *of[Kind.FORCE], *filmed.values(), *beside.values()]
    placed += [*logs_of(movements.values()), *(one for held in single.values() for one in held)]
    files = {one.file for one in placed}
    return RecordingLayout(
        training=[group for group in groups if group not in test],
        test=test,
        depth=depth,
        force=of[Kind.FORCE],
        encoders=_groups(beside, folder),
        movements=_groups(movements, folder),
        single=single,
        unplaced=[one for one in findings if one.file not in files],
    )


def _groups(recorded: dict[Path, Finding], folder: Path) -> list[Group]:
    """The recordings by the pattern of their paths, or as all files of one folder and ending."""
    shared = Counter(_pattern(path.relative_to(folder)) for path in recorded)
    patterns: dict[str, dict[Path, Finding]] = {}
    for path, finding in recorded.items():
        below = path.relative_to(folder)
        pattern = _pattern(below)
        # a number in a folder's name tells takes apart only where there are several
        if shared[pattern] == 1 and not re.search(r"\d", path.stem):
            pattern = glob.escape(below.as_posix())
        patterns.setdefault(pattern, {})[path] = finding
    ends = {(path.parent, path.suffix) for path in recorded}
    if len(patterns) == len(recorded) > 1 and len(ends) == 1:
        ((parent, suffix),) = ends
        if {*parent.glob(f"*{glob.escape(suffix)}")} == {*recorded}:
            place = Path(glob.escape(parent.relative_to(folder).as_posix()), f"*{suffix}")
            return [Group(place.as_posix(), recorded, folder)]
    return [Group(pattern, takes, folder) for pattern, takes in sorted(patterns.items())]


def _pattern(path: Path) -> str:
    """A glob with a star for the last number in the name, or in the nearest folder with one."""
    suffix = "" if path.suffix[1:].isdigit() else path.suffix
    name = path.as_posix().removesuffix(suffix)
    if parts := re.fullmatch(r"(.*?)(\d+)(\D*)", name, re.DOTALL):
        return f"{glob.escape(parts[1])}*{glob.escape(parts[3] + suffix)}"
    return glob.escape(path.as_posix())


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


def shared_pattern(names: Sequence[str]) -> str:
    """Return the names as one pattern: a star for each number and for a differing rest."""
    marked = [re.sub(r"\d+", "*", glob.escape(name)) for name in names]
    alike = takewhile(lambda letters: len({*letters}) == 1, zip(*marked, strict=False))
    shared = "".join(letters[0] for letters in alike)
    return shared if shared == max(marked, key=len) else f"{shared}*".replace("**", "*")
