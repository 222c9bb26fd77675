"""Repetitions of one commanded motion in a robot's log."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pipeline.core.angles import apart
from pipeline.recordings.lags import REACH

# rad/s: less than a microradian per sample, below the resolution of encoders
REST_SPEED = 1e-4
SLACK = 2  # rows by which a log may have the same command earlier, later or longer


class Excursion(NamedTuple):
    """Commanded motion from row ``first`` to row ``last``; ``whole`` if it is from rest to rest."""

    first: int
    last: int
    whole: bool
    pause: int = 0  # steps of the shorter rest before or after

    @property
    def steps(self) -> int:
        """Duration of the motion in steps of the log's clock."""
        return self.last - self.first

    def lack(self, rows: int) -> str:
        """Return why the motion is not whole in a log of ``rows`` rows; "" if it is whole."""
        at_start = self.first <= 1  # the first row has no step before it
        if self.whole:
            return ""
        if at_start and self.last >= rows:
            return "a command that never rests (set rest: 0)"
        edge = "start" if at_start else "end"
        return f"a motion from row {self.first}, cut off by the {edge} of the log"


class Repetitions(NamedTuple):
    """Whole repetitions of one motion in a log, and reason → first rows of other excursions."""

    runs: list[Excursion]
    left_out: dict[str, list[int]]


def _runs(inside: np.ndarray) -> list[tuple[int, int]]:
    """Return the first row of each run of true rows and the row behind the run."""
    edges = np.flatnonzero(np.diff(inside, prepend=False, append=False)).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


def excursions(
    angles: np.ndarray,
    speeds: np.ndarray | float,
    rest_speed: float = REST_SPEED,
) -> list[Excursion]:
    """Return all motions in a log of commanded ``angles`` (N, joints) rad and ``speeds`` (N,
    joints) rad/s, or the rate in Hz: speeds are then the steps of the angles.
    """
    if np.ndim(speeds) == 0:
        speeds = np.diff(angles, axis=0, prepend=angles[:1]) * speeds
    moved = []
    for first, last in _runs(np.any(np.abs(speeds) > rest_speed, axis=1)):
        before = max(first - 1, 0)
        travel = np.ptp(angles[before : last + 1], axis=0)
        if travel.max() > REACH:
            moved.append((first, last))

    stops_before = [0, *(last for _, last in moved)]
    starts_after = [*(first for first, _ in moved[1:]), len(angles)]
    motions = []
    for i, (first, last) in enumerate(moved):
        pause = min(first - stops_before[i], starts_after[i] - last)
        whole = first > 0 and last < len(angles)
        motions.append(Excursion(first, last, whole, pause))
    return motions


def find_repetitions(
    angles: np.ndarray,
    motions: Sequence[Excursion],
    ends: Sequence[Sequence[float]],
    steps: int,
    rest: int,
    circular: np.ndarray | bool = True,
) -> Repetitions:
    """Return the whole ``motions`` in a log of commanded ``angles`` (N, n) rad between the ``ends``
    (rad; m for joints that are not ``circular``) to within REACH, in ``steps`` ± SLACK, with
    ``rest`` steps at rest before and after. With ``rest`` 0, return the stretches of ``steps`` that
    pass both ends within REACH.
    """
    if not rest:
        return _find_passes(angles, ends, steps, circular)
    runs: list[Excursion] = []
    left_out = {"cut_off": [], "other_motion": [], "too_little_rest": []}
    for run in motions:
        before = max(run.first - 1, 0)
        last = min(run.last, len(angles) - 1)
        reached = angles[[before, last]]
        away = np.abs(apart(reached, np.stack(ends), circular)).max()
        if not run.whole:
            left_out["cut_off"].append(run.first)
        elif away > REACH or abs(run.steps - steps) > SLACK:
            left_out["other_motion"].append(run.first)
        elif run.pause < rest + 2 * SLACK + 1:
            left_out["too_little_rest"].append(run.first)
        else:
            runs.append(run)
    return Repetitions(runs, left_out)


def _find_passes(
    angles: np.ndarray,
    ends: Sequence[Sequence[float]],
    steps: int,
    circular: np.ndarray | bool,
) -> Repetitions:
    runs = []
    overlapping = []
    number = max(len(angles) - steps, 0)
    later = angles[steps:][:number]
    passing = np.stack([angles[:number], later], axis=1)
    distances = np.abs(apart(passing, np.array(ends), circular))
    away = distances.max(axis=(1, 2))
    for begin, stop in _runs(away <= REACH):
        first = begin + int(away[begin:stop].argmin())
        if runs and first < runs[-1].last:
            overlapping.append(first)
        else:
            runs.append(Excursion(first, first + steps, whole=True))
    return Repetitions(runs, {"overlapping": overlapping})
