"""Lag of measured angles behind a command, and angles between rows."""

import numpy as np

REACH = 0.01  # rad, least travel of a motion, and greatest distance of equal ends
# least share of the speed, greatest error over the median, for a lag
SLOW = 0.1
FAR = 5.0
OWN_LAG = 0.9  # a joint has its own lag if that reduces its rms error below this share
# rounds of least squares, each with the command at the lag of the round before
ROUNDS = 6
FURTHEST = 0.1  # s, greatest lag of a joint in a run


def lag(
    command: np.ndarray,
    measured: np.ndarray,
    rate: float,
    furthest: float | None = None,
) -> float:
    """Return the lag in s of ``measured`` behind ``command`` (N, n) in rad, by least squares over
    rows in motion; NaN without a motion. It is at most ``furthest`` (default a quarter of the log).
    Rows far from their command, as at a stop, are left out.
    """
    if not np.ptp(command, axis=0).max(initial=0.0) > REACH:
        return np.nan
    late = 0.0
    furthest = furthest or len(command) / 4 / rate
    for _ in range(ROUNDS):
        error, velocity = _errors_in_motion(command, measured, late * rate)
        velocity = velocity * rate
        late += float(np.sum(error * velocity) / np.sum(velocity**2))
        late = float(np.clip(late, -furthest, furthest))
    return late


def joint_lags(command: np.ndarray, measured: np.ndarray, rate: float) -> np.ndarray:
    """Return the :func:`lag` (n,) in s by joint: of all joints, or a joint's own if this reduces
    the joint's error by more than a tenth.
    """
    lags = np.full(command.shape[1], lag(command, measured, rate, FURTHEST))
    moving = np.ptp(command, axis=0) > REACH
    for j in np.flatnonzero(moving):
        joint = command[:, [j]], measured[:, [j]]
        late = lag(*joint, rate, FURTHEST)
        error, _ = _errors_in_motion(*joint, late * rate)
        common_error, _ = _errors_in_motion(*joint, lags[j] * rate)
        if np.std(error) < OWN_LAG * np.std(common_error):
            lags[j] = late
    return lags


def _errors_in_motion(
    command: np.ndarray,
    measured: np.ndarray,
    late: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the error and the step of the command delayed by ``late`` rows, in the rows in motion
    whose error is below FAR times the median.
    """
    shifted, cut = delayed(command, np.full(command.shape[1], late))
    error = shifted - measured[cut]
    step = np.gradient(shifted, axis=0)
    speed = np.abs(step).max(axis=1)
    size = np.linalg.norm(error, axis=1)

    moving = speed > SLOW * speed.max()
    used = moving & (size <= FAR * np.median(size[moving]))
    return error[used], step[used]


def delayed(command: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, slice]:
    """Return ``command`` (N, n) delayed by ``rows`` (n,) of any fraction, by cubic splines, and the
    slice of the rows at which all joints have a command.
    """
    from scipy.interpolate import CubicSpline

    before = max(int(np.ceil(rows.max())), 0)
    after = max(int(np.ceil((-rows).max())), 0)
    cut = slice(before, len(command) - after)
    if not rows.any():
        return command, cut
    clock = np.arange(len(command))
    joints = []
    for joint, late in zip(command.T, rows, strict=True):
        joints.append(CubicSpline(clock, joint)(clock[cut] - late))
    return np.stack(joints, axis=1), cut


def stretch(angles: np.ndarray, place: float, length: int) -> np.ndarray:
    """Return ``length`` rows of ``angles`` from row ``place`` on; cubic splines between rows."""
    from scipy.interpolate import CubicSpline

    if place == round(place):
        return angles[round(place) :][:length]
    return CubicSpline(np.arange(len(angles)), angles)(place + np.arange(length))


def in_phase(
    angles: np.ndarray,
    first: int,
    reference: np.ndarray,
    most: int,
    whole: bool = False,
) -> float:
    """Return the row, within ``most`` of ``first``, from which ``angles`` follow ``reference`` by
    least squares: a ``whole`` row, or a place between rows.
    """
    late = lag(reference, angles[first : first + len(reference)], 1.0, most)
    place = first + np.nan_to_num(late)
    if whole:
        place = round(place)
    return float(np.clip(place, 0, len(angles) - len(reference)))
