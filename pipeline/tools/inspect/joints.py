"""Findings of joint logs and tables of numbers: columns, units, clock, tracking error."""

from collections.abc import Sequence
from math import comb
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.core.angles import TURN, unwrap, whole_turns
from pipeline.core.errors import PipelineError
from pipeline.formats.delimited import ANGLE_UNITS, TIME_UNITS, bare, spelled
from pipeline.formats.force.record import repeats
from pipeline.formats.format import Format, Kind
from pipeline.formats.joints.log import BAG, OPTION, LogOptions, read_joint_table
from pipeline.formats.joints.names import meaning, named_like, other_content, signals_of
from pipeline.recordings.commands import find_pairing, suspects, tracking_errors
from pipeline.recordings.movement import CLOCK_TOLERANCE, MOST_TURNS, UNWRAPPED, smoothness_by_rows
from pipeline.recordings.repetitions import commanded_speeds, excursions, lag
from pipeline.tools.inspect.finding import Finding

RATES = 5.0, 5000.0  # Hz, range of the rates of controllers' logs
ORDER = 6  # order of the differences that estimate noise
LEAST_NOISE = 1e-8  # rad, least estimate of the noise
ANGLES = ("actual", "target")  # signals to compare
LOG_OF_BOTH = f"{OPTION}.joints, .signals, .time, or dataset.force.log.columns with format table"
ONE_COLUMN = (
    "the table has one column: for one joint, set signals {actual: [0], …} and time null; for "
    "several joints, write the values of all joints at one time in one line"
)


def add_joint_log(finding: Finding, form: Format) -> None:
    """Add signals, joints and clock of a joint log to ``finding``."""
    record = form.read(finding.file, LogOptions())
    signals, time = record.signals, record.time
    finding.count(record.counts)
    width = max(values.shape[1] for values in signals.values())
    finding.facts |= {"samples": len(time), "signals": list(signals), "joints": width}
    if record.joints:
        finding.facts["joint_names"] = list(record.joints)
    if len(time) < 2:
        return
    # a bag's message defines its units
    known = ("s", "rad") if form.name == BAG.name else ()
    scales = _scales(finding, time, [*signals.values()], *known)
    time = time * scales[0]
    finding.duration = float(time[-1] - time[0])
    finding.rate = round((len(time) - 1) / finding.duration, 3)
    steps = np.diff(time)
    if len(steps) > 3 and (np.abs(steps * finding.rate - 1) > CLOCK_TOLERANCE).any():
        smoother = smoothness_by_rows(time, np.hstack([*signals.values()]), finding.rate)
        question = (
            f"the times jitter by {1e3 * float(steps.std()):.3g} ms; over evenly spaced rows the "
            f"angles are {smoother:.3g} times as smooth as over the times"
        )
        finding.ask(question, f"{OPTION}.clock", "rows" if smoother > 1 else "times")
    if {*ANGLES} <= {*signals}:
        angles = [signals[name] * scales[1] for name in ANGLES]
        _add_tracking(finding, time, angles, record.joints)


def add_table(finding: Finding, form: Format) -> None:
    """Add size, columns, clock and joint angles of a table of numbers to ``finding``."""
    sheet = form.read(finding.file, key=f"{OPTION}.separator, .decimal (or dataset.force.log)")
    facts, labels = finding.facts, sheet.labels
    cells = pd.DataFrame(sheet.values(sheet.numeric, gaps=True)).dropna(how="all")
    missing, filled = int(cells.isna().sum(axis=None)), cells.interpolate(limit_direction="both")
    finding.count({"missing_cells": missing})
    values = dict(zip(sheet.numeric, filled.to_numpy().T, strict=True))
    finding.version = sheet.origin
    facts |= {"rows": len(sheet.rows), "columns": sheet.width}
    facts |= {"separator": sheet.separator, "decimal": sheet.decimal}
    counts = {"rows_without_numbers": len(sheet.rows) - len(cells)}
    finding.count(sheet.counts | repeats(cells.to_numpy()) | counts)
    if sheet.left_out:
        facts["columns_without_numbers"] = sheet.left_out
    # rows may share a time if the table merges two sources
    later = np.greater_equal if missing else np.greater
    steps = {n: np.diff(column) for n, column in values.items() if len(column) > 2}
    clocks = [n for n, step in steps.items() if later(step, 0).all() and step.any()]
    facts["timed"] = 0 in clocks
    if labels:
        facts["labels"] = labels
        units = {bare(label): sheet.unit(n) for n, label in enumerate(labels)}
        finding.units = {label: unit for label, unit in units.items() if unit}
        clocks = [n for n in clocks if named_like("time", [labels[n]])] or [0] * facts["timed"]
        if clocks:
            facts["time"] = labels[clocks[0]]
    time = values[clocks[0]] if clocks and (labels or facts["timed"]) else None
    if time is not None:
        facts["step_of_time"] = round(float(np.median(steps[clocks[0]])), 9)
        second = TIME_UNITS.get(spelled(sheet.unit(clocks[0]) or ""))
        if second and facts["step_of_time"]:
            finding.rate = round(1 / (facts["step_of_time"] * second), 3)
    columns = {labels[n]: column for n, column in values.items()} if labels else {}
    signals: dict[str, list[str]] = {}
    if len(columns) == len(values):  # labels are unique
        signals, guesses = signals_of([*columns], time, columns.__getitem__)
        if certain := {name: own for name, own in signals.items() if name not in guesses}:
            facts["signals"] = certain
        if guesses:
            named = ", ".join(f"{name}: [{', '.join(own)}]" for name, own in signals.items())
            question = f"no label states the signal: {'; '.join(guesses.values())}"
            finding.ask(question, f"{OPTION}.signals", f"{{{named}}}")
    other = other_content(labels, [sheet.unit(n) for n in range(len(labels))])
    if other and not signals:
        finding.version = f"of {other}"
    elif sheet.width == 1:
        finding.ask(ONE_COLUMN, f"{OPTION}.signals")
    elif {*ANGLES} - {*facts.get("signals", ())}:
        question = "the content of the columns is not stated: a log of joints, or of forces"
        finding.ask(question, LOG_OF_BOTH)
    if {*ANGLES} <= {*signals} and time is not None:
        named = [[labels.index(name) for name in signals[role]] for role in ANGLES]
        samples = sheet.samples([clocks[0], *named[0], *named[1]], clocks[0], named[0])
        finding.count(samples.counts)
        time, *angles = np.split(samples.values, [1, 1 + len(named[0])], axis=1)
        time = time[:, 0]
        facts["step_of_time"] = round(float(np.median(np.diff(time))), 9)
        unit = sheet.unit(labels.index(signals["actual"][0])) or sheet.angle_unit
        scales = _scales(finding, time, angles, sheet.unit(clocks[0]), unit)
        angles = [values * scales[1] for values in angles]
        _add_tracking(finding, time * scales[0], angles, signals["actual"])


def compare_tables(findings: Sequence[Finding]) -> None:
    """Add the ``role`` of each folder's tables by their names, and compare target and actual."""
    folders: dict[Path, dict[str, Finding]] = {}
    for finding in findings:
        if finding.kind == Kind.TABLE and finding.facts.get("timed"):
            folders.setdefault(finding.file.parent, {})[finding.file.stem] = finding
    for tables in folders.values():
        named = {role: named_like(role, tables) for role in ANGLES}
        if [*map(len, named.values())] != [1, 1]:
            continue
        means = {name: meaning(name) for name in tables if meaning(name).role == "target"}
        named["speed"] = [name for name, each in means.items() if each.quantity == "velocity"]
        roles = {role: tables[names[0]] for role, names in named.items() if len(names) == 1}
        for role, one in roles.items():
            one.facts["role"] = role
            one.open = [each for each in one.open if each.option != LOG_OF_BOTH]
        finding = roles["target"]
        options = LogOptions(joints=finding.facts["columns"] - 1, signals={"angles": None})
        try:
            logs = [read_joint_table(roles[role].file, options) for role in ANGLES]
        except PipelineError:
            continue  # no joint log; the table's finding has the reason
        if (length := min(len(log.time) for log in logs)) > 2:
            time, angles = logs[0].time[:length], [log.signals["angles"][:length] for log in logs]
            scales = _scales(finding, time, angles)
            _add_tracking(finding, time * scales[0], [values * scales[1] for values in angles])


def _scales(
    finding: Finding, time: np.ndarray, angles: Sequence[np.ndarray], *stated: str | None
) -> tuple[float, float]:
    """Return s and rad per unit of times and angles; add questions for units not ``stated``."""
    clock, angle = (spelled(unit or "") for unit in stated or ("", ""))
    if clock not in TIME_UNITS:
        step = float(np.median(np.diff(time)))
        fits = [n for n, s in TIME_UNITS.items() if RATES[0] <= 1 / (step * s) <= RATES[1]]
        clock = (fits or ["s"])[0]
        question = f"the unit of the times is not stated; they step by {step:g}"
        finding.ask(question, f"{OPTION}.time_unit", clock)
    if angle not in ANGLE_UNITS:
        greatest = max(float(np.abs(values).max()) for values in angles)
        angle = "deg" if greatest > MOST_TURNS * TURN else "rad"
        question = f"the unit of the angles is not stated; the greatest is {greatest:.4g}"
        finding.ask(question, f"{OPTION}.angle_unit", angle)
    return TIME_UNITS[clock], ANGLE_UNITS[angle]


def _add_tracking(
    finding: Finding, time: np.ndarray, angles: Sequence[np.ndarray], joints: Sequence[str] = ()
) -> None:
    """Add the tracking error of ``angles`` (measured and commanded, (N, joints) in rad at ``time``
    (N,) s), the command's motions, and options for which the signals agree.
    """
    (actual, target), time = angles, time - time[0]
    try:
        actual, removed = unwrap(actual, time, joints, signal="actual")
        target, more = unwrap(target, time, joints, signal="target")
    except PipelineError as error:
        finding.stops.append(error.message)
        return
    finding.count({UNWRAPPED: removed + more})
    actual = actual + TURN * whole_turns(target, actual)
    rate = float(f"{(len(time) - 1) / time[-1]:.4g}")  # nominal rate
    pairing = find_pairing(actual, target, rate)
    for quantity, option, value, without in suspects(pairing, actual, target, rate):
        question = f"the command differs from the measured angles by its {quantity}: without this "
        finding.ask(f"{question}option the error is {without:.2g} of the motion", option, value)
    actual, target = pairing.apply(actual, target)
    missing, late = float(tracking_errors(actual, target).max()), lag(target, actual, rate)
    finding.facts["command"] = (
        f"tracking error {missing:.2g} of the motion (0.9 quantile), lag {1e3 * late:.2g} ms"
        if np.isfinite(late)
        else f"at rest, tracking error {np.abs(actual - target).max():.2g} rad"
    )
    lacks = [run.lack(len(target)) for run in excursions(target, commanded_speeds(target, rate))]
    finding.facts["motions"] = f"{lacks.count('')} whole"
    finding.count({"motions_cut_off": sum("cut off" in lack for lack in lacks)})
    if any("never rests" in lack for lack in lacks):
        question = "the command never rests: motions have no rest before and after"
        finding.ask(question, f"{OPTION}.rest", "0")
        if len(actual) > ORDER:  # noise in rad, from differences of order ORDER
            power = np.mean(np.diff(actual, ORDER, axis=0) ** 2, axis=0).max()
            noise = max(float(np.sqrt(power / comb(2 * ORDER, ORDER))), LEAST_NOISE)
            question = "no row at rest shows the noise of a measured angle"
            finding.ask(question, "dataset.motion.pose_noise", f"{noise:.1e}")
