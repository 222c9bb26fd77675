"""The motions in a controller's logs, each with its ends, steps, pauses and repetitions, of which
one is chosen.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from pipeline.arm.interface import Chain
from pipeline.arm.model import chain_of
from pipeline.core.angles import TURN, apart, turns_apart
from pipeline.core.options.dataset import Robot
from pipeline.recordings.disturbances import disturbances
from pipeline.recordings.logged_movement import LoggedMovement
from pipeline.recordings.repetitions import (
    REACH,
    SLACK,
    Excursion,
    align,
    excursions,
    find_passes,
    in_phase,
    stretch,
)

BEYOND = 6.0  # robust standard deviations, as dataset.joint_log.disturbed_beyond
KEPT = 0.25  # s at rest that are kept on either side of a motion, where its pauses are long enough
NEARLY = 0.1  # of the greatest least singular value of J: below, it is nearly singular
LEAST_TURN = 0.5  # of the farthest turn of a joint: turns less far cut no motion


@dataclass
class Motion:
    """One commanded motion of n joints and where it was found: of every repetition the movement and
    the row that it starts at.
    """

    start: np.ndarray  # (n,) rad
    end: np.ndarray  # (n,) rad
    steps: int
    pause: int | None  # the shortest at either end, in steps; None: it starts and ends in passing
    places: list[tuple[str, int]] = field(default_factory=list)
    disturbed: list[tuple[str, int]] = field(default_factory=list)  # of the places
    least_singular: float = np.nan  # value of J on the way, in m/rad or 1
    deviation: float = np.nan  # rad, the greatest of a command from the first one's

    def rest(self, rate: float) -> int:
        """Steps at rest that are kept on either side, at ``rate`` steps a second: KEPT, or what
        half of the shortest pause leaves beside the rows that ends may be off.
        """
        if self.pause is None:
            return 0
        return max(min(round(KEPT * rate), (self.pause - 2 * SLACK - 2) // 2), 1)


@dataclass(frozen=True)
class _Path:
    """The joints of the robot in one movement."""

    actual: np.ndarray  # (N, n) rad
    target: np.ndarray  # (N, n) rad

    def beside(self, row: int, angles: np.ndarray) -> _Path:
        """The same, moved by the whole turns that take the command at ``row`` to ``angles``."""
        turns = TURN * turns_apart(angles, self.target[row])
        return replace(self, actual=self.actual + turns, target=self.target + turns)


def motions(movements: Mapping[str, LoggedMovement], robot: Robot, rate: float) -> list[Motion]:
    """The motions of the ``robot``'s joints in the ``movements``, at ``rate`` rows a second,
    those of most repetitions first.

    Where no command ever rests, they are the stretches that repeat between the rows at which J is
    nearly singular, or, where it never is, between the turns of the joint that moves farthest.
    Raises ConfigError as :func:`pipeline.arm.model.chain_of` does.
    """
    chain, paths = chain_of(robot), {}
    for name, movement in movements.items():
        columns = [movement.joints.index(joint) for joint in robot.joints]
        paths[name] = _Path(movement.actual[:, columns], movement.target[:, columns])
    listed: list[Motion] = []
    for name, movement in movements.items():
        runs = excursions(movement.target, movement.speed)
        for before, run, after in zip([None, *runs], runs, [*runs[1:], None], strict=False):
            if run.whole:
                _gather(listed, name, paths[name].target, run, before, after)
    listed = listed or _passing(paths, chain)
    for motion in listed:
        _compare(motion, paths, chain, rate)
    return sorted(listed, key=lambda motion: -len(motion.places))


def _gather(
    listed: list[Motion],
    name: str,
    angles: np.ndarray,
    run: Excursion,
    before: Excursion | None,
    after: Excursion | None,
) -> None:
    """Put a ``run`` of commanded ``angles`` to the motion that it repeats, or to the others."""
    start, end = angles[run.first - 1], angles[run.last]
    if np.ptp(angles[run.first - 1 : run.last + 1], axis=0).max() <= REACH:
        return  # joints alone move that the robot does not have
    pause = min(
        run.first - (before.last if before else 0),
        (after.first if after else len(angles)) - run.last,
    )
    motion = next((one for one in listed if _is(one, start, end, run.steps)), None)
    if motion is None:
        listed.append(motion := Motion(start, end, run.steps, pause))
    motion.pause = min(motion.pause, pause)
    motion.places.append((name, run.first))


def _is(motion: Motion, start: np.ndarray, end: np.ndarray, steps: int) -> bool:
    away = np.abs(np.concatenate([apart(motion.start, start), apart(motion.end, end)])).max()
    return bool(away <= REACH and abs(motion.steps - steps) <= SLACK)


def _passing(paths: Mapping[str, _Path], chain: Chain) -> list[Motion]:
    listed: list[Motion] = []
    for path in paths.values():
        for first, last in _stretches(path.target, chain):
            start, end, steps = path.target[first], path.target[last], last - first
            if any(_is(motion, start, end, steps) for motion in listed):
                continue
            passes = [
                (name, run.first)
                for name, other in paths.items()
                for run in find_passes(other.target, start, end, steps).runs
            ]
            if len(passes) > 1:
                listed.append(Motion(start, end, steps, None, passes))
    return listed


def _stretches(angles: np.ndarray, chain: Chain) -> list[tuple[int, int]]:
    """First and last row of the stretches that a command (N, n) in rad is cut into."""
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


def _compare(motion: Motion, paths: Mapping[str, _Path], chain: Chain, rate: float) -> None:
    """Hold the repetitions of a ``motion`` against the first."""
    name, row = motion.places[0]
    reference = paths[name].target[row : row + motion.steps + 1]
    motion.least_singular = float(_least_singular(chain, reference).min())
    place = in_phase if motion.pause is None else align
    residuals, deviations, whole = [], [], []
    for name, row in motion.places:
        path = paths[name].beside(row, reference[0])
        if not SLACK <= row < len(path.target) - motion.steps - SLACK:
            continue
        start = place(path.target, row, reference)
        actual, target = (stretch(q, start, len(reference)) for q in (path.actual, path.target))
        residuals.append(actual - target)
        deviations.append(np.abs(target - reference).max())
        whole.append((name, row))
    if whole:
        scores = disturbances(np.stack(residuals), [], rate)
        motion.deviation = float(np.max(deviations))
        motion.disturbed = [
            place for place, score in zip(whole, scores, strict=True) if score > BEYOND
        ]
