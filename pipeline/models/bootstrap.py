"""Standard errors and intervals of an estimator by the bootstrap over takes (Efron & Tibshirani
1993). Takes are independent of each other, the steps of a take are not: whole takes are drawn with
replacement.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy import ndarray

from pipeline.core.errors import ModelDomainError, SolverError
from pipeline.models import kinds
from pipeline.models.steps import Estimate, Options, Recorded
from pipeline.statistics.takes import percentile_interval

LEAST_TAKES = 10  # for a 95 % interval: resamplings of fewer repeat each other

Estimates = dict[str, float]
Estimator = Callable[[ndarray], Estimates]  # numbers of the takes → estimates by name


class Spread(NamedTuple):
    """Standard error of an estimate, and the ends of its 95 % percentile interval."""

    standard_error: float
    low: float
    high: float


def resampled_estimator(recorded: Recorded, options: Options, estimate: Estimate) -> Estimator:
    """Return the estimator by ``options`` of any takes of ``recorded``; ``estimate`` is the result
    of all takes.
    """
    return estimate.from_takes or partial(_fit_takes, recorded, options)


def _fit_takes(recorded: Recorded, options: Options, takes: ndarray) -> Estimates:
    return kinds.estimate(recorded.subset(takes), options).estimates


def replicate(estimator: Estimator, takes: int, rng: np.random.Generator) -> Estimates | None:
    """Estimates from one resampling of ``takes`` takes; None if it gives none."""
    try:
        return estimator(rng.integers(takes, size=takes))
    except (ModelDomainError, SolverError):
        return None


def spreads(replicates: list[Estimates | None]) -> tuple[dict[str, Spread], int]:
    """Spread by name of the estimates that all replicates have; number of failed replicates."""
    values = {
        name: Spread(float(each.std(ddof=1)), *map(float, percentile_interval(each.to_numpy())))
        for name, each in _common_estimates(replicates).items()
    }
    return values, replicates.count(None)


def joint_covariance(replicates: list[Estimates | None]) -> tuple[list[str], list[list[float]]]:
    """Names (K,) of the estimates that all replicates have, and their covariance (K, K)."""
    table = _common_estimates(replicates)
    covariance = np.atleast_2d(np.cov(table.to_numpy().T)).tolist() if len(table) else []
    return [*table], covariance


def _common_estimates(replicates: list[Estimates | None]) -> pd.DataFrame:
    """Estimates that all replicates have, one replicate a row; empty for fewer than two."""
    table = pd.DataFrame([each for each in replicates if each is not None]).dropna(axis="columns")
    return table if len(table) > 1 else pd.DataFrame()
