"""Repetitions of one commanded motion, cut out of a controller's own logs, as tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.arm.commanded import trajectory_table
from pipeline.arm.interface import Chain
from pipeline.core.columns import spread
from pipeline.core.errors import RecordingError
from pipeline.core.options.dataset import Dataset
from pipeline.recordings.disturbances import disturbed_takes
from pipeline.recordings.logged_movement import UNITS, Take, read_logged_movement
from pipeline.recordings.movement import require_speeds, sliding_joints, speed_limits
from pipeline.recordings.pairing import require_pair
from pipeline.recordings.quality import LEFT_OUT, REPETITIONS, quality_row
from pipeline.recordings.repetitions import (
    align,
    excursions,
    find_passes,
    find_repetitions,
    in_phase,
    lag,
    stretch,
)
from pipeline.recordings.take_names import named_takes


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
    takes, observed, quality = find_takes(raw, dataset, steps)
    if takes:
        first = next(iter(takes.values()))
        reference = first.target[first.first : first.first + steps + 1]
        takes = {name: take.beside(reference[0]) for name, take in takes.items()}
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
        logged = [take.logged(starts[name], length) for name, take in takes.items()]
        signals = {key: np.stack([held[key] for held in logged]) for key in logged[0]}
        left_out, result = disturbed_takes(takes, signals, options, motion.rate, raw)
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
        {"take": np.repeat(list(takes), length), "part": "training", "k": k, "t": k / motion.rate}
    )
    joints = joints.assign(**spread("q", dataset.robot.joints, measured))
    return trajectory_table(chain, held, motion.rate, dataset.robot.joints), joints, quality


def find_takes(
    raw: Path, dataset: Dataset, steps: int
) -> tuple[dict[str, Take], list[str], list[dict]]:
    """The repetitions by name; all motions in words; quality."""
    takes, observed, quality = {}, [], []
    options, rest = dataset.joint_log, dataset.joint_log.rest_speed
    chain = [options.joints.index(name) for name in dataset.robot.joints]
    urdf = dataset.robot.urdf
    limits, sliding = speed_limits(urdf), sliding_joints(urdf)
    movements = named_takes(raw, options.movements, key="dataset.joint_log.movements")
    if not movements:
        raise RecordingError(
            f"no folder or file of a movement matches {options.movements!r}", file=raw
        )
    for name, place in movements.items():
        movement = read_logged_movement(name, place, options, dataset.motion.rate, sliding)
        clock = np.arange(len(movement.actual)) / dataset.motion.rate
        angles = {"actual": movement.actual, "target": movement.target}
        require_speeds(clock, angles, options.joints, limits, file=place)
        target = movement.target
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
            movement.require_held(rows, dataset.robot.locked, file=place, take=take)
            takes[take] = Take(movement, name, chain, run.first)
        motions = excursions(target, movement.speed, rest)
        observed += [run.lack(len(target)) or run.describe(target[:, chain]) for run in motions]
        counts = dict(movement.counts) | {REPETITIONS: len(repetitions.runs)}
        counts |= {
            f"{LEFT_OUT}{reason}": len(rows) for reason, rows in repetitions.left_out.items()
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
