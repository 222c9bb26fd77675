"""Recognition of measured and commanded angles by their values: in tables without labels, and where
names are ambiguous.
"""

from collections.abc import Mapping
from itertools import combinations

import numpy as np

FOLLOWS = 0.05  # greatest difference of commanded and measured angles, over the measured range
ROWS = 0.9  # share of the rows that differ by less
INTEGRAL = 0.1  # greatest error of the integral of a speed, over the motion
UNIT_NORM = 1e-3  # greatest error of the norm of four columns that are a quaternion
MOST_GROUPS = 8  # greatest number of signals in a table without labels
SIGNALS = ("actual", "target")
ORDER = 6  # order of the differences that show noise
SMOOTHER = 2.0  # least factor between the noise of measured and of commanded angles


def signals_by_values(
    columns: Mapping[int, np.ndarray],
    time: np.ndarray | None,
) -> tuple[dict[str, list[int]], dict[str, str]]:
    """Return signal → columns of the joints, and signal → reason, of a table without labels: two
    groups of as many columns, side by side or alternating, of which one follows the other. The
    smoother group, else the one that leads, is commanded. Both are empty unless one pair of groups
    fits. ``columns`` have (N,) values at ``time`` (N,).
    """
    places = sorted(columns)
    for count in range(2, min(len(places), MOST_GROUPS) + 1):
        joints, rest = divmod(len(places), count)
        if rest:
            continue
        beside = [places[k * joints : (k + 1) * joints] for k in range(count)]
        alternating = [places[k::count] for k in range(count)]
        for groups in (beside, alternating):
            pairs = _following_pairs(groups, columns)
            if time is not None:
                pairs = _without_speeds(pairs, groups, columns, time)
            if len(pairs) == 1:
                return _measured_and_commanded(pairs[0], columns)
    return {}, {}


def _without_speeds(
    pairs: list[tuple[list[int], list[int]]],
    groups: list[list[int]],
    columns: Mapping[int, np.ndarray],
    time: np.ndarray,
) -> list[tuple[list[int], list[int]]]:
    """Return the ``pairs`` without speeds: neither the derivative of another of the ``groups``, nor
    groups of angles in the first half and of their derivatives in the second half.
    """
    angles = []
    for pair in pairs:
        first = _values(pair[0], columns)
        half = first.shape[1] // 2
        rest = [_values(group, columns) for group in groups if group not in pair]
        halves = first[:, :half], first[:, -half:]
        joined = half > 0 and _is_speed(halves[1], halves[0], time)
        if not joined and not any(_is_speed(first, other, time) for other in rest):
            angles.append(pair)
    return angles


def _is_speed(speed: np.ndarray, angles: np.ndarray, time: np.ndarray) -> bool:
    """Return whether ``speed`` (N, joints) is not zero and :func:`is_derivative` of ``angles``."""
    return bool(speed.any()) and is_derivative(speed, angles, time)


def _values(group: list[int], columns: Mapping[int, np.ndarray]) -> np.ndarray:
    """Return the ``columns`` (N,) of a ``group`` as (N, joints)."""
    return np.column_stack([columns[column] for column in group])


def _following_pairs(
    groups: list[list[int]],
    columns: Mapping[int, np.ndarray],
) -> list[tuple[list[int], list[int]]]:
    """Return the pairs of ``groups`` of which one follows the other in every column."""
    angles = [_values(group, columns) for group in groups]
    pairs = []
    for n, k in combinations(range(len(groups)), 2):
        if follows(angles[n], angles[k]) and follows(angles[k], angles[n]):
            pairs.append((groups[n], groups[k]))
    return pairs


def _measured_and_commanded(
    pair: tuple[list[int], list[int]],
    columns: Mapping[int, np.ndarray],
) -> tuple[dict[str, list[int]], dict[str, str]]:
    """Return the signals and the reasons of :func:`signals_by_values` for a ``pair`` of groups."""
    angles = [_values(group, columns) for group in pair]
    noise = [_noise(values) for values in angles]
    cause = "are smoother"
    if noise[0] > SMOOTHER * noise[1]:
        actual, target = pair
    elif noise[1] > SMOOTHER * noise[0]:
        target, actual = pair
    else:
        cause = "lead"
        velocity = np.gradient(angles[1], axis=0)
        second_leads = float(np.sum((angles[1] - angles[0]) * velocity)) > 0
        actual, target = pair if second_leads else pair[::-1]
    reason = (
        f"columns {target[0]} … are followed by {actual[0]} … (from 0), and {cause}"
    )
    return {"actual": actual, "target": target}, dict.fromkeys(SIGNALS, reason)


def _noise(angles: np.ndarray) -> float:
    """Return the rms difference of order ORDER of ``angles`` (N, joints), 0 for few rows."""
    if len(angles) <= ORDER:
        return 0.0
    return float(np.sqrt(np.mean(np.diff(angles, ORDER, axis=0) ** 2)))


def follows(angles: np.ndarray, moved: np.ndarray) -> bool:
    """Return whether ``angles`` (N, joints) are within FOLLOWS of the range of the angles ``moved``
    (N, joints) in the share ROWS of the rows, with or without a common lag; False without a motion.
    """
    limit = FOLLOWS * np.ptp(moved, axis=0).max(initial=0.0)
    if not limit:
        return False
    difference = angles - moved
    if np.quantile(np.abs(difference), ROWS) < limit:
        return True
    velocity = np.gradient(moved, axis=0)
    lag = float((difference * velocity).sum() / (velocity**2).sum())  # rows
    return bool(np.quantile(np.abs(difference - lag * velocity), ROWS) < limit)


def is_quaternion(rows: np.ndarray) -> bool:
    """Return whether ``rows`` (N, 4) have unit norm; False for another number of columns."""
    if rows.shape[1] != 4:
        return False
    norms = np.linalg.norm(rows, axis=1)
    return bool(np.abs(norms - 1).max(initial=0.0) < UNIT_NORM)


def is_derivative(speed: np.ndarray, angles: np.ndarray, time: np.ndarray) -> bool:
    """Return whether the integral of ``speed`` (N, joints) over ``time`` (N,) is proportional to
    the motion of the ``angles`` (N, joints), whatever the units; True if the speed is zero.
    """
    means = (speed[1:] + speed[:-1]) / 2
    steps = means * np.diff(time)[:, None]
    integral = np.cumsum(steps, axis=0)
    moved = angles[1:] - angles[0]
    power = float((integral**2).sum())
    if not power:
        return True

    common = float((integral * moved).sum())
    residual = moved - integral * common / power
    greatest = INTEGRAL**2 * (moved**2).sum()
    return bool((residual**2).sum() < greatest)
