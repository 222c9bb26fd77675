"""Repetitions of one motion cut out of a controller's logs, and encoders' logs, as tables."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.arm.commanded import trajectory_table
from pipeline.arm.interface import Chain
from pipeline.core.columns import spread
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.dataset import Dataset
from pipeline.core.options.instruments import JointLogSection
from pipeline.formats.joints.log import LogOptions
from pipeline.recordings import repetitions
from pipeline.recordings.commands import circular_joints
from pipeline.recordings.disturbances import beside_others, disturbances, smallest_push
from pipeline.recordings.inventory import named_takes
from pipeline.recordings.movement import (
    UNITS,
    LoggedMovement,
    beside,
    read_log,
    read_logged_movement,
    require_speeds,
)
from pipeline.recordings.pairing import require_pair
from pipeline.recordings.quality import LEFT_OUT, REPETITIONS, quality_row

KEY, RESIDUALS = "dataset.joint_log", "residuals"


class LoggedTake(NamedTuple):
    """A repetition in the rows of the ``movement`` of that name; it starts at the row ``first``."""

    movement: str
    first: int
    actual: np.ndarray  # (N, n) rad, measured angles of the chain
    target: np.ndarray  # (N, n) rad, commanded
    signals: Mapping[str, np.ndarray]  # (N, joints) RESIDUALS of all joints in rad, and others


def joint_log_rows(
    raw: Path, dataset: Dataset, chain: Chain
) -> tuple[pd.DataFrame, pd.DataFrame, list[dict]]:
    """Return the tables ``trajectory`` and ``joint_log`` of every undisturbed repetition of the
    motion of the dataset, and their quality.

    The desired pose is the mean command, held before and after the motion, as a controller at rest
    logs the measured angle for it. Repetitions without rest are brought in phase between the rows.
    """
    options, rate, joints = dataset.joint_log, dataset.motion.rate, dataset.robot.joints
    rest, length = options.rest, dataset.motion.steps + 1
    steps = dataset.motion.steps - 2 * rest
    takes, observed, quality = find_takes(raw, dataset, steps)
    note, rows = partial(_note, quality), {}
    if takes:
        first = next(iter(takes.values()))
        reference, place = (
            first.target[first.first :][: steps + 1],
            repetitions.align if rest else repetitions.in_phase,
        )
        circular = circular_joints(dataset.robot.urdf, joints)
        for name, take in takes.items():
            pair = beside(take.actual, take.target, take.first, reference[0], circular)
            start = place(pair[1], take.first, reference) - rest
            logged = dict(zip(("actual", "target"), pair, strict=True)) | take.signals
            rows[name] = {
                key: repetitions.stretch(each, start, length) for key, each in logged.items()
            }
            if start != round(start):
                note(name, "resampled_rows", length)
        for name in _disturbed(takes, rows, options, rate, raw, quality):
            del rows[name]
        for name, take in rows.items():
            evidence = {"limit": options.mismatch, "joints": joints, "file": raw, "take": name}
            require_pair(take["actual"], take["target"], rate, **evidence)
    if len(rows) < 2:
        message = (
            f"{len(rows)} repetition(s) of a motion of {steps} steps from {list(options.start)} "
            f"to {list(options.end)} rad between {rest} at rest, where the fits need two; the "
            f"movements hold {'; '.join(sorted(set(observed))) or 'no motion'}"
        )
        raise RecordingError(message, file=raw, key=KEY)
    measured, commanded = (
        np.stack([take[key] for take in rows.values()]) for key in ("actual", "target")
    )
    command, moving = commanded.mean(axis=0), slice(rest, rest + steps + 1)
    deviations = np.abs(commanded - command)[:, moving].max(axis=(1, 2))
    if np.any(deviations > options.tolerance):
        message = (
            f"the command is {deviations.max():.2g} rad off its mean over the takes, more than "
            f"{options.tolerance:g}: another motion?"
        )
        take = [*rows][int(deviations.argmax())]
        raise RecordingError(message, file=raw, take=take, key=f"{KEY}.tolerance")
    for take, q, deviation in zip(rows, measured, deviations, strict=True):
        note(take, "command_deviation", deviation, "rad")
        note(take, "lag_behind_command", repetitions.lag(command[moving], q[moving], rate), "s")
    # the commanded angle takes its first step one sample before the commanded speed is first logged
    held = command[np.clip(np.arange(length), max(rest - 1, 0), rest + steps)]
    k = np.tile(np.arange(length), len(rows))
    identity = {"take": np.repeat([*rows], length), "part": "training", "k": k, "t": k / rate}
    table = pd.DataFrame(identity | spread("q", joints, measured))
    return trajectory_table(chain, held, rate, joints), table, quality


def _note(quality: list[dict], take: str, quantity: str, value: float, unit: str = "count") -> None:
    quality.append(quality_row(take, "training", "joint log", quantity, value, unit))


def find_movements(raw: Path, dataset: Dataset) -> dict[str, Path]:
    """Return name → path of the movements' logs; RecordingError where there are none."""
    pattern = dataset.joint_log.movements
    if movements := named_takes(raw, pattern, key=f"{KEY}.movements"):
        return movements
    raise RecordingError(f"no folder or file of a movement matches {pattern!r}", file=raw)


def read_dataset_movement(name: str, place: Path, dataset: Dataset) -> LoggedMovement:
    """Read one of :func:`find_movements`; RecordingError also for steps that are too fast."""
    options, urdf, rate = dataset.joint_log, dataset.robot.urdf, dataset.motion.rate
    circular = circular_joints(urdf, options.joints)
    movement = read_logged_movement(name, place, options, rate, circular)
    angles = {"actual": movement.actual, "target": movement.target}
    clock = np.arange(len(movement.actual)) / rate
    require_speeds(clock, angles, options.joints, urdf, file=place)
    return movement


def find_takes(
    raw: Path, dataset: Dataset, steps: int
) -> tuple[dict[str, LoggedTake], list[str], list[dict]]:
    """Return the repetitions by name, all motions in words, and the quality of the movements."""
    takes, observed, quality, options = {}, [], [], dataset.joint_log
    columns, rest = [options.joints.index(name) for name in dataset.robot.joints], options.rest
    for name, place in find_movements(raw, dataset).items():
        movement = read_dataset_movement(name, place, dataset)
        target, residuals = movement.target, movement.actual - movement.target
        circular = np.broadcast_to(movement.circular, len(movement.joints))[columns]
        ends = options.start, options.end
        if rest:
            sought = {"steps": steps, "rest": rest, "rest_speed": options.rest_speed}
            sought |= {"circular": circular}
            found = repetitions.find_repetitions(target, movement.speed, columns, *ends, **sought)
        else:
            found = repetitions.find_passes(target[:, columns], *ends, steps, circular)
        for number, run in enumerate(found.runs, 1):
            take = f"{name}_{number}"
            rows = slice(max(run.first - rest, 0), run.last + rest + 1)
            movement.require_held(rows, dataset.robot.locked, file=place, take=take)
            angles = movement.actual[:, columns], target[:, columns]
            signals = {RESIDUALS: residuals} | movement.others
            takes[take] = LoggedTake(name, run.first, *angles, signals)
        for run in repetitions.excursions(target, movement.speed, options.rest_speed):
            if not (words := run.lack(len(target))):
                start, end = target[[run.first - 1, run.last]][:, columns].round(2).tolist()
                words = f"{start} to {end} in {run.steps} steps"
            observed.append(words)
        counts = dict(movement.counts) | {REPETITIONS: len(found.runs)}
        counts |= {f"{LEFT_OUT}{reason}": len(rows) for reason, rows in found.left_out.items()}
        for key, value in counts.items():
            _note(quality, name, key, value, UNITS.get(key, "count"))
        # a motion that was left out is named by the row it starts at
        for reason, rows in found.left_out.items():
            for row in rows:
                _note(quality, name, f"{reason}_from_row", row, "row")
    return takes, observed, quality


def _disturbed(
    takes: Mapping[str, LoggedTake],
    rows: Mapping[str, Mapping[str, np.ndarray]],
    options: JointLogSection,
    rate: float,
    raw: Path,
    quality: list[dict],
) -> set[str]:
    """Names of the disturbed takes by the signals (K, joints) in their ``rows``; their distances go
    to ``quality``. RecordingError where the option refuses disturbed ones.
    """
    signals = next(iter(takes.values())).signals
    residuals, *others = (np.stack([take[key] for take in rows.values()]) for key in signals)
    limit = np.inf if options.residual_limit is None else options.residual_limit
    note, result = partial(_note, quality), set()
    scores = disturbances(residuals, others, rate)
    distances, greatest = beside_others(residuals), np.abs(residuals).max(axis=(1, 2))
    for name, distance, score, largest in zip(takes, distances, scores, greatest, strict=True):
        note(name, "residual_beside_others", distance, "rad")
        note(name, "disturbance", score, "robust standard deviations")
        note(name, "greatest_residual", largest, "rad")
        if score <= options.disturbed_beyond and largest <= limit:
            continue
        row = takes[name].first
        if options.disturbed == "refuse":
            message = (
                f"the repetition from row {row} was disturbed: its residual, or another "
                f"signal, is {score:.3g} robust standard deviations from the median over the "
                f"repetitions; the residual is at most {largest:.3g} rad"
            )
            raise RecordingError(message, file=raw, take=name, key=f"{KEY}.disturbed")
        result.add(name)
        note(takes[name].movement, "disturbed_from_row", row, "row")
    sound = [name not in result for name in takes]
    push = smallest_push(residuals[sound], options.disturbed_beyond, rate)
    for name in dict.fromkeys(take.movement for take in takes.values()):
        if np.isfinite(push):
            note(name, "smallest_push_found", push, "rad")
    return result


def encoder_rows(raw: Path, dataset: Dataset) -> list[tuple[pd.DataFrame, list[dict]]]:
    """Return rows of the table ``encoders`` and quality of every log of encoders below ``raw``;
    RecordingError where none matches or is read, ConfigError for another number of joints.
    """
    options, joints, result = dataset.encoders, dataset.robot.joints, []
    if len(options.actual) != len(joints):
        message = f"{len(options.actual)} columns for the {len(joints)} joints {', '.join(joints)}"
        raise ConfigError(message, key="dataset.encoders.actual")
    read = LogOptions(
        **{key: getattr(options, key) for key in ("time", "angle_unit", "time_unit")},
        joints=len(joints),
        names=joints,
        signals={"actual": options.actual},
        circular=circular_joints(dataset.robot.urdf, joints),
    )
    for part in ("training", "test"):
        pattern, key = getattr(options, part), f"dataset.encoders.{part}"
        files = named_takes(raw, pattern, key=key)
        if not files:
            raise RecordingError(f"no log matches {pattern!r}", file=raw, key=key)
        for name, file in files.items():
            log = read_log(file, read)
            require_speeds(log.time, log.signals, joints, dataset.robot.urdf, file=file)
            identity = {"take": name, "part": part, "t": log.time - options.start}
            rows = pd.DataFrame(identity | spread("q", joints, log.signals["actual"]))
            counts = {"rows": len(rows)} | log.counts
            quality = [quality_row(name, part, "encoders", *row) for row in counts.items()]
            result.append((rows, quality))
    return result
