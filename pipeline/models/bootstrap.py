"""Standard errors and intervals of an estimator by the bootstrap over takes (Efron & Tibshirani
1993). Whole takes are drawn with replacement, because takes are independent and the steps of a take
are not.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy import ndarray
from scipy.special import stdtrit

from pipeline.core.errors import ModelDomainError, SolverError
from pipeline.models import kinds
from pipeline.models.steps import Options, Recorded
from pipeline.statistics.takes import TAILS

# minimum for a 95 % interval: fewer takes have too few distinct resamplings
LEAST_TAKES = 10

Estimates = dict[str, float]
FromTakes = Callable[[ndarray], Estimates]  # indices of takes → estimates by name


class Spread(NamedTuple):
    """Standard error of an estimate, and the ends of its 95 % interval by Student's law."""

    standard_error: float
    low: float
    high: float


def replicate(
    recorded: Recorded,
    options: Options,
    from_takes: FromTakes | None,
    rng: np.random.Generator,
) -> Estimates | None:
    """Return the estimates of one resampling of the takes of ``recorded``, by ``from_takes`` of the
    fit to all takes or by another fit with ``options``; None if the estimator fails.
    """
    takes = rng.integers(len(recorded.q), size=len(recorded.q))
    try:
        if from_takes is not None:
            return from_takes(takes)
        return kinds.estimate(recorded.subset(takes), options).estimates
    except (ModelDomainError, SolverError):
        return None


def spreads(
    replicates: list[Estimates | None],
    estimates: Estimates,
    takes: int,
) -> dict[str, Spread]:
    """Return the spread of every one of the ``estimates`` from ``takes`` takes that all replicates
    have. The interval is centred on the estimate: percentiles of the replicates are shifted by the
    bias of a resampled variance, (takes − 1)/takes.
    """
    quantile = float(stdtrit(takes - 1, TAILS[1]))
    by_name = {}
    for name, error in _common_estimates(replicates).std(ddof=1).items():
        half = quantile * float(error)
        middle = estimates[name]
        by_name[name] = Spread(float(error), middle - half, middle + half)
    return by_name


def joint_covariance(
    replicates: list[Estimates | None],
) -> tuple[list[str], list[list[float]]]:
    """Return the names (K,) and the covariance (K, K) of the estimates that all replicates have."""
    table = _common_estimates(replicates)
    if table.empty:
        return [], []
    covariance = np.atleast_2d(np.cov(table.to_numpy().T))
    return [*table], covariance.tolist()


def _common_estimates(replicates: list[Estimates | None]) -> pd.DataFrame:
    """Estimates that all replicates have, one replicate a row; empty for fewer than two."""
    rows = [estimates for estimates in replicates if estimates is not None]
    table = pd.DataFrame(rows).dropna(axis="columns")
    return table if len(table) > 1 else pd.DataFrame()
