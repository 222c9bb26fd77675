"""Movements whose signals are tables of their own: their roles by the files' names."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.core.errors import PipelineError
from pipeline.formats.format import Kind
from pipeline.formats.joints import names as meanings
from pipeline.formats.joints.log import ANGLES, JointLog, LogOptions
from pipeline.formats.joints.table import read_clock, read_joint_table
from pipeline.tools.inspect.finding import Finding
from pipeline.tools.inspect.tracking import add_tracking, in_units


def compare_tables(findings: Sequence[Finding]) -> None:
    """Add ``role`` and ``movement`` of tables of one signal by their files' names, and compare
    target and actual. A folder holds one movement, or several whose files differ in a word.
    """
    folders: dict[Path, dict[str, Finding]] = {}
    for finding in findings:
        if finding.kind == Kind.TABLE and "rows" in finding.facts:
            tables = folders.setdefault(finding.file.parent, {})
            tables[finding.file.stem] = finding
    for tables in folders.values():
        movements = [_roles_of(group) for group in _groups_of_names(tables)]
        movements = [roles for roles in movements if roles]
        if not movements:
            movements = [_roles_of(tables)]
        for roles in movements:
            if roles:
                add_roles(roles, tables)


def _groups_of_names(tables: Mapping[str, Finding]) -> list[dict[str, Finding]]:
    """Return the ``tables`` by the words and the number in their names beside role and quantity."""
    groups: dict[tuple, dict[str, Finding]] = {}
    for name, table in tables.items():
        meaning = meanings.meaning(name)
        words = [word for word in meaning.rest if word not in meanings.TIME]
        group = groups.setdefault((*words, meaning.number), {})
        group[name] = table
    return [*groups.values()]


def _roles_of(tables: Mapping[str, Finding]) -> dict[str, Finding]:
    """Return role → the one of the ``tables`` of measured and of commanded angles, if their names
    state it, and of commanded speeds and of times, if there is one; else an empty dictionary.
    """
    roles = {}
    for role in ANGLES:
        names = meanings.named_like(role, tables)
        if len(names) != 1:
            return {}
        roles[role] = tables[names[0]]
    actual = roles["actual"].facts
    if actual["columns"] != roles["target"].facts["columns"]:
        return {}
    speeds = []
    clocks = []
    for name, table in tables.items():
        if meanings.meaning(name)[:2] == ("target", "velocity"):
            speeds.append(table)
    for name in meanings.named_like("time", tables):
        facts = tables[name].facts
        is_column = facts["columns"] == 1 and facts["rows"] == actual["rows"]
        if is_column and facts["timed"]:
            clocks.append(tables[name])
    for role, candidates in (("speed", speeds), ("time", clocks)):
        if len(candidates) == 1:
            roles[role] = candidates[0]
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
    signals = dict(zip(ANGLES, angles, strict=True))
    log = JointLog(logs[0].time[:length], signals, {})
    clocked = timed or options.clock is not None
    if clocked:
        step = float(np.median(np.diff(log.time)))
        finding.facts["step_of_time"] = round(step, 9)
    log = in_units(finding, log, timed=not clocked)
    if clocked:
        add_tracking(finding, log)
