"""Findings of joint logs and tables of numbers: columns, units, clock, tracking error."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import ceil, comb, log2
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.core.angles import MOST_TURNS, TURN, unwrap, whole_turns
from pipeline.core.errors import PipelineError, RecordingError
from pipeline.core.options.dataset import JointLogSection
from pipeline.formats import joints as joint_formats
from pipeline.formats.delimited import ANGLE_UNITS, TIME_UNITS, bare, spelled
from pipeline.formats.depth.frame_names import EPOCH
from pipeline.formats.depth.image import dropped_frames
from pipeline.formats.force.record import repeats
from pipeline.formats.format import Format, Kind, format_of, formats_in
from pipeline.formats.joints import names as meanings
from pipeline.formats.joints.bag import FORMAT as BAG
from pipeline.formats.joints.log import OPTION, JointLog, LogOptions
from pipeline.formats.joints.table import (
    log_of_sheet,
    names_in_cells,
    read_clock,
    read_joint_table,
)
from pipeline.formats.joints.values import signals_by_values
from pipeline.formats.number_sheet import LISTS, Sheet, read_sheet
from pipeline.recordings import commands, movement
from pipeline.recordings.lags import lag
from pipeline.recordings.repetitions import excursions
from pipeline.tools.inspect.finding import Finding
from pipeline.tools.new_dataset.template import text_of

RATES = 5.0, 5000.0  # Hz, range of the rates of controllers' logs
ORDER = 6  # order of the differences that estimate noise
LEAST_NOISE = 1e-8  # rad, least estimate of the noise
ANGLES = ("actual", "target")  # signals to compare
GUESSING = LogOptions(guess=True)


def add_joint_log(
    finding: Finding, form: Format, options: LogOptions = GUESSING
) -> None:
    """Add signals, joints and clock of a joint log, read by ``options``, to ``finding``."""
    record = form.read(finding.file, options)
    if record.guesses:
        _ask_signals(finding, record.arrays, record.guesses)
    signals, time = record.signals, record.time
    finding.count(record.counts)
    width = max(values.shape[1] for values in signals.values())
    finding.facts |= {"samples": len(time), "signals": list(signals), "joints": width}
    if record.joints:
        finding.facts["joint_names"] = list(record.joints)
    if record.clock:
        finding.facts["time"] = record.clock
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
    columns = {labels[n]: column for n, column in values.items()} if labels else {}
    named = [labels.index(name) for name in meanings.clocks_of(columns)]
    clocks = _clocks(sheet, values, named, bool(missing))
    facts["timed"] = 0 in clocks
    clock = next(iter(clocks or named), None)
    if clocks:
        steps = np.diff(values[clock])
        facts["step_of_time"] = round(float(np.median(steps)), 9)
        facts |= {"time": labels[clock]} if labels else {}
        second = TIME_UNITS.get(spelled(sheet.unit(clock, "time") or ""))
        if second and facts["step_of_time"]:
            finding.rate = round(1 / (facts["step_of_time"] * second), 3)
    counting = [n for n, column in values.items() if meanings.counts_rows(column)]
    counting = [n for n in counting if n not in clocks]
    if counting:
        facts["row_numbers"] = [labels[n] if labels else n for n in counting]
    time = values[clock] if clocks else None
    signals: dict[str, list] = {}
    guesses: dict[str, str] = {}
    if columns and len(columns) == len(values):  # labels are unique
        signals, guesses = meanings.signals_of([*columns], time, columns.__getitem__)
    elif not labels:
        beside = {*clocks, *counting}
        rows = {n: column for n, column in values.items() if n not in beside}
        signals, guesses = signals_by_values(rows, time)
        if len(rows) > 2 and len(signals.get("actual", ())) == 1:
            signals, guesses = {}, {}  # one pair of many columns may follow by chance
    if certain := {name: signals[name] for name in signals if name not in guesses}:
        facts["signals"] = certain
    if guesses:
        _ask_signals(finding, signals, guesses)
    other = meanings.other_content(labels, [sheet.unit(n) for n in range(len(labels))])
    if other and not signals:
        finding.version = f"of {other}"
    elif sheet.width == 1:
        finding.ask("one_column")
    elif {*ANGLES} - {*signals} and "signals" not in finding.suggested:
        finding.ask("content")
    if {*ANGLES} <= {*signals}:
        _add_signals(finding, sheet, signals, clock)
        return
    lists = [name for name, content in sheet.left_out.items() if content == LISTS]
    if lists:
        finding.stops.append(
            f"the cells of {', '.join(lists)} are lists of numbers: write each number in a "
            "column of its own, or save the table as Parquet"
        )


def _ask_signals(
    finding: Finding, signals: Mapping[str, Sequence], guesses: Mapping[str, str]
) -> None:
    """Ask for the ``signals`` (columns or arrays), suggested for the reasons of the ``guesses``."""
    lists = []
    for name, group in signals.items():
        places = [text_of(column) for column in group]
        lists.append(f"{name}: [{', '.join(places)}]")
    reasons = "; ".join(dict.fromkeys(guesses.values()))
    finding.ask("signals", f"{{{', '.join(lists)}}}", reasons=reasons)


def describe_stated(finding: Finding, stated: Mapping[str, Any]) -> Finding:
    """Return the ``finding`` of a joint log with the signals and the time of the ``stated`` values
    (key of the section joint_log → value) in place of found ones.
    """
    signals = stated["signals"]
    again = replace(finding, open=[], stops=[], facts={**finding.facts})
    try:
        if finding.kind == Kind.JOINTS:
            form = format_of(finding.file, formats_in(joint_formats, Kind.JOINTS))
            options = LogOptions(stated.get("time", 0), rate=1.0, signals=signals)
            add_joint_log(again, form, options)
            return again
        sheet = read_sheet(finding.file)
        found = 0 if finding.facts["timed"] else finding.facts.get("time")
        time = stated.get("time", found)
        wanted = {} if time is None else {"time": time}
        clock = sheet.columns(wanted, f"{OPTION}.time").get("time")
        again.facts["signals"] = signals
        _add_signals(again, sheet, signals, clock)
    except PipelineError as error:
        again.refuse(error)
    return again


def _clocks(
    sheet: Sheet, values: Mapping[int, np.ndarray], named: list[int], merged: bool
) -> list[int]:
    """Return the columns of increasing ``values`` that are ``named`` as times, else the first or,
    without labels, the last column, if it increases and counts no rows. Rows of ``merged`` sources
    may share a time.
    """
    later = np.greater_equal if merged else np.greater
    increasing = []
    for column, numbers in values.items():
        steps = np.diff(numbers)
        if len(steps) > 1 and later(steps, 0).all() and steps.any():
            increasing.append(column)
    clocks = [column for column in named if column in increasing]
    if clocks:
        return clocks
    clocks = [n for n in increasing if not meanings.counts_rows(values[n])]
    if not sheet.labels and sheet.numeric[-1] in clocks and 0 not in clocks:
        return [sheet.numeric[-1]]
    if 0 not in clocks:
        return []
    words = meanings.words_of(sheet.labels[0]) if sheet.labels else []
    return [0] if meanings.COUNTERS.isdisjoint(words) else []


def _add_signals(
    finding: Finding, sheet: Sheet, signals: Mapping[str, list], clock: int | None
) -> None:
    """Add units, joints and tracking of the labelled ``signals``, as the stages read them, with the
    time in the column ``clock``.
    """
    labels, actual = sheet.labels, signals["actual"]
    first = labels.index(actual[0]) if labels else actual[0]
    units = {"time_unit": clock is not None and sheet.unit(clock, "time")}
    units["angle_unit"] = sheet.unit(first, "angle")
    units = {key: spelled(unit or "") for key, unit in units.items()}
    known = {
        key: unit for key, unit in units.items() if unit in (*TIME_UNITS, *ANGLE_UNITS)
    }
    options = {
        "signals": signals,
        "rate": 1.0,
        "time": labels[clock] if labels and clock is not None else clock,
    }
    stated = {"time_unit": clock, "angle_unit": first}
    own = {bare(labels[stated[key]]): unit for key, unit in known.items() if labels}
    finding.units = own | finding.units
    stated = labels and meanings.states_joints(actual)
    names = meanings.joint_parts(actual) if stated else []
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
        finding.facts |= {"time": options["time"], "step_of_time": step}
    log = _in_units(
        finding, log, clock is None or "time_unit" in known, "angle_unit" in known
    )
    if clock is not None:
        _add_tracking(finding, log, signals if labels else None)


def compare_tables(findings: Sequence[Finding]) -> None:
    """Add ``role`` and ``movement`` of tables of one signal by their files' names, and compare
    target and actual. A folder holds one movement, or several whose files differ in a word.
    """
    folders: dict[Path, dict[str, Finding]] = {}
    for finding in findings:
        if finding.kind == Kind.TABLE and "rows" in finding.facts:
            folders.setdefault(finding.file.parent, {})[finding.file.stem] = finding
    for inside in folders.values():
        movements = [_tables_of_movement(group) for group in _groups(inside)]
        movements = [roles for roles in movements if roles]
        for roles in movements or filter(None, [_tables_of_movement(inside)]):
            add_roles(roles, inside)


def _groups(tables: Mapping[str, Finding]) -> list[dict[str, Finding]]:
    """Return the ``tables`` by the words and the number in their names beside role and quantity."""
    groups: dict[tuple, dict[str, Finding]] = {}
    for name, table in tables.items():
        meaning = meanings.meaning(name)
        rest = tuple(word for word in meaning.rest if word not in meanings.TIME)
        groups.setdefault((rest, meaning.number), {})[name] = table
    return [*groups.values()]


def _tables_of_movement(tables: Mapping[str, Finding]) -> dict[str, Finding]:
    """Return role → the one of the ``tables`` of measured and of commanded angles, if their names
    state it, and of commanded speeds and of times, if there is one; else an empty dictionary.
    """
    named = {role: meanings.named_like(role, tables) for role in ANGLES}
    if [*map(len, named.values())] != [1, 1]:
        return {}
    roles = {role: tables[names[0]] for role, names in named.items()}
    if roles["actual"].facts["columns"] != roles["target"].facts["columns"]:
        return {}
    quantities = {name: meanings.meaning(name)[:2] for name in tables}
    speeds = [n for n, stated in quantities.items() if stated == ("target", "velocity")]
    rows = roles["actual"].facts["rows"]
    clocks = []
    for name in meanings.named_like("time", tables):
        facts = tables[name].facts
        if facts["columns"] == 1 and facts["rows"] == rows and facts["timed"]:
            clocks.append(name)
    for role, names in (("speed", speeds), ("time", clocks)):
        if len(names) == 1:
            roles[role] = tables[names[0]]
    return roles


def add_roles(roles: Mapping[str, Finding], inside: Mapping[str, Finding]) -> None:
    """Add the ``roles`` of the tables of a movement, and their tracking to the commanded angles."""
    for role, table in roles.items():
        table.facts |= {"role": role, "movement": str(roles["actual"].file)}
        table.withdraw("content")
    for table in inside.values():  # a column of times beside them is no log
        if table.facts["columns"] == 1:
            table.withdraw("one_column")
    finding = roles["target"]
    timed = bool(finding.facts["timed"] and roles["actual"].facts["timed"])
    options = LogOptions(
        time=0 if timed else None,
        rate=1.0,
        joints=finding.facts["columns"] - timed,
        signals={"angles": None},
    )
    try:
        if not timed and "time" in roles:
            options = replace(options, clock=read_clock(roles["time"].file, options))
        logs = [read_joint_table(roles[role].file, options) for role in ANGLES]
    except PipelineError:
        return  # no joint log; the table's finding has the reason
    length = min(len(log.time) for log in logs)
    if length < 3:
        return
    angles = [log.signals["angles"][:length] for log in logs]
    log = JointLog(logs[0].time[:length], dict(zip(ANGLES, angles, strict=True)), {})
    clocked = timed or options.clock is not None
    step = round(float(np.median(np.diff(log.time))), 9)
    finding.facts |= {"step_of_time": step} if clocked else {}
    log = _in_units(finding, log, timed=not clocked)
    if clocked:
        _add_tracking(finding, log)


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
    if fault := commands.standing_arm(actual, target):
        finding.stops.append(fault)
        return
    if wrong := commands.wrong_commands(actual, target):
        finding.count({"wrong_commands": len(wrong)})
        names = names or [f"joint {n}" for n in range(1, actual.shape[1] + 1)]
        finding.facts["wrong_command"] = wrong[0].reason(names, rate)
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
