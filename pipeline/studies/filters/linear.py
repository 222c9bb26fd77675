"""The linear filters of the study on all test takes: with a law that the training takes tell, and
with one that nobody has but the laboratory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.arm.interface import Chain
from pipeline.core.filters import MEMORY
from pipeline.filtering.linear import linear_filter
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.memory import memory, memory_filter, remembered, spreads
from pipeline.statistics.filters import Filtered
from pipeline.studies.filters.deviations import Deviations
from pipeline.studies.filters.scores import FIRST_ORDER, YARDSTICK


@dataclass(frozen=True)
class Filmed:
    """Takes of motion capture and depth camera."""

    training: np.ndarray  # (takes, M+1, n) rad
    test: np.ndarray  # (T, M+1, n) rad
    frames: Sequence[Measurements]  # of the test takes, in their order
    pose: np.ndarray  # (n, n) rad², noise of a measured pose
    dt: float  # s, step of the motion grid
    chain: Chain  # the arm


def filtered(
    filmed: Filmed,
    frames: Sequence[Measurements],
    covariance: np.ndarray,
    response: np.ndarray | None = None,
) -> Filtered:
    """The best linear filter of ``covariance`` (M+1, n, M+1, n) in rad² about the training takes'
    mean, on each take's ``frames`` of a camera; of ``response`` (n, n) where its error depends on
    the pose.
    """
    path = filmed.training.mean(axis=0)
    means, covariances = linear_filter(path, covariance, frames, filmed.dt, filmed.chain, response)
    return Filtered(means - filmed.test, covariances, filmed.pose)


def linear_filters(filmed: Filmed, law: Deviations, lag: int) -> dict[str, Filtered]:
    """Those that take the camera as every filter does, by name; ``lag`` is a frame of the camera in
    steps, ``law`` the laboratory's.
    """
    training, pose = filmed.training, filmed.pose
    roots, _ = spreads(training, pose)
    lasting = remembered(roots, first_order(memory(training, pose), lag))
    means, covariances, _ = memory_filter(training, pose, filmed.frames, filmed.dt, filmed.chain)
    return {
        FIRST_ORDER: filtered(filmed, filmed.frames, lasting),
        MEMORY: Filtered(means - filmed.test, covariances, pose),
        YARDSTICK: exposed(filtered(filmed, filmed.frames, law.covariance), law),
    }


def first_order(correlation: np.ndarray, lag: int) -> np.ndarray:
    """(K,) the correlation of a deviation of which a step leaves the same share each time, as a
    closed loop does: that of ``correlation`` (K,) at ``lag``, which is to be positive there.
    """
    return np.maximum(correlation[lag], 0.0) ** (np.arange(len(correlation)) / lag)


def exposed(best: Filtered, law: Deviations) -> Filtered:
    """The filter ``best`` of a pose at the time of its step, of one at its exposure."""
    return Filtered(best.error, best.covariance + law.exposure, best.measurement)
