"""Takes, sequences and logs of a folder, each with the pattern that it shares with others."""

import glob
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from os.path import commonprefix
from pathlib import Path
from typing import Any, NamedTuple

from pipeline.formats.delimited import bare
from pipeline.formats.format import Kind
from pipeline.formats.joints.log import ANGLES
from pipeline.recordings.inventory import take_name
from pipeline.tools.inspect.command import DEPTH_TYPES
from pipeline.tools.inspect.finding import ROBOT, Finding
from pipeline.tools.inspect.joints import add_roles, describe_stated

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


def layout(
    findings: list[Finding], folder: Path, stated: Mapping[str, Any] | None = None
) -> RecordingLayout:
    """Return the takes and the other recordings in ``folder``, with the ``stated`` files and
    columns of joint logs (key of the section joint_log → value).
    """
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
    arrays = [one for one in of[Kind.JOINTS] if one.file not in encoders]
    if stated and stated.get("signals"):
        arrays = [describe_stated(one, stated) for one in arrays]
    movements = {one.file: one for one in arrays}
    # copies of tables as arrays of one signal are no logs
    if not (motion or any("signals" in one.facts for one in of[Kind.JOINTS])):
        movements = _movements(of[Kind.TABLE], folder, stated or {}) or movements
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


def _movements(
    tables: list[Finding], folder: Path, stated: Mapping[str, Any]
) -> dict[Path, Finding]:
    """Return path → finding of the movements in ``tables``: tables with measured and commanded
    angles, by their names, their values or the ``stated`` columns; else tables of one signal each,
    by their names or the stated ones; else folders with tables of equal names.
    """
    whole = {}
    for table in tables:
        if _has_both(table, stated):
            told = bool(stated.get("signals"))
            whole[table.file] = describe_stated(table, stated) if told else table
    if whole:
        return whole
    if paired := _paired_tables(tables, folder, stated):
        return paired
    folders: dict[Path, dict[str, Finding]] = defaultdict(dict)
    for table in tables:
        if table.file.parent != folder:
            folders[table.file.parent][table.file.name] = table
    alike = Counter(
        tuple(sorted(names)) for names in folders.values() if len(names) > 1
    )
    usual = [names for names, _ in alike.most_common(1)]
    movements = {}
    for path, inside in folders.items():
        if [tuple(sorted(inside))] == usual:
            movements[path] = _movement(path, inside)
    return movements


def _movement(path: Path, tables: dict[str, Finding]) -> Finding:
    """Return the finding of a movement of several ``tables``."""
    return Finding(path, "movement", Kind.TABLE, facts={"tables": tables})


def _has_both(table: Finding, stated: Mapping[str, Any]) -> bool:
    """Return whether one ``table`` has measured and commanded angles, or the ``stated`` columns."""
    signals = stated.get("signals")
    if isinstance(signals, dict) and "actual" not in stated:
        columns = [column for names in signals.values() for column in names or ()]
        width, labels = table.facts.get("columns", 0), table.facts.get("labels", [])
        plain = {*labels, *map(bare, labels), *range(width)}
        return bool(columns) and {*columns} <= plain
    guessed = {*re.findall("(actual|target): ", table.suggested.get("signals", ""))}
    return {"actual", "target"} <= {*table.facts.get("signals", ())} | guessed


def _paired_tables(
    tables: list[Finding], folder: Path, stated: Mapping[str, Any]
) -> dict[Path, Finding]:
    """Return path → movement of tables of one signal each: a folder with one movement, or the file
    of its measured angles. The words of the signals are the ``stated`` ones, else by the names.
    """
    by_file = {table.file: table for table in tables}
    groups: dict[Path, dict[str, Finding]] = defaultdict(dict)
    for table in tables:
        if "actual" in stated and "target" in stated:
            for role, name in _stated_roles(table.file, stated).items():
                if name in by_file:
                    groups[table.file][role] = by_file[name]
            if {*ANGLES} <= {*groups[table.file]}:
                add_roles(groups[table.file], {})
        elif "role" in table.facts:
            groups[Path(table.facts["movement"])][table.facts["role"]] = table
    groups = {file: roles for file, roles in groups.items() if {*ANGLES} <= {*roles}}
    count = Counter(file.parent for file in groups)
    movements = {}
    for file, roles in groups.items():
        alone = count[file.parent] == 1 and file.parent != folder
        names = {role: table.file.name for role, table in roles.items()}
        words = names if alone else _differing_words(names)
        finding = _movement(file.parent if alone else file, {})
        finding.facts["tables"] = {table.file.name: table for table in roles.values()}
        finding.facts["words"] = words
        movements[finding.file] = finding
    return movements


def _stated_roles(file: Path, stated: Mapping[str, Any]) -> dict[str, Path]:
    """Return role → file of the movement whose measured angles are in ``file``, by the ``stated``
    words in the files' names; empty for another file.
    """
    actual = stated["actual"]
    if actual not in file.name:
        return {}
    words = {
        role: stated[role] for role in (*ANGLES, "speed", "time") if role in stated
    }
    return {
        role: file.parent / file.name.replace(actual, word, 1)
        for role, word in words.items()
        if isinstance(word, str)
    }


def _differing_words(names: Mapping[str, str]) -> dict[str, str]:
    """Return role → the words in which the file ``names`` of a movement differ."""
    split = {role: re.split(r"([^A-Za-z0-9]+)", name) for role, name in names.items()}
    shortest = min(map(len, split.values()))
    before = 0
    while before < shortest and len({words[before] for words in split.values()}) == 1:
        before += 1
    after = 0
    while after < shortest - before:
        if len({words[-1 - after] for words in split.values()}) > 1:
            break
        after += 1
    if shortest == before + after:  # q.csv beside q_target.csv
        before -= 1
    return {
        role: "".join(words[before : len(words) - after])
        for role, words in split.items()
    }
