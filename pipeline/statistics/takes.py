"""Moments, correlations and 95 % intervals over takes, which are independent; steps are not."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy import ndarray
from scipy.special import stdtrit

from pipeline.core.errors import ModelDomainError

TAILS = (0.025, 0.975)
NORMAL_QUANTILE = 1.959964  # standard errors from a normal estimate to the end of its interval
REPLICATES = 200  # resamplings of the takes

# model, indices of the takes → value by quantity
Quantities = Callable[[str, ndarray], dict[str, float]]


class Difference(NamedTuple):
    """Mean difference and the ends of its 95 % interval; NaN where one does not exist."""

    difference: float
    low: float = np.nan
    high: float = np.nan


def takes_moments(samples: ndarray) -> tuple[ndarray, ndarray]:
    """Return mean (M, n) and sample covariance (M, n, n) over the takes of ``samples`` (takes, M,
    n); raises ModelDomainError for a single take.
    """
    takes = len(samples)
    if takes < 2:
        raise ModelDomainError("a sample covariance needs at least two takes", takes=takes)
    mean = samples.mean(axis=0)
    centred = samples - mean
    return mean, np.einsum("tki,tkj->kij", centred, centred) / (takes - 1)


def lag_one_correlation(values: ndarray) -> float:
    """Correlation of neighbouring steps of ``values`` (takes, K) about their mean at each step."""
    centred = values - values.mean(axis=0)
    scale = np.sqrt(np.sum(centred[:, :-1] ** 2) * np.sum(centred[:, 1:] ** 2))
    return float(np.sum(centred[:, :-1] * centred[:, 1:]) / scale) if scale > 0 else 0.0


def share_between(noise: ndarray, groups: Sequence[str]) -> float:
    """Share of the variance of ``noise`` (takes, M, n) over the takes that lies between the means
    of their ``groups`` (takes,); 0 for a single group and for groups of one take each.
    """
    names = list(dict.fromkeys(groups))
    if len(names) in (1, len(groups)):
        return 0.0
    member = np.array([[group == name for group in groups] for name in names], dtype=float)
    centred = (noise - noise.mean(axis=0)).reshape(len(noise), -1)
    means = member @ centred / member.sum(axis=1, keepdims=True)
    return float(member.sum(axis=1) @ np.sum(means**2, axis=1) / np.sum(centred**2))


def percentile_interval(values: ndarray) -> tuple[ndarray, ndarray]:
    """Ends of the interval of ``values`` (N, ...) over the first axis that holds one further value
    with a probability of 95 %; least and greatest value for N < 40.
    """
    low, high = np.quantile(values, TAILS, axis=0, method="weibull")
    return low, high


def _student(difference: float, error: float, degrees: int) -> Difference:
    """Student's interval of a ``difference`` with the standard ``error``; none without degrees."""
    if degrees < 1:
        return Difference(float(difference))
    half = float(stdtrit(degrees, TAILS[1]) * error)
    return Difference(float(difference), difference - half, difference + half)


def paired_difference(scores: ndarray, reference: ndarray) -> Difference:
    """Mean of ``scores`` − ``reference`` (takes,), both of the same takes, with Student's interval
    over the takes: no interval for a single take, NaN where a score is not finite.
    """
    if not (np.all(np.isfinite(scores)) and np.all(np.isfinite(reference))):
        return Difference(np.nan)
    difference, takes = scores - reference, len(scores)
    error = difference.std(ddof=min(1, takes - 1)) / np.sqrt(takes)
    return _student(float(difference.mean()), error, takes - 1)


def jackknife_counts(takes: int) -> ndarray:
    """(1 + takes, takes) weights: first of all takes, then of all but one."""
    return np.vstack([np.ones((1, takes)), 1 - np.eye(takes)])


def jackknife_difference(values: ndarray) -> Difference:
    """First of ``values`` (1 + takes,), one for each row of :func:`jackknife_counts`, with
    Student's interval from the others; no interval below three takes.
    """
    takes = len(values) - 1
    error = np.sqrt((takes - 1) * np.var(values[1:]))
    return _student(values[0], error, takes - 1 if takes > 2 else 0)


def drawn_takes(takes: int, rng: np.random.Generator) -> list[ndarray]:
    """Indices of the takes in each of REPLICATES resamplings, without resamplings of one take."""
    drawn = [rng.integers(takes, size=takes) for _ in range(REPLICATES if takes > 1 else 0)]
    return [indices for indices in drawn if np.ptp(indices) > 0]


def resampled_differences(
    quantities: Quantities, models: Sequence[str], takes: int, rng: np.random.Generator
) -> pd.DataFrame:
    """Tabulate every quantity of every model, and its difference to the first model with the 95 %
    percentile interval of the bootstrap over takes, the same takes for all models.
    """
    drawn, tables, first = [np.arange(takes), *drawn_takes(takes, rng)], [], None
    for model in models:
        values = pd.DataFrame([quantities(model, indices) for indices in drawn])
        table = pd.DataFrame({"model": model, "quantity": values.columns, "value": values.iloc[0]})
        table = table.assign(**dict.fromkeys(Difference._fields, np.nan))
        first = values if first is None else first
        if model != models[0]:
            difference = (values - first)[values.columns]
            table["difference"] = difference.iloc[0]
            if len(drawn) > 1:
                table["low"], table["high"] = percentile_interval(difference.iloc[1:])
        tables.append(table)
    return pd.concat(tables, ignore_index=True)


def wrench_summary(errors: pd.DataFrame, spread: pd.DataFrame) -> pd.DataFrame:
    """Mean and greatest error of the tables ``wrench_errors`` and ``wrench_spread`` by number of
    cables, and the 95 % interval of the greatest error over the repeats.
    """
    summary = errors.groupby("agents")["error"].agg(["mean", "max"])
    maxima = spread.groupby("agents")["maximum"]
    ends = np.array([percentile_interval(values) for _, values in maxima])
    return summary.assign(max_low=ends[:, 0], max_high=ends[:, 1]).reset_index()
