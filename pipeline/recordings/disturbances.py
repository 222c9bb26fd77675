"""Repetitions of one commanded motion that stand out from the others, as after a push."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

# of the median, by which undisturbed repetitions differ, however few there are to show it; and of
# the median over all joints, by which a joint differs
LEAST_SPREAD = 0.25
LEAST_IN_WINDOWS = 0.45  # of the median likewise: the greatest of many differs by more
WINDOW = 0.25  # s, as a push by hand lasts
OVERLAP = 4  # windows begin within the time of one


def disturbances(residuals: np.ndarray, others: Sequence[np.ndarray], rate: float) -> np.ndarray:
    """Return (..., takes) the distance of each repetition from the others, in robust standard
    deviations (1.4826 times the median absolute deviation, no less than a share of the median) from
    their median: as a whole, by the root mean square, or in the joint and window where it is
    greatest, by the mean.

    The median over the repetitions at each step is what all share, such as the lag. ``residuals``
    (..., takes, K, joints) rad, measured minus commanded angles at ``rate`` rows a second;
    ``others`` likewise, other signals in any unit, as currents. Of two repetitions neither is
    disturbed.
    """
    signals = [residuals, *others]
    farthest = np.max([_windowed(signal, rate) for signal in signals], axis=0)
    whole = [_scores(beside_others(signal), LEAST_SPREAD) for signal in signals]
    return np.max([_scores(farthest, LEAST_IN_WINDOWS), *whole], axis=0)


def beside_others(signal: np.ndarray) -> np.ndarray:
    """Return (..., takes) the root mean square of ``signal`` beside its median at each step."""
    return np.sqrt(np.mean(_beside(signal) ** 2, axis=(-2, -1)))


def _beside(signal: np.ndarray) -> np.ndarray:
    return signal - np.median(signal, axis=-3, keepdims=True)


def _windowed(signal: np.ndarray, rate: float) -> np.ndarray:
    """(..., takes) greatest mean over a window and of a joint of ``signal`` beside its median, over
    the usual one: the median in this window, or of the joint, or a quarter of that of all joints.
    """
    beside, length = _beside(signal), signal.shape[-2]
    rows = min(max(round(WINDOW * rate), 1), length)
    starts = np.arange(0, length - rows + 1, max(rows // OVERLAP, 1))
    sums = np.cumsum(np.concatenate([np.zeros_like(beside[..., :1, :]), beside], axis=-2), axis=-2)
    means = np.abs(sums[..., starts + rows, :] - sums[..., starts, :]) / rows
    here, of_joint, of_all = (
        np.median(means, axis=axes, keepdims=True) for axes in (-3, (-3, -2), (-3, -2, -1))
    )
    usual = np.maximum(here, np.maximum(of_joint, LEAST_SPREAD * of_all))
    ratios = np.divide(means, usual, out=np.ones_like(means), where=usual > 0)
    return ratios.max(axis=(-2, -1))


def _scores(distance: np.ndarray, least: float) -> np.ndarray:
    """Distance (..., takes) from its median, in robust standard deviations."""
    off = distance - np.median(distance, axis=-1, keepdims=True)
    deviation = 1.4826 * np.median(np.abs(off), axis=-1, keepdims=True)
    scale = np.maximum(deviation, least * (distance - off))
    return np.divide(off, scale, out=np.zeros_like(off), where=scale > 0)
