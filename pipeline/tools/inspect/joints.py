"""Account of joint logs and tables of numbers: columns, units and clock, and whether the measured
and the commanded angles are a pair.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import comb
from pathlib import Path

import numpy as np

from pipeline.core.angles import TURN, unwrapped, whole_turns
from pipeline.core.errors import PipelineError
from pipeline.formats.force.record import repeats
from pipeline.formats.format import Format, Kind
from pipeline.formats.joints import bag
from pipeline.formats.joints.log import OPTION, JointLog, LogOptions
from pipeline.formats.joints.names import meaning, named_like, signals_of
from pipeline.formats.joints.table import read_joint_table
from pipeline.formats.number_sheet import Sheet
from pipeline.formats.units import ANGLE_UNITS, TIME_UNITS, bare, spelled
from pipeline.recordings.movement import (
    CLOCK_TOLERANCE,
    MOST_TURNS,
    UNWRAPPED,
    smoothness_by_rows,
)
from pipeline.recordings.pairing import missed, pairing_of, suspects
from pipeline.recordings.repetitions import commanded_speeds, excursions, lag
from pipeline.tools.inspect.finding import Finding

RATES = 5.0, 5000.0  # 1/s, between which controllers log
ORDER = 6  # of the differences that show noise
LEAST_NOISE = 1e-8  # rad, where they show none
ANGLES, SPEED = ("actual", "target"), ("target", "velocity")  # role and quantity of a name


def joint_log(finding: Finding, form: Format) -> None:
    """Add signals, joints and clock of a log of the joints."""
    record: JointLog = form.read(finding.file, LogOptions())
    signals, time = record.signals, record.time
    finding.count(record.counts)
    width = max(values.shape[1] for values in signals.values())
    finding.facts |= {"samples": len(time), "signals": list(signals), "joints": width}
    if record.joints:
        finding.facts["joint_names"] = list(record.joints)
    stated = form.name == bag.FORMAT.name  # rad and s by the definition of the message
    if not stated and len(time) > 1:
        step = float(np.median(np.diff(time)))
        unit = time_unit(step) or "s"
        question = f"the unit of the times is not stated; they step by {step:g}"
        finding.ask(question, f"{OPTION}.time_unit", unit)
        time = time * TIME_UNITS[unit]
    finding.duration = float(time[-1] - time[0])
    if finding.duration:
        finding.rate = round((len(time) - 1) / finding.duration, 3)
    steps = np.diff(time)
    if len(steps) > 3 and (np.abs(steps * finding.rate - 1) > CLOCK_TOLERANCE).any():
        smoother = smoothness_by_rows(time, np.hstack([*signals.values()]), finding.rate)
        question = (
            f"the times jitter by {1e3 * float(steps.std()):.3g} ms, and row by row the angles are "
            f"{smoother:.3g} times as smooth as over the times"
        )
        finding.ask(question, f"{OPTION}.clock", "rows" if smoother > 1 else "times")
    unit = "rad"
    if not stated:
        greatest = max(float(np.abs(values).max()) for values in signals.values())
        unit = unit_of_angles(greatest)
        question = f"the unit of the angles is not stated; the greatest is {greatest:.4g}"
        finding.ask(question, f"{OPTION}.angle_unit", unit)
    if {*ANGLES} <= {*signals} and finding.duration:
        angles = [signals[name] for name in ANGLES]
        _compare(finding, time, *angles, record.joints, (unit, "s"))


def table(finding: Finding, form: Format) -> None:
    """Add size, columns and clock of a table of numbers, and the columns of joint angles."""
    key = f"{OPTION}.separator, .decimal (or dataset.force.log)"
    sheet: Sheet = form.read(finding.file, key=key)
    values = dict(zip(sheet.numeric, sheet.values(sheet.numeric).T, strict=True))
    if any(line.strip(" ,;\t") == "endheader" for line in sheet.header):
        finding.version = "of OpenSim (MOT, STO)"
    finding.facts |= {"rows": len(sheet.rows), "columns": sheet.width}
    finding.facts |= {"separator": sheet.separator, "decimal": sheet.decimal}
    finding.count(sheet.counts | repeats(np.column_stack([*values.values()])))
    if sheet.left_out:
        finding.facts["columns_without_numbers"] = sheet.left_out
    clock = [n for n, held in values.items() if len(held) > 2 and (np.diff(held) > 0).all()]
    finding.facts["increasing_columns"] = clock
    if finding.timed:
        finding.facts["step_of_time"] = round(float(np.median(np.diff(values[0]))), 9)
        others = [np.abs(held).max() for column, held in values.items() if column]
        finding.facts["greatest"] = float(max(others, default=0.0))
    if sheet.labels:
        _labelled(finding, sheet, values, clock)
    if sheet.width == 1:
        question = (
            "one number a line is one column: it is one joint's, read with signals {actual: [0], …}"
            " and time null; else write the numbers of one time in one line"
        )
        finding.ask(question, f"{OPTION}.signals")
    elif {*ANGLES} - {*finding.facts.get("signals", ())}:
        keys = f"{OPTION}.joints, .signals, .time, or dataset.force.log.columns with format table"
        finding.ask("what the columns hold is not stated: a log of joints, or of forces", keys)


def _labelled(
    finding: Finding, sheet: Sheet, values: dict[int, np.ndarray], clock: list[int]
) -> None:
    labels = finding.facts["labels"] = sheet.labels
    units = {bare(label): sheet.unit(n) for n, label in enumerate(labels)}
    finding.units = {label: unit for label, unit in units.items() if unit}
    timed = [n for n in clock if named_like("time", [labels[n]])] or [n for n in clock if n == 0]
    if timed:
        finding.facts["time"] = labels[timed[0]]
        finding.facts["step_of_time"] = round(float(np.median(np.diff(values[timed[0]]))), 9)
    columns = {labels[n]: held for n, held in values.items()}
    if len(columns) < len(values):
        return  # two columns have one label: numbers name them
    time = values[timed[0]] if timed else None
    signals, guesses = signals_of([*columns], time, columns.__getitem__)
    if angles := [columns[label] for held in signals.values() for label in held]:
        finding.facts["greatest"] = float(np.abs(angles).max())
    if certain := {name: held for name, held in signals.items() if name not in guesses}:
        finding.facts["signals"] = certain
    if guesses:
        named = ", ".join(f"{name}: [{', '.join(held)}]" for name, held in signals.items())
        question = f"no label says it: {'; '.join(guesses.values())}"
        finding.ask(question, f"{OPTION}.signals", f"{{{named}}}")
    if {*ANGLES} <= {*signals} and timed:
        angles = [np.column_stack([columns[n] for n in signals[name]]) for name in ANGLES]
        stated = sheet.unit(labels.index(signals["actual"][0])) or sheet.angle_unit
        _compare(finding, time, *angles, signals["actual"], (stated, sheet.unit(timed[0])))


def time_unit(step: float) -> str | None:
    """Return the unit in which a ``step`` of the times is one of a controller's log."""
    units = ("s", "ms", "us", "ns")
    fits = (unit for unit in units if RATES[0] <= 1 / (step * TIME_UNITS[unit]) <= RATES[1])
    return next(fits, None)


def unit_of_angles(greatest: float) -> str:
    """Return deg where the ``greatest`` angle cannot be a joint's in rad."""
    return "deg" if greatest > MOST_TURNS * TURN else "rad"


def _compare(
    finding: Finding,
    time: np.ndarray,
    actual: np.ndarray,
    target: np.ndarray,
    joints: Sequence[str] = (),
    units: tuple[str | None, str | None] = (None, None),
) -> None:
    """Add how the measured angles ``actual`` follow the command ``target``, both (N, joints) at
    ``time`` (N,), the motions in the command, and the options that make them a pair; ``units`` of
    angles and time as the header states them.
    """
    unit, clock = (spelled(stated or "") for stated in units)
    clock = clock if clock in TIME_UNITS else time_unit(float(np.median(np.diff(time))))
    greatest = float(np.abs(actual).max())
    if unit not in ANGLE_UNITS and (unit := unit_of_angles(greatest)) == "deg":
        finding.ask(f"angles of {greatest:.4g} are no radians", f"{OPTION}.angle_unit", unit)
    if clock is None:
        return
    time = (time - time[0]) * TIME_UNITS[clock]
    actual, target = actual * ANGLE_UNITS[unit], target * ANGLE_UNITS[unit]
    try:
        actual, removed = unwrapped(actual, time, joints, signal="actual")
        target, more = unwrapped(target, time, joints, signal="target")
    except PipelineError as error:
        finding.stops.append(error.message)
        return
    finding.count({UNWRAPPED: removed + more})
    turns = whole_turns(target, actual)
    if turns.any():
        actual = actual + TURN * turns
        finding.facts["joints_moved_by_whole_turns"] = int(np.count_nonzero(turns))
    rate = float(f"{(len(time) - 1) / time[-1]:.4g}")  # as it was meant
    pairing = pairing_of(actual, target, rate)
    for what, option, value, without in suspects(pairing, actual, target, rate):
        question = f"the command differs from the measured angles by its {what}: without that, "
        finding.ask(f"{question}{without:.2g} of the motion is left", option, value)
    actual, target = pairing.apply(actual, target)
    missing, late = float(missed(actual, target).max()), lag(target, actual, rate)
    finding.facts["command"] = (
        f"missed by {missing:.2g} of the motion (0.9 quantile) and {1e3 * late:.2g} ms"
        if np.isfinite(late)
        else f"at rest, missed by {np.abs(actual - target).max():.2g} rad"
    )
    motions = excursions(target, commanded_speeds(target, rate))
    lacks = [run.lack(len(target)) for run in motions]
    finding.facts["motions"] = f"{lacks.count('')} whole"
    finding.count({"motions_cut_off": sum("cut off" in lack for lack in lacks)})
    if any("never rests" in lack for lack in lacks):
        question = "the command never rests: a motion is cut in passing"
        finding.ask(question, f"{OPTION}.rest", "0")
        if len(actual) > ORDER:  # noise in rad, by differences of the motion
            power = np.mean(np.diff(actual, ORDER, axis=0) ** 2, axis=0).max()
            noise = float(np.sqrt(power / comb(2 * ORDER, ORDER)))
            finding.facts["noise"] = max(noise, LEAST_NOISE)


def compare_tables(findings: Sequence[Finding]) -> None:
    """Note in the tables of each folder which one their names say holds the measured angles, the
    commanded ones (fact ``role``) and their speed, and compare the first two.
    """
    folders: dict[Path, dict[str, Finding]] = {}
    for finding in findings:
        if finding.kind == Kind.TABLE and finding.timed:
            folders.setdefault(finding.file.parent, {})[finding.file.stem] = finding
    for held in folders.values():
        named = {role: named_like(role, held) for role in ANGLES}
        if [*map(len, named.values())] != [1, 1]:
            continue
        meant = {name: meaning(name) for name in held}
        named["speed"] = [n for n, m in meant.items() if (m.role, m.quantity) == SPEED]
        tables = {role: held[names[0]] for role, names in named.items() if len(names) == 1}
        for role, one in tables.items():
            one.facts["role"] = role
        options = LogOptions(joints=tables["target"].facts["columns"] - 1, signals={"angles": None})
        try:
            logs = [read_joint_table(tables[role].file, options) for role in ANGLES]
        except PipelineError:
            continue  # a table of something else, whose own finding says why
        length = min(len(log.time) for log in logs)
        if length > 2:
            angles = [log.signals["angles"][:length] for log in logs]
            _compare(tables["target"], logs[0].time[:length], *angles)
