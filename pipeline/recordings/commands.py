"""Commanded motion: its steps, and checks that a record of the motion agrees with the command in
unit, order, sign and clock.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.arm.chain import Chain
from pipeline.arm.urdf import Joint, read_urdf
from pipeline.core.angles import TURN
from pipeline.core.columns import columns, members, values
from pipeline.core.errors import RecordingError
from pipeline.recordings.lags import REACH, lag

OPTION = "dataset.joint_log"
STEADY = 0.9  # least speed over the 0.9 quantile, low enough that noise leaves no gap
UNFILLED = "???"  # placeholder for a file name
# s, greatest lag of a controller; a longer lag is an offset of two clocks
LATEST = 0.05
FASTER = 1.05  # greatest speed of a step over the joint's velocity limit
FAST = 0.9  # least share of a joint's greatest commanded speed of a fast step
# least size of a wrong command, over the steps of the rows around it
BEYOND_STEPS = 3.0
STEP_NOISE = 1e-3  # rad, greatest contribution of noise and rounding to a step
SEARCH = 10.0  # s, greatest offset of two clocks that is searched
QUANTILE = 0.9  # quantile of the error over rows: insensitive to a disturbed repetition
# least scale of a joint's error, over the motion of the farthest joint
LEAST_MOTION = 0.1
STANDING = 1e-3  # rad, greatest motion of a standing joint
STILL = 0.1  # rad, least scale of an error, above the noise of encoders at rest
SMOOTHING = 0.02  # s, over which the speed of the arm is averaged
# number of delays tried, and their least correlation over the highest
PEAKS = 8
NEAR = 0.8
SAME = 0.02  # greatest relative difference of a factor from a unit conversion
ORDER_GAIN = 0.5  # another order or sign must reduce the error below this share
MOST = 0.25  # greatest difference of two records over the motion, far above any uncertainty
# greatest difference of integrated velocities and positions, over the motion
VELOCITY = 0.05
LEAST_TIMES = 3  # least number of readings within the take
DEGREES = 180 / np.pi
FACTORS = {"1": 1.0, "180/π": DEGREES, "π/180": 1 / DEGREES, "(180/π)²": DEGREES**2}
FACTORS |= {"(π/180)²": DEGREES**-2, "2π": TURN, "1/2π": 1 / TURN}


def commanded_steps(trajectory: pd.DataFrame, rate: float) -> np.ndarray:
    """Return v = ẋᵈΔt (M, m) in m and rad; for a redundant arm (M, m + n) with joint steps."""
    return np.hstack([values(trajectory, family) for family in ("v", "u")])[:-1] / rate


def constant_speed(q: np.ndarray) -> np.ndarray:
    """Return the mask (M,) of steps at full speed, in the mean of ``q`` (takes, M+1, n) rad."""
    pace = np.linalg.norm(np.diff(q.mean(axis=0), axis=0), axis=-1)
    return pace >= STEADY * np.quantile(pace, 0.9)


class Pairing(NamedTuple):
    """Command of joint i: column ``order[i]`` times ``factor[i]``, delayed by ``delay`` rows."""

    factor: np.ndarray  # (n,)
    order: np.ndarray  # (n,) int
    delay: int  # rows by which the command is early

    def apply(
        self,
        actual: np.ndarray,
        target: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the paired rows of ``actual`` and ``target``, (N − |delay|, n) in rad."""
        actual, target = shift_rows(actual, target, self.delay)
        return actual, target[:, self.order] * self.factor

    def error(self, actual: np.ndarray, target: np.ndarray) -> float:
        """Return the greatest of the joints' :func:`tracking_errors` in the paired rows."""
        return float(tracking_errors(*self.apply(actual, target)).max())


def _plain(n: int, factor: float = 1.0, delay: int = 0) -> Pairing:
    return Pairing(np.full(n, factor), np.arange(n), delay)


def shift_rows(
    actual: np.ndarray,
    target: np.ndarray,
    rows: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the pairs of a measured row and the commanded row ``rows`` rows earlier."""
    length = len(actual) - abs(rows)
    return actual[max(rows, 0) :][:length], target[max(-rows, 0) :][:length]


def tracking_errors(actual: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return the 0.9 quantile (n,) of the tracking error divided by the joint's motion; ``actual``
    and ``target`` (N, n) in rad. The quantile is the greater one of rows with moving and with
    resting command. The divisor is at least STILL and LEAST_MOTION of the greatest motion.
    """
    residual = np.abs(actual - target)
    motion = np.ptp(actual, axis=0)
    least = max(LEAST_MOTION * motion.max(), STILL)
    scale = np.maximum(motion, least)

    changes = np.diff(target, axis=0, prepend=target[:1])
    steps = np.abs(changes).max(axis=1)
    usual = np.quantile(steps, 0.99)
    moving = steps > LEAST_MOTION * usual
    quantiles = []
    for rows in (moving, ~moving):
        if rows.any():
            quantiles.append(np.quantile(residual[rows], QUANTILE, axis=0))
    return np.max(quantiles, axis=0) / scale


def standing_joints(actual: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return the mask (n,) of joints that stand still while ``target`` (N, n) rad moves them."""
    moved = np.ptp(actual, axis=0)
    commanded = np.ptp(target, axis=0)
    return (commanded > REACH) & (moved < STANDING)


class WrongCommand(NamedTuple):
    """Commanded angle of one row that steps away and back, where the measured angle does not."""

    row: int
    column: int
    size: float  # rad, distance from the mean of the rows beside it

    def reason(self, joints: Sequence[str], rate: float) -> str:
        """Return the fault at ``rate`` (Hz) of one of the ``joints``, as text."""
        return (
            f"the command of {joints[self.column]} steps by {self.size:.3g} rad and back in row "
            f"{self.row} ({self.row / rate:.6g} s), and the arm does not: correct the cell"
        )


def wrong_commands(actual: np.ndarray, target: np.ndarray) -> list[WrongCommand]:
    """Return the single commanded angles of ``target`` (N, n) rad that step away from the rows
    beside them by more than STEP_NOISE and BEYOND_STEPS times the steps around, and back, where
    ``actual`` (N, n) rad has no step of half this size.
    """
    if len(target) < 5:
        return []
    inner = target[2:-2]
    before = target[1:-3]
    after = target[3:-1]
    size = inner - (before + after) / 2
    around = [after - before, before - target[:-4], target[4:] - after]
    usual = np.max(np.abs(around), axis=0)

    steps_back = np.sign(inner - before) == np.sign(inner - after)
    is_large = np.abs(size) > np.maximum(BEYOND_STEPS * usual, STEP_NOISE)

    bends = np.abs(actual[1:-1] - (actual[:-2] + actual[2:]) / 2)
    faults = []
    for row, column in np.argwhere(steps_back & is_large).tolist():
        distance = float(size[row, column])
        near = bends[max(row - 1, 0) : row + 4, column]
        if near.max() < abs(distance) / 2:
            faults.append(WrongCommand(row + 2, column, distance))
    return faults


def standing_arm(actual: np.ndarray, target: np.ndarray) -> str:
    """Return the fault of a log in which every joint that ``target`` (N, n) rad moves stands still;
    "" for an arm that moves or is not commanded to.
    """
    moves = np.ptp(target, axis=0) > REACH
    if not moves.any() or not standing_joints(actual, target)[moves].all():
        return ""
    commanded, moved = (float(np.ptp(q, axis=0).max()) for q in (target, actual))
    return (
        f"the arm does not follow: its command moves by {commanded:.3g} rad, its measured angles "
        f"by {moved:.2g} rad; leave this recording out"
    )


def find_pairing(actual: np.ndarray, target: np.ndarray, rate: float) -> Pairing:
    """Return the pairing of angles (N, n) in rad; the identity unless another halves the error."""
    best = _plain(actual.shape[1])
    standing = standing_joints(actual, target)
    if standing.any() and not standing.all():
        follows = np.flatnonzero(~standing)
        of_following = find_pairing(actual[:, follows], target[:, follows], rate)
        best.order[follows] = follows[of_following.order]
        best.factor[:] = np.median(of_following.factor)
        best.factor[follows] = of_following.factor
        return best._replace(delay=of_following.delay)
    if not (np.ptp(actual, axis=0).max() > REACH and np.ptp(target, axis=0).any()):
        return best

    least = best.error(actual, target)
    for delay in _delays(actual, target, rate):
        tried = _unit_and_order(*shift_rows(actual, target, delay), delay)
        error = tried.error(actual, target)
        if error < ORDER_GAIN * least:
            best = tried
            least = error

    # round the delay to a row; a delay up to LATEST is the controller's lag, not a clock offset
    measured, command = best.apply(actual, target)
    delay = best.delay + round(np.nan_to_num(lag(command, measured, rate)) * rate)
    late = best._replace(delay=delay if abs(delay) > LATEST * rate else 0)
    # a lag beside an error of another kind is not an offset
    useless = late.error(actual, target) > ORDER_GAIN * least and not best.delay
    return best if useless else late


def require_pair(
    actual: np.ndarray,
    target: np.ndarray,
    rate: float,
    limit: float,
    joints: Sequence[str],
    **where,
) -> None:
    """Raise RecordingError where the :func:`tracking_errors` of ``actual`` and ``target`` (N, n)
    rad exceed ``limit``, or the lag exceeds LATEST at ``rate`` (Hz). The message names the unit,
    order and clock for which the angles agree, with the options to set.
    """
    standing = standing_joints(actual, target)
    if standing.any():
        named = ", ".join(np.array(joints)[standing])
        message = "stands still while its command moves; leave it out of the joints"
        raise RecordingError(f"{named} {message}", **where, key=OPTION)
    errors = tracking_errors(actual, target)
    worst = int(errors.argmax())
    late = lag(target, actual, rate)  # NaN: command at rest
    if errors[worst] > limit:
        fault = (
            f"{joints[worst]} misses its command by {errors[worst]:.2g} of its motion "
            f"(0.9 quantile over the rows), more than {limit:g} (mismatch)"
        )
    elif abs(late) > LATEST:
        fault = f"the arm is {late:.2g} s behind its command, more than {LATEST:g}"
    else:
        return
    cause = _suspected_cause(actual, target, rate, limit)
    message = f"measured and commanded angles do not agree: {fault}; {cause}"
    raise RecordingError(message, **where, key=OPTION)


def _suspected_cause(
    actual: np.ndarray,
    target: np.ndarray,
    rate: float,
    limit: float,
) -> str:
    """Return, as text, the options with which ``actual`` and ``target`` agree within ``limit``."""
    pairing = find_pairing(actual, target, rate)
    left = pairing.error(actual, target)
    words = []
    for cause, option, value, error in suspects(pairing, actual, target, rate):
        key = option.rpartition(".")[2]
        words.append(f"the {cause} ({key}: {value}; else the error is {error:.2g})")
    if left <= limit and words:
        return f"suspected: {', '.join(words)}; the error is then {left:.2g}"
    return "they agree in no other unit, order or clock: check that both are of one movement"


def suspects(
    pairing: Pairing,
    actual: np.ndarray,
    target: np.ndarray,
    rate: float,
) -> Iterator[tuple[str, str, str, float]]:
    """Yield name, option and value of each change of a ``pairing``, and the error without it."""
    plain = _plain(len(pairing.order))
    factor, order, delay = pairing
    scale = "sign"
    if np.any(np.abs(factor) != 1):
        units = [
            f", {name}" for name, size in FACTORS.items() if size == abs(factor[0])
        ]
        scale = f"unit{units[0] if units else ''}"
    listed = [repr(float(number)).removesuffix(".0") for number in factor]
    value = listed[0] if len({*listed}) == 1 else f"[{', '.join(listed)}]"
    columns = f"the commanded columns in the order {(order + 1).tolist()}"
    for field, option, cause, stated in (
        ("factor", "target_factor", scale, value),
        ("order", "signals", "order", columns),
        ("delay", "target_delay", "clock", f"{delay / rate:.6g}"),
    ):
        if np.any(getattr(pairing, field) != getattr(plain, field)):
            without = pairing._replace(**{field: getattr(plain, field)})
            yield cause, f"{OPTION}.{option}", stated, without.error(actual, target)


def _delays(actual: np.ndarray, target: np.ndarray, rate: float) -> list[int]:
    """Return possible delays in rows: 0, and the correlation peaks of the arm's speeds."""
    from scipy.signal import correlate, correlation_lags, find_peaks

    width = max(1, round(SMOOTHING * rate))
    measured = np.linalg.norm(actual[width:] - actual[:-width], axis=1)
    commanded = np.linalg.norm(target[width:] - target[:-width], axis=1)
    measured = measured - measured.mean()
    commanded = commanded - commanded.mean()

    rows = correlation_lags(len(measured), len(commanded))
    near = np.abs(rows) <= min(SEARCH * rate, len(measured) // 2)
    rows = rows[near]
    overlapping = len(measured) - np.abs(rows)
    correlation = correlate(measured, commanded)[near] / overlapping

    peaks, _ = find_peaks(correlation, height=NEAR * correlation.max())
    highest = peaks[np.argsort(-correlation[peaks])[:PEAKS]]
    return sorted({0, *rows[highest].tolist()}, key=abs)


def _unit_and_order(actual: np.ndarray, target: np.ndarray, delay: int) -> Pairing:
    """Return the pairing with the best unit, order and signs for rows paired by ``delay``."""
    from scipy.optimize import linear_sum_assignment

    n = actual.shape[1]
    motion = np.ptp(target, axis=0).sum()
    if not motion:
        return _plain(n, delay=delay)
    size = _unit_near(np.ptp(actual, axis=0).sum() / motion)

    # (n, n) root mean square difference of joint i from column j, and from minus column j
    commanded = (size * target).T
    same_sign = np.sqrt(np.mean((actual.T[:, None] - commanded) ** 2, axis=-1))
    other_sign = np.sqrt(np.mean((actual.T[:, None] + commanded) ** 2, axis=-1))
    cost = np.minimum(same_sign, other_sign)
    joints = np.arange(n)
    in_place = np.diagonal(same_sign)
    _, order = linear_sum_assignment(cost)
    if cost[joints, order].sum() > ORDER_GAIN * in_place.sum():
        return _plain(n, size, delay)
    reversed_sign = other_sign[joints, order] < ORDER_GAIN * same_sign[joints, order]
    sign = np.where(reversed_sign, -1.0, 1.0)

    # keep the place of columns whose exchange hardly reduces the cost
    stay = in_place <= cost[joints, order] / ORDER_GAIN
    nearer_order = np.where(stay, joints, order)
    if len({*nearer_order.tolist()}) == n:
        order = nearer_order
        sign = np.where(stay, 1.0, sign)
    return Pairing(size * sign, order, delay)


def _unit_near(size: float) -> float:
    """Return the factor of a conversion of units that differs from ``size`` by less than SAME."""
    for factor in FACTORS.values():
        if abs(size / factor - 1) < SAME:
            return factor
    return size


def named_joints(urdf: str, names: Sequence[str]) -> list[Joint | None]:
    """Return the joints ``names`` of the file ``urdf``, None for a joint that the file lacks."""
    joints = {} if urdf == UNFILLED else read_urdf(Path(urdf)).joints
    return [joints.get(name) for name in names]


def circular_joints(urdf: str, names: Sequence[str]) -> np.ndarray:
    """Return the mask (joints,) of the joints ``names`` that are not prismatic in ``urdf``."""
    joints = named_joints(urdf, names)
    return np.array([joint is None or joint.kind != "prismatic" for joint in joints])


def require_velocities(trajectory: pd.DataFrame, rate: float, file: Path) -> None:
    """Raise RecordingError where the integral of the velocities differs from the positions."""
    x = values(trajectory, "x")
    v = values(trajectory, "v")
    # a velocity may be instantaneous, or the mean over the step before or after it
    integral = np.cumsum((v[:-1] + v[1:]) / 2, axis=0) / rate
    fault = (
        "the commanded velocities do not lead along the commanded positions; suspected are "
        "the velocities' unit, the order of their columns, and t"
    )
    names = members(trajectory, "x")
    _require_near(x[1:] - x[0], integral, names, VELOCITY, fault, file=file)


def require_commanded(
    q: np.ndarray,
    trajectory: pd.DataFrame,
    chain: Chain,
    take: str,
) -> None:
    """Raise RecordingError where the tip at ``q`` (M+1, n) rad is far from the commanded path."""
    tip = chain.coordinates(q)
    path = values(trajectory, "x")
    fault = (
        "the tip that the motion capture tracked is not on the commanded path; suspected are "
        "the path's unit, columns and start, and the arm's base (dataset.mocap.base)"
    )
    where = {"take": take, "key": "dataset.trajectory"}
    _require_near(tip, path, chain.task, MOST, fault, **where)


def require_encoders(
    q: pd.DataFrame,
    readings: pd.DataFrame,
    joints: Sequence[str],
    take: str,
) -> None:
    """Raise RecordingError where ``readings`` (rows of the table ``encoders``) differ from the
    tracked angles ``q`` (rows of the table ``joints``) at the same times.
    """
    during = readings[readings["t"].between(q["t"].min(), q["t"].max())]
    where = {"take": take, "key": "dataset.encoders"}
    names = columns("q", joints)
    if len(during) < LEAST_TIMES:
        raise RecordingError(
            f"{len(during)} of {len(readings)} readings of the encoders are within the take: "
            "correct start, the start of their log",
            **where,
        )
    at_readings = [np.interp(during["t"], q["t"], q[name]) for name in names]
    tracked = np.stack(at_readings, axis=1)
    fault = (
        "the encoders differ from the angles that the motion capture tracked; suspected are "
        "angle_unit, the order of the columns (actual), the start of the log (start), and "
        "whole turns (6.283 rad: log the angle of the URDF)"
    )
    _require_near(during[names].to_numpy(), tracked, joints, MOST, fault, **where)


def _require_near(
    a: np.ndarray,
    b: np.ndarray,
    names: Sequence[str],
    most: float,
    fault: str,
    **where: object,
) -> None:
    errors = tracking_errors(a, b)
    worst = int(errors.argmax())
    if errors[worst] > most:
        median = np.median(a[:, worst] - b[:, worst])
        raise RecordingError(
            f"{names[worst]} is off by {errors[worst]:.2g} of the motion, more than {most:g} "
            f"(median difference {median:.4g}): {fault}",
            **where,
        )


def beyond_speed(
    steps: np.ndarray,
    limits: np.ndarray,
    seconds: np.ndarray | float,
) -> np.ndarray:
    """Return the mask of ``steps`` (..., n) in ``seconds`` s that exceed the ``limits`` (n,)."""
    return np.abs(steps) > FASTER * limits * seconds + STEP_NOISE


def speed_scores(
    steps: np.ndarray,
    nominal: np.ndarray,
    limits: np.ndarray,
    rate: float,
    joints: Sequence[str],
) -> dict[str, float]:
    """Return the speeds of true ``steps`` (takes, M, n) in rad beside the commanded ``nominal``
    steps: share of the moving steps beyond a speed limit, and by joint the greatest speed and the
    share of the fast steps, commanded at FAST times the greatest speed or more, that run backwards.
    """
    moving = np.any(nominal, axis=-1)
    beyond = beyond_speed(steps, limits, 1 / rate).any(axis=-1)
    scores = {
        "true_moving_steps_beyond_a_speed_limit_share": float(beyond[moving].mean()),
    }
    for j, joint in enumerate(joints):
        step = steps[..., j]
        command = nominal[..., j]
        fast = np.abs(command) >= FAST * np.abs(command).max()
        backwards = float((step * command < 0)[fast].mean())
        greatest = float(np.abs(step).max())
        scores[f"true_{joint}_speed_limit_rad_per_s"] = float(limits[j])
        scores[f"true_{joint}_greatest_speed_rad_per_s"] = rate * greatest
        scores[f"true_{joint}_fast_steps_backwards_share"] = backwards
    return scores
