"""What a controller's joint log says of itself, and whether the angles in it that were measured and
those that were commanded are a pair.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import comb
from pathlib import Path

import numpy as np

from pipeline.core.errors import PipelineError
from pipeline.formats.format import Format, Kind
from pipeline.formats.joints.log import OPTION, JointLog, LogOptions
from pipeline.formats.joints.table import read_joint_table
from pipeline.recordings.movement import CLOCK_TOLERANCE, MOST_TURNS, smoothness_by_rows
from pipeline.recordings.pairing import missed, pairing_of, suspects
from pipeline.recordings.repetitions import commanded_speeds, excursions, lag
from pipeline.tools.inspect.finding import Finding, counted

# words of a file's name that tell measured from commanded angles
ORDER = 6  # of the differences that show noise
LEAST_NOISE = 1e-8  # rad, where they show none
LIKE_SPEED = 0.1  # of the mean step of the angles, by which its speed may be off on average
MEASURED, COMMANDED = ("actual", "measured"), ("target", "commanded", "desired")


def log(form: Format, file: Path) -> Finding:
    """A log of the joints, with the signals that it holds."""
    finding, stated = Finding.read_by(form, file), form.states(file)
    finding.version, finding.units, finding.facts = stated.version, stated.units, stated.facts
    try:
        record = form.read(file, LogOptions())
    except PipelineError as error:
        return finding.refused(error)
    finding.duration = float(record.time[-1] - record.time[0])
    if finding.duration:
        finding.rate = round((len(record.time) - 1) / finding.duration, 3)
    finding.gaps = counted(record.counts, "cut_rows", "blank_rows", "doubled_rows")
    finding.facts |= {"samples": len(record.time), "signals": list(record.signals)}
    finding.facts |= {"joints": max(values.shape[1] for values in record.signals.values())}
    if record.joints:
        finding.facts["joint_names"] = list(record.joints)
    _clock(finding, record)
    if {"actual", "target"} <= {*record.signals}:
        _pair(finding, record.time, record.signals["actual"], record.signals["target"])
    return finding


def compare_tables(findings: Sequence[Finding]) -> None:
    """Hold tables against each other whose names differ in a word for measured and commanded alone,
    as ``q_actual.csv`` and ``q_target.csv``; what is found stands with the commanded ones.
    """
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
        _pair(commanded, logs[0].time[:length], *angles)


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


def _clock(finding: Finding, record: JointLog) -> None:
    """What the times of an uneven log ask."""
    steps = np.diff(record.time)
    if len(steps) < 4 or (np.abs(steps * finding.rate - 1) <= CLOCK_TOLERANCE).all():
        return
    jitter = 1e3 * float(steps.std())
    smoother = smoothness_by_rows(record.time, np.hstack([*record.signals.values()]), finding.rate)
    choice = "rows" if smoother > 1 else "times"
    _ask(
        finding,
        "clock",
        choice,
        f"the times jitter by {jitter:.3g} ms, and row by row the angles are {smoother:.3g} times "
        "as smooth as over the times",
    )


def _pair(finding: Finding, time: np.ndarray, actual: np.ndarray, target: np.ndarray) -> None:
    """What makes the commanded angles those of the measured ones, or that they are."""
    rate = float(f"{(len(time) - 1) / (time[-1] - time[0]):.4g}")  # as it was meant
    pairing = pairing_of(actual, target, rate)
    for what, option, value, without in suspects(pairing, actual, target, rate):
        _ask(
            finding,
            option.rpartition(".")[2],
            value,
            f"the command differs from the measured angles by its {what}: without that, "
            f"{without:.2g} of the motion is left",
        )
    actual, target = pairing.apply(actual, target)
    if np.abs(actual).max() > MOST_TURNS * 2 * np.pi:
        _ask(finding, "angle_unit", "deg", f"angles of {np.abs(actual).max():.4g} are no radians")
    missing, late = float(missed(actual, target).max()), lag(target, actual, rate)
    finding.facts["command"] = (
        f"missed by {missing:.2g} of the motion and {1e3 * late:.2g} ms"
        if np.isfinite(late)
        else f"at rest, missed by {np.abs(actual - target).max():.2g} rad"
    )
    motions = excursions(target, commanded_speeds(target, rate))
    lacks = [run.lack(len(target)) for run in motions]
    finding.facts["motions"] = f"{lacks.count('')} whole"
    if cut := sum("cut off" in lack for lack in lacks):
        finding.gaps["motions_cut_off"] = cut
    if any("never rests" in lack for lack in lacks):
        _ask(finding, "rest", "0", "the command never rests: a motion is cut in passing")
        if len(actual) > ORDER:
            finding.facts["noise"] = _noise(actual)


def _noise(angles: np.ndarray) -> float:
    """Standard deviation in rad of what white noise ``angles`` (N, joints) hold beside a smooth
    motion: by their differences of the order ORDER, the greatest over the joints.
    """
    gain = comb(2 * ORDER, ORDER)  # of the variance of white noise
    power = np.mean(np.diff(angles, ORDER, axis=0) ** 2, axis=0)
    return max(float(np.sqrt(power.max() / gain)), LEAST_NOISE)


def _ask(finding: Finding, key: str, value: str, question: str) -> None:
    finding.facts.setdefault("settings", {})[key] = value
    finding.open.append((f"{question}; suggested is {value}", f"{OPTION}.{key}"))
