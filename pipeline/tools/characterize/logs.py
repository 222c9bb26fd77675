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
from pipeline.tools.inspect.finding import printable_path
from pipeline.tools.new_dataset.layout import PlacedTake, RecordingLayout, layout
from pipeline.tools.new_dataset.values import entries

SECTION = "joint_log."
UNSTATED = {"start": [], "end": [], "rest": 0, "tolerance": 1.0}  # keys of one motion


class FolderLogs(NamedTuple):
    """Logs of one arm in a folder, at ``rate`` (Hz)."""

    movements: dict[str, LoggedMovement]
    rate: float
    unused: dict[str, str]  # recording → reason
    suggested: dict[str, list[str]]  # suggestion that was taken → recordings


def folder_logs(
    folder: Path, assigned: Mapping[str, str], only: Path | None = None
) -> FolderLogs:
    """Return the logs in ``folder`` of the arm with the most rows; ``only`` one log of them.
    ``assigned`` values (key such as joint_log.clock → YAML) replace what a file states.
    """
    recorded = layout(inspect(only or folder), folder)
    read: dict[str, tuple[LoggedMovement, float]] = {}
    taken: dict[str, dict[str, str]] = {}
    unused = {}
    for take in recorded.of("joint_log"):
        try:
            values, suggested = _values(recorded, take, folder, assigned)
            read[take.name] = _read(take, values)
            taken[take.name] = suggested
        except PipelineError as error:
            unused[take.name] = str(error)
    unused |= {
        printable_path(
            one.file, folder
        ): "no log of joints with measured and commanded angles"
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
            unused[name] = (
                f"a log of another arm: {', '.join(one.joints)}, not {', '.join(joints)}"
            )
        elif own != rate:
            unused[name] = (
                f"recorded at {own:g}/s, most rows at {rate:g}/s; resample the log"
            )
    movements = {name: one for name, (one, _) in read.items() if name not in unused}
    notes: dict[str, str] = {}  # suggestion → its reason in the first log
    for name in taken:
        notes = taken[name] | notes
    suggested = {
        f"{w} ({notes[w]})": [n for n in movements if w in taken[n]] for w in notes
    }
    return FolderLogs(
        movements, rate, unused, {w: of for w, of in suggested.items() if of}
    )


def _values(
    recorded: RecordingLayout,
    take: PlacedTake,
    folder: Path,
    assigned: Mapping[str, str],
) -> tuple[dict[str, Any], dict[str, str]]:
    """Return key → value of the log ``take`` alone, and suggestion → reason of guessed values."""
    if stops := [stop for log in take.files for stop in log.stops]:
        raise ConfigError(stops[0], file=take.path)
    first, values = take.files[0].facts, {}
    if take.finding.facts is first:
        count = first.get("joints") or len(first.get("signals", {}).get("actual", ()))
    else:  # the first of several tables
        count = first["columns"] - bool(first["timed"])
    while True:  # repeat, since the rate depends on the unit of the times
        taken, found = {}, {key: parse_yaml(text) for key, text in assigned.items()}
        nested = {
            "joint_log": {key[len(SECTION) :]: one for key, one in values.items()}
        }
        for key, entry in entries(
            "", recorded._replace(takes=[take]), folder, nested
        ).items():
            log_key = key.startswith(SECTION) or key == "motion.rate"
            if log_key and key not in found and entry.text:
                found[key] = parse_yaml(entry.text)
                if not entry.certain and entry.note:
                    taken[f"{key}: {entry.value}"] = entry.note
        if found.get("joint_log.joints") is None:
            found["joint_log.joints"] = [f"joint_{n}" for n in range(1, count + 1)]
        if found == values:
            if isinstance(found.get("joint_log.signals"), str):  # advice, not a value
                raise ConfigError(
                    "; ".join(map(str, take.finding.open)), file=take.path
                )
            return values, taken
        values = found


def _read(take: PlacedTake, values: Mapping[str, Any]) -> tuple[LoggedMovement, float]:
    log = {
        k[len(SECTION) :]: v for k, v in values.items() if k.startswith(SECTION)
    } | UNSTATED
    options = validated(
        JointLogSection, log | {"movements": take.path.name}, "joint_log"
    )
    rate = values.get("motion.rate")
    if not isinstance(rate, int | float):
        asked = (
            ""
            if "joint_log.signals" in values
            else "; ".join(map(str, take.finding.open))
        )
        raise ConfigError(asked or "the log states no times; --set motion.rate=HZ")
    return read_logged_movement(take.name, take.path, options, float(rate)), float(rate)
