"""Tables of the repetitions of one motion in a controller's logs, and of encoders' logs."""

from collections.abc import Callable, Iterator, Mapping, Sequence
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
from pipeline.recordings import movement
from pipeline.recordings.commands import (
    UNFILLED,
    circular_joints,
    require_pair,
    wrong_commands,
)
from pipeline.recordings.inventory import named_takes, raw_folder
from pipeline.recordings.lags import REACH, in_phase, lag, stretch
from pipeline.recordings.movement import LoggedMovement
from pipeline.recordings.paths import thinned
from pipeline.recordings.quality import (
    LEFT_OUT,
    REPETITIONS,
    compare_takes,
    quality_row,
    quality_rows,
)
from pipeline.recordings.repetitions import (
    SLACK,
    Excursion,
    Repetitions,
    find_repetitions,
)


class LoggedTake(NamedTuple):
    """One repetition of the dataset's motion in a movement of N rows."""

    movement: str  # name of the movement
    first: int  # row at which the repetition starts
    actual: np.ndarray  # (N, n) rad, measured angles of the chain
    target: np.ndarray  # (N, n) rad, commanded


def read_dataset_movement(name: str, place: Path, dataset: Dataset) -> LoggedMovement:
    """Return the movement ``name`` in ``place``; see :func:`movement.read_logged_movement`."""
    log = dataset.joint_log
    rate = dataset.motion.rate
    urdf = UNFILLED if dataset.robot is None else dataset.robot.urdf
    return movement.read_logged_movement(name, place, log, rate, urdf)


def read_movements(
    dataset: Dataset,
    guard: Callable[[], AbstractContextManager] = nullcontext,
) -> dict[str, LoggedMovement]:
    """Return name → movement of all logs of the ``dataset``, each read in a context of ``guard``.
    RecordingError where there is no log.
    """
    places = named_takes(
        raw_folder(dataset.recordings),
        dataset.joint_log.movements,
        key=f"{OPTION}.movements",
        what="folder or file of a movement",
    )
    movements = {}
    for name, place in places.items():
        with guard():
            movements[name] = read_dataset_movement(name, place, dataset)
    return movements


class AlignedTake(NamedTuple):
    """One repetition on the K rows of the motion grid, in phase with the first repetition."""

    measured: np.ndarray  # (K, n) rad, angles of the chain
    commanded: np.ndarray  # (K, n) rad
    error: np.ndarray  # (K, joints) rad, measured minus commanded, of all logged joints
    is_resampled: bool


class JointLogTables(NamedTuple):
    """Tables of the repetitions of a dataset's motion, and rows of the table ``quality``."""

    trajectory: pd.DataFrame
    joint_log: pd.DataFrame
    disturbed_log: pd.DataFrame  # repetitions beyond the limit of the disturbance
    quality: list[dict]


def joint_log_rows(
    movements: Mapping[str, LoggedMovement],
    dataset: Dataset,
) -> JointLogTables:
    """Return the tables of the repetitions of the dataset's motion in the ``movements``.

    The desired pose is the mean command of the undisturbed repetitions. Before and after the
    motion it is constant, since a controller at rest logs the measured angle as command.
    Repetitions without rest are shifted to equal phase by interpolation. Raises RecordingError for
    fewer than two undisturbed repetitions, and where commands differ.
    """
    rate = dataset.motion.rate
    rest = dataset.joint_log.rest
    takes, observed, notes = find_takes(movements, dataset)
    aligned = align_takes(takes, movements, dataset)
    for name, take in aligned.items():
        if take.is_resampled:
            notes.append((name, "resampled_rows", len(take.measured)))

    disturbed = {}
    if aligned:
        measures = _measures_of(aligned, dataset)
        for quantity, (of_takes, unit) in measures.items():
            for name, value in zip(takes, of_takes, strict=True):
                notes.append((name, quantity, value, unit))
        disturbed = _disturbed_takes(aligned, measures["disturbance"][0], dataset)
    for name in disturbed:
        first = takes[name].first
        notes.append((takes[name].movement, "disturbed_from_row", first, "row"))

    undisturbed = {name: aligned[name] for name in aligned if name not in disturbed}
    _require_repetitions(undisturbed, observed, dataset)
    command = np.stack([take.commanded for take in undisturbed.values()]).mean(axis=0)
    deviations = _command_deviations(undisturbed, command, dataset)
    moving = _moving_rows(dataset)
    for name, take in undisturbed.items():
        late = lag(command[moving], take.measured[moving], rate)
        notes.append((name, "command_deviation", deviations[name], "rad"))
        notes.append((name, "lag_behind_command", late, "s"))

    # the commanded angle changes one sample before the commanded speed is first logged
    first_row = max(rest - 1, 0)
    last_row = moving.stop - 1
    held = np.clip(np.arange(len(command)), first_row, last_row)
    chain = chain_of(dataset.robot)
    joints = dataset.robot.joints
    return JointLogTables(
        trajectory_table(chain, command[held], rate, joints),
        _take_rows(undisturbed, dataset),
        _take_rows(disturbed, dataset),
        [quality_row(take, "training", "joint log", *note) for take, *note in notes],
    )


def _moving_rows(dataset: Dataset) -> slice:
    """Return the rows of the motion grid from the start to the end of the motion."""
    rest = dataset.joint_log.rest
    return slice(rest, dataset.motion.steps - rest + 1)


def align_takes(
    takes: Mapping[str, LoggedTake],
    movements: Mapping[str, LoggedMovement],
    dataset: Dataset,
) -> dict[str, AlignedTake]:
    """Return name → repetition in phase and whole turns with the command of the first of the
    ``takes``, with ``rest`` rows before and after the motion.
    """
    rest = dataset.joint_log.rest
    length = dataset.motion.steps + 1
    aligned = {}
    reference = None
    for name, take in takes.items():
        movement_log = movements[take.movement]
        if reference is None:
            reference = take.target[take.first :][: length - 2 * rest]
        circular = movement_log.of(dataset.robot.joints).circular
        first_command = take.target[take.first]
        turns = TURN * turns_apart(reference[0], first_command, circular)
        target = take.target + turns
        start = in_phase(target, take.first, reference, SLACK, whole=rest > 0)
        errors = movement_log.actual - movement_log.target
        aligned[name] = AlignedTake(
            stretch(take.actual + turns, start - rest, length),
            stretch(target, start - rest, length),
            stretch(errors, start - rest, length),
            is_resampled=start != round(start),
        )
    return aligned


def _measures_of(
    aligned: Mapping[str, AlignedTake],
    dataset: Dataset,
) -> dict[str, tuple[np.ndarray, str]]:
    """Return quantity → values (takes,) and unit of :func:`compare_takes`, and greatest error."""
    errors = np.stack([take.error for take in aligned.values()])
    angles = np.stack([take.measured for take in aligned.values()])
    limit = dataset.limits.likeness
    measures = compare_takes(angles, errors, dataset.motion.rate, limit)
    measures["greatest_residual"] = np.abs(errors).max(axis=(1, 2)), "rad"
    return measures


def _disturbed_takes(
    aligned: Mapping[str, AlignedTake],
    scores: np.ndarray,
    dataset: Dataset,
) -> dict[str, AlignedTake]:
    """Return the repetitions whose disturbance ``scores`` (takes,) are beyond the limit."""
    limit = dataset.limits.disturbance
    if limit is None:
        return {}
    beyond = zip(aligned.items(), scores > limit, strict=True)
    return dict(item for item, is_disturbed in beyond if is_disturbed)


def _require_repetitions(
    takes: Mapping[str, AlignedTake],
    observed: list[str],
    dataset: Dataset,
) -> None:
    """Raise RecordingError where measured and commanded angles of a repetition disagree, and for
    fewer than two repetitions, with the ``observed`` motions.
    """
    options = dataset.joint_log
    rate = dataset.motion.rate
    joints = dataset.robot.joints
    raw = raw_folder(dataset.recordings)
    for name, take in takes.items():
        pair = take.measured, take.commanded
        require_pair(*pair, rate, options.mismatch, joints, file=raw, take=name)
    if len(takes) >= 2:
        return
    steps = dataset.motion.steps - 2 * options.rest
    motions = "; ".join(sorted(set(observed))) or "no motion"
    raise RecordingError(
        f"{len(takes)} repetition(s) found, at least two required, of the motion from "
        f"{[*options.start]} to {[*options.end]} rad in {steps} steps between "
        f"{options.rest} of rest; the movements hold {motions}",
        file=raw,
        key=OPTION,
    )


def _command_deviations(
    takes: Mapping[str, AlignedTake],
    command: np.ndarray,
    dataset: Dataset,
) -> dict[str, float]:
    """Return name → greatest distance in rad of a repetition's command from the mean ``command``
    (K, n) in motion; RecordingError beyond the option ``tolerance``.
    """
    moving = _moving_rows(dataset)
    tolerance = dataset.joint_log.tolerance
    deviations = {}
    for name, take in takes.items():
        deviations[name] = np.abs(take.commanded - command)[moving].max()
    farthest = max(deviations, key=deviations.get)
    if deviations[farthest] > tolerance:
        raise RecordingError(
            f"the command is {deviations[farthest]:.2g} rad off its mean over the takes, "
            f"above {tolerance:g}: set tolerance, or leave out takes of another motion",
            file=raw_folder(dataset.recordings),
            take=farthest,
            key=f"{OPTION}.tolerance",
        )
    return deviations


def _take_rows(takes: Mapping[str, AlignedTake], dataset: Dataset) -> pd.DataFrame:
    """Return the rows of the table ``joint_log`` of the ``takes``."""
    length = dataset.motion.steps + 1
    joints = dataset.robot.joints
    k = np.tile(np.arange(length), len(takes))
    identity = {
        "take": np.repeat(np.array([*takes], dtype=str), length),
        "part": "training",
        "k": k,
        "t": k / dataset.motion.rate,
    }
    measured = [take.measured for take in takes.values()]
    angles = np.stack(measured) if measured else np.empty((0, length, len(joints)))
    return pd.DataFrame(identity | spread("q", joints, angles))


def count_rows(name: str, counts: Mapping[str, float]) -> list[dict]:
    """Return the quality rows of the ``counts`` of the movement ``name``."""
    return quality_rows(name, "training", "joint log", _with_units(counts))


def _with_units(counts: Mapping[str, float]) -> Iterator[tuple[str, float, str]]:
    """Yield quantity, value and unit of each of the ``counts`` of a movement."""
    for quantity, count in counts.items():
        yield quantity, count, movement.UNITS.get(quantity, "count")


def movement_paths(
    movements: Mapping[str, LoggedMovement],
    rate: float,
) -> pd.DataFrame:
    """Return the rows of the table ``take_paths`` of ``movements`` at ``rate`` (Hz) of a dataset
    without robot, at most MOST_ROWS of a movement.
    """
    tables = []
    for name, log in movements.items():
        identity = {"take": name, "part": "training"}
        clock = {"t": np.arange(len(log.actual)) / rate}
        angles = spread("q", log.joints, log.actual)
        table = pd.DataFrame(identity | clock | angles)
        tables.append(thinned(table).assign(left_out=False, reason=""))
    return pd.concat(tables, ignore_index=True)


def find_takes(
    movements: Mapping[str, LoggedMovement],
    dataset: Dataset,
) -> tuple[dict[str, LoggedTake], list[str], list[tuple]]:
    """Return name → repetition, descriptions of all motions, and notes on the movements (name, and
    quantity, value and unit of a quality row).

    Raises RecordingError where a locked joint moves in a repetition.
    """
    takes = {}
    observed = []
    notes = []
    rest = dataset.joint_log.rest
    for name, movement_log in movements.items():
        log = movement_log.of(dataset.robot.joints)
        runs, left_out = _sound_repetitions(log, movement_log.motions, dataset)
        for number, run in enumerate(runs, 1):
            take = f"{name}_{number}"
            rows = slice(max(run.first - rest, 0), run.last + rest + 1)
            _require_locked(movement_log, rows, dataset, take)
            takes[take] = LoggedTake(name, run.first, log.actual, log.target)
        observed += [_description(run, log.target) for run in movement_log.motions]
        counts = dict(movement_log.counts)
        counts[REPETITIONS] = len(runs)
        for reason, first_rows in left_out.items():
            counts[f"{LEFT_OUT}{reason}"] = len(first_rows)
        notes += [(name, *note) for note in _with_units(counts)]
        # the first row identifies a motion that is left out
        for reason, first_rows in left_out.items():
            for row in first_rows:
                notes.append((name, f"{reason}_from_row", row, "row"))
    return takes, observed, notes


def _sound_repetitions(
    log: LoggedMovement,
    motions: Sequence[Excursion],
    dataset: Dataset,
) -> Repetitions:
    """Return the repetitions of the dataset's motion among the ``motions`` of a movement whose rows
    have no wrong command; ``log`` has the joints of the robot.
    """
    options = dataset.joint_log
    rest = dataset.joint_log.rest
    repeated = find_repetitions(
        log.target,
        motions,
        (options.start, options.end),
        dataset.motion.steps - 2 * rest,
        rest,
        log.circular,
    )
    faults = [fault.row for fault in wrong_commands(log.actual, log.target)]
    sound = []
    wrong = []
    for run in repeated.runs:
        first = run.first - rest
        last = run.last + rest
        if any(first <= row <= last for row in faults):
            wrong.append(run.first)
        else:
            sound.append(run)
    left_out = dict(repeated.left_out)
    if wrong:
        left_out["wrong_command"] = wrong
    return Repetitions(sound, left_out)


def _description(run: Excursion, target: np.ndarray) -> str:
    """Return why the motion ``run`` is not whole, or its ends in rad and its duration, as text."""
    lack = run.lack(len(target))
    if lack:
        return lack
    start, end = target[[run.first - 1, run.last]].round(2).tolist()
    return f"{start} to {end} in {run.steps} steps"


def _require_locked(
    read: LoggedMovement,
    rows: slice,
    dataset: Dataset,
    take: str,
) -> None:
    """Raise RecordingError where a joint is more than REACH off its locked angle in ``rows``."""
    for joint, angle in sorted(dataset.robot.locked.items()):
        if joint not in read.joints:
            continue
        log = read.of([joint])
        measured = log.actual[rows]
        if np.abs(apart(measured, angle, log.circular)).max() > REACH:
            raise RecordingError(
                f"{joint} is locked at {angle:.4g} rad, but was logged from "
                f"{measured.min():.4g} to {measured.max():.4g} rad: lock it at the logged "
                "angle, or choose a motion in which it does not move",
                file=dataset.recordings,
                take=take,
                key=f"dataset.robot.locked.{joint}",
            )


def encoder_rows(raw: Path, dataset: Dataset) -> list[tuple[pd.DataFrame, list[dict]]]:
    """Return the rows of the table ``encoders`` and the quality rows per log, training first."""
    options = dataset.encoders
    joints = dataset.robot.joints
    urdf = dataset.robot.urdf
    read = LogOptions(
        time=options.time,
        angle_unit=options.angle_unit,
        time_unit=options.time_unit,
        names=joints,
        joints=len(joints),
        signals={"actual": options.actual},
        circular=circular_joints(urdf, joints),
    )
    logs = []
    for use, pattern in (("training", options.training), ("test", options.test)):
        key = f"dataset.encoders.{use}"
        for name, file in named_takes(raw, pattern, key=key, what="log").items():
            log = movement.read_log(file, read)
            movement.require_speeds(log.time, log.signals, joints, urdf, file=file)
            identity = {"take": name, "part": use, "t": log.time - options.start}
            rows = pd.DataFrame(identity | spread("q", joints, log.signals["actual"]))
            counts = {"rows": len(rows)} | log.counts
            logs.append((rows, quality_rows(name, use, "encoders", counts.items())))
    return logs
