"""Repetitions of one commanded motion in a robot's log, and disturbed ones among them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pipeline.core.angles import apart

# rad: a command that moves no joint farther is the controller's start, not a motion; ends within
# this distance are the same
REACH = 0.01
REST_SPEED = 1e-4  # rad/s: less than a microradian a sample, below what encoders resolve
PHASE_ROUNDS = 4  # each squares the error of the phase
# least scale of a score as a share of the median over the takes: of a whole take, and of its
# greatest window; and least scale of a joint as a share of the median over all joints
LEAST_SPREAD, LEAST_IN_WINDOWS = 0.25, 0.45
WINDOW = 0.25  # s, as a push by hand lasts
OVERLAP = 4  # windows begin within the time of one
SLACK = 2  # rows by which the logger may record the same command early, late or longer


class Excursion(NamedTuple):
    """A commanded motion from row ``first`` up to row ``last``; ``whole``: from rest to rest."""

    first: int
    last: int
    whole: bool

    @property
    def steps(self) -> int:
        """Steps of the log's clock that the motion takes."""
        return self.last - self.first

    def lack(self, rows: int) -> str:
        """Say why the motion is not whole in a log of so many ``rows``; "" if it is."""
        at_start = self.first <= 1  # the first row has no step before it
        if at_start and self.last >= rows:
            return "a command that never rests, to be cut with rest: 0"
        edge = "start" if at_start else "end"
        cut = f"a motion from row {self.first}, cut off by the {edge} of the log"
        return "" if self.whole else cut


class Repetitions(NamedTuple):
    """Whole repetitions of one motion in a log, and first rows of other excursions by reason."""

    runs: list[Excursion]
    left_out: dict[str, list[int]]


def _runs(inside: np.ndarray) -> list[tuple[int, int]]:
    """First row of each run of true rows, and the row behind it."""
    edges = np.flatnonzero(np.diff(inside, prepend=False, append=False)).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


def excursions(
    angles: np.ndarray, speeds: np.ndarray, rest_speed: float = REST_SPEED
) -> list[Excursion]:
    """Find every motion in a log of commanded ``angles`` (N, joints) rad, ``speeds`` rad/s."""
    return [
        Excursion(first, last, 0 < first and last < len(speeds))
        for first, last in _runs(np.any(np.abs(speeds) > rest_speed, axis=1))
        if np.ptp(angles[max(first - 1, 0) : last + 1], axis=0).max() > REACH
    ]


def commanded_speeds(angles: np.ndarray, rate: float, rest_speed: float = REST_SPEED) -> np.ndarray:
    """Return (N, joints) rad/s, the steps of commanded ``angles``, 0 outside :func:`excursions`."""
    steps = np.diff(angles, axis=0, prepend=angles[:1]) * rate
    speeds = np.zeros_like(steps)
    for run in excursions(angles, steps, rest_speed):
        speeds[run.first : run.last] = steps[run.first : run.last]
    return speeds


def find_repetitions(
    angles: np.ndarray,
    speeds: np.ndarray,
    columns: Sequence[int],
    ends: Sequence[Sequence[float]],
    *,
    steps: int,
    rest: int,
    rest_speed: float = REST_SPEED,
    circular: np.ndarray | bool = True,
) -> Repetitions:
    """Find the whole :func:`excursions` that move the joints ``columns`` between the ``ends`` (rad;
    m of joints not ``circular``) within 0.01, in ``steps`` ± 2, with ``rest`` rows at rest on
    either side. With ``rest`` 0 find the stretches of ``steps`` that pass both ends within 0.01.
    """
    if not rest:
        return _find_passes(angles[:, columns], ends, steps, circular)
    moving = np.any(np.abs(speeds) > rest_speed, axis=1)
    runs, left_out = [], {"cut_off": [], "other_motion": [], "too_little_rest": []}
    for run in excursions(angles, speeds, rest_speed):
        if not run.whole:
            left_out["cut_off"].append(run.first)
            continue
        reached = angles[[run.first - 1, run.last]][:, columns]
        before, after = run.first - rest - SLACK, run.last + rest + 2 * SLACK + 1
        away = np.abs(apart(reached, np.stack(ends), circular)).max()
        near = moving[max(before, 0) : run.first].any() or moving[run.last : after].any()
        if away > REACH or abs(run.steps - steps) > SLACK:
            left_out["other_motion"].append(run.first)
        elif before < 0 or after > len(moving) or near:
            left_out["too_little_rest"].append(run.first)
        else:
            runs.append(run)
    return Repetitions(runs, left_out)


def _find_passes(
    angles: np.ndarray, ends: Sequence[Sequence[float]], steps: int, circular: np.ndarray | bool
) -> Repetitions:
    runs, overlapping = [], []
    if len(angles) > steps:
        rows = angles[:-steps], angles[steps:]
        distances = [apart(*pair, circular) for pair in zip(rows, np.array(ends), strict=True)]
        away = np.abs(np.hstack(distances)).max(axis=1)
        for begin, stop in _runs(away <= REACH):
            first = begin + int(away[begin:stop].argmin())
            if runs and first < runs[-1].last:
                overlapping.append(first)
            else:
                runs.append(Excursion(first, first + steps, whole=True))
    return Repetitions(runs, {"overlapping": overlapping})


def in_phase(angles: np.ndarray, first: int, reference: np.ndarray) -> float:
    """Return the place between rows from which ``angles`` follow ``reference`` by least squares."""
    place = float(first)
    for _ in range(PHASE_ROUNDS):
        late = lag(reference, stretch(angles, place, len(reference)), 1.0)
        place = float(np.clip(place + late, max(0, first - SLACK), first + SLACK))
        place = min(place, float(len(angles) - len(reference)))
    return place


def align(angles: np.ndarray, first: int, reference: np.ndarray) -> int:
    """Return the row within two of ``first`` from which ``angles`` follow ``reference`` best."""
    rows = range(first - SLACK, first + SLACK + 1)
    return min(rows, key=lambda row: np.abs(angles[row : row + len(reference)] - reference).max())


def stretch(angles: np.ndarray, place: float, length: int) -> np.ndarray:
    """Return (length, joints) of ``angles`` from ``place`` on, between rows by cubic splines."""
    from scipy.interpolate import CubicSpline

    if place == round(place):
        return angles[round(place) :][:length]
    return CubicSpline(np.arange(len(angles)), angles)(place + np.arange(length))


def lag(commanded: np.ndarray, measured: np.ndarray, rate: float) -> float:
    """Return the s by which ``measured`` angles trail the ``commanded``; NaN without a motion."""
    if not np.ptp(commanded, axis=0).max() > REACH:
        return np.nan
    velocity = np.gradient(commanded, axis=0) * rate
    return float(np.sum((commanded - measured) * velocity) / np.sum(velocity**2))


def disturbances(residuals: np.ndarray, others: Sequence[np.ndarray], rate: float) -> np.ndarray:
    """Return (takes,) the distance of each repetition from the others in robust standard
    deviations (1.4826 times the median absolute deviation, at least a share of the median).

    The distance is the greater one of the whole take's, by the root mean square, and of the joint
    and window of greatest mean. ``residuals`` (takes, K, joints) rad are measured minus commanded
    angles at ``rate`` rows a second; ``others`` are signals of the same shape, as currents. Of two
    repetitions none is disturbed.
    """
    signals = [residuals, *others]
    farthest = np.max([_windowed(signal, rate) for signal in signals], axis=0)
    whole = [_scores(beside_others(signal), LEAST_SPREAD) for signal in signals]
    return np.max([_scores(farthest, LEAST_IN_WINDOWS), *whole], axis=0)


def beside_others(signal: np.ndarray) -> np.ndarray:
    """Return (takes,) the root mean square distance of ``signal`` from its median at each step."""
    return np.sqrt(np.mean((signal - np.median(signal, axis=0)) ** 2, axis=(-2, -1)))


def _windowed(signal: np.ndarray, rate: float) -> np.ndarray:
    """(takes,) greatest mean over a window of a joint beside the median, over the usual one."""
    beside, length = signal - np.median(signal, axis=0), signal.shape[1]
    rows = min(max(round(WINDOW * rate), 1), length)
    starts = np.arange(0, length - rows + 1, max(rows // OVERLAP, 1))
    sums = np.cumsum(np.concatenate([np.zeros_like(beside[:, :1]), beside], axis=1), axis=1)
    means = np.abs(sums[:, starts + rows] - sums[:, starts]) / rows
    here, of_joint, of_all = (np.median(means, axes, keepdims=True) for axes in (0, (0, 1), None))
    usual = np.maximum(here, np.maximum(of_joint, LEAST_SPREAD * of_all))
    ratios = np.divide(means, usual, out=np.ones_like(means), where=usual > 0)
    return ratios.max(axis=(1, 2))


def _scores(distance: np.ndarray, least: float) -> np.ndarray:
    """Distance (takes,) from its median, in robust standard deviations."""
    off = distance - np.median(distance)
    deviation = 1.4826 * np.median(np.abs(off))
    scale = np.maximum(deviation, least * (distance - off))
    return np.divide(off, scale, out=np.zeros_like(off), where=scale > 0)
