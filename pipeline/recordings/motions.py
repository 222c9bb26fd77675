"""Motions in a controller's logs: ends, steps, pauses and repetitions, and recorded steps."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from pipeline.arm.interface import Chain
from pipeline.arm.model import chain_of
from pipeline.core.angles import TURN, apart, turns_apart
from pipeline.core.options.dataset import Dataset, Robot
from pipeline.models.other_motions import MotionSteps
from pipeline.recordings import repetitions
from pipeline.recordings.commands import circular_joints
from pipeline.recordings.joint_logs import read_movements
from pipeline.recordings.movement import LoggedMovement
from pipeline.recordings.repetitions import REACH, SLACK, stretch

BEYOND = 6.0  # robust standard deviations, as dataset.joint_log.disturbed_beyond
KEPT = 0.25  # s, rest that is kept before and after a motion, if its pauses are long enough
NEARLY = 0.1  # J is nearly singular if σ_min is below this share of the greatest σ_min
LEAST_TURN = 0.5  # least prominence of a turn between two motions, over the joint's range
SAME = 0.02  # rad, greatest distance of the ends of equal motions

Paths = Mapping[str, tuple[np.ndarray, np.ndarray]]  # actual, target (N, n) rad of the robot


@dataclass
class FoundMotion:
    """One commanded motion of n joints, and the places (movement, first row) of repetitions."""

    start: np.ndarray  # (n,) rad
    end: np.ndarray  # (n,) rad
    steps: int
    pause: int | None  # steps of the shortest pause before or after; None: no rest
    places: list[tuple[str, int]] = field(default_factory=list)
    disturbed: list[tuple[str, int]] = field(default_factory=list)  # disturbed places
    least_singular: float = np.nan  # m/rad or 1, least singular value of J along the motion
    deviation: float = np.nan  # rad, greatest distance of a command from the first command

    def rest(self, rate: float) -> int:
        """Return the steps of rest to keep before and after: KEPT, or half the shortest pause."""
        if self.pause is None:
            return 0
        return max(min(round(KEPT * rate), (self.pause - 2 * SLACK - 2) // 2), 1)

    def like(self, ends: tuple, steps: int, circular: np.ndarray, reach: float, slack: int) -> bool:
        """Return whether ends and ``steps`` agree within ``reach`` rad and ``slack`` steps."""
        off = apart(np.stack([self.start, self.end]), np.stack(ends), circular)
        return bool(np.abs(off).max() <= reach and abs(self.steps - steps) <= slack)


def find_motions(
    movements: Mapping[str, LoggedMovement], robot: Robot, rate: float
) -> list[FoundMotion]:
    """Return the motions of the ``robot``'s joints in the ``movements`` at ``rate`` (Hz), most
    repetitions first. If no command ever rests, motions are repeated stretches between rows where J
    is nearly singular or, without such rows, between turns of the joint that moves farthest.
    """
    chain, circular = chain_of(robot), circular_joints(robot.urdf, robot.joints)
    paths, listed = {}, []

    def known(ends: tuple[np.ndarray, np.ndarray], steps: int) -> FoundMotion | None:
        return next((one for one in listed if one.like(ends, steps, circular, REACH, SLACK)), None)

    for name, movement in movements.items():
        columns = [movement.joints.index(joint) for joint in robot.joints]
        target = movement.target[:, columns]
        paths[name] = movement.actual[:, columns], target
        runs = repetitions.excursions(movement.target, movement.speed)
        edges = [0, *(edge for run in runs for edge in (run.first, run.last)), len(target)]
        for run, before, after in zip(runs, edges[::2], edges[3::2], strict=False):
            rows = target[max(run.first - 1, 0) : run.last + 1]
            # ignore excursions in which only other joints move
            if run.whole and np.ptp(rows, axis=0).max() > REACH:
                pause, ends = min(run.first - before, after - run.last), (rows[0], rows[-1])
                if not (motion := known(ends, run.steps)):
                    listed.append(motion := FoundMotion(*ends, run.steps, pause))
                motion.pause = min(motion.pause, pause)
                motion.places.append((name, run.first))
    for _, target in paths.values() if not listed else ():
        for first, last in _stretches(target, chain):
            ends, steps = (target[first], target[last]), last - first
            if not known(ends, steps):
                sought, places = {"steps": steps, "rest": 0, "circular": circular}, []
                for name, (_, other) in paths.items():
                    log = other, other, slice(None), ends
                    found = repetitions.find_repetitions(*log, **sought)
                    places += [(name, run.first) for run in found.runs]
                listed += [FoundMotion(*ends, steps, None, places)] if len(places) > 1 else []
    for motion in listed:
        _compare(motion, paths, chain, rate, circular)
    return sorted(listed, key=lambda motion: -len(motion.places))


def _stretches(angles: np.ndarray, chain: Chain) -> list[tuple[int, int]]:
    """Return first and last row of the stretches of a command ``angles`` (N, n) in rad."""
    from scipy.signal import find_peaks

    least = _least_singular(chain, angles)
    regular = least > NEARLY * least.max()
    if not regular.all():
        edges = np.flatnonzero(np.diff(regular)).tolist()
        return [(first + 1, last) for first, last in pairwise(edges) if regular[first + 1]]
    joint = angles[:, int(np.ptp(angles, axis=0).argmax())]
    turns = [find_peaks(s * joint, prominence=LEAST_TURN * np.ptp(joint))[0] for s in (1, -1)]
    return list(pairwise(sorted(np.concatenate(turns).tolist())))


def _least_singular(chain: Chain, angles: np.ndarray) -> np.ndarray:
    return np.linalg.svd(chain.jacobian(angles), compute_uv=False)[:, -1]


def _compare(motion: FoundMotion, paths: Paths, chain: Chain, rate: float, circular) -> None:
    """Set ``least_singular``, ``deviation`` and ``disturbed`` of a ``motion``."""
    name, row = motion.places[0]
    reference = paths[name][1][row : row + motion.steps + 1]
    motion.least_singular = float(_least_singular(chain, reference).min())
    residuals, deviations, whole = [], [], []
    find = repetitions.in_phase if motion.pause is None else repetitions.align
    for name, row in motion.places:
        if SLACK <= row < len(paths[name][1]) - motion.steps - SLACK:
            turns = TURN * turns_apart(reference[0], paths[name][1][row], circular)
            actual, target = (q + turns for q in paths[name])
            start = find(target, row, reference)
            actual, target = (stretch(q, start, len(reference)) for q in (actual, target))
            residuals.append(actual - target)
            deviations.append(np.abs(target - reference).max())
            whole.append((name, row))
    if whole:
        scores = repetitions.disturbances(np.stack(residuals), [], rate)
        motion.deviation = float(np.max(deviations))
        motion.disturbed = [place for place, far in zip(whole, scores > BEYOND, strict=True) if far]


def logged_motions(dataset: Dataset) -> list[MotionSteps]:
    """Return the steps of the undisturbed repetitions per motion, most repetitions first."""
    log, rate, robot = dataset.joint_log, dataset.motion.rate, dataset.robot
    movements = read_movements(dataset)
    columns = [log.joints.index(joint) for joint in robot.joints]
    circular = circular_joints(robot.urdf, robot.joints)
    found, listed = [], []
    for motion in find_motions(movements, robot, rate):
        rest, kept, ends = motion.rest(rate), [], (motion.start, motion.end)
        for name, row in motion.places:
            rows = movements[name]
            first, last = max(row - 1 - rest, 0), row + motion.steps + rest
            if (name, row) not in motion.disturbed and last < len(rows.actual):
                kept.append([q[first : last + 1, columns] for q in (rows.actual, rows.target)])
        if not kept or any(one.like(ends, motion.steps, circular, SAME, 0) for one in listed):
            continue
        listed.append(motion)
        length = min(len(actual) for actual, _ in kept)
        pairs = zip(*kept, strict=True)
        actual, target = (np.stack([q[:length] for q in angles]) for angles in pairs)
        dq = np.diff(target, axis=1)
        name = str(len(listed))
        found.append(MotionSteps(name, actual[:, :-1], dq, np.diff(actual, axis=1) - dq))
    return found
