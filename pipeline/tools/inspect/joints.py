"""Findings of joint logs and tables of numbers: columns, units, clock, signals."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from pipeline.core.errors import PipelineError, RecordingError
from pipeline.formats import joints as joint_formats
from pipeline.formats.delimited import ANGLE_UNITS, TIME_UNITS, bare, spelled
from pipeline.formats.force.record import repeats
from pipeline.formats.format import Format, Kind, format_of, formats_in
from pipeline.formats.joints import names as meanings
from pipeline.formats.joints.bag import FORMAT as BAG
from pipeline.formats.joints.log import ANGLES, OPTION, LogOptions
from pipeline.formats.joints.table import log_of_sheet, names_in_cells
from pipeline.formats.joints.values import signals_by_values
from pipeline.formats.number_sheet import LISTS, Sheet, read_sheet
from pipeline.recordings import movement
from pipeline.tools.inspect.finding import Finding
from pipeline.tools.inspect.tracking import add_tracking, in_units
from pipeline.tools.new_dataset.template import text_of

GUESSING = LogOptions(guess=True)
TABLE_KEY = f"{OPTION}.separator, .decimal (or dataset.force.log)"
Signals = Mapping[str, list[int | str]]  # signal → columns


def add_joint_log(
    finding: Finding,
    form: Format,
    options: LogOptions = GUESSING,
) -> None:
    """Add signals, joints and clock of a joint log, read by ``options``, to ``finding``."""
    record = form.read(finding.file, options)
    if record.guesses:
        _ask_signals(finding, record.arrays, record.guesses)
    finding.count(record.counts)
    facts = finding.facts
    signals = record.signals
    facts["samples"] = len(record.time)
    if record.recordings > 1:
        facts["recordings"] = record.recordings
    facts["signals"] = list(signals)
    facts["joints"] = max(values.shape[1] for values in signals.values())
    if record.joints:
        facts["joint_names"] = list(record.joints)
    if record.clock:
        facts["time"] = record.clock
    if len(record.time) < 2:
        return
    # a bag's message defines its units
    in_bag = form.name == BAG.name
    time_is_known = in_bag or record.time_unit
    angle_is_known = in_bag or record.angle_unit
    log = in_units(finding, record, time_is_known, angle_is_known)
    finding.timed(log.time)
    _ask_clock(finding, log.time, signals, finding.rate)
    if {*ANGLES} <= {*signals}:
        add_tracking(finding, log)


def _ask_clock(
    finding: Finding,
    time: np.ndarray,
    signals: Mapping[str, np.ndarray],
    rate: float,
) -> None:
    """Ask whether rows are even at ``rate`` (Hz) or were measured at their ``time`` (N,) s, if the
    steps differ. Rows that are not even at any rate are resampled at their times.
    """
    steps = np.diff(time)
    jitters = np.abs(steps * rate - 1) > movement.CLOCK_TOLERANCE
    if len(steps) <= 3 or not jitters.any():
        return
    angles = np.hstack([*signals.values()])
    smoother = movement.smoothness_by_rows(time, angles, rate)
    drifts = movement.lasting_deviations(time, rate).any()
    likely = "rows" if smoother > 1 and not drifts else "times"
    jitter = 1e3 * float(steps.std())
    least = 1e3 * steps.min()
    greatest = 1e3 * steps.max()
    finding.facts["row_distance"] = f"{least:.3g} to {greatest:.3g} ms"
    finding.ask("clock", likely, jitter=jitter, smoother=smoother)


def add_table(finding: Finding, form: Format) -> None:
    """Add size, columns, clock and joint angles of a table of numbers to ``finding``."""
    sheet = form.read(finding.file, key=TABLE_KEY)
    finding.version = sheet.origin
    values = _filled_columns(finding, sheet)
    labels = sheet.labels
    units = [sheet.unit(n) for n in range(len(labels))]
    for label, unit in zip(labels, units, strict=True):
        if unit:
            finding.units[bare(label)] = unit
    clocks, clock = _clocks_of_table(finding, sheet, values)
    signals, guesses = _signals_of_table(finding, sheet, values, clocks)
    certain = {name: signals[name] for name in signals if name not in guesses}
    if certain:
        finding.facts["signals"] = certain
    if guesses:
        _ask_signals(finding, signals, guesses)
    has_angles = {*ANGLES} <= {*signals}
    content = meanings.other_content(labels, units)
    if content and not signals:
        finding.version = f"of {content}"
    elif sheet.width == 1:
        finding.ask("one_column")
    elif not has_angles and "signals" not in finding.suggested:
        finding.ask("content")
    if has_angles:
        _add_signals(finding, sheet, signals, clock)
        return
    lists = [name for name, cells in sheet.left_out.items() if cells == LISTS]
    if lists:
        finding.stops.append(
            f"the cells of {', '.join(lists)} are lists of numbers: write each number in a "
            "column of its own, or save the table as Parquet",
        )


def _filled_columns(finding: Finding, sheet: Sheet) -> dict[int, np.ndarray]:
    """Return column → numbers of a ``sheet`` without empty rows, with interpolated gaps, which are
    counted; add size and layout.
    """
    cells = pd.DataFrame(sheet.values(sheet.numeric, gaps=True)).dropna(how="all")
    finding.count({"missing_cells": int(cells.isna().sum(axis=None))})
    finding.count(sheet.counts | repeats(cells.to_numpy()))
    finding.count({"rows_without_numbers": len(sheet.rows) - len(cells)})
    finding.facts |= {
        "rows": len(sheet.rows),
        "columns": sheet.width,
        "separator": sheet.separator,
        "decimal": sheet.decimal,
        "labels": sheet.labels,
    }
    if sheet.left_out:
        finding.facts["columns_without_numbers"] = sheet.left_out
    filled = cells.interpolate(limit_direction="both").to_numpy()
    return dict(zip(sheet.numeric, filled.T, strict=True))


def _clocks_of_table(
    finding: Finding,
    sheet: Sheet,
    values: Mapping[int, np.ndarray],
) -> tuple[list[int], int | None]:
    """Return the columns that increase as times do, and the column of the time, if there is one;
    add its step and rate.
    """
    labels = sheet.labels
    facts = finding.facts
    columns = {labels[n]: numbers for n, numbers in values.items()} if labels else {}
    named = [labels.index(label) for label in meanings.clocks_of(columns)]
    merged = "missing_cells" in finding.gaps
    clocks = _clocks(sheet, values, named, merged)
    facts["timed"] = 0 in clocks
    clock = next(iter(clocks or named), None)
    if clocks:
        step = round(float(np.median(np.diff(values[clock]))), 9)
        facts["step_of_time"] = step
        if labels:
            facts["time"] = labels[clock]
        second = TIME_UNITS.get(spelled(sheet.unit(clock, "time") or ""))
        if second and step:
            finding.rate = round(1 / (step * second), 3)
    return clocks, clock


def _signals_of_table(
    finding: Finding,
    sheet: Sheet,
    values: Mapping[int, np.ndarray],
    clocks: Sequence[int],
) -> tuple[Signals, dict[str, str]]:
    """Return signal → columns by labels, or by values without labels, and signal → reason of the
    guessed ones; add the columns that count rows.
    """
    labels = sheet.labels
    counting = []
    for n, numbers in values.items():
        if meanings.counts_rows(numbers) and n not in clocks:
            counting.append(n)
    if counting:
        numbers = [labels[n] if labels else n for n in counting]
        finding.facts["row_numbers"] = numbers
    time = values[clocks[0]] if clocks else None
    if labels:
        columns = {labels[n]: numbers for n, numbers in values.items()}
        if len(columns) < len(values):  # labels are not unique
            return {}, {}
        return meanings.signals_of([*columns], time, columns.__getitem__)
    beside = {*clocks, *counting}
    rows = {n: numbers for n, numbers in values.items() if n not in beside}
    signals, guesses = signals_by_values(rows, time)
    if len(rows) > 2 and len(signals.get("actual", ())) == 1:
        return {}, {}  # one pair of many columns may follow by chance
    return signals, guesses


def _ask_signals(
    finding: Finding,
    signals: Mapping[str, Sequence],
    guesses: Mapping[str, str],
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
    sheet: Sheet,
    values: Mapping[int, np.ndarray],
    named: list[int],
    merged: bool,
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
    finding: Finding,
    sheet: Sheet,
    signals: Signals,
    clock: int | None,
) -> None:
    """Add units, joints and tracking of the labelled ``signals``, as the stages read them, with the
    time in the column ``clock``.
    """
    labels = sheet.labels
    actual = signals["actual"]
    first = labels.index(actual[0]) if labels else actual[0]
    units = {}
    for key, column, quantity in (
        ("time_unit", clock, "time"),
        ("angle_unit", first, "angle"),
    ):
        unit = "" if column is None else spelled(sheet.unit(column, quantity) or "")
        if unit in (*TIME_UNITS, *ANGLE_UNITS):
            units[key] = unit
            if labels:
                finding.units.setdefault(bare(labels[column]), unit)
    time = labels[clock] if labels and clock is not None else clock
    options = LogOptions(signals=signals, rate=1.0, time=time, **units)
    names = []
    if labels and meanings.states_joints(actual):
        names = meanings.joint_parts(actual)
    try:
        names = names_in_cells(sheet, len(actual)) or names
        log = log_of_sheet(sheet, options)
    except RecordingError as error:
        finding.refuse(error)
        return
    if names:
        finding.facts["joint_names"] = names
    finding.count(log.counts)
    if clock is None:
        _ask_time(finding, sheet)
        in_units(finding, log, True, "angle_unit" in units)
        return
    step = round(float(np.median(np.diff(log.time))), 9)
    finding.facts |= {"time": time, "step_of_time": step}
    log = in_units(finding, log, "time_unit" in units, "angle_unit" in units)
    _ask_clock(finding, log.time, log.signals, 1 / float(np.median(np.diff(log.time))))
    add_tracking(finding, log, signals if labels else None)


def _ask_time(finding: Finding, sheet: Sheet) -> None:
    """Ask for the column of the time, and name the content of the columns without numbers."""
    contents = [f"{label} holds {cells}" for label, cells in sheet.left_out.items()]
    content = f" ({', '.join(contents)})" if contents else ""
    finding.ask("no_clock", "null", content=content)
