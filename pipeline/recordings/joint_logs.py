"""Repetitions of one commanded motion, cut out of a controller's own logs, as tables."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.arm.commanded import trajectory_table
from pipeline.arm.model import Arm
from pipeline.core.columns import spread
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.dataset import Dataset
from pipeline.core.options.logs import SIGNALS, JointLog
from pipeline.formats.joints.log import LogOptions
from pipeline.formats.patterns import matching
from pipeline.recordings.commands import task_columns
from pipeline.recordings.movement import read_movement
from pipeline.recordings.quality import quality_row
from pipeline.recordings.repetitions import (
    align,
    commanded_speeds,
    disturbances,
    excursions,
    find_repetitions,
    lag,
)


@dataclass(frozen=True)
class Take:
    """The chain's angles in the movement that a repetition was found in."""

    movement: str
    actual: np.ndarray  # (N, 3) rad
    target: np.ndarray  # (N, 3) rad
    first: int  # row at which the repetition starts to move


def joint_log_rows(
    raw: Path, dataset: Dataset, arm: Arm
) -> tuple[pd.DataFrame, pd.DataFrame, list[dict]]:
    """Desired trajectory and measured angles of every undisturbed repetition of the motion that the
    dataset asks for.

    The desired pose is that of the mean command over the repetitions. Before and after the motion
    it is held: a controller at rest logs the measured angle for the commanded one.
    """
    options, motion = dataset.joint_log, dataset.motion
    steps = motion.steps - 2 * options.rest
    takes, observed, quality = _repetitions(raw, options, motion.rate, steps)
    if takes:
        first = next(iter(takes.values()))
        reference = first.target[first.first : first.first + steps + 1]
        starts = {
            name: align(take.target, take.first, reference) - options.rest
            for name, take in takes.items()
        }
        rows = {name: slice(start, start + motion.steps + 1) for name, start in starts.items()}
        residuals = np.stack(
            [(take.actual - take.target)[rows[name]] for name, take in takes.items()]
        )
        left_out, result = _disturbed(takes, residuals, options, raw)
        quality += result
        takes = {name: take for name, take in takes.items() if name not in left_out}
    if len(takes) < 2:
        raise RecordingError(
            f"{len(takes)} repetition(s) of a motion of {steps} steps from {list(options.start)} "
            f"to {list(options.end)} rad between "
            f"{options.rest} at rest, where the fits need two; the movements hold "
            f"{'; '.join(sorted(set(observed))) or 'no motion'}",
            file=raw,
            key="dataset.joint_log",
        )
    measured = np.stack([take.actual[rows[name]] for name, take in takes.items()])
    commanded = np.stack([take.target[rows[name]] for name, take in takes.items()])
    command = commanded.mean(axis=0)
    moving = slice(options.rest, options.rest + steps + 1)
    deviations = np.abs(commanded - command)[:, moving].max(axis=(1, 2))
    if np.any(deviations > options.tolerance):
        raise RecordingError(
            f"the command is {deviations.max():.2g} rad off its mean over the takes, more than "
            f"{options.tolerance:g}: another motion?",
            file=raw,
            take=list(takes)[int(deviations.argmax())],
            key="dataset.joint_log.tolerance",
        )
    for take, q, deviation in zip(takes, measured, deviations, strict=True):
        behind = lag(command[moving], q[moving], motion.rate)
        quality.append(
            quality_row(take, "training", "joint log", "command_deviation", deviation, "rad")
        )
        quality.append(
            quality_row(take, "training", "joint log", "lag_behind_command", behind, "s")
        )
    # the commanded angle takes its first step one sample before the commanded speed is first logged
    held = command[np.clip(np.arange(motion.steps + 1), options.rest - 1, options.rest + steps)]
    k = np.tile(np.arange(motion.steps + 1), len(takes))
    joints = pd.DataFrame(
        {
            "take": np.repeat(list(takes), motion.steps + 1),
            "part": "training",
            "k": k,
            "t": k / motion.rate,
        }
    )
    joints = joints.assign(**spread("q", dataset.robot.joints, measured))
    return task_columns(trajectory_table(arm.chain, held, motion.rate)), joints, quality


def _disturbed(
    takes: dict[str, Take], residuals: np.ndarray, options: JointLog, raw: Path
) -> tuple[set[str], list[dict]]:
    """Names of the disturbed takes, and how far each take is from the others; RecordingError where
    the option refuses disturbed ones.
    """
    limit = np.inf if options.residual_limit is None else options.residual_limit
    result, quality = set(), []
    for (name, take), residual, distance, score in zip(
        takes.items(), residuals, *disturbances(residuals), strict=True
    ):
        largest = np.abs(residual).max()
        quality.append(
            quality_row(name, "training", "joint log", "residual_beside_others", distance, "rad")
        )
        quality.append(
            quality_row(
                name, "training", "joint log", "disturbance", score, "robust standard deviations"
            )
        )
        quality.append(
            quality_row(name, "training", "joint log", "greatest_residual", largest, "rad")
        )
        if score <= options.disturbed_beyond and largest <= limit:
            continue
        if options.disturbed == "refuse":
            raise RecordingError(
                f"the repetition from row {take.first} was disturbed: its residual is "
                f"{score:.3g} robust standard deviations from the "
                "median over the repetitions, at most "
                f"{largest:.3g} rad",
                file=raw,
                take=name,
                key="dataset.joint_log.disturbed",
            )
        result.add(name)
        quality.append(
            quality_row(
                take.movement, "training", "joint log", "disturbed_from_row", take.first, "row"
            )
        )
    return result, quality


def _repetitions(
    raw: Path, options: JointLog, rate: float, steps: int
) -> tuple[dict[str, Take], list[str], list[dict]]:
    """The repetitions by name; all motions in words; quality."""
    takes, observed, quality = {}, [], []
    chain = [column - 1 for column in options.columns]
    movements = matching(raw, options.movements, key="dataset.joint_log.movements")
    if not movements:
        raise RecordingError(
            f"no folder or file of a movement matches {options.movements!r}", file=raw
        )
    for movement in movements:
        actual, target, speed, counts = _read(movement, options, rate)
        rest = options.rest_speed
        repetitions = find_repetitions(
            target,
            speed,
            chain,
            options.start,
            options.end,
            steps=steps,
            rest=options.rest,
            rest_speed=rest,
        )
        name = movement.name if movement.is_dir() else movement.stem
        takes |= {
            f"{name}_{number}": Take(name, actual[:, chain], target[:, chain], run.first)
            for number, run in enumerate(repetitions.runs, 1)
        }
        observed += [
            run.describe(target[:, chain]) for run in excursions(target, speed, rest) if run.whole
        ]
        counts |= {"repetitions": len(repetitions.runs)} | {
            f"excursions_{reason}": len(rows) for reason, rows in repetitions.left_out.items()
        }
        quality += [
            quality_row(name, "training", "joint log", key, value) for key, value in counts.items()
        ]
        # a motion that was left out is named by the row it starts at
        named = [(reason, row) for reason, rows in repetitions.left_out.items() for row in rows]
        quality += [
            quality_row(name, "training", "joint log", f"{reason}_from_row", row, "row")
            for reason, row in named
        ]
    return takes, observed, quality


def _read(
    movement: Path, options: JointLog, rate: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, int]]:
    """Measured and commanded angles and commanded speeds (N, joints) of a folder of logs, or of one
    file that is a movement.
    """
    wanted: dict[Path, dict] = {movement: options.signals} if movement.is_file() else {}
    if movement.is_dir():
        for signal in SIGNALS:
            if file := getattr(options, signal):
                columns = wanted.setdefault(movement / file, {})
                columns[signal] = options.signals.get(signal)
    common = LogOptions(
        options.time,
        rate,
        options.separator,
        options.decimal,
        options.angle_unit,
        options.time_unit,
        options.joints,
    )
    files = {file: replace(common, signals=signals) for file, signals in wanted.items()}
    signals, counts = read_movement(files, rate) if files else ({}, {})
    if missing := [signal for signal in ("actual", "target") if signal not in signals]:
        where = "signals" if movement.is_file() else " and ".join(missing)
        raise ConfigError(
            f"nothing says where {movement.name} holds the {' and '.join(missing)} angles",
            key=f"dataset.joint_log.{where}",
        )
    actual, target = signals["actual"], signals["target"]
    if "speed" in signals:
        return actual, target, signals["speed"], counts
    speed = commanded_speeds(target, rate, options.rest_speed)
    return actual, target, speed, counts | {"speed_from_angles": 1}
