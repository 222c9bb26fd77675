"""Account of a controller's joint log, and whether the angles in it that were measured and those
that were commanded are a pair.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import comb
from pathlib import Path

import numpy as np

from pipeline.core.angles import TURN, unwrapped, whole_turns
from pipeline.core.errors import PipelineError
from pipeline.formats.format import Format, Kind
from pipeline.formats.joints.log import OPTION, JointLog, LogOptions
from pipeline.formats.joints.table import read_joint_table
from pipeline.formats.units import ANGLE_UNITS, TIME_UNITS, spelled
from pipeline.recordings.movement import (
    CLOCK_TOLERANCE,
    FASTER,
    MOST_TURNS,
    STEP_NOISE,
    UNWRAPPED,
    smoothness_by_rows,
    speed_limits,
)
from pipeline.recordings.pairing import missed, pairing_of, suspects
from pipeline.recordings.repetitions import commanded_speeds, excursions, lag
from pipeline.tools.inspect.finding import ROBOT, Finding, counted

RATES = 5.0, 5000.0  # 1/s, between which controllers log
ORDER = 6  # of the differences that show noise
LEAST_NOISE = 1e-8  # rad, where they show none
LIKE_SPEED = 0.1  # of the mean step of the angles, by which its speed may be off on average
# words of a file's name that tell measured from commanded angles
MEASURED, COMMANDED = ("actual", "measured"), ("target", "commanded", "desired")
STATED_BY_TYPE = "joint states in a ROS bag"  # rad and s, by the definition of the message
REPAIRS = ("cut_rows", "blank_rows", "doubled_rows", "messages_of_other_joints", UNWRAPPED)


def log(form: Format, file: Path) -> Finding:
    """Return the account of a log of the joints, with the signals that it holds."""
    finding, stated = Finding.read_by(form, file), form.states(file)
    finding.version, finding.units, finding.facts = stated.version, stated.units, stated.facts
    try:
        record = form.read(file, LogOptions())
    except PipelineError as error:
        return finding.refused(error)
    finding.gaps = counted(record.counts, *REPAIRS)
    finding.facts |= {"samples": len(record.time), "signals": list(record.signals)}
    finding.facts |= {"joints": max(values.shape[1] for values in record.signals.values())}
    if record.joints:
        finding.facts["joint_names"] = list(record.joints)
    steps, time = np.diff(record.time), record.time
    step, unit = float(np.median(steps)) if len(steps) else 0.0, "s"
    if form.name != STATED_BY_TYPE and step:
        unit = _time_unit(step) or "s"
        ask(
            finding,
            "time_unit",
            unit,
            f"the unit of the times is not stated; they step by {step:g}",
        )
    time = time * TIME_UNITS[unit]
    finding.duration = float(time[-1] - time[0])
    if finding.duration:
        finding.rate = round((len(time) - 1) / finding.duration, 3)
    _clock(finding, time, record)
    signals = record.signals
    if form.name != STATED_BY_TYPE:
        greatest = max(float(np.abs(values).max()) for values in signals.values())
        unit = _angle_unit(greatest)
        question = f"the unit of the angles is not stated; the greatest is {greatest:.4g}"
        ask(finding, "angle_unit", unit, question)
    if {"actual", "target"} <= {*signals} and finding.duration:
        angles = signals["actual"], signals["target"]
        pair(finding, time, *angles, record.joints, None if form.name != STATED_BY_TYPE else "rad")
    return finding


def _time_unit(step: float) -> str | None:
    """The unit in which steps of the times are those of a controller's log."""
    fits = [unit for unit in ("s", "ms", "us", "ns") if RATES[0] <= 1 / (step * TIME_UNITS[unit])]
    fits = [unit for unit in fits if 1 / (step * TIME_UNITS[unit]) <= RATES[1]]
    return fits[0] if fits else None


def _angle_unit(greatest: float) -> str:
    return "deg" if greatest > MOST_TURNS * TURN else "rad"


def compare_tables(findings: Sequence[Finding]) -> None:
    """Compare tables whose names differ in a word for measured and commanded alone, as
    ``q_actual.csv`` and ``q_target.csv``, which is noted with the commanded ones; and the speeds
    of all joint logs with the limits of the one robot among the ``findings``.
    """
    _hold_against_limits(findings)
    tables = {finding.file: finding for finding in findings if finding.kind == Kind.TABLE}
    for file, finding in tables.items():
        parts = re.split(r"([^A-Za-z]+)", file.stem)
        place = next((i for i, part in enumerate(parts) if part.lower() in MEASURED), None)
        if place is None or finding.facts.get("increasing_columns", [])[:1] != [0]:
            continue
        for word in COMMANDED:
            other = file.with_stem("".join([*parts[:place], word, *parts[place + 1 :]]))
            if other in tables:
                _pair_of_tables(finding, tables[other])
                tables[other].facts["measured"] = file.name
                _find_speed(
                    tables[other],
                    [one for path, one in tables.items() if path.parent == file.parent],
                )


def _hold_against_limits(findings: Sequence[Finding]) -> None:
    """Add a stop where a step of a log is faster than its joint can move, by the only URDF."""
    robots = [finding for finding in findings if finding.kind == ROBOT and not finding.stops]
    if len(robots) != 1:
        return
    limits = speed_limits(str(robots[0].file))
    arms = {tuple(arm["joints"]) for arm in robots[0].facts.get("arms", ())}
    for finding in findings:
        if not (fastest := finding.facts.get("fastest")):
            continue
        named = finding.facts.get("joint_names") or [*next(iter(arms), ())]
        if len(named) != len(fastest) or (len(arms) != 1 and "joint_names" not in finding.facts):
            continue
        for joint, (speed, seconds) in zip(named, fastest, strict=True):
            if 0 < FASTER * limits.get(joint, 0.0) < speed:
                finding.stops.append(
                    f"{joint} steps at {speed:.4g} rad/s at {seconds:.6g} s from the start, where "
                    f"{robots[0].file.name} allows {limits[joint]:.4g} rad/s: leave this part of "
                    "the log out, or correct the velocity limit"
                )


def _pair_of_tables(measured: Finding, commanded: Finding) -> None:
    joints = measured.facts["columns"] - 1
    options = LogOptions(joints=joints, signals={"angles": None})
    try:
        logs = [read_joint_table(finding.file, options) for finding in (measured, commanded)]
    except PipelineError:
        return  # either is a table of something else; each says for itself what is wrong with it
    length = min(len(log.time) for log in logs)
    angles = [log.signals["angles"][:length] for log in logs]
    if length > 2:
        pair(commanded, logs[0].time[:length], *angles)


def _find_speed(commanded: Finding, beside: Sequence[Finding]) -> None:
    """Mark the table ``beside`` the ``commanded`` angles that holds their speed."""
    width = commanded.facts["columns"]
    options = LogOptions(joints=width - 1, signals={"angles": None})
    for finding in beside:
        if finding is commanded or finding.facts.get("columns") != width:
            continue
        try:
            angles, speeds = (read_joint_table(one.file, options) for one in (commanded, finding))
        except PipelineError:
            continue
        length = min(len(angles.time), len(speeds.time))
        if length < 3:
            continue
        q, v = (log.signals["angles"][:length] for log in (angles, speeds))
        steps = np.gradient(q, angles.time[:length], axis=0)
        if np.abs(v - steps).mean() < LIKE_SPEED * np.abs(steps).mean():
            finding.facts["speed_of"] = commanded.file.name


def _clock(finding: Finding, time: np.ndarray, record: JointLog) -> None:
    """Ask what the times of an uneven log leave open."""
    steps = np.diff(time)
    if len(steps) < 4 or (np.abs(steps * finding.rate - 1) <= CLOCK_TOLERANCE).all():
        return
    jitter = 1e3 * float(steps.std())
    smoother = smoothness_by_rows(time, np.hstack([*record.signals.values()]), finding.rate)
    choice = "rows" if smoother > 1 else "times"
    ask(
        finding,
        "clock",
        choice,
        f"the times jitter by {jitter:.3g} ms, and row by row the angles are {smoother:.3g} times "
        "as smooth as over the times",
    )


def pair(
    finding: Finding,
    time: np.ndarray,
    actual: np.ndarray,
    target: np.ndarray,
    joints: Sequence[str] = (),
    angle_unit: str | None = None,
    time_unit: str | None = None,
) -> None:
    """Add to ``finding`` what makes the commanded angles those of the measured ones (N, joints), or
    that they are, and the jumps of whole turns in them; ``time`` (N,) and angles are in the units
    that the file states, if any.
    """
    step = float(np.median(np.diff(time)))
    clock = spelled(time_unit or "") if spelled(time_unit or "") in TIME_UNITS else _time_unit(step)
    if clock is None:
        return
    time = (time - time[0]) * TIME_UNITS[clock]
    unit = spelled(angle_unit or "")
    if unit not in ANGLE_UNITS:
        unit = _angle_unit(float(np.abs(actual).max()))
        if unit == "deg" and "angle_unit" not in finding.facts.get("settings", {}):
            ask(finding, "angle_unit", unit, f"angles of {np.abs(actual).max():.4g} are no radians")
    factor = ANGLE_UNITS[unit]
    try:
        actual, removed = unwrapped(actual * factor, time, joints, signal="actual")
        target, more = unwrapped(target * factor, time, joints, signal="target")
    except PipelineError as error:
        finding.stops.append(error.message)
        return
    if removed + more:
        finding.gaps[UNWRAPPED] = removed + more
    turns = whole_turns(target, actual)
    if turns.any():
        actual = actual + TURN * turns
        finding.facts["joints_moved_by_whole_turns"] = int(np.count_nonzero(turns))
    rate = float(f"{(len(time) - 1) / time[-1]:.4g}")  # as it was meant
    pairing = pairing_of(actual, target, rate)
    for what, option, value, without in suspects(pairing, actual, target, rate):
        ask(
            finding,
            option.rpartition(".")[2],
            value,
            f"the command differs from the measured angles by its {what}: without that, "
            f"{without:.2g} of the motion is left",
        )
    actual, target = pairing.apply(actual, target)
    missing, late = float(missed(actual, target).max()), lag(target, actual, rate)
    finding.facts["command"] = (
        f"missed by {missing:.2g} of the motion and {1e3 * late:.2g} ms"
        if np.isfinite(late)
        else f"at rest, missed by {np.abs(actual - target).max():.2g} rad"
    )
    steps = np.maximum(*(np.abs(np.diff(angles, axis=0)) for angles in (actual, target)))
    steps = np.maximum(steps - STEP_NOISE, 0) * rate
    rows = steps.argmax(axis=0).tolist()
    finding.facts["fastest"] = [
        (float(steps[row, joint]), (row + 1) / rate) for joint, row in enumerate(rows)
    ]
    motions = excursions(target, commanded_speeds(target, rate))
    lacks = [run.lack(len(target)) for run in motions]
    finding.facts["motions"] = f"{lacks.count('')} whole"
    if cut := sum("cut off" in lack for lack in lacks):
        finding.gaps["motions_cut_off"] = cut
    if any("never rests" in lack for lack in lacks):
        ask(finding, "rest", "0", "the command never rests: a motion is cut in passing")
        if len(actual) > ORDER:
            finding.facts["noise"] = _noise(actual)


def _noise(angles: np.ndarray) -> float:
    """Standard deviation in rad of what white noise ``angles`` (N, joints) hold beside a smooth
    motion: by their differences of the order ORDER, the greatest over the joints.
    """
    gain = comb(2 * ORDER, ORDER)  # of the variance of white noise
    power = np.mean(np.diff(angles, ORDER, axis=0) ** 2, axis=0)
    return max(float(np.sqrt(power.max() / gain)), LEAST_NOISE)


def ask(finding: Finding, key: str, value: str, question: str) -> None:
    """Add a ``question`` that the option ``key`` of dataset.joint_log settles, with the ``value``
    that is suggested.
    """
    finding.facts.setdefault("settings", {})[key] = value
    finding.open.append((f"{question}; suggested is {value}", f"{OPTION}.{key}"))
