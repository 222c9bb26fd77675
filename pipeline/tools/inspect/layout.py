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
from pipeline.tools.inspect.bag import DEPTH_TYPES
from pipeline.tools.inspect.finding import ROBOT, Finding

# of which one serves the whole dataset
SINGLE = (Kind.TRAJECTORY, Kind.INTRINSICS, Kind.CALIBRATION, ROBOT)


@dataclass(frozen=True)
class Group:
    """Recordings whose paths differ in one number: their pattern below the folder, and file or
    folder of each take.
    """

    pattern: str
    takes: dict[Path, Finding]

    @property
    def names(self) -> set[str]:
        """The takes' names."""
        return {path.stem if path.is_file() else path.name for path in self.takes}


@dataclass(frozen=True)
class Layout:
    """The recordings of one folder, by what they are."""

    training: list[Group]  # takes of motion capture that no depth sequence has the name of
    test: list[Group]  # those of which one has
    depth: list[Group]  # sequences or bags of a depth camera, by take
    force: list[Finding]
    movements: list[Group]  # joint logs, else folders of tables with the same names
    single: dict[str, list[Finding]]  # by kind, those of SINGLE
    unplaced: list[Finding]


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
    filmed = set().union(*(group.names for group in depth))
    groups = _groups({finding.file: finding for finding in motion}, folder)
    test = [group for group in groups if filmed & group.names]
    single: dict[str, list[Finding]] = {}
    for finding in findings:
        if finding.kind in SINGLE:
            single.setdefault(finding.kind, []).append(finding)
    force = [finding for finding in findings if finding.kind == Kind.FORCE]
    joints = [finding for finding in findings if finding.kind == Kind.JOINTS]
    movements = _groups({finding.file: finding for finding in joints}, folder)
    if not (motion or joints):
        movements = _movements(findings, folder)
    placed = [*motion, *sequences, *force, *joints, *chain.from_iterable(single.values())]
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
        movements,
        single,
        unplaced,
    )


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
    patterns: dict[str, dict[Path, Finding]] = {}
    for path, finding in recorded.items():
        patterns.setdefault(_pattern(path.relative_to(folder)), {})[path] = finding
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
            )
        ]
    return [Group(pattern, takes) for pattern, takes in sorted(patterns.items())]


def _pattern(path: Path) -> str:
    """``path`` as a glob, with a star for the last number in its name."""
    suffix = "" if path.suffix[1:].isdigit() else path.suffix
    parts = re.fullmatch(r"(.*?)(\d+)(\D*)", path.name.removesuffix(suffix))
    name = (
        f"{glob.escape(parts[1])}*{glob.escape(parts[3] + suffix)}"
        if parts
        else glob.escape(path.name)
    )
    return (Path(glob.escape(path.parent.as_posix())) / name).as_posix()


def _movements(findings: list[Finding], folder: Path) -> list[Group]:
    """The folders that hold tables of the same names, two or more, as most such folders do."""
    tables: dict[Path, dict[str, Finding]] = {}
    for finding in findings:
        if finding.kind == Kind.TABLE:
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
