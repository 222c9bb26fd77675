"""Modelled noise beside the recorded one: the tables that claims on spreads are read from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.statistics.following import following_tests
from pipeline.statistics.resampling import mean_error_comparison, spread_comparison


@dataclass(frozen=True)
class ModelledNoise:
    """Exact moments of a model's process noise ω at the recorded poses and at the recorded level,
    the measurement noise apart, and draws of both together.
    """

    motion: np.ndarray  # (M, n) rad², mean over the takes of the variance of a step
    measurement: np.ndarray  # (n,) rad², variances of the measurement noise
    error: np.ndarray  # (takes, M, n) rad, the model's mean next pose minus the measured one
    draws: np.ndarray  # (S, M, n) rad, of ω with the measurement noise

    @property
    def std(self) -> np.ndarray:
        """(M, n) standard deviation of ω in rad."""
        return np.sqrt(self.motion + self.measurement)


def following_rows(
    modelled: ModelledNoise,
    noise: np.ndarray,
    steady: np.ndarray,
    joints: Sequence[str],
    rng: np.random.Generator,
) -> pd.DataFrame:
    """:func:`following_tests` of a model over all steps and over the ``steady`` ones (M,) at
    constant speed, where what follows is the pose and not the speed; ``noise`` (takes, M, n) in rad
    is the recorded one.
    """
    steps = {"all": np.ones(len(steady), dtype=bool), "constant_speed": steady}
    return following_tests(modelled.std, modelled.draws, noise, steps, tuple(joints), rng)


def spread_tables(
    modelled: Mapping[str, ModelledNoise],
    following: Mapping[str, pd.DataFrame],
    noise: np.ndarray,
    joints: Sequence[str],
) -> dict[str, pd.DataFrame]:
    """The tables ``spread_following``, ``spread_comparison`` and ``mean_error_comparison``, by
    name; none without a model.

    Args:
        modelled: noise by model, the model to compare with first.
        following: rows of :func:`following_rows` by model.
        noise: (takes, M, n) rad, recorded noise of at least two takes.
        joints: names of the n joints.
    """
    if not modelled:
        return {}
    rows = [table.assign(model=model) for model, table in following.items() if len(table)]
    motion = {model: each.motion for model, each in modelled.items()}
    measurement = next(iter(modelled.values())).measurement
    tables = {
        "spread_comparison": spread_comparison(motion, measurement, noise, joints),
        "mean_error_comparison": mean_error_comparison(
            {model: each.error for model, each in modelled.items()}
        ),
    }
    return ({"spread_following": pd.concat(rows, ignore_index=True)} if rows else {}) | tables
