"""Tables of the repetitions of one motion in a controller's logs, and of encoders' logs."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.arm.interface import trajectory_table
from pipeline.arm.model import chain_of
from pipeline.core.angles import TURN, apart, turns_apart
from pipeline.core.columns import spread
from pipeline.core.errors import RecordingError
from pipeline.core.options.dataset import Dataset
from pipeline.formats.joints.log import OPTION, LogOptions
from pipeline.recordings import movement, repetitions
from pipeline.recordings.commands import (
    UNFILLED,
    circular_joints,
    require_pair,
    wrong_commands,
)
from pipeline.recordings.inventory import named_takes, raw_folder
from pipeline.recordings.lags import REACH, in_phase, lag, stretch
from pipeline.recordings.movement import LoggedMovement
from pipeline.recordings.quality import (
    LEFT_OUT,
    REPETITIONS,
    compare_takes,
    quality_row,
)
from pipeline.recordings.repetitions import SLACK


class LoggedTake(NamedTuple):
    """One repetition of the dataset's motion in a movement of N rows."""

    movement: str  # name of the movement
    first: int  # row at which the repetition starts
    actual: np.ndarray  # (N, n) rad, measured angles of the chain
    target: np.ndarray  # (N, n) rad, commanded


def read_dataset_movement(name: str, place: Path, dataset: Dataset) -> LoggedMovement:
    """Return the movement ``name`` in ``place``; see :func:`movement.read_logged_movement`."""
    log, rate = dataset.joint_log, dataset.motion.rate
    urdf = UNFILLED if dataset.robot is None else dataset.robot.urdf
    return movement.read_logged_movement(name, place, log, rate, urdf)


def read_movements(
    dataset: Dataset, guard: Callable[[], AbstractContextManager] = nullcontext
) -> dict[str, LoggedMovement]:
    """Return name → movement of all logs of the ``dataset``, each read in a context of ``guard``.
    RecordingError where there is no log.
    """
    pattern, movements = dataset.joint_log.movements, {}
    wanted = {"what": "folder or file of a movement", "key": f"{OPTION}.movements"}
    for name, place in named_takes(
        raw_folder(dataset.recordings), pattern, **wanted
    ).items():
        with guard():
            movements[name] = read_dataset_movement(name, place, dataset)
    return movements


def joint_log_rows(
    movements: Mapping[str, LoggedMovement], dataset: Dataset
) -> tuple[pd.DataFrame, pd.DataFrame, list[dict]]:
    """Return the tables ``trajectory`` and ``joint_log`` of the undisturbed repetitions of the
    dataset's motion in the ``movements``, and the quality rows.

    The desired pose is the mean command. Before and after the motion it is constant, since a
    controller at rest logs the measured angle as command. Repetitions without rest are shifted to
    equal phase by interpolation. Raises RecordingError for fewer than two repetitions, and where
    commands differ.
    """
    options, rate, joints = dataset.joint_log, dataset.motion.rate, dataset.robot.joints
    rest, length, raw = (
        options.rest,
        dataset.motion.steps + 1,
        raw_folder(dataset.recordings),
    )
    steps = dataset.motion.steps - 2 * rest
    takes, observed, notes = find_takes(movements, dataset)
    rows, residuals, reference = {}, {}, None
    for name, take in takes.items():
        read = movements[take.movement]
        if reference is None:
            reference = take.target[take.first :][: steps + 1]
        circular = read.of(joints).circular
        turns = TURN * turns_apart(reference[0], take.target[take.first], circular)
        actual, target = take.actual + turns, take.target + turns
        start = in_phase(target, take.first, reference, SLACK, whole=rest > 0)
        rows[name] = [stretch(q, start - rest, length) for q in (actual, target)]
        residuals[name] = stretch(read.actual - read.target, start - rest, length)
        notes += [(name, "resampled_rows", length)] if start != round(start) else []
    if rows:
        errors = np.stack([*residuals.values()])
        angles = np.stack([actual for actual, _ in rows.values()])
        measures = compare_takes(angles, errors, rate, dataset.limits.likeness)
        measures["greatest_residual"] = np.abs(errors).max(axis=(1, 2)), "rad"
        for quantity, (of_takes, unit) in measures.items():
            notes += [
                (n, quantity, v, unit) for n, v in zip(takes, of_takes, strict=True)
            ]
        limit, (scores, _) = dataset.limits.disturbance, measures["disturbance"]
        for (name, take), score in zip(takes.items(), scores, strict=True):
            if limit is not None and score > limit:
                del rows[name]
                notes.append((take.movement, "disturbed_from_row", take.first, "row"))
    for name, pair in rows.items():
        require_pair(*pair, rate, options.mismatch, joints, file=raw, take=name)
    if len(rows) < 2:
        message = f"{len(rows)} repetition(s) found, at least two required, of the motion from"
        message += f" {[*options.start]} to {[*options.end]} rad in {steps} steps between {rest} of"
        message += f" rest; the movements hold {'; '.join(sorted(set(observed))) or 'no motion'}"
        raise RecordingError(message, file=raw, key=OPTION)
    measured, commanded = np.stack([*rows.values()], axis=1)
    command, moving = commanded.mean(axis=0), slice(rest, rest + steps + 1)
    deviations = np.abs(commanded - command)[:, moving].max(axis=(1, 2))
    if np.any(deviations > options.tolerance):
        message = f"the command is {deviations.max():.2g} rad off its mean over the takes, above"
        message += f" {options.tolerance:g}: set tolerance, or leave out takes of another motion"
        take = [*rows][int(deviations.argmax())]
        raise RecordingError(message, file=raw, take=take, key=f"{OPTION}.tolerance")
    for take, q, deviation in zip(rows, measured, deviations, strict=True):
        notes.append((take, "command_deviation", deviation, "rad"))
        notes.append(
            (take, "lag_behind_command", lag(command[moving], q[moving], rate), "s")
        )
    quality = [
        quality_row(take, "training", "joint log", *note) for take, *note in notes
    ]
    # the commanded angle changes one sample before the commanded speed is first logged
    desired = command[np.clip(np.arange(length), max(rest - 1, 0), rest + steps)]
    k = np.tile(np.arange(length), len(rows))
    identity = {
        "take": np.repeat([*rows], length),
        "part": "training",
        "k": k,
        "t": k / rate,
    }
    table = pd.DataFrame(identity | spread("q", joints, measured))
    return (
        trajectory_table(chain_of(dataset.robot), desired, rate, joints),
        table,
        quality,
    )


def count_rows(name: str, counts: Mapping[str, float]) -> list[dict]:
    """Return the quality rows of the ``counts`` of the movement ``name``."""
    notes = [(key, n, movement.UNITS.get(key, "count")) for key, n in counts.items()]
    return [quality_row(name, "training", "joint log", *note) for note in notes]


def find_takes(
    movements: Mapping[str, LoggedMovement], dataset: Dataset
) -> tuple[dict[str, LoggedTake], list[str], list[tuple]]:
    """Return name → repetition, descriptions of all motions, and notes on the movements (name, and
    quantity, value and unit of a quality row).

    Raises RecordingError where a locked joint moves in a repetition.
    """
    takes, observed, notes, options = {}, [], [], dataset.joint_log
    rest, ends = options.rest, (options.start, options.end)
    for name, read in movements.items():
        own, steps = read.of(dataset.robot.joints), dataset.motion.steps - 2 * rest
        log = own.target, read.motions, ends, steps, rest, own.circular
        runs, left_out = repetitions.find_repetitions(*log)
        rows_of_faults = [fault.row for fault in wrong_commands(own.actual, own.target)]
        wrong = [
            run
            for run in runs
            if any(run.first - rest <= row <= run.last + rest for row in rows_of_faults)
        ]
        if wrong:
            runs = [run for run in runs if run not in wrong]
            left_out = left_out | {"wrong_command": [run.first for run in wrong]}
        for number, run in enumerate(runs, 1):
            take, rows = (
                f"{name}_{number}",
                slice(max(run.first - rest, 0), run.last + rest + 1),
            )
            _require_locked(read, rows, dataset, take)
            takes[take] = LoggedTake(name, run.first, own.actual, own.target)
        for run in read.motions:
            if not (words := run.lack(len(read.target))):
                start, end = own.target[[run.first - 1, run.last]].round(2).tolist()
                words = f"{start} to {end} in {run.steps} steps"
            observed.append(words)
        counts = dict(read.counts) | {REPETITIONS: len(runs)}
        counts |= {
            f"{LEFT_OUT}{reason}": len(rows) for reason, rows in left_out.items()
        }
        notes += [
            (name, key, n, movement.UNITS.get(key, "count"))
            for key, n in counts.items()
        ]
        # the first row identifies a motion that is left out
        for reason, rows in left_out.items():
            notes += [(name, f"{reason}_from_row", row, "row") for row in rows]
    return takes, observed, notes


def _require_locked(
    read: LoggedMovement, rows: slice, dataset: Dataset, take: str
) -> None:
    """Raise RecordingError where a joint is more than REACH off its locked angle in ``rows``."""
    for joint, angle in sorted(dataset.robot.locked.items()):
        if joint not in read.joints:
            continue
        one = read.of([joint])
        measured = one.actual[rows]
        if np.abs(apart(measured, angle, one.circular)).max() > REACH:
            message = f"{joint} is locked at {angle:.4g} rad, but was logged from"
            message += f" {measured.min():.4g} to {measured.max():.4g} rad: lock it at the logged"
            message += " angle, or choose a motion in which it does not move"
            where = {"file": dataset.recordings, "take": take}
            raise RecordingError(message, **where, key=f"dataset.robot.locked.{joint}")


def encoder_rows(raw: Path, dataset: Dataset) -> list[tuple[pd.DataFrame, list[dict]]]:
    """Return the rows of the table ``encoders`` and the quality rows per log, training first."""
    options, joints, urdf, result = (
        dataset.encoders,
        dataset.robot.joints,
        dataset.robot.urdf,
        [],
    )
    stated = {key: getattr(options, key) for key in ("time", "angle_unit", "time_unit")}
    stated |= {
        "names": joints,
        "joints": len(joints),
        "signals": {"actual": options.actual},
    }
    read = LogOptions(**stated, circular=circular_joints(urdf, joints))
    for part in ("training", "test"):
        pattern, key = getattr(options, part), f"dataset.encoders.{part}"
        for name, file in named_takes(raw, pattern, key=key, what="log").items():
            log = movement.read_log(file, read)
            movement.require_speeds(log.time, log.signals, joints, urdf, file=file)
            identity = {"take": name, "part": part, "t": log.time - options.start}
            rows = pd.DataFrame(identity | spread("q", joints, log.signals["actual"]))
            counts = {"rows": len(rows)} | log.counts
            quality = [
                quality_row(name, part, "encoders", *row) for row in counts.items()
            ]
            result.append((rows, quality))
    return result
