"""Joint logs in a folder, each read by what its own file states or suggests."""

from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from pipeline.core.errors import ConfigError, PipelineError
from pipeline.core.options.dataset import JointLogSection
from pipeline.core.typed_yaml import parse_yaml
from pipeline.core.validation import validated
from pipeline.formats import joints as joint_formats
from pipeline.formats.format import Kind, format_of, formats_in
from pipeline.formats.joints import names as meanings
from pipeline.formats.joints.log import LogOptions
from pipeline.recordings.movement import LoggedMovement, read_logged_movement
from pipeline.tools.inspect.command import inspect
from pipeline.tools.inspect.finding import UNKNOWN, Finding, printable_path
from pipeline.tools.new_dataset.layout import PlacedTake, RecordingLayout, layout
from pipeline.tools.new_dataset.template import list_of_names, text_of
from pipeline.tools.new_dataset.values import entries

SECTION = "joint_log."
UNSTATED = {"start": [], "end": [], "rest": 0, "tolerance": 1.0}  # keys of one motion


class FolderLogs(NamedTuple):
    """Logs of one arm in a folder, at ``rate`` (Hz)."""

    movements: dict[str, LoggedMovement]
    rate: float
    unused: dict[str, str]  # recording → reason
    suggested: dict[str, list[str]]  # suggestion that was taken → recordings
    clocks: list[str]  # columns, arrays or files of the times, or "even rows"
    resampled: dict[
        str,
        str,
    ]  # recording of uneven rows → their distances and their number
    missing: dict[str, str]  # without a log: key that no file states → value to correct


def folder_logs(
    folder: Path,
    assigned: Mapping[str, str],
    only: Path | None = None,
) -> FolderLogs:
    """Return the logs in ``folder`` of the arm with the most rows; ``only`` one log of them, a file
    or the folder of a movement. ``assigned`` values (key such as joint_log.clock → YAML) replace
    what a file states.
    """
    recorded = _recorded_logs(folder, assigned, only)
    read: dict[str, ReadLog] = {}
    unused: dict[str, str] = {}
    for take in _takes_of_recordings(recorded):
        try:
            read[take.name] = _read_log(recorded, take, folder, assigned)
        except PipelineError as error:
            unused[take.name] = str(error)
    for finding in recorded.unplaced:
        if finding.kind in (Kind.JOINTS, Kind.TABLE):
            unused[printable_path(finding.file, folder)] = _reason_unplaced(finding)
    if not read and not unused:
        unknown = [log for log in recorded.unplaced if log.kind == UNKNOWN]
        for finding in unknown:
            unused[printable_path(finding.file, folder)] = _reason_unplaced(finding)
    if not read:
        missing = missing_values(recorded, assigned)
        return FolderLogs({}, 0.0, unused, {}, [], {}, missing)
    joints, rate = _usual_arm(read)
    for take in _takes_of_recordings(recorded):
        name = take.name
        if name not in read or read[name].rate == rate:
            continue
        # a clock that jitters has another median rate in each log
        with suppress(PipelineError):
            at_rate = assigned | {"motion.rate": f"{rate!r}"}
            read[name] = _read_log(recorded, take, folder, at_rate)
    for name, log in read.items():
        if log.joints != joints:
            arms = f"{', '.join(log.joints)}, not {', '.join(joints)}"
            unused[name] = f"a log of another arm: {arms}"
        elif log.rate != rate:
            rates = f"recorded at {log.rate:g}/s, most rows at {rate:g}/s"
            unused[name] = f"{rates}; resample the log"
    used = {name: log for name, log in read.items() if name not in unused}
    return FolderLogs(
        movements={name: log.movement for name, log in used.items()},
        rate=rate,
        unused=unused,
        suggested=_recordings_by_suggestion(used),
        clocks=list(dict.fromkeys(log.clock for log in used.values())),
        resampled={name: log.resampled for name, log in used.items() if log.resampled},
        missing={},
    )


def _takes_of_recordings(recorded: RecordingLayout) -> list[PlacedTake]:
    """Return the joint logs of the layout, a file of several recordings once for each, with the
    number of the recording (from 1) behind the name.
    """
    takes = []
    for take in recorded.of("joint_log"):
        count = take.finding.facts.get("recordings", 1)
        if count == 1:
            takes.append(take)
            continue
        for number in range(count):
            facts = take.finding.facts | {"recording": number}
            finding = replace(take.finding, facts=facts)
            name = f"{take.name}_{number + 1}"
            takes.append(take._replace(name=name, finding=finding))
    return takes


class ReadLog(NamedTuple):
    """A log and how it was read."""

    movement: LoggedMovement
    rate: float  # Hz
    suggested: dict[str, str]  # suggestion that was taken → its reason
    clock: str  # column, array or file of the times, in words
    resampled: (
        str  # distances of uneven rows and number of resampled rows; "" for even rows
    )

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(self.movement.joints)


def _read_log(
    recorded: RecordingLayout,
    take: PlacedTake,
    folder: Path,
    assigned: Mapping[str, str],
) -> ReadLog:
    """Read a log of the layout by what it states and by the ``assigned`` values."""
    values, suggested = _values(recorded, take, folder, assigned)
    rate = values.get("motion.rate")
    if not isinstance(rate, int | float):
        questions = "; ".join(map(str, take.finding.open))
        if "joint_log.signals" in values or not questions:
            questions = "the log states no times; --set motion.rate=HZ"
        raise ConfigError(questions)
    section = _log_values(values) | UNSTATED | {"movements": take.path.name}
    options = validated(JointLogSection, section, "joint_log")
    recording = take.finding.facts.get("recording")
    movement = read_logged_movement(
        take.name,
        take.path,
        options,
        float(rate),
        recording=recording,
    )
    clock = _clock_of(take, values)
    resampled = _resampling_of(take, movement, float(rate))
    return ReadLog(movement, float(rate), suggested, clock, resampled)


def _resampling_of(take: PlacedTake, movement: LoggedMovement, rate: float) -> str:
    """Return the distances of the uneven rows of a ``take`` and the number of resampled rows at
    ``rate`` (Hz), as text; "" for rows that were not resampled.
    """
    rows = movement.counts.get("resampled_rows")
    if not rows:
        return ""
    distances = take.finding.facts.get("row_distance", "unevenly")
    return f"rows {distances} apart, resampled to {1e3 / rate:.4g} ms; {rows} rows"


def _usual_arm(read: Mapping[str, ReadLog]) -> tuple[tuple[str, ...], float]:
    """Return the joints and the rate in Hz of the most rows."""
    rows = Counter()
    for log in read.values():
        rows[log.joints, log.rate] += len(log.movement.actual)
    return max(rows, key=lambda arm: rows[arm])


def _recorded_logs(
    folder: Path,
    assigned: Mapping[str, str],
    only: Path | None,
) -> RecordingLayout:
    """Return the layout of the ``folder``, or of ``only`` one file or movement in it."""
    stated = {}
    for key, text in assigned.items():
        if key.startswith(SECTION):
            stated[key.removeprefix(SECTION)] = parse_yaml(text)
    recorded = layout(inspect(only or folder), folder, stated)
    if only is None or recorded.of("joint_log"):
        return recorded
    # a table of one signal is read with the tables beside it
    beside = layout(inspect(folder), folder, stated)
    takes = [
        take
        for take in beside.of("joint_log")
        if only in (take.path, *(log.file for log in take.files))
    ]
    return recorded._replace(takes=takes) if takes else recorded


def _reason_unplaced(finding: Finding) -> str:
    """Return why a table or file of arrays is no log of measured and commanded angles."""
    if finding.stops:
        return finding.stops[0]
    if "reason" in finding.facts:
        return str(finding.facts["reason"])
    if "role" in finding.facts:
        return "a table beside another log of the same angles"
    measured = finding.facts.get("signals", {})
    if "actual" in measured:
        return "no commanded angles beside the measured ones"
    if "target" in measured:
        return "no measured angles beside the commanded ones"
    return "no log of joints with measured and commanded angles"


def missing_values(
    recorded: RecordingLayout,
    assigned: Mapping[str, str],
) -> dict[str, str]:
    """Return key → value to correct, of the first log that states no signals or no times; empty
    without such a log.
    """
    logs = [take.finding for take in recorded.of("joint_log")] + recorded.unplaced
    for log in logs:
        if log.stops or log.kind not in (Kind.TABLE, Kind.JOINTS):
            continue
        missing = _missing_of(log)
        missing = {key: text for key, text in missing.items() if key not in assigned}
        if missing:
            return missing
    return {}


def _missing_of(log: Finding) -> dict[str, str]:
    """Return key → value to correct, of the signals and times that a ``log`` does not state."""
    missing: dict[str, str] = {}
    clock = log.facts.get("time")
    options = [question.option for question in log.open]
    if any("joint_log" in option and "signals" in option for option in options):
        if log.facts.get("timed"):
            clock = 0
        missing["joint_log.signals"] = _proposed_signals(log, clock)
        if log.kind == Kind.TABLE:
            missing["joint_log.time"] = "null" if clock is None else str(clock)
    if log.kind == Kind.TABLE and clock is None:
        missing["motion.rate"] = "HZ"
    if "counts_per_turn" in log.facts:
        missing["joint_log.angle_unit"] = (
            f"turn/{max(log.facts['counts_per_turn'], 1024)}"
        )
    return missing


def _proposed_signals(log: Finding, clock: int | str | None) -> str:
    """Return the signals of a ``log`` as YAML: suggested ones, the first pair of groups with equal
    names but for the role, halves, or words to replace.
    """
    if "signals" in log.suggested:
        return log.suggested["signals"]
    for actual, target in meanings.paired_columns(log.facts.get("labels", ())):
        return (
            f"{{actual: [{list_of_names(actual)}], target: [{list_of_names(target)}]}}"
        )
    labels = log.facts.get("labels") or range(log.facts.get("columns", 0))
    beside = [clock, *log.facts.get("row_numbers", ())]
    columns = [text_of(label) for label in labels if label not in beside]
    half, odd = divmod(len(columns), 2)
    if odd or not half:
        return "{actual: [COLUMN, …], target: [COLUMN, …]}"
    actual = ", ".join(columns[:half])
    target = ", ".join(columns[half:])
    return f"{{actual: [{actual}], target: [{target}]}}"


def _recordings_by_suggestion(used: Mapping[str, ReadLog]) -> dict[str, list[str]]:
    """Return suggestion with the reason in the first log → recordings that it was taken for."""
    recordings: dict[str, list[str]] = {}
    reasons: dict[str, str] = {}
    for name, log in used.items():
        for suggestion, reason in log.suggested.items():
            reasons.setdefault(suggestion, reason)
            words = f"{suggestion} ({reasons[suggestion]})"
            recordings.setdefault(words, [])
            recordings[words].append(name)
    return recordings


def _values(
    recorded: RecordingLayout,
    take: PlacedTake,
    folder: Path,
    assigned: Mapping[str, str],
) -> tuple[dict[str, Any], dict[str, str]]:
    """Return key → value of the log ``take``, and suggestion → reason of guessed values."""
    if stops := [stop for log in take.files for stop in log.stops]:
        raise ConfigError(stops[0], file=take.path)
    only = recorded._replace(takes=[take])
    before: dict[str, Any] = {}
    while True:  # repeat, since the rate depends on the unit of the times
        values = {key: parse_yaml(text) for key, text in assigned.items()}
        suggested = {}
        nested = {"joint_log": _log_values(before)}
        for key, entry in entries("", only, folder, nested).items():
            if key in values or not entry.text:
                continue
            if key.startswith(SECTION) or key == "motion.rate":
                values[key] = parse_yaml(entry.text)
                if entry.note and not entry.certain:
                    suggested[f"{key}: {entry.value}"] = entry.note
        if isinstance(values.get("joint_log.signals"), str):  # advice, not a value
            raise ConfigError("; ".join(map(str, take.finding.open)), file=take.path)
        if values.get("joint_log.joints") is None:
            count = _count_joints(take, _log_values(values))
            values["joint_log.joints"] = [f"joint_{n}" for n in range(1, count + 1)]
        if values == before:
            return values, suggested
        before = values


def _log_values(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the ``values`` of the section joint_log by their last words."""
    return {
        key.removeprefix(SECTION): value
        for key, value in values.items()
        if key.startswith(SECTION)
    }


def _clock_of(take: PlacedTake, values: Mapping[str, Any]) -> str:
    """Return the clock of a ``take`` with these ``values``, in words."""
    time = values.get("joint_log.time", 0)
    if take.finding.kind == Kind.JOINTS and time == 0:
        return f"the times {take.finding.facts.get('time', 'of the messages')}"
    if time is None:
        return "motion.rate, for even rows"
    return (
        f"the times in column {time}" if isinstance(time, int) else f"the times {time}"
    )


def _count_joints(take: PlacedTake, log: Mapping[str, Any]) -> int:
    """Return the number of joints of a ``take`` with the values ``log`` of its section."""
    signals = log.get("signals") or {}
    facts = take.finding.facts
    columns = signals.get("actual", ())
    tables = facts.get("tables")
    if tables and not columns:
        clock = log.get("time") == 0  # a column of each table
        return _target_table(tables).facts["columns"] - int(clock)
    if take.finding.kind == Kind.TABLE:
        return len(columns)
    if "joints" in facts and not signals:
        return int(facts["joints"])
    form = format_of(take.path, formats_in(joint_formats, Kind.JOINTS))
    time = log.get("time", LogOptions.time)
    options = LogOptions(time=time, rate=1.0, signals=signals, guess=True)
    read = form.read(take.path, options)
    return int(read.signals["actual"].shape[1])


def _target_table(tables: Mapping[str, Finding]) -> Finding:
    """Return the table of commanded angles of a movement, else its first table."""
    for table in tables.values():
        if table.facts.get("role") == "target":
            return table
    return next(iter(tables.values()))
