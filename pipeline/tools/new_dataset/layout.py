"""Takes, sequences and logs of a folder, each with the pattern that it shares with others."""

import glob
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from os.path import commonprefix
from pathlib import Path
from typing import NamedTuple

from pipeline.formats.format import Kind
from pipeline.recordings.inventory import take_name
from pipeline.tools.inspect.command import DEPTH_TYPES
from pipeline.tools.inspect.finding import ROBOT, Finding

# kinds with one recording per dataset (FORCE: per configuration)
SINGLE = (Kind.TRAJECTORY, Kind.INTRINSICS, Kind.CALIBRATION, Kind.FORCE, ROBOT)


class PlacedTake(NamedTuple):
    """A recording at ``path`` of a ``section`` (mocap, encoders, depth or joint_log). Takes whose
    paths differ in one number share a ``pattern``, by which the dataset gives them their names.
    """

    section: str
    pattern: str
    name: str
    path: Path
    finding: Finding

    @property
    def files(self) -> list[Finding]:
        """Findings of the files of a movement: one, or one per table in its folder."""
        return [*(self.finding.facts.get("tables") or {"": self.finding}).values()]


class RecordingLayout(NamedTuple):
    """Takes in a folder by section and pattern, files of other kinds, and the rest."""

    takes: list[PlacedTake]
    single: dict[str, list[Finding]]
    unplaced: list[Finding]

    def of(self, section: str) -> list[PlacedTake]:
        """Return the takes of a section."""
        return [take for take in self.takes if take.section == section]

    def patterns(self, section: str) -> list[str]:
        """Return the patterns of a section's takes."""
        return [*dict.fromkeys(take.pattern for take in self.of(section))]

    def shared(self, fact: str) -> list[str]:
        """Return the names (``fact`` is markers or bodies) that all motion-capture takes have."""
        lists = [take.finding.facts[fact] for take in self.of("mocap")]
        return (
            [name for name in lists[0] if all(name in names for names in lists)]
            if lists
            else []
        )


def layout(findings: list[Finding], folder: Path) -> RecordingLayout:
    """Return the takes and the other recordings in ``folder``."""
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
    sections = {
        "mocap": motion,
        "encoders": encoders,
        "depth": filmed,
        "joint_log": movements,
    }
    takes = [
        take
        for section, own in sections.items()
        for take in _placed(section, own, folder)
    ]
    single = {kind: of[kind] for kind in SINGLE if of[kind]}
    placed = {one.file for kind in single.values() for one in kind}
    placed |= {one.file for take in takes for one in take.files}
    return RecordingLayout(
        takes, single, [one for one in findings if one.file not in placed]
    )


def _placed(
    section: str, recorded: dict[Path, Finding], folder: Path
) -> Iterator[PlacedTake]:
    """Yield the takes of a section, sorted by pattern. If every pattern would match one take, and a
    shared pattern all takes, the shared one is used.
    """
    patterns = {path: _pattern(path.relative_to(folder)) for path in recorded}
    alone = len({*patterns.values()}) == len(recorded) > 1
    if alone and (one := shared_pattern([*recorded], folder)):
        patterns = dict.fromkeys(recorded, one)
    for path in sorted(recorded, key=patterns.get):
        name = take_name(path, folder, patterns[path])
        yield PlacedTake(section, patterns[path], name, path, recorded[path])


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
    matched = {
        path for path in folder.glob(pattern) if path.is_dir() == paths[0].is_dir()
    }
    return pattern if matched == {*paths} else None


def _movements(tables: list[Finding], folder: Path) -> dict[Path, Finding]:
    """Return tables with measured and commanded angles, else folders with tables of equal names."""
    whole, folders = {}, defaultdict(dict)
    for one in tables:
        guessed = {*re.findall("(actual|target): ", one.suggested.get("signals", ""))}
        if {"actual", "target"} <= {*one.facts.get("signals", ())} | guessed:
            whole[one.file] = one
        if one.file.parent != folder:
            folders[one.file.parent][one.file.name] = one
    alike = Counter(
        tuple(sorted(names)) for names in folders.values() if len(names) > 1
    )
    return whole or {
        path: Finding(path, "movement", Kind.TABLE, facts={"tables": inside})
        for path, inside in folders.items()
        if [(*sorted(inside),)] == [names for names, _ in alike.most_common(1)]
    }
