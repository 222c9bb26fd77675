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
from pipeline.core.options.dataset import Dataset, Limits
from pipeline.models.joint_error.samples import JointRun
from pipeline.recordings.commands import (
    standing_joints,
    wrong_commands,
)
from pipeline.recordings.joint_logs import read_movements
from pipeline.recordings.lags import REACH, delayed, joint_lags
from pipeline.recordings.movement import LoggedMovement
from pipeline.recordings.quality import (
    are_equal,
    compare_takes,
    rounding,
)
from pipeline.recordings.repetitions import SLACK

LIMITS = Limits()  # of the likeness and the disturbance of runs of one motion
PAUSE = 0.1  # s, shortest pause between two runs
CORE = 0.1  # share of a command that is not compared, at both ends
# rows by which the clock of an equal command may differ
LATE_ROWS = np.arange(-4, 5)[:, None]
SAME = 0.01  # greatest distance of equal commands over the motion of the farthest joint
ALIKE = 1e-3  # rad, greatest difference of commands whose errors are compared
FEWEST = 5  # least number of runs that show a disturbed one
# greatest distance of two runs that repeat each other, over the usual distance
REPEATED = 1.5
STARTED = 0.1  # least step of a moving command, over its greatest step
ENDS = 0.05  # share of the rows at each end that may not follow the command
SETTLED = 0.25  # s after a motion in which an arm may still move
RESTING = 50  # least number of rows at rest that show the noise of a measured angle
# differences that show a quantum
LEAST_STEPS = 20
MULTIPLES = 8.0
IN_PHASE = 0.8
DECIMAL = 1e-3  # greatest distance of a step from a power of ten, as a logarithm
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
    joints = [*(joints or next(iter(movements.values())).joints)]
    moving, unused = _moving_joints(movements, joints)
    runs: list[JointRun] = []
    distinct: dict[str, np.ndarray] = {}  # recording → measured angles
    for name, movement in movements.items():
        if name in unused or not moving:
            continue
        chosen = movement.of(moving)
        original = _original_of(chosen.actual, distinct)
        if original:
            equal = f"its measured angles are equal to the angles of {original}"
            unused[name] = f"a copy: {equal}"
            continue
        distinct[name] = chosen.actual
        if not chosen.motions:
            most = np.ptp(chosen.target, axis=0).max()
            unused[name] = (
                f"the command never moves by more than {REACH:g} rad between two rests, "
                f"by {most:.3g} rad in all; resample a log whose rows repeat each command "
                "at the command's rate"
            )
            continue
        of_movement, wrong = _runs_of(name, chosen, rate, pose_noise)
        runs += of_movement
        unused |= wrong
    if runs:
        runs = named_motions(runs, chosen.circular)
    unused |= _beyond_limits(runs)
    used = [run for run in runs if run.name not in unused]
    if not used:
        reasons = [f"{name}: {reason}" for name, reason in unused.items()]
        message = "no run of a commanded motion is in the logs"
        raise RecordingError(f"{message}: {'; '.join(reasons) or 'no log'}")
    return RunsOfLogs(used, unused)


def _moving_joints(
    movements: Mapping[str, LoggedMovement],
    joints: Sequence[str],
) -> tuple[list[str], dict[str, str]]:
    """Return the ``joints`` that move, and name → reason of every joint and recording left out. A
    joint is left out if it stands still in all recordings that command it to move; a recording, if
    a joint stands still in it that moves in others.
    """
    standing: dict[str, dict[str, str]] = {joint: {} for joint in joints}
    following: set[str] = set()
    for name, movement in movements.items():
        chosen = movement.of(joints)
        commanded = np.ptp(chosen.target, axis=0)
        moved = np.ptp(chosen.actual, axis=0)
        still = standing_joints(chosen.actual, chosen.target)
        for column, joint in enumerate(joints):
            if still[column]:
                standing[joint][name] = (
                    f"its command moves by {commanded[column]:.3g} rad, it moves by "
                    f"{moved[column]:.2g} rad"
                )
            elif commanded[column] > REACH:
                following.add(joint)
    unused = {}
    for joint, reasons in standing.items():
        if joint not in following:
            if reasons:
                unused[joint] = [*reasons.values()][-1]
            continue
        for name, reason in reasons.items():
            unused[name] = f"{joint} does not follow: {reason}"
    return [joint for joint in joints if joint not in unused], unused


def runs_of_dataset(dataset: Dataset) -> RunsOfLogs:
    """Return :func:`joint_runs` of the robot's joints in the dataset's logs."""
    rate = dataset.motion.rate
    noise = dataset.motion.pose_noise
    joints = () if dataset.robot is None else dataset.robot.joints
    return joint_runs(read_movements(dataset), rate, joints, noise)


def _runs_of(
    name: str,
    movement: LoggedMovement,
    rate: float,
    stated: float | None,
) -> tuple[list[JointRun], dict[str, str]]:
    """Return the runs in one movement, from pause to pause, and name → reason of runs with a wrong
    command. The noise of a measured angle in rad is ``stated``, or estimated.
    """
    measured = movement.actual
    target = movement.target
    motions = movement.motions
    late = joint_lags(target, measured, rate)
    command, cut = delayed(target, late * rate)
    following = following_rows(measured[cut] - command)
    command = command[following]
    start = cut.start + following.start
    measured_after = measured[start:]

    resting = np.ones(len(target), bool)
    for motion in motions:
        settled = motion.last + round(SETTLED * rate)
        resting[max(motion.first - SLACK, 0) : settled] = False
    quantum = np.array([find_quantum(joint) for joint in measured.T])
    noise = stated or _noise_of(measured, resting, quantum)

    middles = []
    for before, after in pairwise(motions):
        if after.first - before.last >= PAUSE * rate:
            middles.append((before.last + after.first) // 2 - start)

    limits = np.clip([0, *middles, len(command)], 0, len(command)).tolist()
    wrong = wrong_commands(measured, target)
    late = late + movement.counts.get("command_delay", 0.0)
    runs = []
    unused = {}
    for number, (first, end) in enumerate(pairwise(limits), 1):
        run = f"{name}_{number}" if middles else name
        inside = [fault for fault in wrong if first <= fault.row - start < end]
        if inside:
            unused[run] = inside[0].reason(movement.joints, rate)
            continue
        log = JointRun(
            name=run,
            rate=rate,
            command=command[first:end],
            measured=measured_after[first:end],
            joints=tuple(movement.joints),
            lag=late,
            quantum=quantum,
            pose_noise=noise,
            motion="",
        )
        runs.append(log)
    return runs, unused


def following_rows(error: np.ndarray) -> slice:
    """Return the rows of ``error`` (N, n) in rad without those at the ends that are beyond twice
    the greatest error between: the arm has stopped, or the logs begin at different times.
    """
    size = np.abs(error).max(axis=1)
    ends = int(ENDS * len(error))
    last = len(error) - ends
    beyond = size > 2 * size[ends:last].max(initial=0.0)

    stop = len(error)
    if beyond[last:].any():
        stop = last + int(beyond[last:].argmax())
    start = int(np.flatnonzero(beyond[:ends]).max(initial=-1)) + 1
    return slice(start, stop)


def find_quantum(angles: np.ndarray) -> float:
    """Return the step in rad of recorded ``angles`` (N,), 0 where there is none: the step of the
    differences from row to row, if differences of several multiples show it. At a constant speed
    all rows differ by one multiple, and the step is the step between these differences.
    """
    differences = np.diff(angles)
    step = _common_step(np.abs(differences))
    if not step:
        return 0.0
    near = differences[np.abs(differences) <= MULTIPLES * step]
    multiples = np.rint(near / step).astype(int)
    least = multiples.min()
    usual = np.bincount(multiples - least).argmax() + least
    unusual = near[multiples != usual]
    if len(unusual) >= LEAST_STEPS and _coherence(unusual, step) >= IN_PHASE:
        return step
    step = _common_step(np.diff(np.sort(differences)))
    if not step:
        return 0.0
    printed = abs(np.log10(step) - np.rint(np.log10(step))) < DECIMAL
    return 0.0 if printed else step  # the last decimal is no resolution


def _common_step(differences: np.ndarray) -> float:
    """Return the greatest step of which small positive ``differences`` are multiples, else 0. Their
    phases have a mean length of at least IN_PHASE.
    """
    steps = np.sort(differences[differences > LEAST_QUANTUM])
    if len(steps) < LEAST_STEPS:
        return 0.0
    tried = np.geomspace(steps[0], 4 * steps[LEAST_STEPS - 1], 2000)
    counts = np.searchsorted(steps, MULTIPLES * tried)
    lengths = []
    for quantum, count in zip(tried, counts, strict=True):
        enough = count >= LEAST_STEPS
        lengths.append(_coherence(steps[:count], quantum) if enough else 0.0)
    best = int(np.argmax(lengths))
    return float(tried[best]) if lengths[best] >= IN_PHASE else 0.0


def _coherence(differences: np.ndarray, quantum: float) -> float:
    """Return the mean cosine of the phases of ``differences`` in periods of ``quantum``."""
    return float(np.mean(np.cos(2 * np.pi * differences / quantum)))


def _noise_of(
    measured: np.ndarray,
    resting: np.ndarray,
    quantum: np.ndarray,
) -> float | None:
    """Return the noise in rad of a measured angle, rms over the joints, from rows at rest, else
    from the quantum; None if both are 0.
    """
    pairs = resting[1:] & resting[:-1]
    if pairs.sum() >= RESTING:
        still = np.diff(measured, axis=0)[pairs]
        noise = float(np.sqrt(np.mean(still**2) / 2))
        if noise:
            return noise
    return float(np.sqrt(np.mean(quantum**2) / 12)) or None


def named_motions(runs: Sequence[JointRun], circular: np.ndarray) -> list[JointRun]:
    """Return the ``runs`` with their motions, numbered from 1 with most runs first. A run is of a
    motion if its command, apart from the ends, is a part of the motion's longest command.
    """
    moving = [run.command[_moving_rows(run.command)] for run in runs]
    longest_first = sorted(range(len(runs)), key=lambda i: -len(moving[i]))
    motions: dict[int, list[int]] = {}  # run with the longest command → runs
    for i in longest_first:
        for longest, members in motions.items():
            if _is_part(moving[i], runs[longest].command, circular):
                members.append(i)
                break
        else:
            motions[i] = [i]
    ordered = sorted(
        motions.values(),
        key=lambda members: (-len(members), min(members)),
    )
    named = [*runs]
    for number, members in enumerate(ordered, 1):
        for i in members:
            named[i] = replace(runs[i], motion=str(number))
    return named


def _moving_rows(command: np.ndarray) -> slice:
    step = np.abs(np.diff(command, axis=0)).max(axis=1)
    rows = np.flatnonzero(step > STARTED * step.max())
    return slice(int(rows[0]), int(rows[-1]) + 2)


def _is_part(section: np.ndarray, whole: np.ndarray, circular: np.ndarray) -> bool:
    """Return whether ``section`` (K, n) rad, apart from its ends, is in ``whole`` (N, n)."""
    ends = int(CORE * len(section))
    core = section[ends : len(section) - ends]
    step = np.abs(np.diff(core, axis=0)).max(axis=1)
    half_a_row = step.max() / 2
    reach = max(REACH, SAME * np.ptp(core, axis=0).max(initial=0.0)) + half_a_row

    fast = int(step.argmax())
    places = max(len(whole) - len(core) + 1, 0)
    from_fast = apart(whole[fast : places + fast], core[fast], circular)
    for first in np.flatnonzero(np.abs(from_fast).max(axis=1) <= reach):
        rows = np.clip(first + np.arange(len(core)) + LATE_ROWS, 0, len(whole) - 1)
        distance = np.abs(apart(whole[rows], core, circular)).max(axis=2)
        if distance.min(axis=0).max() <= reach:
            return True
    return False


def _original_of(angles: np.ndarray, earlier: Mapping[str, np.ndarray]) -> str:
    """Return the ``earlier`` recording that equals ``angles`` (N, n) rad by rounding, or ""."""
    for name, recorded in earlier.items():
        tolerance = np.maximum(rounding(angles), rounding(recorded))
        if are_equal(angles, recorded, tolerance):
            return name
    return ""


def _beyond_limits(runs: Sequence[JointRun]) -> dict[str, str]:
    """Return name → reason of each run that is a copy of others of its motion or, of at least
    FEWEST runs, disturbed: :func:`compare_takes` of runs whose commands differ by less than ALIKE.
    """
    motions: dict[str, dict[str, np.ndarray]] = {}
    for run in runs:
        pair = np.stack([run.command, run.measured - run.command])
        moving = pair[:, _moving_rows(run.command)]
        motions.setdefault(run.motion, {})[run.name] = moving
    reasons = {}
    for pairs in motions.values():
        usual, errors = _errors_of_equal_commands(pairs)
        if len(errors) >= 3:
            reasons |= _copies_and_disturbed(usual, errors, runs[0].rate)
    return reasons


def _errors_of_equal_commands(
    pairs: Mapping[str, np.ndarray],
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return the median command (K, n) rad of the runs ``pairs`` (2, rows, n), command and error,
    and name → error (K, n) of the runs that differ from it by less than ALIKE.
    """
    length = int(np.median([pair.shape[1] for pair in pairs.values()])) - SLACK
    cut = {}
    for name, pair in pairs.items():
        if pair.shape[1] >= length:
            cut[name] = pair[:, :length]
    usual = np.median([command for command, _ in cut.values()], axis=0)
    errors = {}
    for name, (command, error) in cut.items():
        if np.abs(command - usual).max() < ALIKE:
            errors[name] = error
    return usual, errors


def _copies_and_disturbed(
    usual: np.ndarray,
    errors_by_run: Mapping[str, np.ndarray],
    rate: float,
) -> dict[str, str]:
    """Return name → reason of each run with the command ``usual`` that is beyond the LIMITS."""
    errors = np.stack([*errors_by_run.values()])
    measures = compare_takes(usual + errors, errors, rate, LIMITS.likeness)
    likeness, _ = measures["likeness"]
    size, _ = measures["alike_takes"]
    scores, _ = measures["disturbance"]
    far = scores > LIMITS.disturbance
    disturbed = far & ~_repeated(errors, far)
    reasons = {}
    for i, name in enumerate(errors_by_run):
        if likeness[i] > LIMITS.likeness:
            reasons[name] = (
                f"a copy: {size[i]:g} runs are equal within the noise, and "
                f"{likeness[i]:.3g} times as far from the next run of the motion"
            )
        elif disturbed[i] and len(errors) >= FEWEST:
            reasons[name] = (
                f"disturbed: {scores[i]:.3g} robust standard deviations from "
                f"{len(errors) - 1} runs of the same motion"
            )
    return reasons


def _repeated(residuals: np.ndarray, far: np.ndarray) -> np.ndarray:
    """Return the mask (runs,) of ``residuals`` (runs, K, n) rad that another run repeats as nearly
    as the runs that are not ``far`` repeat each other: a second way of the arm, no disturbance.
    """
    if far.sum() < 2 or far.all():
        return np.zeros(len(far), bool)

    differences = residuals[:, None] - residuals
    distances = np.sqrt(np.mean(differences**2, axis=(2, 3)))
    np.fill_diagonal(distances, np.inf)
    nearest = distances.min(axis=1)
    return nearest < REPEATED * np.median(nearest[~far])
