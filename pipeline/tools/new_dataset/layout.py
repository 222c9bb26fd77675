"""Takes, sequences and logs of a folder, each with the pattern that it shares with others."""

import glob
import re
from collections import Counter, defaultdict
from collections.abc import Container, Iterable, Mapping, Sequence
from os.path import commonprefix
from pathlib import Path
from typing import Any, NamedTuple

from pipeline.formats.delimited import bare
from pipeline.formats.format import Kind
from pipeline.formats.joints.log import ANGLES
from pipeline.recordings.inventory import take_name
from pipeline.tools.inspect.command import DEPTH_TYPES
from pipeline.tools.inspect.finding import ROBOT, Finding, printable_path
from pipeline.tools.inspect.joints import describe_stated
from pipeline.tools.inspect.movements import add_roles

# kinds with one recording per dataset (FORCE: per configuration)
LAST_NUMBER = re.compile(r"(.*?)\d+(\D*)", re.DOTALL)
SEPARATORS = re.compile("([^A-Za-z0-9]+)")
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

    def names(self, kind: str, folder: Path) -> list[str]:
        """Return the printable paths of the files of a ``kind``, relative to the ``folder``."""
        findings = self.single.get(kind, [])
        return [printable_path(finding.file, folder) for finding in findings]

    def shared(self, fact: str) -> list[str]:
        """Return the names (``fact`` is markers or bodies) that all motion-capture takes have."""
        lists = [take.finding.facts[fact] for take in self.of("mocap")]
        first = lists[0] if lists else []
        return [name for name in first if all(name in names for names in lists)]


def layout(
    findings: list[Finding],
    folder: Path,
    stated: Mapping[str, Any] | None = None,
) -> RecordingLayout:
    """Return the takes and the other recordings in ``folder``, with the ``stated`` files and
    columns of joint logs (key of the section joint_log → value).
    """
    by_kind: dict[str, list[Finding]] = defaultdict(list)
    for finding in findings:
        if finding.facts or not finding.stops:  # its reader did not refuse it
            by_kind[finding.kind].append(finding)

    motion = {}
    for finding in by_kind[Kind.MOTION]:
        if "markers" in finding.facts:
            motion[finding.file] = finding
    take_names = {file.stem for file in motion}
    timed = [table for table in by_kind[Kind.TABLE] if table.facts.get("timed")]
    encoders = {}
    for log in by_kind[Kind.JOINTS] + timed:
        if log.file.stem in take_names:
            encoders[log.file] = log
    sections = {
        "mocap": motion,
        "encoders": encoders,
        "depth": _depth_takes(by_kind, take_names),
        "joint_log": _joint_logs(by_kind, folder, encoders, motion, stated or {}),
    }
    takes = []
    for section, recorded in sections.items():
        takes += _placed(section, recorded, folder)
    single = {kind: by_kind[kind] for kind in SINGLE if by_kind[kind]}

    placed = {finding.file for of_kind in single.values() for finding in of_kind}
    placed |= {finding.file for take in takes for finding in take.files}
    unplaced = [finding for finding in findings if finding.file not in placed]
    return RecordingLayout(takes, single, unplaced)


def _depth_takes(
    by_kind: Mapping[str, list[Finding]],
    take_names: Container[str],
) -> dict[Path, Finding]:
    """Return folder or bag → finding of the takes of a depth camera. The folder is the one named as
    a motion-capture take, else the folder of the index.
    """
    filmed = {}
    for sequence in by_kind[Kind.SEQUENCE]:
        parents = list(sequence.file.parents)[:3]
        named = [parent for parent in parents if parent.name in take_names]
        filmed[(named or parents)[0]] = sequence
    for bag in by_kind[Kind.BAG]:
        types = {kind for kind, _ in bag.facts.get("topics", {}).values()}
        if types & {*DEPTH_TYPES}:
            filmed[bag.file] = bag
    return filmed


def _joint_logs(
    by_kind: Mapping[str, list[Finding]],
    folder: Path,
    encoders: Container[Path],
    motion: Mapping[Path, Finding],
    stated: Mapping[str, Any],
) -> dict[Path, Finding]:
    """Return path → finding of the movements: of arrays, or of tables where no file of arrays names
    its signals (copies of tables as arrays of one signal are no logs).
    """
    arrays = [log for log in by_kind[Kind.JOINTS] if log.file not in encoders]
    if stated.get("signals"):
        arrays = [describe_stated(log, stated) for log in arrays]
    movements = {log.file: log for log in arrays}
    if motion or any("signals" in log.facts for log in by_kind[Kind.JOINTS]):
        return movements
    return _movements(by_kind[Kind.TABLE], folder, stated) or movements


def _placed(
    section: str,
    recorded: Mapping[Path, Finding],
    folder: Path,
) -> list[PlacedTake]:
    """Return the takes of a section, sorted by pattern. If every pattern would match one take, and
    a shared pattern all takes, the shared one is used.
    """
    patterns = {path: _pattern(path.relative_to(folder)) for path in recorded}
    if len({*patterns.values()}) == len(recorded) > 1:
        if shared := shared_pattern([*recorded], folder):
            patterns = dict.fromkeys(recorded, shared)
    takes = []
    for path in sorted(recorded, key=patterns.get):
        pattern = patterns[path]
        name = take_name(path, folder, pattern)
        takes.append(PlacedTake(section, pattern, name, path, recorded[path]))
    return takes


def _pattern(path: Path) -> str:
    """Return the path as a glob with a star for its last number."""
    suffix = "" if path.suffix[1:].isdigit() else path.suffix
    name = path.as_posix().removesuffix(suffix)
    numbered = LAST_NUMBER.fullmatch(name)
    if numbered is None:
        return glob.escape(path.as_posix())
    before, after = numbered.groups()
    return f"{glob.escape(before)}*{glob.escape(after + suffix)}"


def shared_pattern(paths: Sequence[Path], folder: Path) -> str | None:
    """Return one glob for all ``paths``; None if it also matches other files or folders."""
    names = []
    for path in paths:
        name = glob.escape(path.relative_to(folder).as_posix())
        names.append(re.sub(r"\d+", "*", name))
    start = commonprefix(names)  # noqa: RUF071 - letter by letter
    rests = [name.removeprefix(start) for name in names]
    backwards = [rest[::-1] for rest in rests]
    end = commonprefix(backwards)[::-1]  # noqa: RUF071
    pattern = f"{start}*{end}" if any(rests) else start
    pattern = pattern.replace("**", "*")
    folders = paths[0].is_dir()
    matched = {path for path in folder.glob(pattern) if path.is_dir() == folders}
    return pattern if matched == {*paths} else None


def _movements(
    tables: list[Finding],
    folder: Path,
    stated: Mapping[str, Any],
) -> dict[Path, Finding]:
    """Return path → finding of the movements in ``tables``: tables with measured and commanded
    angles, by their names, their values or the ``stated`` columns; else tables of one signal each,
    by their names or the stated ones; else folders with tables of equal names.
    """
    whole = {}
    for table in tables:
        if _has_both(table, stated):
            restated = (
                describe_stated(table, stated) if stated.get("signals") else table
            )
            whole[table.file] = restated
    return (
        whole
        or _paired_tables(tables, folder, stated)
        or _folders_of_equal_names(tables, folder)
    )


def _folders_of_equal_names(tables: list[Finding], folder: Path) -> dict[Path, Finding]:
    """Return folder → movement of the folders that hold the most frequent names of tables."""
    folders: dict[Path, dict[str, Finding]] = defaultdict(dict)
    for table in tables:
        if table.file.parent != folder:
            folders[table.file.parent][table.file.name] = table
    counts = Counter(frozenset(names) for names in folders.values() if len(names) > 1)
    if not counts:
        return {}
    ((usual, _),) = counts.most_common(1)
    movements = {}
    for path, inside in folders.items():
        if inside.keys() == usual:
            movements[path] = _movement(path, inside)
    return movements


def _movement(path: Path, tables: dict[str, Finding]) -> Finding:
    """Return the finding of a movement of several ``tables``."""
    return Finding(path, "movement", Kind.TABLE, facts={"tables": tables})


def _has_both(table: Finding, stated: Mapping[str, Any]) -> bool:
    """Return whether one ``table`` has measured and commanded angles, or the ``stated`` columns."""
    signals = stated.get("signals")
    if isinstance(signals, dict) and "actual" not in stated:
        wanted = set()
        for columns in signals.values():
            wanted.update(columns or ())
        labels = table.facts.get("labels", [])
        present = {*range(table.facts.get("columns", 0))}
        present.update(labels)
        present.update(bare(label) for label in labels)
        return bool(wanted) and wanted <= present
    suggested = table.suggested.get("signals", "")
    certain_or_guessed = {*table.facts.get("signals", ())}
    certain_or_guessed.update(re.findall("(actual|target): ", suggested))
    return {*ANGLES} <= certain_or_guessed


def _paired_tables(
    tables: list[Finding],
    folder: Path,
    stated: Mapping[str, Any],
) -> dict[Path, Finding]:
    """Return path → movement of tables of one signal each: a folder with one movement, or the file
    of its measured angles. The words of the signals are the ``stated`` ones, else by the names.
    """
    groups = _tables_by_role(tables, stated)
    count = Counter(file.parent for file in groups)
    movements = {}
    for file, roles in groups.items():
        alone = count[file.parent] == 1 and file.parent != folder
        by_name = {table.file.name: table for table in roles.values()}
        movement = _movement(file.parent if alone else file, by_name)
        names = {role: table.file.name for role, table in roles.items()}
        movement.facts["words"] = names if alone else _differing_words(names)
        movements[movement.file] = movement
    return movements


def _tables_by_role(
    tables: list[Finding],
    stated: Mapping[str, Any],
) -> dict[Path, dict[str, Finding]]:
    """Return file of measured angles → role → table, of movements with commanded angles too."""
    by_file = {table.file: table for table in tables}
    groups: dict[Path, dict[str, Finding]] = defaultdict(dict)
    if "actual" in stated and "target" in stated:
        for table in tables:
            for role, file in _stated_roles(table.file, stated).items():
                if file in by_file:
                    groups[table.file][role] = by_file[file]
    else:
        for table in tables:
            if "role" in table.facts:
                movement = Path(table.facts["movement"])
                groups[movement][table.facts["role"]] = table
    paired = {file: roles for file, roles in groups.items() if {*ANGLES} <= {*roles}}
    if "actual" in stated and "target" in stated:
        for roles in paired.values():
            add_roles(roles, {})
    return paired


def _stated_roles(file: Path, stated: Mapping[str, Any]) -> dict[str, Path]:
    """Return role → file of the movement whose measured angles are in ``file``, by the ``stated``
    words in the files' names; empty for another file.
    """
    actual = stated["actual"]
    if actual not in file.name:
        return {}
    files = {}
    for role in (*ANGLES, "speed", "time"):
        word = stated.get(role)
        if isinstance(word, str):
            files[role] = file.with_name(file.name.replace(actual, word, 1))
    return files


def _differing_words(names: Mapping[str, str]) -> dict[str, str]:
    """Return role → the words in which the file ``names`` of a movement differ."""
    split = {role: SEPARATORS.split(name) for role, name in names.items()}
    lists = [*split.values()]
    shortest = min(len(parts) for parts in lists)
    before = _count_equal(lists, range(shortest))
    from_the_end = range(-1, before - shortest - 1, -1)
    after = _count_equal(lists, from_the_end)
    if shortest == before + after:  # q.csv beside q_target.csv
        before -= 1
    words = {}
    for role, parts in split.items():
        words[role] = "".join(parts[before : len(parts) - after])
    return words


def _count_equal(lists: Iterable[Sequence[str]], places: Iterable[int]) -> int:
    """Return at how many of the first ``places`` all ``lists`` have equal elements."""
    count = 0
    for place in places:
        if len({words[place] for words in lists}) > 1:
            break
        count += 1
    return count
