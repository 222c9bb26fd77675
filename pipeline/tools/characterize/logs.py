"""Joint logs in a folder, each read by what its own file states or suggests."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from pipeline.core.errors import ConfigError, PipelineError
from pipeline.core.options.dataset import JointLogSection
from pipeline.core.typed_yaml import parse_yaml
from pipeline.core.validation import validated
from pipeline.formats.format import Kind
from pipeline.recordings.movement import LoggedMovement, read_logged_movement
from pipeline.tools.inspect.command import inspect
from pipeline.tools.inspect.finding import Finding, printable_path
from pipeline.tools.new_dataset.layout import Group, RecordingLayout, layout, logs_of
from pipeline.tools.new_dataset.values import entries

SECTION = "joint_log."
UNSTATED = {"start": [], "end": [], "rest": 0, "tolerance": 1.0}  # keys of one motion


class FolderLogs(NamedTuple):
    """Logs of one arm in a folder, at ``rate`` (Hz)."""

    movements: dict[str, LoggedMovement]
    rate: float
    unused: dict[str, str]  # recording → reason
    suggested: dict[str, list[str]]  # suggestion that was taken → recordings


def folder_logs(folder: Path, assigned: Mapping[str, str], only: Path | None = None) -> FolderLogs:
    """Return the logs in ``folder`` of the arm with the most rows; ``only`` one log of them.
    ``assigned`` values (key such as joint_log.clock → YAML) replace what a file states.
    """
    recorded = layout(inspect(only or folder), folder)
    read: dict[str, tuple[LoggedMovement, float]] = {}
    unused, suggested = {}, {}
    for group in recorded.groups["joint_log"]:
        for path, take in group.takes.items():
            name = next(name for name, one in group.named.items() if one is take)
            try:
                values, taken = _values(recorded, group, path, take, folder, assigned)
                read[name] = _read(name, path, values)
            except PipelineError as error:
                unused[name] = str(error)
                continue
            for words, note in taken.items():
                known = next((w for w in suggested if w.startswith(f"{words} (")), None)
                suggested.setdefault(known or f"{words} ({note})", []).append(name)
    unused |= {
        printable_path(one.file, folder): "no log of joints with measured and commanded angles"
        for one in recorded.unplaced
        if one.kind in (Kind.JOINTS, Kind.TABLE)
    }
    if not read:
        return FolderLogs({}, 0.0, unused, {})
    rows = Counter()
    for one, rate in read.values():
        rows[(*one.joints,), rate] += len(one.actual)
    (joints, rate), _ = rows.most_common(1)[0]
    for name, (one, own) in read.items():
        if (*one.joints,) != joints:
            unused[name] = f"a log of another arm: {', '.join(one.joints)}, not {', '.join(joints)}"
        elif own != rate:
            unused[name] = f"recorded at {own:g}/s, most rows at {rate:g}/s; resample the log"
    movements = {name: one for name, (one, _) in read.items() if name not in unused}
    suggested = {words: [n for n in of if n in movements] for words, of in suggested.items()}
    return FolderLogs(movements, rate, unused, {w: of for w, of in suggested.items() if of})


def _values(
    recorded: RecordingLayout,
    group: Group,
    path: Path,
    take: Finding,
    folder: Path,
    assigned: Mapping[str, str],
) -> tuple[dict[str, Any], dict[str, str]]:
    """Return key → value of the log ``take`` alone, and suggestion → reason of guessed values."""
    stops = [stop for log in logs_of([take]) for stop in log.stops]
    if stops:
        raise ConfigError(stops[0], file=path)
    alone = Group(group.pattern, {path: take}, {path.name: take})
    empty = {key: [] for key in recorded.groups} | {"joint_log": [alone]}
    own = recorded._replace(groups=empty)
    values: dict[str, Any] = {}
    while True:  # repeat, since the rate depends on the unit of the times
        taken, found = {}, {key: parse_yaml(text) for key, text in assigned.items()}
        nested = {"joint_log": {key[len(SECTION) :]: one for key, one in values.items()}}
        for key, entry in entries("", own, folder, nested).items():
            if key in found or not (key.startswith(SECTION) or key == "motion.rate"):
                continue
            if isinstance(entry.value, str) and entry.value:
                found[key] = parse_yaml(entry.value)
                if not entry.certain and entry.note:
                    taken[f"{key}: {entry.value}"] = entry.note
        if found.get("joint_log.joints") is None:
            found["joint_log.joints"] = [f"joint_{n}" for n in range(1, _joint_count(take) + 1)]
        if found == values:
            return values, taken
        values = found


def _joint_count(take: Finding) -> int:
    facts = take.facts
    if tables := facts.get("tables"):
        one = next(iter(tables.values())).facts
        return one["columns"] - bool(one["timed"])
    signals = facts.get("signals", {})
    return facts.get("joints") or len(signals.get("actual", ()))


def _read(name: str, path: Path, values: Mapping[str, Any]) -> tuple[LoggedMovement, float]:
    log = {k[len(SECTION) :]: v for k, v in values.items() if k.startswith(SECTION)} | UNSTATED
    options = validated(JointLogSection, log | {"movements": path.name}, "joint_log")
    rate = values.get("motion.rate")
    if not isinstance(rate, int | float):
        raise ConfigError("the log states no times; --set motion.rate=HZ", key="motion.rate")
    return read_logged_movement(name, path, options, float(rate)), float(rate)
