"""Repetitions of one commanded motion in a robot's log, found by what was commanded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.core.angles import apart

# rad: a command that moves no joint farther is the controller taking over, not a motion; ends this
# near are the same
REACH = 0.01
REST_SPEED = 1e-4  # rad/s: less than a microradian a sample, below what encoders resolve
PHASE_ROUNDS = 4  # each squares what is left of the phase
SLACK = 2  # rows by which the logger may see the same command start early or late, or last longer


@dataclass(frozen=True)
class Excursion:
    """A commanded motion: the speed is commanded from row ``first`` up to, but not on, row ``last``
    of its log.
    """

    first: int
    last: int
    whole: bool  # whether the log holds it from rest to rest

    @property
    def steps(self) -> int:
        """Steps of the log's clock that the motion takes."""
        return self.last - self.first

    def lack(self, rows: int) -> str:
        """What keeps it from being whole, in words, in a log of so many ``rows``; empty of a whole
        one.
        """
        if self.whole:
            return ""
        # the first row has no step before it
        at_start, at_end = self.first <= 1, self.last >= rows
        if at_start and at_end:
            return "a command that never rests, to be cut with rest: 0"
        edge = "start" if at_start else "end"
        return f"a motion from row {self.first}, cut off by the {edge} of the log"

    def describe(self, angles: np.ndarray) -> str:
        """The motion in words, its ends read from the commanded ``angles`` (N, joints): for a
        message to choose from.
        """
        start, end = angles[self.first - 1], angles[self.last]
        return f"{np.round(start, 2).tolist()} to {np.round(end, 2).tolist()} in {self.steps} steps"


@dataclass(frozen=True)
class Repetitions:
    """The whole repetitions of one motion in a log, and the rows at which each other excursion
    starts, by why it was left out.
    """

    runs: list[Excursion]
    # cut_off, other_motion, too_little_rest; of motions in passing overlapping
    left_out: dict[str, list[int]]


def _moving(speeds: np.ndarray, rest_speed: float) -> np.ndarray:
    return np.any(np.abs(speeds) > rest_speed, axis=1)


def excursions(
    angles: np.ndarray, speeds: np.ndarray, rest_speed: float = REST_SPEED
) -> list[Excursion]:
    """Every motion in a log of commanded ``angles`` (N, joints) in rad and commanded ``speeds`` (N,
    joints) in rad/s, in order of time.

    The speed tells motion from rest: it is zero, or at most ``rest_speed``, while a controller
    holds its position, where the commanded angle may creep.
    """
    edges = np.flatnonzero(np.diff(_moving(speeds, rest_speed), prepend=False, append=False))
    bounds = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    runs = [Excursion(first, last, 0 < first and last < len(speeds)) for first, last in bounds]
    return [
        run
        for run in runs
        if np.ptp(angles[max(run.first - 1, 0) : run.last + 1], axis=0).max() > REACH
    ]


def commanded_speeds(angles: np.ndarray, rate: float, rest_speed: float = REST_SPEED) -> np.ndarray:
    """(N, joints) in rad/s: the step to each commanded angle (N, joints) from the one before at
    ``rate`` (1/s), 0 for the first.

    For controllers that log no commanded speed. It is 0 outside :func:`excursions`: an angle that
    creeps at rest, or settles after a motion, goes nowhere. Creeping next to a motion is told from
    it by ``rest_speed`` alone, which must lie above its steps.
    """
    steps = np.diff(angles, axis=0, prepend=angles[:1]) * rate
    speeds = np.zeros_like(steps)
    for run in excursions(angles, steps, rest_speed):
        speeds[run.first : run.last] = steps[run.first : run.last]
    return speeds


def find_repetitions(
    angles: np.ndarray,
    speeds: np.ndarray,
    columns: Sequence[int],
    start: Sequence[float],
    end: Sequence[float],
    *,
    steps: int,
    rest: int,
    rest_speed: float = REST_SPEED,
) -> Repetitions:
    """The whole excursions that take the joints ``columns`` from ``start`` to ``end`` (rad) in
    ``steps`` steps.

    ``angles``, ``speeds`` (N, joints) and ``rest_speed`` as for :func:`excursions`. Each repetition
    has ``rest`` rows at rest on either side; ends agree within 0.01 rad and durations within two
    steps.
    """
    moving = _moving(speeds, rest_speed)
    runs, left_out = [], {"cut_off": [], "other_motion": [], "too_little_rest": []}
    for run in excursions(angles, speeds, rest_speed):
        if not run.whole:
            left_out["cut_off"].append(run.first)
            continue
        ends = apart(angles[[run.first - 1, run.last]][:, list(columns)], np.stack([start, end]))
        before, after = run.first - rest - SLACK, run.last + rest + 2 * SLACK + 1
        if np.abs(ends).max() > REACH or abs(run.steps - steps) > SLACK:
            left_out["other_motion"].append(run.first)
        elif (
            before < 0
            or after > len(moving)
            or moving[before : run.first].any()
            or moving[run.last : after].any()
        ):
            left_out["too_little_rest"].append(run.first)
        else:
            runs.append(run)
    return Repetitions(runs, left_out)


def find_passes(
    angles: np.ndarray, start: Sequence[float], end: Sequence[float], steps: int
) -> Repetitions:
    """The stretches of ``steps`` steps in which commanded ``angles`` (N, joints) in rad pass
    ``start`` and then ``end``, of a command that repeats without rest.

    Both are passed within 0.01 rad; of the rows around, the one nearest to both counts. A stretch
    that begins before the one before has ended is left out.
    """
    runs, left_out = [], {"overlapping": []}
    if len(angles) <= steps:
        return Repetitions(runs, left_out)
    ends = [apart(angles[:-steps], np.array(start)), apart(angles[steps:], np.array(end))]
    away = np.abs(np.hstack(ends)).max(axis=1)
    edges = np.flatnonzero(np.diff(away <= REACH, prepend=False, append=False)).tolist()
    for begin, stop in zip(edges[::2], edges[1::2], strict=True):
        first = begin + int(away[begin:stop].argmin())
        if runs and first < runs[-1].last:
            left_out["overlapping"].append(first)
        else:
            runs.append(Excursion(first, first + steps, whole=True))
    return Repetitions(runs, left_out)


def in_phase(angles: np.ndarray, first: int, reference: np.ndarray) -> float:
    """The place between rows near ``first`` from which ``angles`` (N, joints) follow ``reference``
    (K, joints), both in rad, best by least squares: a period is seldom a whole number of rows.
    """
    place = float(first)
    for _ in range(PHASE_ROUNDS):
        late = lag(reference, stretch(angles, place, len(reference)), 1.0)
        place = float(np.clip(place + late, max(0, first - SLACK), first + SLACK))
        place = min(place, float(len(angles) - len(reference)))
    return place


def stretch(angles: np.ndarray, place: float, length: int) -> np.ndarray:
    """(length, joints) of ``angles`` (N, joints) from ``place`` on, a row or a place between two:
    there by cubic splines through the rows.
    """
    from scipy.interpolate import CubicSpline

    if place == round(place):
        return angles[round(place) :][:length]
    return CubicSpline(np.arange(len(angles)), angles)(place + np.arange(length))


def align(angles: np.ndarray, first: int, reference: np.ndarray) -> int:
    """The row within two of ``first`` from which ``angles`` (N, joints) follow ``reference`` (K,
    joints) best, in rad.

    A motion starts anywhere between two samples, so that equal commands can differ by a row at one
    of their ends.
    """
    rows = range(first - SLACK, first + SLACK + 1)
    return min(rows, key=lambda row: np.abs(angles[row : row + len(reference)] - reference).max())


def lag(commanded: np.ndarray, measured: np.ndarray, rate: float) -> float:
    """Time in s by which ``measured`` angles (K, joints) trail the ``commanded`` ones, at ``rate``
    samples per second.

    Least squares of measured(t) = commanded(t − lag) to first order in the lag, over all joints
    together. NaN of a command at rest, which moves no joint farther than REACH: nothing trails it.
    """
    if not np.ptp(commanded, axis=0).max() > REACH:
        return np.nan
    velocity = np.gradient(commanded, axis=0) * rate
    return float(np.sum((commanded - measured) * velocity) / np.sum(velocity**2))
