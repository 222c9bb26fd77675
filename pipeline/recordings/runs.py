"""Runs of a position-controlled arm in the logs of its movements: all rows, without the lag of the
run, cut where the command rests. Runs with equal commands are one motion.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.core.angles import apart
from pipeline.core.errors import RecordingError
from pipeline.core.options.dataset import Dataset
from pipeline.models.runs import JointRun
from pipeline.recordings.commands import standing_joints
from pipeline.recordings.joint_logs import find_movements, read_dataset_movement
from pipeline.recordings.movement import LoggedMovement
from pipeline.recordings.repetitions import (
    REACH,
    SLACK,
    disturbances,
    excursions,
    lag,
    true_runs,
)

BEYOND = 6.0  # robust standard deviations, as dataset.joint_log.disturbed_beyond
PAUSE = 0.1  # s, shortest pause between two runs
CORE = 0.1  # share of a command that is not compared, at both ends
STARTED = 0.01  # least step of a moving command, over its greatest step
OWN_LAG = 0.9  # a joint has its own lag if that reduces its rms error below this share
LAG_ROUNDS = 6  # rounds of least squares, each with the command at the lag of the round before
FURTHEST = 0.1  # s, greatest lag of a joint that least squares finds
RESTING = 50  # least number of rows at rest that show the noise of a measured angle
MULTIPLES = 0.98, 0.05, 20  # share of steps that are multiples, to within, up to
LEAST_QUANTUM = 1e-9  # rad, below the resolution of any encoder


class RunsOfLogs(NamedTuple):
    """Runs of one arm, and name → reason of every recording or part that is not used."""

    runs: list[JointRun]
    unused: dict[str, str]


def logged_runs(dataset: Dataset) -> RunsOfLogs:
    """Return the runs in the logs of a ``dataset`` with a joint_log, of its robot's joints."""
    places = find_movements(Path(dataset.recordings), dataset).items()
    read = {name: read_dataset_movement(name, place, dataset) for name, place in places}
    motion, joints = dataset.motion, dataset.robot.joints
    return joint_runs(read, motion.rate, joints, motion.pose_noise)


def joint_runs(
    movements: Mapping[str, LoggedMovement],
    rate: float,
    joints: Sequence[str] = (),
    pose_noise: float | None = None,
) -> RunsOfLogs:
    """Return the runs of the ``joints`` (default all) in the ``movements`` at ``rate`` (Hz).

    Joints that stand still while their command moves are left out. ``pose_noise`` in rad is stated,
    else estimated from rows at rest, else from the quantum. Among three or more runs of one motion,
    disturbed runs are not used. Raises RecordingError without a run.
    """
    unused, runs, circular = {}, [], {}
    joints = [*(joints or next(iter(movements.values())).joints)]
    for read in movements.values():
        columns = [read.joints.index(joint) for joint in joints]
        for joint in np.array(joints)[standing_joints(read.actual, read.target)[columns]]:
            column = read.joints.index(joint)
            moved = np.ptp(read.target[:, column]), np.ptp(read.actual[:, column])
            unused[joint] = "its command moves by {:.3g} rad, it moves by {:.2g} rad".format(*moved)
    joints = [joint for joint in joints if joint not in unused]
    for name, read in movements.items():
        found = _runs_of(name, read, rate, joints, pose_noise)
        circular = read.circular[[read.joints.index(joint) for joint in joints]]
        runs += found
        if not found:
            unused[name] = f"the command never moves by more than {REACH:g} rad"
    runs = named_motions(runs, circular)
    for name, score, others in _disturbed(runs):
        reason = f"disturbed: {score:.3g} robust standard deviations from {others} runs of"
        unused[name] = f"{reason} the same motion"
    runs = [run for run in runs if run.name not in unused]
    if not (runs and joints):
        found = "; ".join(f"{name}: {reason}" for name, reason in unused.items())
        raise RecordingError(f"no run of a commanded motion is in the logs: {found or 'no log'}")
    return RunsOfLogs(runs, unused)


def _runs_of(
    name: str, read: LoggedMovement, rate: float, joints: Sequence[str], stated: float | None
) -> list[JointRun]:
    """Return the runs in one movement, from pause to pause."""
    columns = [read.joints.index(joint) for joint in joints]
    measured, target = read.actual[:, columns], read.target[:, columns]
    moved = [
        run
        for run in excursions(read.target, read.speed)
        if np.ptp(target[max(run.first - 1, 0) : run.last + 1], axis=0).max(initial=0.0) > REACH
    ]
    if not moved:
        return []
    late = joint_lags(target, measured, rate)
    command, cut = delayed(target, late * rate)
    rows = np.arange(len(target))[cut]
    resting = np.ones(len(target), bool)
    for run in moved:
        resting[max(run.first - SLACK, 0) : run.last + SLACK] = False
    quantum = np.array([find_quantum(joint) for joint in measured.T])
    noise = stated or _noise_at_rest(measured, resting) or _noise_of(quantum)
    edges = [0]
    for before, after in pairwise(moved):
        if after.first - before.last >= PAUSE * rate:
            edges.append((before.last + after.first) // 2)
    known = read.counts.get("command_delay", 0.0)
    runs = []
    for number, (first, stop) in enumerate(zip(edges, [*edges[1:], len(target)], strict=True), 1):
        inside = (rows >= first) & (rows < stop)
        runs.append(
            JointRun(
                name=f"{name}_{number}" if len(edges) > 1 else name,
                rate=rate,
                command=command[inside],
                measured=measured[cut][inside],
                joints=tuple(joints),
                lag=late + known,
                quantum=quantum,
                pose_noise=noise,
                motion="",
            )
        )
    return runs


def joint_lags(command: np.ndarray, measured: np.ndarray, rate: float) -> np.ndarray:
    """Return the lag (n,) in s of ``measured`` behind ``command`` (N, n) in rad, by least squares:
    one lag of all joints, and a joint's own lag if this reduces its error by more than a tenth.
    """
    n, common = command.shape[1], 0.0
    for _ in range(LAG_ROUNDS):
        shifted, cut = delayed(command, np.full(n, common * rate))
        common = _bounded(common + lag(shifted, measured[cut], rate))
    lags = np.full(n, common)
    for j in np.flatnonzero(np.ptp(command, axis=0) > REACH):
        own, column = common, slice(j, j + 1)
        for _ in range(LAG_ROUNDS):
            shifted, cut = delayed(command[:, column], np.array([own * rate]))
            own = _bounded(own + lag(shifted, measured[cut, column], rate))
        pair = command[:, column], measured[:, column]
        rms = [_rms_error(*pair, one * rate) for one in (own, common)]
        if rms[0] < OWN_LAG * rms[1]:
            lags[j] = own
    return lags


def _bounded(seconds: float) -> float:
    return float(np.clip(np.nan_to_num(seconds), -FURTHEST, FURTHEST))


def _rms_error(command: np.ndarray, measured: np.ndarray, rows: float) -> float:
    shifted, cut = delayed(command, np.array([rows]))
    return float(np.std(measured[cut] - shifted))


def delayed(command: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, slice]:
    """Return ``command`` (N, n) delayed by ``rows`` (n,) of any fraction, by cubic splines, and the
    slice of the rows at which all joints have a command.
    """
    from scipy.interpolate import CubicSpline

    before, after = (max(int(np.ceil((s * rows).max())), 0) for s in (1, -1))
    cut, at = slice(before, len(command) - after), np.arange(len(command))
    if not rows.any():
        return command, cut
    each = zip(command.T, rows, strict=True)
    return np.stack([CubicSpline(at, c)(at[cut] - late) for c, late in each], axis=1), cut


def find_quantum(angles: np.ndarray) -> float:
    """Return the step in rad of recorded ``angles`` (N,), the smallest difference of which small
    differences are multiples; 0 where there is none.
    """
    share, within, most = MULTIPLES
    steps = np.abs(np.diff(angles))
    steps = np.sort(steps[steps > LEAST_QUANTUM])
    if len(steps) < most:
        return 0.0
    # printed angles are rounded: the mean of the steps near the smallest one
    least = float(np.median(steps[steps < 1.5 * steps[0]]))
    few = steps[steps < most * least] / least
    near = np.abs(few - np.rint(few)) < within * np.maximum(np.rint(few), 1)
    return least if len(few) > most / 2 and near[few < 1 / within / 2].mean() >= share else 0.0


def _noise_at_rest(measured: np.ndarray, resting: np.ndarray) -> float | None:
    """Return the noise in rad of a measured angle, rms over the joints, from rows at rest."""
    pairs = resting[1:] & resting[:-1]
    if pairs.sum() < RESTING:
        return None
    return float(np.sqrt(np.mean(np.diff(measured, axis=0)[pairs] ** 2) / 2)) or None


def _noise_of(quantum: np.ndarray) -> float | None:
    return float(np.sqrt(np.mean(quantum**2) / 12)) or None


def named_motions(runs: Sequence[JointRun], circular: np.ndarray) -> list[JointRun]:
    """Return the ``runs`` with their motions, numbered from 1 with most runs first. A run is of a
    motion if its command, apart from the ends, is a part of the motion's longest command.
    """
    moving = [run.command[_moving_rows(run.command)] for run in runs]
    longest, members = [], []
    for number in sorted(range(len(runs)), key=lambda number: -len(moving[number])):
        known = (i for i, one in enumerate(longest) if _is_part(moving[number], one, circular))
        place = next(known, len(longest))
        if place == len(longest):
            longest.append(runs[number].command)
            members.append([])
        members[place].append(number)
    ordered = sorted(members, key=lambda each: (-len(each), min(each)))
    names = {number: str(i) for i, each in enumerate(ordered, 1) for number in each}
    return [replace(run, motion=names[number]) for number, run in enumerate(runs)]


def _moving_rows(command: np.ndarray) -> slice:
    step = np.abs(np.diff(command, axis=0)).max(axis=1)
    rows = np.flatnonzero(step > STARTED * step.max())
    return slice(int(rows[0]), int(rows[-1]) + 2)


def _is_part(part: np.ndarray, whole: np.ndarray, circular: np.ndarray) -> bool:
    """Return whether ``part`` (K, n), apart from its ends, is a stretch of ``whole`` (N, n)."""
    ends = int(CORE * len(part))
    core = part[ends : len(part) - ends]
    reach = REACH + np.abs(np.diff(core, axis=0)).max(initial=0.0) / 2  # half a row apart
    if len(core) > len(whole):
        return False
    away = np.abs(apart(whole[: len(whole) - len(core) + 1], core[0], circular)).max(axis=1)
    for begin, stop in true_runs(away <= reach):
        row = begin + int(away[begin:stop].argmin())
        for first in range(max(row - SLACK, 0), min(row + SLACK, len(away) - 1) + 1):
            stretch = whole[first : first + len(core)]
            if np.abs(apart(stretch, core, circular)).max() <= reach:
                return True
    return False


def _disturbed(runs: Sequence[JointRun]) -> list[tuple[str, float, int]]:
    """Return name, score and number of other runs of each disturbed run of a motion with at least
    three whole runs; see :func:`disturbances`.
    """
    found = []
    for motion in dict.fromkeys(run.motion for run in runs):
        own = {run.name: run for run in runs if run.motion == motion}
        parts = {name: _moving_rows(run.command) for name, run in own.items()}
        length = int(np.median([rows.stop - rows.start for rows in parts.values()]))
        whole = [n for n, rows in parts.items() if abs(rows.stop - rows.start - length) <= SLACK]
        if len(whole) < 3:
            continue
        rows = [slice(parts[name].start, parts[name].start + length - SLACK) for name in whole]
        errors = np.stack([_errors(own[n])[r] for n, r in zip(whole, rows, strict=True)])
        scores = disturbances(errors, [], own[whole[0]].rate)
        pairs = zip(whole, scores.tolist(), strict=True)
        found += [(name, score, len(whole) - 1) for name, score in pairs if score > BEYOND]
    return found


def _errors(run: JointRun) -> np.ndarray:
    return run.measured - run.command
