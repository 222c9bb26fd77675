"""Repetitions of one commanded motion that were disturbed, as by a push: told by what stands out
from the other repetitions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.core.options.instruments import JointLog
from pipeline.recordings.logged_movement import RESIDUALS, Take
from pipeline.recordings.quality import quality_row

# of the median, what repetitions differ by undisturbed, however few there are to show it; and of
# the median over all joints, what a joint differs by
LEAST_SPREAD = 0.25
LEAST_IN_WINDOWS = 0.45  # of the median likewise: the greatest of many differs by more
WINDOW = 0.25  # s, as a push by hand lasts
OVERLAP = 4  # windows begin within the time of one
PUSHES, FOUND = 20, 0.9  # that are tried for the power of the rule, and the share to be found
DOUBLINGS, HALVINGS = 40, 6  # of the height of a push, until it is found and to be precise


def disturbances(residuals: np.ndarray, others: Sequence[np.ndarray], rate: float) -> np.ndarray:
    """(..., takes) how far each repetition is from the others, in robust standard deviations from
    their median: as a whole, or in the joint and the stretch of WINDOW in which it is farthest.

    What every repetition has at a step, such as the lag, is their median there. As a whole, the
    root mean square of the rest counts; in a window the mean of the rest, over what is usual there.
    The standard deviation over the repetitions is 1.4826 times the median absolute deviation
    (Gaussian-consistent), yet no less than a share of the median. A disturbance shows where more
    repetitions are undisturbed than not; of two, neither can be told to be the disturbed one.

    Args:
        residuals: (..., takes, K, joints) rad, measured minus commanded angles.
        others: (..., takes, K, joints) each, other signals of the joints in any unit, as currents.
        rate: Rows a second.
    """
    signals = [residuals, *others]
    farthest = [_windowed(signal, rate) for signal in signals]
    whole = [beside_others(signal) for signal in signals]
    scores = [_scores(np.max(farthest, axis=0), LEAST_IN_WINDOWS)]
    return np.max([*scores, *(_scores(distance, LEAST_SPREAD) for distance in whole)], axis=0)


def beside_others(signal: np.ndarray) -> np.ndarray:
    """(..., takes) root mean square of a ``signal`` (..., takes, K, joints) beside its median at
    each step.
    """
    return np.sqrt(np.mean(_beside(signal) ** 2, axis=(-2, -1)))


def smallest_push(residuals: np.ndarray, beyond: float, rate: float) -> float:
    """The height in rad of a push that is found nine times in ten.

    It is half a sine over WINDOW, of one joint in either direction, added to the ``residuals``
    (takes, K, joints) in rad of undisturbed repetitions, at PUSHES places spread over takes, joints
    and steps; found where it puts its take more than ``beyond`` robust standard deviations from the
    others. NaN where no height is, as of two repetitions.
    """
    takes, length, joints = residuals.shape
    rows = _rows(length, rate)
    push, each = np.sin(np.pi * (np.arange(rows) + 0.5) / rows), np.arange(PUSHES)
    pushes = np.zeros((PUSHES, *residuals.shape))
    starts = np.linspace(0, length - rows, PUSHES).round().astype(int)
    pushed = each % takes
    for i, start in enumerate(starts):
        sign = (-1) ** (i // (takes * joints))
        pushes[i, pushed[i], start : start + rows, i // takes % joints] = sign * push

    def enough(height: float) -> bool:
        scores = disturbances(residuals + height * pushes, [], rate)
        return np.mean(scores[each, pushed] > beyond) >= FOUND

    height = float(np.median(np.abs(_beside(residuals))) or np.abs(residuals).max())
    for _ in range(DOUBLINGS if takes > 2 and height else 0):
        if enough(height):
            break
        height *= 2
    else:
        return np.nan
    low, high = 0.0, height
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (low, middle) if enough(middle) else (middle, high)
    return high


def _beside(signal: np.ndarray) -> np.ndarray:
    return signal - np.median(signal, axis=-3, keepdims=True)


def _rows(length: int, rate: float) -> int:
    return min(max(round(WINDOW * rate), 1), length)


def _windowed(signal: np.ndarray, rate: float) -> np.ndarray:
    """(..., takes) the greatest mean, over a window and of a joint, of a ``signal`` (..., takes, K,
    joints) beside its median; over what is usual: the median over the takes in this window, yet no
    less than over all windows of the joint, and a quarter of that over all joints.
    """
    beside, length = _beside(signal), signal.shape[-2]
    rows = _rows(length, rate)
    starts = np.arange(0, length - rows + 1, max(rows // OVERLAP, 1))
    sums = np.cumsum(np.concatenate([np.zeros_like(beside[..., :1, :]), beside], axis=-2), axis=-2)
    means = np.abs(sums[..., starts + rows, :] - sums[..., starts, :]) / rows
    usual = np.maximum(
        np.median(means, axis=-3, keepdims=True),
        np.maximum(
            np.median(means, axis=(-3, -2), keepdims=True),
            LEAST_SPREAD * np.median(means, axis=(-3, -2, -1), keepdims=True),
        ),
    )
    ratios = np.divide(means, usual, out=np.ones_like(means), where=usual > 0)
    return ratios.max(axis=(-2, -1))


def _scores(distance: np.ndarray, least: float) -> np.ndarray:
    """How far ``distance`` (..., takes) is from its median, in robust standard deviations."""
    off = distance - np.median(distance, axis=-1, keepdims=True)
    spread = np.maximum(
        1.4826 * np.median(np.abs(off), axis=-1, keepdims=True), least * (distance - off)
    )
    return np.divide(off, spread, out=np.zeros_like(off), where=spread > 0)


def disturbed_takes(
    takes: Mapping[str, Take],
    signals: Mapping[str, np.ndarray],
    options: JointLog,
    rate: float,
    raw: Path,
) -> tuple[set[str], list[dict]]:
    """Names of the disturbed takes, how far each take is from the others, and what the rule finds;
    RecordingError where the option refuses disturbed ones. ``signals`` are those of
    :meth:`Take.logged`, each (takes, K, joints), at ``rate`` rows a second.
    """
    residuals = signals[RESIDUALS]
    others = [values for name, values in signals.items() if name != RESIDUALS]
    limit = np.inf if options.residual_limit is None else options.residual_limit
    result, quality = set(), []
    scores = disturbances(residuals, others, rate)
    for (name, take), residual, distance, score in zip(
        takes.items(), residuals, beside_others(residuals), scores, strict=True
    ):
        largest = np.abs(residual).max()
        quality.append(
            quality_row(name, "training", "joint log", "residual_beside_others", distance, "rad")
        )
        quality.append(
            quality_row(
                name, "training", "joint log", "disturbance", score, "robust standard deviations"
            )
        )
        quality.append(
            quality_row(name, "training", "joint log", "greatest_residual", largest, "rad")
        )
        if score <= options.disturbed_beyond and largest <= limit:
            continue
        if options.disturbed == "refuse":
            raise RecordingError(
                f"the repetition from row {take.first} was disturbed: its residual, or another "
                f"signal, is {score:.3g} robust standard deviations from the median over the "
                f"repetitions; the residual is at most {largest:.3g} rad",
                file=raw,
                take=name,
                key="dataset.joint_log.disturbed",
            )
        result.add(name)
        quality.append(
            quality_row(take.name, "training", "joint log", "disturbed_from_row", take.first, "row")
        )
    sound = [name not in result for name in takes]
    push = smallest_push(residuals[sound], options.disturbed_beyond, rate)
    if np.isfinite(push):
        quality += [
            quality_row(name, "training", "joint log", "smallest_push_found", push, "rad")
            for name in dict.fromkeys(take.name for take in takes.values())
        ]
    return result, quality
