"""The linear filters of the study on all test takes: with a law that the training takes tell, and
with one that nobody has but the laboratory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.filtering.measurement import Measurements
from pipeline.statistics.filters import Filtered
from pipeline.studies.filters.deviations import Deviations
from pipeline.studies.filters.memory import first_order, memory, remembered, spreads
from pipeline.studies.filters.scores import FIRST_ORDER, REMEMBERED, YARDSTICK
from pipeline.studies.filters.yardstick import best_linear


@dataclass(frozen=True)
class Filmed:
    """Takes of motion capture and depth camera."""

    training: np.ndarray  # (takes, M+1, n) rad
    test: np.ndarray  # (T, M+1, n) rad
    frames: Sequence[Measurements]  # of the test takes, in their order
    pose: np.ndarray  # (n, n) rad², noise of a measured pose
    dt: float  # s, step of the motion grid


def filtered(
    filmed: Filmed, frames: Sequence[Measurements], covariance: np.ndarray, response: np.ndarray
) -> Filtered:
    """The best linear filter of ``covariance`` (M+1, n, M+1, n) in rad² about the training takes'
    mean, on the ``frames`` of a camera of ``response`` (n, n), each take's.
    """
    path = filmed.training.mean(axis=0)
    known = [best_linear(path, covariance, take, filmed.dt, response) for take in frames]
    means, covariances = (np.stack(each) for each in zip(*known, strict=True))
    return Filtered(means - filmed.test, covariances, filmed.pose)


def linear_filters(filmed: Filmed, law: Deviations, lag: int) -> dict[str, Filtered]:
    """Those that take the camera as every filter does, by name; ``lag`` is a frame of the camera in
    steps, ``law`` the laboratory's.
    """
    root, correlation = spreads(filmed.training, filmed.pose), memory(filmed.training, filmed.pose)
    laws = {
        FIRST_ORDER: remembered(root, first_order(correlation, lag)),
        REMEMBERED: remembered(root, correlation),
        YARDSTICK: law.covariance,
    }
    blind = np.eye(len(filmed.pose))
    filters = {name: filtered(filmed, filmed.frames, each, blind) for name, each in laws.items()}
    return filters | {YARDSTICK: exposed(filters[YARDSTICK], law)}


def exposed(best: Filtered, law: Deviations) -> Filtered:
    """The filter ``best`` of a pose at the time of its step, of one at its exposure."""
    return Filtered(best.error, best.covariance + law.exposure, best.measurement)
