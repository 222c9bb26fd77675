"""Findings of joint logs and tables of numbers: columns, units, clock, tracking error."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import ceil, comb, log2
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.core.angles import MOST_TURNS, TURN, unwrap, whole_turns
from pipeline.core.errors import PipelineError, RecordingError
from pipeline.core.options.dataset import JointLogSection
from pipeline.formats.delimited import ANGLE_UNITS, TIME_UNITS, bare, spelled
from pipeline.formats.depth.frame_names import EPOCH
from pipeline.formats.depth.image import dropped_frames
from pipeline.formats.force.record import repeats
from pipeline.formats.format import Format, Kind
from pipeline.formats.joints import names as meanings
from pipeline.formats.joints.log import (
    BAG,
    OPTION,
    JointLog,
    LogOptions,
    log_of_sheet,
    names_in_cells,
    read_joint_table,
)
from pipeline.formats.number_sheet import Sheet
from pipeline.recordings import commands, movement
from pipeline.recordings.lags import lag
from pipeline.recordings.repetitions import excursions
from pipeline.tools.inspect.finding import Finding

RATES = 5.0, 5000.0  # Hz, range of the rates of controllers' logs
ORDER = 6  # order of the differences that estimate noise
LEAST_NOISE = 1e-8  # rad, least estimate of the noise
ANGLES = ("actual", "target")  # signals to compare


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
    bag = form.name == BAG.name
    record = _in_units(
        finding, record, bag or record.time_unit, bag or record.angle_unit
    )
    time = record.time
    finding.timed(time)
    steps = np.diff(time)
    if (
        len(steps) > 3
        and (np.abs(steps * finding.rate - 1) > movement.CLOCK_TOLERANCE).any()
    ):
        smoother = movement.smoothness_by_rows(
            time, np.hstack([*signals.values()]), finding.rate
        )
        likely, jitter = "rows" if smoother > 1 else "times", 1e3 * float(steps.std())
        finding.ask("clock", likely, jitter=jitter, smoother=smoother)
    if {*ANGLES} <= {*signals}:
        _add_tracking(finding, record)


def add_table(finding: Finding, form: Format) -> None:
    """Add size, columns, clock and joint angles of a table of numbers to ``finding``."""
    sheet = form.read(
        finding.file, key=f"{OPTION}.separator, .decimal (or dataset.force.log)"
    )
    facts, labels = finding.facts, sheet.labels
    cells = pd.DataFrame(sheet.values(sheet.numeric, gaps=True)).dropna(how="all")
    missing, filled = (
        int(cells.isna().sum(axis=None)),
        cells.interpolate(limit_direction="both"),
    )
    finding.count({"missing_cells": missing})
    values = dict(zip(sheet.numeric, filled.to_numpy().T, strict=True))
    finding.version = sheet.origin
    facts |= {"rows": len(sheet.rows), "columns": sheet.width}
    facts |= {"separator": sheet.separator, "decimal": sheet.decimal}
    counts = {"rows_without_numbers": len(sheet.rows) - len(cells)}
    finding.count(sheet.counts | repeats(cells.to_numpy()) | counts)
    if sheet.left_out:
        facts["columns_without_numbers"] = sheet.left_out
    facts["labels"] = labels
    units = {bare(label): sheet.unit(n) for n, label in enumerate(labels)}
    finding.units = {label: unit for label, unit in units.items() if unit}
    # rows may share a time if the table merges two sources
    later = np.greater_equal if missing else np.greater
    steps = {n: np.diff(column) for n, column in values.items() if len(column) > 2}
    clocks = [n for n, step in steps.items() if later(step, 0).all() and step.any()]
    facts["timed"] = 0 in clocks
    columns = {labels[n]: column for n, column in values.items()} if labels else {}
    named = [labels.index(name) for name in meanings.clocks_of(columns)]
    counted = bool(labels) and not meanings.COUNTERS.isdisjoint(
        meanings.words_of(labels[0])
    )
    clocks = [n for n in named if n in clocks] or [0] * (facts["timed"] and not counted)
    clock = next(iter(clocks or named), None)
    if clocks:
        facts["step_of_time"] = round(float(np.median(steps[clock])), 9)
        facts |= {"time": labels[clock]} if labels else {}
        second = TIME_UNITS.get(spelled(sheet.unit(clock, "time") or ""))
        if second and facts["step_of_time"]:
            finding.rate = round(1 / (facts["step_of_time"] * second), 3)
    signals: dict[str, list[str]] = {}
    if len(columns) == len(values):  # labels are unique
        time = values[clock] if clocks else None
        signals, guesses = meanings.signals_of([*columns], time, columns.__getitem__)
        if certain := {
            name: own for name, own in signals.items() if name not in guesses
        }:
            facts["signals"] = certain
        if guesses:
            each = ", ".join(
                f"{name}: [{', '.join(own)}]" for name, own in signals.items()
            )
            finding.ask("signals", f"{{{each}}}", reasons="; ".join(guesses.values()))
    other = meanings.other_content(labels, [sheet.unit(n) for n in range(len(labels))])
    if other and not signals:
        finding.version = f"of {other}"
    elif sheet.width == 1:
        finding.ask("one_column")
    elif {*ANGLES} - {*signals} and "signals" not in finding.suggested:
        finding.ask("content")
    if {*ANGLES} <= {*signals}:
        _add_signals(finding, sheet, signals, clock)


def _add_signals(
    finding: Finding, sheet: Sheet, signals: Mapping[str, list[str]], clock: int | None
) -> None:
    """Add units, joints and tracking of the labelled ``signals``, as the stages read them, with the
    time in the column ``clock``.
    """
    labels, actual = sheet.labels, signals["actual"]
    first = labels.index(actual[0])
    units = {"time_unit": clock is not None and sheet.unit(clock, "time")}
    units["angle_unit"] = sheet.unit(first, "angle")
    units = {key: spelled(unit or "") for key, unit in units.items()}
    known = {
        key: unit for key, unit in units.items() if unit in (*TIME_UNITS, *ANGLE_UNITS)
    }
    options = {
        "signals": signals,
        "rate": 1.0,
        "time": None if clock is None else labels[clock],
    }
    stated = {"time_unit": clock, "angle_unit": first}
    own = {bare(labels[stated[key]]): unit for key, unit in known.items()}
    finding.units = own | finding.units
    names = meanings.joint_parts(actual) if meanings.states_joints(actual) else []
    try:
        names = names_in_cells(sheet, len(actual)) or names
        log = log_of_sheet(sheet, LogOptions(**options, **known))
    except RecordingError as error:
        finding.refuse(error)
        return
    finding.facts |= {"joint_names": names} if names else {}
    finding.count(log.counts)
    if clock is None:
        content = ", ".join(
            f"{label} holds {what}" for label, what in sheet.left_out.items()
        )
        finding.ask("no_clock", "null", content=content and f" ({content})")
    else:
        step = round(float(np.median(np.diff(log.time))), 9)
        finding.facts |= {"time": labels[clock], "step_of_time": step}
    log = _in_units(
        finding, log, clock is None or "time_unit" in known, "angle_unit" in known
    )
    if clock is not None:
        _add_tracking(finding, log, signals)


def compare_tables(findings: Sequence[Finding]) -> None:
    """Add the ``role`` of each folder's tables by their names, and compare target and actual."""
    folders: dict[Path, dict[str, Finding]] = {}
    for finding in findings:
        if finding.kind == Kind.TABLE and "rows" in finding.facts:
            folders.setdefault(finding.file.parent, {})[finding.file.stem] = finding
    for inside in folders.values():
        tables = {name: one for name, one in inside.items() if one.facts.get("timed")}
        named = {role: meanings.named_like(role, tables) for role in ANGLES}
        if [*map(len, named.values())] != [1, 1]:
            continue
        means = {name: meanings.meaning(name) for name in tables}
        speed = "target", "velocity"
        named["speed"] = [
            n for n, each in means.items() if (each.role, each.quantity) == speed
        ]
        roles = {
            role: tables[names[0]] for role, names in named.items() if len(names) == 1
        }
        for role, one in roles.items():
            one.facts["role"] = role
            one.withdraw("content")
        for one in inside.values():  # a column of times beside them is no log
            if one.facts["columns"] == 1:
                one.withdraw("one_column")
        finding = roles["target"]
        options = LogOptions(
            joints=finding.facts["columns"] - 1, signals={"angles": None}
        )
        try:
            logs = [read_joint_table(roles[role].file, options) for role in ANGLES]
        except PipelineError:
            continue  # no joint log; the table's finding has the reason
        if (length := min(len(log.time) for log in logs)) > 2:
            angles = [log.signals["angles"][:length] for log in logs]
            log = JointLog(
                logs[0].time[:length], dict(zip(ANGLES, angles, strict=True)), {}
            )
            _add_tracking(finding, _in_units(finding, log))


def _in_units(
    finding: Finding, log: JointLog, timed: object = False, angled: object = False
) -> JointLog:
    """Return ``log`` in s and rad; add questions for units that are not stated (``timed``,
    ``angled``). The measured angles without damaged cells suggest the unit of all angles.
    """
    second = angle = 1.0
    if not timed:
        step = float(np.median(np.diff(log.time)))
        fits = [
            n for n, s in TIME_UNITS.items() if RATES[0] <= 1 / (step * s) <= RATES[1]
        ]
        fits = [n for n in fits if log.time[-1] * TIME_UNITS[n] < EPOCH.stop]
        odd = f"{step:g}, at a rate from {RATES[0]:g} to {RATES[1]:g} Hz in none of the units"
        finding.ask(
            "time_unit", fits[0] if fits else None, step=f"{step:g}" if fits else odd
        )
        second = TIME_UNITS[fits[0]] if fits else 1.0
    if not angled:
        first = log.signals.get("actual", np.hstack([*log.signals.values()]))
        greatest = float(np.abs(movement.without_damage(first)).max())
        angle = ANGLE_UNITS["deg"] if greatest > MOST_TURNS * TURN else 1.0
        if angle == 1.0 or (first % 1).any():
            finding.ask(
                "angle_unit", "rad" if angle == 1.0 else "deg", greatest=greatest
            )
        else:
            counts = 2 ** ceil(log2(greatest + 1))
            ends, angle = {"least": first.min(), "greatest": first.max()}, TURN / counts
            finding.ask("encoder_counts", counts=counts, angle=angle, **ends)
    signals = {name: values * angle for name, values in log.signals.items()}
    if "actual" in signals:
        sound = movement.without_damage(signals["actual"])
        finding.facts["range"] = [
            sound.min(axis=0).tolist(),
            sound.max(axis=0).tolist(),
        ]
    return replace(log, time=log.time * second, signals=signals)


def _add_tracking(
    finding: Finding, log: JointLog, labels: Mapping[str, Sequence[str]] | None = None
) -> None:
    """Add the tracking error of the measured and commanded angles of ``log`` in s and rad, the
    command's motions, and options for which the signals agree. ``labels`` of the columns of each
    signal stand in errors for the names of the joints.
    """
    time, angles = log.time - log.time[0], []
    steps = np.diff(time)
    rate = float(
        f"{1 / steps[steps < 2 * np.median(steps)].mean():.4g}"
    )  # nominal, without gaps
    if not RATES[0] / 100 < rate <= RATES[1]:  # the times are in an unknown unit
        return
    try:
        sound = [movement.without_damage(log.signals[name]) for name in ANGLES]
        pairing = commands.find_pairing(*sound, rate)
        for name, factor in zip(ANGLES, (1.0, abs(pairing.factor[0])), strict=True):
            where, values = (
                {"signal": name, "lines": log.lines},
                log.signals[name] * factor,
            )
            names = tuple((labels or {}).get(name, log.joints))
            movement.require_plausible(values, time, names, True, "rad", **where)
            values, removed = unwrap(values, time, names, **where)
            finding.count(
                {movement.UNWRAPPED: removed + finding.gaps.get(movement.UNWRAPPED, 0)}
            )
            angles.append(values / factor)
        movement.require_fresh(*angles, rate)
    except PipelineError as error:
        finding.stops.append(str(error))
        return
    actual, target = angles
    actual = actual + TURN * whole_turns(target, actual)
    pairing = commands.find_pairing(actual, target, rate)
    for quantity, option, value, without in commands.suspects(
        pairing, actual, target, rate
    ):
        finding.ask("pairing", value, quantity=quantity, without=without, option=option)
    actual, target = pairing.apply(actual, target)
    standing, late = commands.standing_joints(actual, target), lag(target, actual, rate)
    finding.count({"missing_samples": dropped_frames(time)})
    moving, joints = (
        ~standing,
        names or [f"joint {n}" for n in range(1, len(standing) + 1)],
    )
    pair = actual[:, moving], target[:, moving], rate, JointLogSection.mismatch
    try:
        commands.require_pair(*pair, np.array(joints)[moving])
    except RecordingError as error:
        finding.stops.append(error.message)
    missing = commands.tracking_errors(actual, target)[~standing].max(initial=0.0)
    finding.facts["command"] = (
        f"tracking error {missing:.2g} of the motion (0.9 quantile), lag {1e3 * late:.2g} ms"
        if np.isfinite(late)
        else f"at rest, tracking error {np.abs(actual - target).max():.2g} rad"
    )
    if standing.any():
        finding.facts["joints_that_stand_still"] = (
            np.flatnonzero(standing) + 1
        ).tolist()
    lacks = [run.lack(len(target)) for run in excursions(target, rate)]
    finding.facts["motions"] = f"{lacks.count('')} whole"
    finding.count({"motions_cut_off": sum("cut off" in lack for lack in lacks)})
    if any("never rests" in lack for lack in lacks):
        finding.ask("rest", "0")
        if len(actual) > ORDER:  # noise in rad, from differences of order ORDER
            power = np.mean(np.diff(actual, ORDER, axis=0) ** 2, axis=0).max()
            noise = max(float(np.sqrt(power / comb(2 * ORDER, ORDER))), LEAST_NOISE)
            finding.ask("pose_noise", f"{noise:.1e}")
