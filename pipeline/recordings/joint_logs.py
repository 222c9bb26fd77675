"""Repetitions of one commanded motion, cut out of a controller's own logs, as tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import schema
from pipeline.arm.model import Arm
from pipeline.arm.trajectory import trajectory_table
from pipeline.errors import RecordingError
from pipeline.instruments.joint_log import read_movement
from pipeline.perception.repetitions import align, excursions, find_repetitions, lag
from pipeline.recordings.quality import quality_row


def joint_log_rows(raw: Path, dataset: schema.Dataset, arm: Arm) -> tuple[pd.DataFrame, pd.DataFrame, list[dict]]:
    """Desired trajectory and measured angles of every repetition of the motion that the dataset asks for.

    The desired pose is that of the mean command over the repetitions. Before and after the motion it is held: a controller at rest
    logs the measured angle for the commanded one.
    """
    options, motion = dataset.joint_log, dataset.motion
    steps = motion.steps - 2 * options.rest
    takes, seen, quality = _repetitions(raw, options, motion.rate, steps)
    if len(takes) < 2:
        raise RecordingError(
            f"{len(takes)} repetition(s) of a motion of {steps} steps from {list(options.start)} to {list(options.end)} rad between "
            f"{options.rest} at rest, where the fits need two; the movements hold {'; '.join(sorted(set(seen))) or 'no motion'}",
            file=raw, key="dataset.joint_log",
        )  # fmt: skip
    _, target, first = next(iter(takes.values()))
    reference = target[first : first + steps + 1]
    starts = [align(target, first, reference) - options.rest for _, target, first in takes.values()]
    rows = [slice(start, start + motion.steps + 1) for start in starts]
    measured = np.stack([actual[window] for (actual, _, _), window in zip(takes.values(), rows, strict=True)])
    commanded = np.stack([target[window] for (_, target, _), window in zip(takes.values(), rows, strict=True)])
    command = commanded.mean(axis=0)
    moving = slice(options.rest, options.rest + steps + 1)
    deviations = np.abs(commanded - command)[:, moving].max(axis=(1, 2))
    if np.any(deviations > options.tolerance):
        raise RecordingError(
            f"the command is {deviations.max():.2g} rad off its mean over the takes, more than {options.tolerance:g}: another motion?",
            file=raw, take=list(takes)[int(deviations.argmax())], key="dataset.joint_log.tolerance",
        )  # fmt: skip
    for take, q, deviation in zip(takes, measured, deviations, strict=True):
        behind = lag(command[moving], q[moving], motion.rate)
        quality.append(quality_row(take, "training", "joint log", "command_deviation", deviation, "rad"))
        quality.append(quality_row(take, "training", "joint log", "lag_behind_command", behind, "s"))
    # the commanded angle takes its first step one sample before the commanded speed is first logged
    held = command[np.clip(np.arange(motion.steps + 1), options.rest - 1, options.rest + steps)]
    k = np.tile(np.arange(motion.steps + 1), len(takes))
    joints = pd.DataFrame({"take": np.repeat(list(takes), motion.steps + 1), "part": "training", "k": k, "t": k / motion.rate})
    joints = joints.assign(**{f"q{j + 1}": measured[..., j].ravel() for j in range(3)})
    return trajectory_table(arm.chain, held, motion.rate), joints, quality


def _repetitions(
    raw: Path, options: schema.JointLog, rate: float, steps: int
) -> tuple[dict[str, tuple[np.ndarray, np.ndarray, int]], list[str], list[dict]]:
    """By take: the chain's measured and commanded angles in its movement, and its first row; all motions in words; quality."""
    takes, seen, quality = {}, [], []
    chain = [column - 1 for column in options.columns]
    folders = sorted(path for path in raw.glob(options.movements) if path.is_dir())
    if not folders:
        raise RecordingError(f"no folder of a movement matches {options.movements!r}", file=raw)
    for folder in folders:
        files = (options.actual, options.target, options.speed)
        (actual, target, speed), counts = read_movement(folder, files, joints=options.joints, rate=rate)
        runs = find_repetitions(target, speed, chain, options.start, options.end, steps=steps, rest=options.rest)
        takes |= {f"{folder.name}_{number}": (actual[:, chain], target[:, chain], run.first) for number, run in enumerate(runs.found, 1)}
        seen += [run.describe(target[:, chain]) for run in excursions(target, speed) if run.whole]
        counts |= {"repetitions": len(runs.found)} | {f"excursions_{reason}": len(rows) for reason, rows in runs.left_out.items()}
        quality += [quality_row(folder.name, "training", "joint log", key, value) for key, value in counts.items()]
        # a motion that was left out is named by the row it starts at
        named = [(reason, row) for reason, rows in runs.left_out.items() for row in rows]
        quality += [quality_row(folder.name, "training", "joint log", f"{reason}_from_row", row) for reason, row in named]
    return takes, seen, quality
