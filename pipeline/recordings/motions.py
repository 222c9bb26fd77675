"""Motions in a controller's logs that a dataset may analyse: ends, steps, pauses, repetitions."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from pipeline.arm.interface import Chain
from pipeline.arm.model import chain_of
from pipeline.core.options.dataset import Dataset, Robot
from pipeline.models.other_motions import MotionSteps
from pipeline.recordings.commands import circular_joints
from pipeline.recordings.joint_logs import read_movements
from pipeline.recordings.lags import in_phase, stretch
from pipeline.recordings.movement import LoggedMovement
from pipeline.recordings.repetitions import SLACK, find_repetitions
from pipeline.recordings.runs import ALIKE, located_runs

KEPT = 0.25  # s, rest that is kept before and after a motion, if its pauses are long enough
NEARLY = 0.1  # J is nearly singular if σ_min is below this share of the greatest σ_min
LEAST_TURN = 0.5  # least prominence of a turn between two motions, over the joint's range


@dataclass
class FoundMotion:
    """One commanded motion of n joints, and the places (movement, first row) of repetitions."""

    start: np.ndarray  # (n,) rad
    end: np.ndarray  # (n,) rad
    steps: int
    pause: int | None  # steps of the shortest pause before or after; None: no rest
    places: list[tuple[str, int]] = field(default_factory=list)
    disturbed: list[tuple[str, int]] = field(default_factory=list)  # or with another command
    least_singular: float = np.nan  # m/rad or 1, least singular value of J along the motion
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
    repetitions first: runs of equal commands from rest to rest. If no command ever rests, motions
    are repeated stretches between rows where J is nearly singular or, without such rows, between
    turns of the joint that moves farthest.
    """
    chain, listed = chain_of(robot), {}
    paths = {name: read.of(robot.joints).target for name, read in movements.items()}

    def stretch_of(motion: FoundMotion) -> np.ndarray:
        """Return the commanded angles of the first repetition."""
        name, first = motion.places[0]
        return paths[name][first:][: motion.steps + 1]

    (runs, unused), places = located_runs(movements, rate, robot.joints)
    for run in runs:
        name, (first, last, whole, pause) = places[run.name]
        if not whole:
            continue
        target = paths[name]
        new = FoundMotion(target[first - 1], target[last], last - first, pause)
        motion = listed.setdefault(run.motion, new)
        if abs(last - first - motion.steps) > SLACK:  # a part of the motion
            continue
        motion.pause = min(motion.pause, pause)
        motion.places.append((name, first))
        reference = stretch_of(motion)
        place = in_phase(target, first, reference, SLACK, whole=True)
        off = float(np.abs(stretch(target, place, len(reference)) - reference).max())
        if run.name in unused or off > ALIKE:
            motion.disturbed.append((name, first))
        motion.deviation = max(motion.deviation, off)
    found = [*listed.values()] or _repeated_stretches(paths, chain, robot)
    for motion in found:
        motion.least_singular = float(_least_singular(chain, stretch_of(motion)).min())
    return sorted(found, key=lambda motion: -len(motion.places))


def _repeated_stretches(paths: Mapping, chain: Chain, robot: Robot) -> list[FoundMotion]:
    circular, found = circular_joints(robot.urdf, robot.joints), []
    for path in paths.values():
        for first, last in _regular_stretches(path, chain):
            ends, steps = (path[first], path[last]), last - first
            each = {n: find_repetitions(q, [], ends, steps, 0, circular) for n, q in paths.items()}
            places = [(name, run.first) for name, (runs, _) in each.items() for run in runs]
            if len(places) > 1 and not any({*places} & {*other.places} for other in found):
                found.append(FoundMotion(*ends, steps, None, places))
    return found


def _regular_stretches(angles: np.ndarray, chain: Chain) -> list[tuple[int, int]]:
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
