"""Pairs of measured and commanded angles, and the unit, order or clock that makes them one."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.recordings.repetitions import REACH, lag

OPTION = "dataset.joint_log"
LATEST = 0.05  # s by which a controller may lag behind its command; beyond, two clocks differ
SEARCH = 10.0  # s, the farthest that clocks are looked for apart
MOST = 0.9  # of the rows: a repetition that was disturbed does not decide
LEAST_MOTION = 0.1  # of the farthest joint's motion: what joints that move less are held against
STILL = 0.1  # rad, likewise: an arm at rest is held to a command, not to the noise of its encoders
SMOOTHING = 0.02  # s, over which the speed of the arm is taken
PEAKS, NEAR = 8, 0.8  # delays that are tried: those of the highest correlations, down to this share
SAME = 0.02  # of a factor, up to which it is one of those that unit conversions have
ORDER_GAIN = 0.5  # of what is left: another order or sign has to leave less than this of it
DEGREES, TURN = 180 / np.pi, 2 * np.pi
FACTORS = {"1": 1.0, "180/π": DEGREES, "π/180": 1 / DEGREES, "(180/π)²": DEGREES**2}
FACTORS |= {"(π/180)²": DEGREES**-2, "2π": TURN, "1/2π": 1 / TURN}


class Pairing(NamedTuple):
    """Command of joint i: column ``order[i]`` times ``factor[i]``, ``delay`` rows later."""

    factor: np.ndarray  # (n,)
    order: np.ndarray  # (n,) int
    delay: int  # rows by which the command is early

    def apply(self, actual: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows of both (N − |delay|, n) that belong together, in rad."""
        actual, target = delayed(actual, target, self.delay)
        return actual, target[:, self.order] * self.factor

    def left(self, actual: np.ndarray, target: np.ndarray) -> float:
        """Return the greatest tracking error that the pair leaves, of :func:`missed`."""
        return float(missed(*self.apply(actual, target)).max())


def delayed(actual: np.ndarray, target: np.ndarray, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Return measured rows and the commanded ones ``rows`` before them, without the unpaired."""
    length = len(actual) - abs(rows)
    return actual[max(rows, 0) :][:length], target[max(-rows, 0) :][:length]


def missed(actual: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return (n,) the tracking error of each joint divided by its motion (a tenth of the farthest
    joint's and STILL at least): the greater 0.9 quantile over the rows of ``actual`` and ``target``
    (N, n) rad at which the command moves, or rests.
    """
    residual, motion = np.abs(actual - target), np.ptp(actual, axis=0)
    scale = np.maximum(motion, max(LEAST_MOTION * motion.max(), STILL))
    steps = np.abs(np.diff(target, axis=0, prepend=target[:1])).max(axis=1)
    moving = steps > LEAST_MOTION * np.quantile(steps, 0.99)
    shares = [np.quantile(residual[rows], MOST, axis=0) for rows in (moving, ~moving) if rows.any()]
    return np.max(shares, axis=0) / scale


def pairing_of(actual: np.ndarray, target: np.ndarray, rate: float) -> Pairing:
    """Return the pairing of least error, the plain one where no other leaves clearly less."""
    best = _plain(actual.shape[1])
    if not (np.ptp(actual, axis=0).max() > REACH and np.ptp(target, axis=0).any()):
        return best
    least = best.left(actual, target)
    for delay in _delays(actual, target, rate):
        tried = _settled(*delayed(actual, target, delay), delay)
        if (left := tried.left(actual, target)) < ORDER_GAIN * least:
            best, least = tried, left
    # the delay to the nearest row; within LATEST of none it is the controller's, not a clock's
    behind, command = best.apply(actual, target)
    late = lag(command, behind, rate)
    delay = best.delay + (round(late * rate) if np.isfinite(late) else 0)
    return best._replace(delay=delay if abs(delay) > LATEST * rate else 0)


def require_pair(
    actual: np.ndarray,
    target: np.ndarray,
    rate: float,
    *,
    limit: float,
    joints: Sequence[str],
    **evidence: object,
) -> None:
    """Raise RecordingError where ``actual`` angles (N, n) in rad are no pair with commanded
    ``target`` at ``rate`` rows a second: a joint misses its command by more than ``limit`` of its
    motion, or the arm lags by more than LATEST. Unit, order and clock are named with their option.
    """
    missing = missed(actual, target)
    worst, late = int(missing.argmax()), lag(target, actual, rate)  # NaN of a command at rest
    if missing[worst] > limit:
        fault = f"{joints[worst]} misses its command by {missing[worst]:.2g} of its motion (0.9"
        fault += f" quantile over the rows), more than {limit:g} (mismatch)"
    elif abs(late) > LATEST:
        fault = f"the arm is {late:.2g} s behind its command, more than {LATEST:g}"
    else:
        return
    pairing = pairing_of(actual, target, rate)
    left = pairing.left(actual, target)
    words = [
        f"the {what} ({option.rpartition('.')[2]}: {value}, without which {without:.2g} is left)"
        for what, option, value, without in suspects(pairing, actual, target, rate)
    ]
    cause = "no other unit, order or clock makes them one: are they of one movement?"
    if words and left <= limit:
        cause = f"suspected: {', '.join(words)}; that leaves {left:.2g}"
    message = f"measured and commanded angles are no pair: {fault}; {cause}"
    raise RecordingError(message, **evidence, key=OPTION)


def suspects(
    pairing: Pairing, actual: np.ndarray, target: np.ndarray, rate: float
) -> Iterator[tuple[str, str, str, float]]:
    """Yield each change of a ``pairing``: words, option, value, and the error left without it."""
    plain, (factor, order, delay) = _plain(len(pairing.order)), pairing
    same = len(set(factor.tolist())) == 1
    unit = next((f", {name}" for name, known in FACTORS.items() if known == abs(factor[0])), "")
    what = "sign" if (np.abs(factor) == 1).all() else f"unit{unit}"
    value = f"{factor[0]:.16g}" if same else f"[{', '.join(f'{each:.16g}' for each in factor)}]"
    columns = f"the commanded columns in the order {[int(j) + 1 for j in order]}"
    for changed, field, option, found, stated in (
        ((factor != 1).any(), "factor", "target_factor", what, value),
        ((order != plain.order).any(), "order", "signals", "order", columns),
        (delay != 0, "delay", "target_delay", "clock", f"{delay / rate:.6g}"),
    ):
        if changed:
            without = pairing._replace(**{field: getattr(plain, field)})
            yield found, f"{OPTION}.{option}", stated, without.left(actual, target)


def _plain(n: int, factor: float = 1.0, delay: int = 0) -> Pairing:
    return Pairing(np.full(n, factor), np.arange(n), delay)


def _delays(actual: np.ndarray, target: np.ndarray, rate: float) -> list[int]:
    """Rows by which the command may be early: 0, and correlation peaks of the arm's speeds."""
    from scipy.signal import correlate, correlation_lags, find_peaks

    width = max(1, round(SMOOTHING * rate))
    speeds = [np.linalg.norm(q[width:] - q[:-width], axis=1) for q in (actual, target)]
    measured, commanded = (speed - speed.mean() for speed in speeds)
    rows = correlation_lags(len(measured), len(commanded))
    near = np.abs(rows) <= min(SEARCH * rate, len(measured) // 2)
    alike, rows = correlate(measured, commanded)[near], rows[near]
    alike = alike / (len(measured) - np.abs(rows))  # a longer delay leaves fewer rows
    peak = find_peaks(alike, height=NEAR * alike.max())[0]
    highest = peak[np.argsort(-alike[peak])[:PEAKS]]
    return sorted({0, *rows[highest].tolist()}, key=abs)


def _settled(actual: np.ndarray, target: np.ndarray, delay: int) -> Pairing:
    """Unit and order of rows that are paired already."""
    from scipy.optimize import linear_sum_assignment

    n, motion = actual.shape[1], np.ptp(target, axis=0).sum()
    if not motion:
        return _plain(n, delay=delay)
    size = np.ptp(actual, axis=0).sum() / motion
    size = next((known for known in FACTORS.values() if abs(size / known - 1) < SAME), size)
    # (2, n, n) root mean square residual of joint i from column j, and from its opposite
    pairs = ((actual.T[:, None] - sign * (size * target).T) for sign in (1, -1))
    costs = np.array([np.sqrt(np.mean(pair**2, axis=-1)) for pair in pairs])
    cost, same = costs.min(axis=0), np.arange(n)
    rows, order = linear_sum_assignment(cost)
    if cost[rows, order].sum() > ORDER_GAIN * costs[0, same, same].sum():
        return _plain(n, size, delay)
    sign = np.where(costs[1, rows, order] < ORDER_GAIN * costs[0, rows, order], -1.0, 1.0)
    # columns that are alike stay where they are
    stay = costs[0, same, same] <= cost[rows, order] / ORDER_GAIN
    kept = np.where(stay, same, order)
    if len(set(kept.tolist())) == n:
        order, sign = kept, np.where(stay, 1.0, sign)
    return Pairing(size * sign, order, delay)
