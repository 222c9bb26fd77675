"""Motions in a robot's logs which a dataset may analyse: ends, steps, pauses and repetitions."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from pipeline.arm.chain import Chain
from pipeline.arm.model import chain_of
from pipeline.core.options.dataset import Dataset, Robot
from pipeline.models.other_motions import MotionSteps
from pipeline.recordings.commands import circular_joints
from pipeline.recordings.joint_logs import read_movements
from pipeline.recordings.lags import in_phase, stretch
from pipeline.recordings.movement import LoggedMovement
from pipeline.recordings.quality import disturbances
from pipeline.recordings.repetitions import SLACK, Excursion, find_repetitions
from pipeline.recordings.runs import ALIKE, FEWEST, LIMITS

KEPT = 0.25  # s, rest that is kept before and after a motion, if its pauses are long enough
NEARLY = 0.1  # J is nearly singular if σ_min is below this share of the greatest σ_min
# least prominence of a turn between two motions, over the joint's range
LEAST_TURN = 0.5


@dataclass
class FoundMotion:
    """One commanded motion of n joints, and the places (movement, first row) of repetitions."""

    start: np.ndarray  # (n,) rad
    end: np.ndarray  # (n,) rad
    steps: int
    pause: int | None  # steps of the shortest pause before or after; None: no rest
    places: list[tuple[str, int]] = field(default_factory=list)
    # places of disturbed repetitions, or with another command
    disturbed: list[tuple[str, int]] = field(default_factory=list)
    # m/rad or 1, least singular value of J along the motion
    least_singular: float = np.nan
    deviation: float = 0.0  # rad, greatest distance of a command from the first command

    def rest(self, rate: float) -> int:
        """Return the steps of rest to keep before and after: KEPT, or half the shortest pause."""
        if self.pause is None:
            return 0
        half_pause = (self.pause - 2 * SLACK - 2) // 2
        return max(min(round(KEPT * rate), half_pause), 1)


def find_motions(
    movements: Mapping[str, LoggedMovement],
    robot: Robot,
    rate: float,
) -> list[FoundMotion]:
    """Return the motions of the ``robot``'s joints in the ``movements`` at ``rate`` (Hz), most
    repetitions first: commands from rest to rest with equal ends and steps. If no command ever
    rests, motions are repeated stretches between rows where J is nearly singular or, without such
    rows, between turns of the joint that moves farthest.
    """
    chain = chain_of(robot)
    circular = circular_joints(robot.urdf, robot.joints)
    logs = {name: log.of(robot.joints) for name, log in movements.items()}
    resting = any(run.whole for log in logs.values() for run in log.motions)
    motions: list[FoundMotion] = []
    seen: set[tuple[str, int]] = set()
    fewest = 1 if resting else 2
    for log in logs.values():
        for first, last in _spans(log, resting, chain):
            ends = (log.target[first], log.target[last])
            steps = last - first
            if resting:
                steps -= 1  # the first row is the last one at rest
            runs = _repetitions_in(logs, ends, steps, resting, circular)
            places = [(name, run.first) for name, run in runs]
            if len(places) < fewest or not seen.isdisjoint(places):
                continue
            seen |= {*places}
            pause = min(run.pause for _, run in runs) if resting else None
            motion = FoundMotion(*ends, steps, pause, places)
            _compare(motion, logs, rate, chain)
            motions.append(motion)
    return sorted(motions, key=lambda motion: -len(motion.places))


def _spans(
    log: LoggedMovement,
    resting: bool,
    chain: Chain,
) -> list[tuple[int, int]]:
    """Return first and last row of each stretch of a ``log`` that may be a motion."""
    if resting:
        return [(run.first - 1, run.last) for run in log.motions if run.whole]
    return _regular_stretches(log.target, chain)


def _repetitions_in(
    logs: Mapping[str, LoggedMovement],
    ends: tuple[np.ndarray, np.ndarray],
    steps: int,
    resting: bool,
    circular: np.ndarray,
) -> list[tuple[str, Excursion]]:
    """Return movement and rows of each repetition in ``logs`` of the motion between the ``ends``
    (n,) rad in ``steps``; ``resting`` if the arm rests before and after.
    """
    runs = []
    for name, log in logs.items():
        repetitions = find_repetitions(
            log.target,
            log.motions,
            ends,
            steps,
            int(resting),
            circular,
        )
        runs += [(name, run) for run in repetitions.runs]
    return runs


def _compare(
    motion: FoundMotion,
    logs: Mapping[str, LoggedMovement],
    rate: float,
    chain: Chain,
) -> None:
    """Set the least singular value along the first repetition and, of a motion between rests, the
    greatest deviation of a command from the first command and the disturbed repetitions.
    """
    name, row = motion.places[0]
    length = motion.steps + 1
    reference = logs[name].target[row:][:length]
    motion.least_singular = float(_least_singular(chain, reference).min())
    if motion.pause is None:
        return

    residuals = {}
    for name, row in motion.places:
        log = logs[name]
        start = in_phase(log.target, row, reference, SLACK, whole=True)
        command = stretch(log.target, start, len(reference))
        deviation = float(np.abs(command - reference).max())
        motion.deviation = max(motion.deviation, deviation)
        if deviation > ALIKE:
            motion.disturbed.append((name, row))
        else:
            errors = log.actual - log.target
            residuals[name, row] = stretch(errors, start, len(reference))

    if len(residuals) >= FEWEST:
        scores = disturbances(np.stack([*residuals.values()]), rate)
        places = [*residuals]
        for i in np.flatnonzero(scores > LIMITS.disturbance):
            motion.disturbed.append(places[i])


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
    prominence = LEAST_TURN * np.ptp(joint)
    highest, _ = find_peaks(joint, prominence=prominence)
    lowest, _ = find_peaks(-joint, prominence=prominence)
    turns = sorted([*highest.tolist(), *lowest.tolist()])
    return list(pairwise(turns))


def _least_singular(chain: Chain, angles: np.ndarray) -> np.ndarray:
    return np.linalg.svd(chain.jacobian(angles), compute_uv=False)[:, -1]


def logged_motions(dataset: Dataset) -> list[MotionSteps]:
    """Return the steps of the undisturbed repetitions per motion, most repetitions first."""
    rate = dataset.motion.rate
    robot = dataset.robot
    movements = read_movements(dataset)
    logs = {name: movement.of(robot.joints) for name, movement in movements.items()}
    steps_of_motions: list[MotionSteps] = []
    for motion in find_motions(movements, robot, rate):
        takes = _undisturbed_takes(motion, logs, rate)
        if not takes:
            continue
        length = min(take.shape[1] for take in takes)
        equally_long = [take[:, :length] for take in takes]
        actual, target = np.stack(equally_long, axis=1)
        commanded = np.diff(target, axis=1)
        noise = np.diff(actual, axis=1) - commanded
        number = str(len(steps_of_motions) + 1)
        steps_of_motions.append(MotionSteps(number, actual[:, :-1], commanded, noise))
    return steps_of_motions


def _undisturbed_takes(
    motion: FoundMotion,
    logs: Mapping[str, LoggedMovement],
    rate: float,
) -> list[np.ndarray]:
    """Return actual and target angles (2, K, n) rad of each undisturbed repetition with its rest
    before and after, without a repetition whose rest is cut off.
    """
    rest = motion.rest(rate)
    takes = []
    for name, row in motion.places:
        log = logs[name]
        first = max(row - 1 - rest, 0)
        last = row + motion.steps + rest
        if (name, row) not in motion.disturbed and last < len(log.actual):
            angles = np.stack([log.actual, log.target])
            takes.append(angles[:, first : last + 1])
    return takes
