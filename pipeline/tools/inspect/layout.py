"""How the recordings of a folder belong together: the patterns of takes and sequences, told by
their names.
"""

from __future__ import annotations

import glob
import re
from collections import Counter
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from pipeline.formats.format import Kind
from pipeline.recordings.take_names import take_name
from pipeline.tools.inspect.bag import DEPTH_TYPES
from pipeline.tools.inspect.finding import ROBOT, Finding

# of which one serves the whole dataset
SINGLE = (Kind.TRAJECTORY, Kind.INTRINSICS, Kind.CALIBRATION, ROBOT)


@dataclass(frozen=True)
class Group:
    """Recordings whose paths differ in one number: their pattern below the ``folder``, and file or
    folder of each take.
    """

    pattern: str
    takes: dict[Path, Finding]
    folder: Path

    @property
    def named(self) -> dict[str, Finding]:
        """The takes by the names that the stages give them."""
        names = (take_name(path, self.folder, self.pattern) for path in self.takes)
        return dict(zip(names, self.takes.values(), strict=True))


@dataclass(frozen=True)
class Layout:
    """The recordings of one folder, by what they are."""

    training: list[Group]  # takes of motion capture that no depth sequence has the name of
    test: list[Group]  # those of which one has
    depth: list[Group]  # sequences or bags of a depth camera, by take
    force: list[Finding]
    encoders: list[Group]  # joint logs of the names of takes of motion capture
    movements: list[Group]  # other joint logs, else folders of tables with the same names
    single: dict[str, list[Finding]]  # by kind, those of SINGLE
    unplaced: list[Finding]

    @property
    def markers(self) -> list[str]:
        """The markers that all takes of motion capture have."""
        return _in_all([take.markers for take in self._takes()])

    @property
    def bodies(self) -> list[str]:
        """The rigid bodies that all takes of motion capture have, where they are what follows the
        links: no markers are named by three links, and no depth camera looks at a planar arm.
        """
        if self.depth or links_of(self.markers):
            return []
        return _in_all([take.bodies for take in self._takes()])

    def _takes(self) -> list[Finding]:
        groups = (*self.training, *self.test)
        return [take for group in groups for take in group.takes.values()]


def links_of(names: list[str]) -> dict[str, list[str]] | None:
    """The names of markers by what stands before their last part, where these are three times
    three.
    """
    links: dict[str, list[str]] = {}
    for name in names:
        links.setdefault(re.sub(r"[_:. -]*(\d+|[A-Za-z]|[Mm]arker ?\d+)$", "", name), []).append(
            name
        )
    return (
        links
        if len(links) == 3 and all(len(markers) == 3 for markers in links.values()) and all(links)
        else None
    )


def _in_all(held: list[list[str]]) -> list[str]:
    return [name for name in held[0] if all(name in each for each in held)] if held else []


def layout(findings: list[Finding], folder: Path) -> Layout:
    """The recordings in ``folder`` by what they are and by how their names belong together."""
    motion = [finding for finding in findings if finding.kind == Kind.MOTION]
    sequences = [
        finding
        for finding in findings
        if finding.kind == Kind.SEQUENCE or set(_types(finding)) & set(DEPTH_TYPES)
    ]
    names = {finding.file.stem for finding in motion}
    takes = {_take_folder(finding, names): finding for finding in sequences}
    depth = _groups(takes, folder)
    filmed = set().union(*(group.named for group in depth))
    groups = _groups({finding.file: finding for finding in motion}, folder)
    test = [group for group in groups if filmed & {*group.named}]
    single: dict[str, list[Finding]] = {}
    for finding in findings:
        if finding.kind in SINGLE:
            single.setdefault(finding.kind, []).append(finding)
    force = [finding for finding in findings if finding.kind == Kind.FORCE]
    beside = [finding for finding in findings if finding.file.stem in names and _timed(finding)]
    encoders = _groups({finding.file: finding for finding in beside}, folder)
    joints = [f for f in findings if f.kind == Kind.JOINTS and f not in beside]
    movements = _groups({finding.file: finding for finding in joints}, folder)
    if not (motion or joints):
        movements = _movements(findings, folder)
    placed = [*motion, *sequences, *force, *joints, *beside, *chain.from_iterable(single.values())]
    placed += [one for group in movements for one in group.takes.values()]
    placed += [
        table
        for group in movements
        for held in group.takes.values()
        for table in held.facts.get("tables", {}).values()
    ]
    taken = {id(finding) for finding in placed}
    unplaced = [finding for finding in findings if id(finding) not in taken]
    return Layout(
        [group for group in groups if group not in test],
        test,
        depth,
        force,
        encoders,
        movements,
        single,
        unplaced,
    )


def _timed(finding: Finding) -> bool:
    """Whether it may be a log of joints on a clock."""
    timed = finding.facts.get("increasing_columns", [])[:1] == [0]
    return finding.kind == Kind.JOINTS or (finding.kind == Kind.TABLE and timed)


def _asked_signals(finding: Finding) -> set[str]:
    """The signals that a table seems to hold, of which its labels do not say it."""
    return {"target"} if "signals" in finding.facts.get("settings", {}) else set()


def _types(finding: Finding) -> list[str]:
    return [topic["type"] for topic in finding.facts.get("topics", {}).values()]


def _take_folder(finding: Finding, takes: set[str]) -> Path:
    """The folder, or the bag, that is the take of a sequence: that with the name of a take of
    motion capture, else where its index lies.
    """
    if finding.kind != Kind.SEQUENCE:
        return finding.file
    parents = [finding.file.parent, *list(finding.file.parent.parents)[:2]]
    return next((parent for parent in parents if parent.name in takes), finding.file.parent)


def _groups(recorded: dict[Path, Finding], folder: Path) -> list[Group]:
    """The recordings by the pattern of their paths; where no two share one and all are the files of
    one folder and ending, as one.
    """
    below = [path.relative_to(folder) for path in recorded]
    shared = Counter(map(_pattern, below))
    patterns: dict[str, dict[Path, Finding]] = {}
    for path, (place, finding) in zip(below, recorded.items(), strict=True):
        pattern = _pattern(path)
        # a number in a folder's name tells takes apart only where there are several
        if shared[pattern] == 1 and not re.search(r"\d", path.stem):
            pattern = glob.escape(path.as_posix())
        patterns.setdefault(pattern, {})[place] = finding
    ends = {(path.parent, path.suffix) for path in recorded}
    parent, suffix = next(iter(ends), (folder, ""))
    if (
        len(patterns) == len(recorded) > 1
        and len(ends) == 1
        and set(parent.glob(f"*{glob.escape(suffix)}")) == set(recorded)
    ):
        return [
            Group(
                (
                    Path(glob.escape(parent.relative_to(folder).as_posix())) / f"*{suffix}"
                ).as_posix(),
                recorded,
                folder,
            )
        ]
    return [Group(pattern, takes, folder) for pattern, takes in sorted(patterns.items())]


def _pattern(path: Path) -> str:
    """``path`` as a glob, with a star for the last number in its name, or else in that of the
    nearest folder with one.
    """
    suffix = "" if path.suffix[1:].isdigit() else path.suffix
    parts = re.fullmatch(r"(.*?)(\d+)(\D*)", path.name.removesuffix(suffix))
    if parts:
        name = f"{glob.escape(parts[1])}*{glob.escape(parts[3] + suffix)}"
        return (Path(glob.escape(path.parent.as_posix())) / name).as_posix()
    above = path.parent if path.parent == Path() else Path(_pattern(path.parent))
    return (above / glob.escape(path.name)).as_posix()


def _movements(findings: list[Finding], folder: Path) -> list[Group]:
    """The tables whose labels say that they hold measured and commanded angles; where there are
    none, the folders below ``folder`` that hold tables of the same names, two or more, as most such
    folders do.
    """
    whole = {
        finding.file: finding
        for finding in findings
        if finding.kind == Kind.TABLE
        and {"actual", "target"} <= {*finding.facts.get("signals", ()), *_asked_signals(finding)}
    }
    if whole:
        return _groups(whole, folder)
    tables: dict[Path, dict[str, Finding]] = {}
    for finding in findings:
        if finding.kind == Kind.TABLE and finding.file.parent != folder:
            tables.setdefault(finding.file.parent, {})[finding.file.name] = finding
    alike = Counter(tuple(sorted(held)) for held in tables.values() if len(held) > 1)
    if not alike:
        return []
    names = alike.most_common(1)[0][0]
    chosen = {path: held for path, held in tables.items() if tuple(sorted(held)) == names}
    return _groups(
        {
            path: Finding(path, "movement", Kind.TABLE, facts={"tables": held})
            for path, held in chosen.items()
        },
        folder,
    )
