"""Runs of a position-controlled arm in the logs of its movements: all rows, without the lag of the
run, cut where the command rests. Runs with equal commands are one motion.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from pipeline.core.angles import apart
from pipeline.core.errors import RecordingError
from pipeline.core.options.dataset import Dataset
from pipeline.models.runs import JointRun
from pipeline.recordings.commands import standing_joints
from pipeline.recordings.joint_logs import read_movements
from pipeline.recordings.movement import LoggedMovement
from pipeline.recordings.repetitions import REACH, SLACK, disturbances, excursions

BEYOND = 6.0  # robust standard deviations, as dataset.joint_log.disturbed_beyond
PAUSE = 0.1  # s, shortest pause between two runs
CORE = 0.1  # share of a command that is not compared, at both ends
LATE_ROWS = 4  # rows by which the clock of an equal command may differ along the way
SAME = 0.01  # greatest distance of equal commands over the motion of the farthest joint
ALIKE = 1e-3  # rad, greatest difference of commands whose errors are compared
FEWEST = 5  # least number of runs that show a disturbed one
STARTED = 0.1  # least step of a moving command, over its greatest step
SLOW, FAR = 0.1, 5.0  # least share of the speed, greatest error over the median, for a lag
ENDS = 0.05  # share of the rows at each end that may not follow the command
OWN_LAG = 0.9  # a joint has its own lag if that reduces its rms error below this share
LAG_ROUNDS = 6  # rounds of least squares, each with the command at the lag of the round before
FURTHEST = 0.1  # s, greatest lag of a joint that least squares finds
SETTLED = 0.25  # s after a motion in which an arm may still move
RESTING = 50  # least number of rows at rest that show the noise of a measured angle
LEAST_STEPS, MULTIPLES, IN_PHASE = 20, 8.0, 0.8  # differences that show a quantum
LEAST_QUANTUM = 1e-9  # rad, below the resolution of any encoder


class RunsOfLogs(NamedTuple):
    """Runs of one arm, and name → reason of every recording or part that is not used."""

    runs: list[JointRun]
    unused: dict[str, str]


def joint_runs(
    movements: Mapping[str, LoggedMovement],
    rate: float,
    joints: Sequence[str] = (),
    pose_noise: float | None = None,
) -> RunsOfLogs:
    """Return the runs of the ``joints`` (default all) in the ``movements`` at ``rate`` (Hz).

    Joints that stand still while their command moves are left out. ``pose_noise`` in rad is stated,
    else estimated from rows at rest, else from the quantum. Disturbed runs among FEWEST or more
    of one motion are not used. Raises RecordingError without a run.
    """
    unused, runs, circular = {}, [], {}
    joints = [*(joints or next(iter(movements.values())).joints)]
    for read in movements.values():
        columns = [read.joints.index(joint) for joint in joints]
        standing = standing_joints(read.actual, read.target)
        for column in (column for column in columns if standing[column]):
            moved = np.ptp(read.target[:, column]), np.ptp(read.actual[:, column])
            unused[read.joints[column]] = (
                "its command moves by {:.3g} rad, it moves by {:.2g} rad".format(*moved)
            )
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


def runs_of_dataset(dataset: Dataset) -> RunsOfLogs:
    """Return :func:`joint_runs` of the robot's joints in the dataset's logs."""
    rate, noise = dataset.motion.rate, dataset.motion.pose_noise
    return joint_runs(read_movements(dataset), rate, dataset.robot.joints, noise)


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
    kept = following_rows(measured[cut] - command)
    command, cut = command[kept], slice(cut.start + kept.start, cut.start + kept.stop)
    rows = np.arange(len(target))[cut]
    resting = np.ones(len(target), bool)
    for run in moved:
        resting[max(run.first - SLACK, 0) : run.last + round(SETTLED * rate)] = False
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
    """Return the lag (n,) in s of ``measured`` behind ``command`` (N, n) in rad, by least squares
    over rows in motion: one lag of all joints, and a joint's own lag if this reduces its error by
    more than a tenth.
    """
    n = command.shape[1]
    lags = np.full(n, _least_squares_lag(command, measured, rate))
    for j in np.flatnonzero(np.ptp(command, axis=0) > REACH):
        pair = command[:, [j]], measured[:, [j]]
        own = _least_squares_lag(*pair, rate)
        if _typical_error(*pair, own * rate) < OWN_LAG * _typical_error(*pair, lags[j] * rate):
            lags[j] = own
    return lags


def _least_squares_lag(command: np.ndarray, measured: np.ndarray, rate: float) -> float:
    """Return the lag in s; rows far from their command, as at a stop, are left out."""
    late = 0.0
    for _ in range(LAG_ROUNDS):
        shifted, cut = delayed(command, np.full(command.shape[1], late * rate))
        error, velocity = shifted - measured[cut], np.gradient(shifted, axis=0) * rate
        used = _usual_rows(error, velocity)
        late += float(np.sum((error * velocity)[used]) / np.sum(velocity[used] ** 2))
        late = float(np.clip(late, -FURTHEST, FURTHEST))
    return late


def _usual_rows(error: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return the mask (N,) of rows in motion whose error is below FAR times the median."""
    speed, size = np.abs(velocity).max(axis=1), np.linalg.norm(error, axis=1)
    moving = speed > SLOW * speed.max()
    return moving & (size <= FAR * np.median(size[moving]))


def _typical_error(command: np.ndarray, measured: np.ndarray, rows: float) -> float:
    shifted, cut = delayed(command, np.array([rows]))
    error = measured[cut] - shifted
    return float(np.std(error[_usual_rows(error, np.gradient(shifted, axis=0))]))


def following_rows(error: np.ndarray) -> slice:
    """Return the rows of ``error`` (N, n) in rad without those at the ends that are beyond twice
    the greatest error between: the arm has stopped, or the logs begin at different times.
    """
    size, ends = np.abs(error).max(axis=1), int(ENDS * len(error))
    beyond = size > 2 * size[ends : len(size) - ends].max(initial=0.0)
    first = np.flatnonzero(beyond[:ends])
    last = np.flatnonzero(beyond[len(size) - ends :])
    start = int(first[-1]) + 1 if len(first) else 0
    return slice(start, len(size) - (ends - int(last[0]) if len(last) else 0))


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
    """Return the step in rad of recorded ``angles`` (N,), 0 where there is none: small differences
    are multiples of it. The phases of the differences have a mean length of at least IN_PHASE.
    """
    steps = np.abs(np.diff(angles))
    steps = np.sort(steps[steps > LEAST_QUANTUM])
    if len(steps) < LEAST_STEPS:
        return 0.0
    tried = np.geomspace(steps[0], 4 * steps[LEAST_STEPS - 1], 2000)
    lengths = np.zeros(len(tried))
    for i, quantum in enumerate(tried):
        few = steps[: np.searchsorted(steps, MULTIPLES * quantum)]
        if len(few) >= LEAST_STEPS:
            lengths[i] = np.mean(np.cos(2 * np.pi * few / quantum))
    best = int(lengths.argmax())
    return float(tried[best]) if lengths[best] >= IN_PHASE else 0.0


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
    reach = max(REACH, SAME * np.ptp(core, axis=0).max(initial=0.0))
    reach += np.abs(np.diff(core, axis=0)).max(initial=0.0) / 2  # half a row apart
    if len(core) > len(whole):
        return False
    fast = int(np.abs(np.diff(core, axis=0)).max(axis=1).argmax())
    places = whole[fast : len(whole) - len(core) + 1 + fast]
    away = np.abs(apart(places, core[fast], circular)).max(axis=1)
    shifts = range(-LATE_ROWS, LATE_ROWS + 1)
    for first in np.flatnonzero(away <= reach):
        rows = first + np.arange(len(core)) + np.array(shifts)[:, None]
        rows = np.clip(rows, 0, len(whole) - 1)
        off = np.abs(apart(whole[rows], core, circular)).max(axis=2)
        if off.min(axis=0).max() <= reach:
            return True
    return False


def _disturbed(runs: Sequence[JointRun]) -> list[tuple[str, float, int]]:
    """Return name, score and number of other runs of each disturbed one of at least FEWEST runs of
    one motion whose commands differ by less than ALIKE in every row; see :func:`disturbances`.
    """
    found = []
    for motion in dict.fromkeys(run.motion for run in runs):
        parts = {}
        for run in (run for run in runs if run.motion == motion):
            rows = _moving_rows(run.command)
            parts[run.name] = np.stack([run.command[rows], (run.measured - run.command)[rows]])
        length = int(np.median([part.shape[1] for part in parts.values()])) - SLACK
        parts = {name: part[:, :length] for name, part in parts.items() if part.shape[1] >= length}
        usual = np.median([part[0] for part in parts.values()], axis=0)
        parts = {n: part for n, part in parts.items() if np.abs(part[0] - usual).max() < ALIKE}
        if len(parts) >= FEWEST:
            scores = disturbances(np.stack([part[1] for part in parts.values()]), [], runs[0].rate)
            pairs = zip(parts, scores.tolist(), strict=True)
            found += [(name, score, len(parts) - 1) for name, score in pairs if score > BEYOND]
    return found
