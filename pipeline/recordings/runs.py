"""Runs of a position-controlled arm in the logs of its movements: all rows, without the lag of the
run, cut where the command rests. Runs with equal commands are one motion, which a dataset may
analyse: its ends, steps, pauses and repetitions.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from pipeline.arm.chain import Chain
from pipeline.arm.model import chain_of
from pipeline.core.angles import apart
from pipeline.core.errors import RecordingError
from pipeline.core.options.dataset import Dataset, Limits, Robot
from pipeline.models.joint_error.samples import JointRun
from pipeline.models.other_motions import MotionSteps
from pipeline.recordings.commands import (
    circular_joints,
    standing_joints,
    wrong_commands,
)
from pipeline.recordings.joint_logs import read_movements
from pipeline.recordings.lags import REACH, delayed, in_phase, joint_lags, stretch
from pipeline.recordings.movement import LoggedMovement
from pipeline.recordings.quality import (
    are_equal,
    compare_takes,
    disturbances,
    rounding,
)
from pipeline.recordings.repetitions import SLACK, find_repetitions

LIMITS = Limits()  # of the likeness and the disturbance of runs of one motion
PAUSE = 0.1  # s, shortest pause between two runs
CORE = 0.1  # share of a command that is not compared, at both ends
LATE_ROWS = np.arange(-4, 5)[
    :, None
]  # rows by which the clock of an equal command may differ
SAME = 0.01  # greatest distance of equal commands over the motion of the farthest joint
ALIKE = 1e-3  # rad, greatest difference of commands whose errors are compared
FEWEST = 5  # least number of runs that show a disturbed one
REPEATED = (
    1.5  # greatest distance of two runs that repeat each other, over the usual one
)
STARTED = 0.1  # least step of a moving command, over its greatest step
ENDS = 0.05  # share of the rows at each end that may not follow the command
SETTLED = 0.25  # s after a motion in which an arm may still move
RESTING = 50  # least number of rows at rest that show the noise of a measured angle
LEAST_STEPS, MULTIPLES, IN_PHASE = 20, 8.0, 0.8  # differences that show a quantum
DECIMAL = 1e-3  # greatest distance of a step from a power of ten, as a logarithm
LEAST_QUANTUM = 1e-9  # rad, below the resolution of any encoder
KEPT = 0.25  # s, rest that is kept before and after a motion, if its pauses are long enough
NEARLY = 0.1  # J is nearly singular if σ_min is below this share of the greatest σ_min
LEAST_TURN = (
    0.5  # least prominence of a turn between two motions, over the joint's range
)


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
    for name, read in movements.items() if moving else ():
        if name in unused:
            continue
        chosen = read.of(moving)
        if original := _original_of(chosen.actual, distinct):
            unused[name] = (
                f"a copy: its measured angles are equal to the angles of {original}"
            )
            continue
        distinct[name] = chosen.actual
        if not chosen.motions:
            most = np.ptp(chosen.target, axis=0).max()
            reason = f"the command never moves by more than {REACH:g} rad between two rests, by "
            reason += f"{most:.3g} rad in all; resample a log whose rows repeat each command at the"
            unused[name] = f"{reason} command's rate"
            continue
        of_movement, wrong = _runs_of(name, chosen, rate, pose_noise)
        runs += of_movement
        unused |= wrong
    runs = named_motions(runs, chosen.circular) if runs else []
    unused |= _beyond_limits(runs)
    if not (runs := [run for run in runs if run.name not in unused]):
        found = "; ".join(f"{name}: {reason}" for name, reason in unused.items())
        raise RecordingError(
            f"no run of a commanded motion is in the logs: {found or 'no log'}"
        )
    return RunsOfLogs(runs, unused)


def _moving_joints(
    movements: Mapping[str, LoggedMovement], joints: Sequence[str]
) -> tuple[list[str], dict[str, str]]:
    """Return the ``joints`` that move, and name → reason of every joint and recording left out. A
    joint is left out if it stands still in all recordings that command it to move; a recording, if
    a joint stands still in it that moves in others.
    """
    standing: dict[str, dict[str, str]] = {joint: {} for joint in joints}
    following: set[str] = set()
    for name, read in movements.items():
        chosen = read.of(joints)
        commanded, moved = (np.ptp(q, axis=0) for q in (chosen.target, chosen.actual))
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
    rate, noise = dataset.motion.rate, dataset.motion.pose_noise
    joints = () if dataset.robot is None else dataset.robot.joints
    return joint_runs(read_movements(dataset), rate, joints, noise)


def _runs_of(
    name: str, read: LoggedMovement, rate: float, stated: float | None
) -> tuple[list[JointRun], dict[str, str]]:
    """Return the runs in one movement, from pause to pause, and name → reason of runs with a wrong
    command.
    """
    measured, target, moved = read.actual, read.target, read.motions
    late = joint_lags(target, measured, rate)
    command, cut = delayed(target, late * rate)
    kept = following_rows(measured[cut] - command)
    command, start = command[kept], cut.start + kept.start
    resting = np.ones(len(target), bool)
    for run in moved:
        resting[max(run.first - SLACK, 0) : run.last + round(SETTLED * rate)] = False
    quantum = np.array([find_quantum(joint) for joint in measured.T])
    noise = stated or _noise_of(measured, resting, quantum)
    pauses = [(one.last, other.first) for one, other in pairwise(moved)]
    middles = [(a + b) // 2 - start for a, b in pauses if b - a >= PAUSE * rate]
    limits = np.clip([0, *middles, len(command)], 0, len(command)).tolist()
    wrong = wrong_commands(measured, target)
    late = late + read.counts.get("command_delay", 0.0)
    runs, unused = [], {}
    for number, (first, end) in enumerate(pairwise(limits), 1):
        run = f"{name}_{number}" if middles else name
        inside = [fault for fault in wrong if first <= fault.row - start < end]
        if inside:
            unused[run] = inside[0].reason(read.joints, rate)
            continue
        angles = command[first:end], measured[start:][first:end], tuple(read.joints)
        runs.append(JointRun(run, rate, *angles, late, quantum, noise, motion=""))
    return runs, unused


def following_rows(error: np.ndarray) -> slice:
    """Return the rows of ``error`` (N, n) in rad without those at the ends that are beyond twice
    the greatest error between: the arm has stopped, or the logs begin at different times.
    """
    size, ends = np.abs(error).max(axis=1), int(ENDS * len(error))
    last = len(error) - ends
    beyond = size > 2 * size[ends:last].max(initial=0.0)
    stop = last + int(beyond[last:].argmax()) if beyond[last:].any() else len(error)
    return slice(int(np.flatnonzero(beyond[:ends]).max(initial=-1)) + 1, stop)


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
    usual = np.bincount(multiples - multiples.min()).argmax() + multiples.min()
    others = near[multiples != usual]
    if len(others) >= LEAST_STEPS and _coherence(others, step) >= IN_PHASE:
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
    lengths = []
    for quantum, count in zip(
        tried, np.searchsorted(steps, MULTIPLES * tried), strict=True
    ):
        enough = count >= LEAST_STEPS
        lengths.append(_coherence(steps[:count], quantum) if enough else 0.0)
    best = int(np.argmax(lengths))
    return float(tried[best]) if lengths[best] >= IN_PHASE else 0.0


def _coherence(differences: np.ndarray, quantum: float) -> float:
    """Return the mean cosine of the phases of ``differences`` in periods of ``quantum``."""
    return float(np.mean(np.cos(2 * np.pi * differences / quantum)))


def _noise_of(
    measured: np.ndarray, resting: np.ndarray, quantum: np.ndarray
) -> float | None:
    """Return the noise in rad of a measured angle, rms over the joints, from rows at rest, else
    from the quantum; None if both are 0.
    """
    pairs = resting[1:] & resting[:-1]
    still = np.diff(measured, axis=0)[pairs] if pairs.sum() >= RESTING else np.zeros(1)
    return (
        float(np.sqrt(np.mean(still**2) / 2) or np.sqrt(np.mean(quantum**2) / 12))
        or None
    )


def named_motions(runs: Sequence[JointRun], circular: np.ndarray) -> list[JointRun]:
    """Return the ``runs`` with their motions, numbered from 1 with most runs first. A run is of a
    motion if its command, apart from the ends, is a part of the motion's longest command.
    """
    moving = [run.command[_moving_rows(run.command)] for run in runs]
    motions: dict[int, list[int]] = {}  # run with the longest command → runs
    for number in sorted(range(len(runs)), key=lambda number: -len(moving[number])):
        known = (
            i for i in motions if _is_part(moving[number], runs[i].command, circular)
        )
        motions.setdefault(next(known, number), []).append(number)
    ordered = sorted(motions.values(), key=lambda each: (-len(each), min(each)))
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
    step = np.abs(np.diff(core, axis=0)).max(axis=1)
    reach = (
        max(REACH, SAME * np.ptp(core, axis=0).max(initial=0.0)) + step.max() / 2
    )  # half a row
    fast, most = int(step.argmax()), len(whole) - len(core) + 1
    away = np.abs(apart(whole[fast : max(most, 0) + fast], core[fast], circular)).max(
        axis=1
    )
    for first in np.flatnonzero(away <= reach):
        rows = np.clip(first + np.arange(len(core)) + LATE_ROWS, 0, len(whole) - 1)
        if (
            np.abs(apart(whole[rows], core, circular)).max(axis=2).min(axis=0).max()
            <= reach
        ):
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
        length = int(np.median([pair.shape[1] for pair in pairs.values()])) - SLACK
        pairs = {n: p[:, :length] for n, p in pairs.items() if p.shape[1] >= length}
        usual = np.median([pair[0] for pair in pairs.values()], axis=0)
        alike = [n for n, p in pairs.items() if np.abs(p[0] - usual).max() < ALIKE]
        if len(alike) < 3:
            continue
        errors = np.stack([pairs[name][1] for name in alike])
        measures = compare_takes(usual + errors, errors, runs[0].rate, LIMITS.likeness)
        likeness, size, scores = (
            measures[name][0] for name in ("likeness", "alike_takes", "disturbance")
        )
        far = scores > LIMITS.disturbance
        disturbed = far & ~_repeated(errors, far)
        for i, name in enumerate(alike):
            if likeness[i] > LIMITS.likeness:
                reasons[name] = (
                    f"a copy: {size[i]:g} runs are equal within the noise, and "
                    f"{likeness[i]:.3g} times as far from the next run of the motion"
                )
            elif disturbed[i] and len(alike) >= FEWEST:
                reasons[name] = (
                    f"disturbed: {scores[i]:.3g} robust standard deviations from "
                    f"{len(alike) - 1} runs of the same motion"
                )
    return reasons


def _repeated(residuals: np.ndarray, far: np.ndarray) -> np.ndarray:
    """Return the mask (runs,) of ``residuals`` (runs, K, n) rad that another run repeats as nearly
    as the runs that are not ``far`` repeat each other: a second way of the arm, no disturbance.
    """
    if far.sum() < 2 or far.all():
        return np.zeros(len(far), bool)
    differences = residuals[:, None] - residuals
    apart_by = np.sqrt(np.mean(differences**2, axis=(2, 3)))
    np.fill_diagonal(apart_by, np.inf)
    nearest = apart_by.min(axis=1)
    return nearest < REPEATED * np.median(nearest[~far])


@dataclass
class FoundMotion:
    """One commanded motion of n joints, and the places (movement, first row) of repetitions."""

    start: np.ndarray  # (n,) rad
    end: np.ndarray  # (n,) rad
    steps: int
    pause: int | None  # steps of the shortest pause before or after; None: no rest
    places: list[tuple[str, int]] = field(default_factory=list)
    disturbed: list[tuple[str, int]] = field(
        default_factory=list
    )  # or with another command
    least_singular: float = (
        np.nan
    )  # m/rad or 1, least singular value of J along the motion
    deviation: float = 0.0  # rad, greatest distance of a command from the first command

    def rest(self, rate: float) -> int:
        """Return the steps of rest to keep before and after: KEPT, or half the shortest pause."""
        if self.pause is None:
            return 0
        return max(min(round(KEPT * rate), (self.pause - 2 * SLACK - 2) // 2), 1)


def find_motions(
    movements: Mapping[str, LoggedMovement], robot: Robot, rate: float
) -> list[FoundMotion]:
    """Return the motions of the ``robot``'s joints in the ``movements`` at ``rate`` (Hz), most
    repetitions first: commands from rest to rest with equal ends and steps. If no command ever
    rests, motions are repeated stretches between rows where J is nearly singular or, without such
    rows, between turns of the joint that moves farthest.
    """
    chain, circular, found = (
        chain_of(robot),
        circular_joints(robot.urdf, robot.joints),
        [],
    )
    logs = {name: read.of(robot.joints) for name, read in movements.items()}
    resting = any(run.whole for read in logs.values() for run in read.motions)
    for read in logs.values():
        path, spans = (
            read.target,
            [(run.first - 1, run.last) for run in read.motions if run.whole],
        )
        for first, last in spans if resting else _regular_stretches(path, chain):
            steps, ends = last - first - resting, (path[first], path[last])
            seek = partial(find_repetitions, ends=ends, steps=steps, rest=int(resting))
            each = {
                n: seek(q.target, q.motions, circular=circular) for n, q in logs.items()
            }
            runs = [(name, run) for name, (runs, _) in each.items() for run in runs]
            places = [(name, run.first) for name, run in runs]
            known = any({*places} & {*other.places} for other in found)
            if not known and len(places) > (not resting):
                pause = min(run.pause for _, run in runs) if resting else None
                motion = FoundMotion(*ends, steps, pause, places)
                _compare(motion, logs, rate, chain)
                found.append(motion)
    return sorted(found, key=lambda motion: -len(motion.places))


def _compare(motion: FoundMotion, logs: Mapping, rate: float, chain: Chain) -> None:
    """Set the least singular value along the first repetition and, of a motion between rests, the
    greatest deviation of a command from the first command and the disturbed repetitions.
    """
    name, row = motion.places[0]
    reference, residuals = logs[name].target[row:][: motion.steps + 1], {}
    motion.least_singular = float(_least_singular(chain, reference).min())
    for name, row in motion.places if motion.pause is not None else ():
        read, length = logs[name], len(reference)
        start = in_phase(read.target, row, reference, SLACK, whole=True)
        off = float(np.abs(stretch(read.target, start, length) - reference).max())
        motion.deviation = max(motion.deviation, off)
        residuals[name, row] = stretch(read.actual - read.target, start, length)
        if off > ALIKE:
            motion.disturbed.append((name, row))
            del residuals[name, row]
    if len(residuals) >= FEWEST:
        scores = disturbances(np.stack([*residuals.values()]), rate)
        disturbed = np.flatnonzero(scores > LIMITS.disturbance)
        motion.disturbed += [[*residuals][i] for i in disturbed]


def _regular_stretches(angles: np.ndarray, chain: Chain) -> list[tuple[int, int]]:
    """Return first and last row of the stretches of a command ``angles`` (N, n) in rad."""
    from scipy.signal import find_peaks

    least = _least_singular(chain, angles)
    regular = least > NEARLY * least.max()
    if not regular.all():
        edges = np.flatnonzero(np.diff(regular)).tolist()
        return [
            (first + 1, last) for first, last in pairwise(edges) if regular[first + 1]
        ]
    joint = angles[:, int(np.ptp(angles, axis=0).argmax())]
    turns = [
        find_peaks(s * joint, prominence=LEAST_TURN * np.ptp(joint))[0] for s in (1, -1)
    ]
    return list(pairwise(sorted(np.concatenate(turns).tolist())))


def _least_singular(chain: Chain, angles: np.ndarray) -> np.ndarray:
    return np.linalg.svd(chain.jacobian(angles), compute_uv=False)[:, -1]


def logged_motions(dataset: Dataset) -> list[MotionSteps]:
    """Return the steps of the undisturbed repetitions per motion, most repetitions first."""
    rate, robot, found = dataset.motion.rate, dataset.robot, []
    movements = read_movements(dataset)
    for motion in find_motions(movements, robot, rate):
        rest, kept = motion.rest(rate), []
        for name, row in motion.places:
            read = movements[name].of(robot.joints)
            first, last = max(row - 1 - rest, 0), row + motion.steps + rest
            if (name, row) not in motion.disturbed and last < len(read.actual):
                kept.append(np.stack([read.actual, read.target])[:, first : last + 1])
        if kept:
            length = min(each.shape[1] for each in kept)
            actual, target = np.stack([each[:, :length] for each in kept], axis=1)
            dq = np.diff(target, axis=1)
            steps = actual[:, :-1], dq, np.diff(actual, axis=1) - dq
            found.append(MotionSteps(str(len(found) + 1), *steps))
    return found
