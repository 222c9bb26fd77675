"""Repetitions of one commanded motion, cut out of a controller's own logs, as tables."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.arm.commanded import trajectory_table
from pipeline.arm.interface import Chain
from pipeline.core.columns import spread
from pipeline.core.errors import RecordingError
from pipeline.core.options.dataset import Dataset
from pipeline.core.options.logs import JointLog
from pipeline.formats.patterns import matching
from pipeline.recordings.logged_movement import UNITS, read_logged_movement
from pipeline.recordings.pairing import require_pair
from pipeline.recordings.quality import quality_row
from pipeline.recordings.repetitions import (
    align,
    disturbances,
    excursions,
    find_passes,
    find_repetitions,
    in_phase,
    lag,
    stretch,
)


@dataclass(frozen=True)
class Take:
    """The chain's angles in the movement that a repetition was found in."""

    movement: str
    actual: np.ndarray  # (N, n) rad
    target: np.ndarray  # (N, n) rad
    first: int  # row at which the repetition starts


def joint_log_rows(
    raw: Path, dataset: Dataset, chain: Chain
) -> tuple[pd.DataFrame, pd.DataFrame, list[dict]]:
    """Desired trajectory and measured angles of every undisturbed repetition of the motion that the
    dataset asks for.

    The desired pose is that of the mean command over the repetitions. Before and after the motion
    it is held: a controller at rest logs the measured angle for the commanded one. Repetitions that
    follow each other without rest are brought in phase with the first, between the rows.
    """
    options, motion = dataset.joint_log, dataset.motion
    steps, length = motion.steps - 2 * options.rest, motion.steps + 1
    takes, observed, quality = _repetitions(raw, dataset, steps)
    if takes:
        first = next(iter(takes.values()))
        reference = first.target[first.first : first.first + steps + 1]
        place = align if options.rest else in_phase
        starts = {
            name: place(take.target, take.first, reference) - options.rest
            for name, take in takes.items()
        }
        actual, target = (
            {
                name: stretch(getattr(take, angles), starts[name], length)
                for name, take in takes.items()
            }
            for angles in ("actual", "target")
        )
        quality += [
            quality_row(name, "training", "joint log", "resampled_rows", length)
            for name, start in starts.items()
            if start != round(start)
        ]
        residuals = np.stack([actual[name] - target[name] for name in takes])
        left_out, result = _disturbed(takes, residuals, options, raw)
        quality += result
        takes = {name: take for name, take in takes.items() if name not in left_out}
        for name in takes:
            require_pair(
                actual[name],
                target[name],
                motion.rate,
                limit=options.mismatch,
                joints=dataset.robot.joints,
                file=raw,
                take=name,
            )
    if len(takes) < 2:
        raise RecordingError(
            f"{len(takes)} repetition(s) of a motion of {steps} steps from {list(options.start)} "
            f"to {list(options.end)} rad between "
            f"{options.rest} at rest, where the fits need two; the movements hold "
            f"{'; '.join(sorted(set(observed))) or 'no motion'}",
            file=raw,
            key="dataset.joint_log",
        )
    measured, commanded = (np.stack([rows[name] for name in takes]) for rows in (actual, target))
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
    moving_rows = max(options.rest - 1, 0), options.rest + steps
    held = command[np.clip(np.arange(length), *moving_rows)]
    k = np.tile(np.arange(length), len(takes))
    joints = pd.DataFrame(
        {
            "take": np.repeat(list(takes), length),
            "part": "training",
            "k": k,
            "t": k / motion.rate,
        }
    )
    joints = joints.assign(**spread("q", dataset.robot.joints, measured))
    return trajectory_table(chain, held, motion.rate, dataset.robot.joints), joints, quality


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
    raw: Path, dataset: Dataset, steps: int
) -> tuple[dict[str, Take], list[str], list[dict]]:
    """The repetitions by name; all motions in words; quality."""
    takes, observed, quality = {}, [], []
    options, rest = dataset.joint_log, dataset.joint_log.rest_speed
    chain = [options.joints.index(name) for name in dataset.robot.joints]
    movements = matching(raw, options.movements, key="dataset.joint_log.movements")
    if not movements:
        raise RecordingError(
            f"no folder or file of a movement matches {options.movements!r}", file=raw
        )
    for folder in movements:
        movement = read_logged_movement(folder, options, dataset.motion.rate)
        name, target = movement.name, movement.target
        if options.rest:
            repetitions = find_repetitions(
                target,
                movement.speed,
                chain,
                options.start,
                options.end,
                steps=steps,
                rest=options.rest,
                rest_speed=rest,
            )
        else:
            repetitions = find_passes(target[:, chain], options.start, options.end, steps)
        for number, run in enumerate(repetitions.runs, 1):
            take = f"{name}_{number}"
            rows = slice(max(run.first - options.rest, 0), run.last + options.rest + 1)
            movement.require_held(rows, dataset.robot.locked, file=folder, take=take)
            takes[take] = Take(name, movement.actual[:, chain], target[:, chain], run.first)
        motions = excursions(target, movement.speed, rest)
        observed += [run.describe(target[:, chain]) for run in motions if run.whole]
        if motions and not any(run.whole for run in motions):
            observed.append("a command that never rests, to be cut with rest: 0")
        counts = dict(movement.counts) | {"repetitions": len(repetitions.runs)}
        counts |= {
            f"excursions_{reason}": len(rows) for reason, rows in repetitions.left_out.items()
        }
        quality += [
            quality_row(name, "training", "joint log", key, value, UNITS.get(key, "count"))
            for key, value in counts.items()
        ]
        # a motion that was left out is named by the row it starts at
        named = [(reason, row) for reason, rows in repetitions.left_out.items() for row in rows]
        quality += [
            quality_row(name, "training", "joint log", f"{reason}_from_row", row, "row")
            for reason, row in named
        ]
    return takes, observed, quality
