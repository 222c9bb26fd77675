"""Moments, correlations and 95 % intervals over takes. Takes are independent; steps are not."""

from collections.abc import Callable, Sequence
from typing import NamedTuple
from warnings import catch_warnings, simplefilter

import numpy as np
import pandas as pd
from numpy import ndarray
from scipy.special import chdtrc, fdtrc, stdtrit

from pipeline.core.errors import ModelDomainError

TAILS = (0.025, 0.975)
NORMAL_QUANTILE = 1.959964  # 0.975 quantile of the normal law
REPLICATES = 200  # resamplings of the takes
PARTS = 8  # of a motion, whose means are tested

# model, indices of the takes → values (q,)
Quantities = Callable[[str, ndarray], ndarray]


class Difference(NamedTuple):
    """Mean difference, the ends of its 95 % interval, its standard error and the degrees of freedom
    of Student's law; NaN if there is no interval, degrees also for an interval of another law.
    """

    difference: float
    low: float = np.nan
    high: float = np.nan
    standard_error: float = np.nan
    degrees: float = np.nan


def takes_moments(samples: ndarray) -> tuple[ndarray, ndarray]:
    """Return mean (M, n) and sample covariance (M, n, n) over the takes of ``samples`` (takes, M,
    n); raises ModelDomainError for a single take.
    """
    takes = len(samples)
    if takes < 2:
        raise ModelDomainError(
            "a sample covariance needs at least two takes",
            takes=takes,
        )
    mean = samples.mean(axis=0)
    centred = samples - mean
    return mean, np.einsum("tki,tkj->kij", centred, centred) / (takes - 1)


def lag_one_correlation(values: ndarray) -> float:
    """Return the correlation of neighbouring steps of ``values`` (takes, K) minus step means."""
    centred = values - values.mean(axis=0)
    before = centred[:, :-1]
    after = centred[:, 1:]
    scale = np.sqrt(np.sum(before**2) * np.sum(after**2))
    if not scale > 0:
        return 0.0
    return float(np.sum(before * after) / scale)


def fast_against_slow(noise: ndarray, steps: ndarray) -> list[Difference]:
    """Return for each joint the mean over the takes of ln σ_fast − ln σ_slow: standard deviations
    of ``noise`` (takes, M, n) in rad over the fastest and the slowest third of the joint's
    commanded ``steps`` (M, n) in a take. NaN if a take has no noise in a third.
    """
    third = len(steps) // 3
    differences = []
    for j, speeds in enumerate(np.abs(steps.T)):
        ordered = noise[:, np.argsort(speeds, kind="stable"), j]
        slow_std = ordered[:, :third].std(axis=1)
        fast_std = ordered[:, -third:].std(axis=1)
        with np.errstate(divide="ignore"):
            slow = np.log(slow_std)
            fast = np.log(fast_std)
        differences.append(paired_difference(fast, slow))
    return differences


def share_between(noise: ndarray, groups: Sequence[str]) -> float:
    """Return the share of the variance of ``noise`` (takes, M, n) over the takes that lies between
    the means of the ``groups`` (takes,); 0 for a single group and for groups of one take each.
    """
    names = list(dict.fromkeys(groups))
    if len(names) in (1, len(groups)):
        return 0.0
    is_member = np.array(names)[:, None] == np.array([*groups])
    member = is_member.astype(float)
    sizes = member.sum(axis=1)
    mean = noise.mean(axis=0)
    centred = (noise - mean).reshape(len(noise), -1)
    group_means = member @ centred / sizes[:, None]
    squares = np.sum(group_means**2, axis=1)
    between = sizes @ squares
    total = np.sum(centred**2)
    return float(between / total)


def percentile_interval(values: ndarray) -> tuple[ndarray, ndarray]:
    """Return the ends of the interval that contains one further value with a probability of 95 %,
    from ``values`` (N, ...) over the first axis; least and greatest value for N < 40.
    """
    low, high = np.quantile(values, TAILS, axis=0, method="weibull")
    return low, high


def _student(difference: float, error: float, degrees: int) -> Difference:
    """Return a ``difference`` with Student's interval; no interval for ``degrees`` < 1."""
    difference = float(difference)
    if degrees < 1:
        return Difference(difference)
    half = float(stdtrit(degrees, TAILS[1]) * error)
    low = difference - half
    high = difference + half
    return Difference(difference, low, high, float(error), float(degrees))


def paired_difference(scores: ndarray, reference: ndarray) -> Difference:
    """Return the mean of ``scores`` − ``reference`` (takes,), both of the same takes, with
    Student's interval over the takes: no interval for a single take, NaN if a score is not finite.
    """
    both = np.stack([scores, reference])
    if not np.isfinite(both).all():
        return Difference(np.nan)
    difference = scores - reference
    takes = len(difference)
    std = difference.std(ddof=min(1, takes - 1))
    return _student(difference.mean(), std / np.sqrt(takes), takes - 1)


def part_means(values: ndarray) -> ndarray:
    """Return the means (takes, p) of ``values`` (takes, K), NaN where missing, in PARTS equal parts
    of the time, or in K parts if there are fewer values; NaN for a part without a value.
    """
    parts = np.array_split(values, min(PARTS, values.shape[1]), axis=1)
    with catch_warnings():
        simplefilter("ignore", RuntimeWarning)  # of a part without a value
        return np.stack([np.nanmean(part, axis=1) for part in parts], axis=1)


def zero_mean_p_value(values: ndarray) -> float:
    """Return the p-value of Hotelling's test that the mean of ``values`` (takes, p) over the takes
    is zero, for normal values; NaN for p or fewer takes, p = 0, dependent and missing values.
    """
    takes, number = values.shape
    if not 0 < number < takes or np.isnan(values).any():
        return np.nan
    mean = values.mean(axis=0)
    if np.linalg.matrix_rank(values - mean) < number:
        return np.nan
    covariance = np.cov(values.T)
    whitened = np.linalg.solve(covariance, mean)
    squared = takes * mean @ whitened
    degrees = takes - number
    ratio = squared * degrees / ((takes - 1) * number)
    return float(fdtrc(number, degrees, ratio))


def equal_covariances_p_value(
    covariances: Sequence[ndarray],
    counts: Sequence[float],
) -> float:
    """Return the p-value of Box's test that the populations of the sample ``covariances`` (p, p) of
    ``counts`` independent normal samples have one covariance (Box 1949, the χ² approximation).
    """
    degrees = np.array(counts) - 1
    covariances = np.array(covariances)
    groups, size, _ = covariances.shape
    pooled = np.einsum("g,gij->ij", degrees, covariances) / degrees.sum()
    logarithms = np.linalg.slogdet(covariances)[1]
    of_pooled = np.linalg.slogdet(pooled)[1]
    total = degrees.sum()
    ratio = total * of_pooled - degrees @ logarithms
    bias = np.sum(1 / degrees) - 1 / total
    weight = 2 * size**2 + 3 * size - 1
    divisor = 6 * (size + 1) * (groups - 1)
    factor = 1 - bias * weight / divisor
    restrictions = size * (size + 1) * (groups - 1) / 2
    return float(chdtrc(restrictions, factor * ratio))


def jackknife_counts(takes: int) -> ndarray:
    """Return weights (1 + takes, takes): the first row has all takes, other rows all but one."""
    return np.vstack([np.ones((1, takes)), 1 - np.eye(takes)])


def jackknife_difference(values: ndarray) -> Difference:
    """Return the first of ``values`` (1 + takes,), one for each row of :func:`jackknife_counts`,
    with Student's interval from the other values; no interval below three takes.
    """
    takes = len(values) - 1
    error = np.sqrt((takes - 1) * np.var(values[1:]))
    return _student(values[0], error, takes - 1 if takes > 2 else 0)


def drawn_takes(takes: int, rng: np.random.Generator) -> list[ndarray]:
    """Return the take indices of REPLICATES resamplings; drops those that repeat a single take."""
    if takes < 2:
        return []
    drawn = [rng.integers(takes, size=takes) for _ in range(REPLICATES)]
    return [indices for indices in drawn if np.ptp(indices) > 0]


def resampled_differences(
    quantities: Quantities,
    models: Sequence[str],
    takes: int,
    rng: np.random.Generator,
) -> dict[str, list[Difference]]:
    """Return by model the difference of every quantity to the first model, with the 95 % percentile
    interval of the bootstrap over takes, the same takes for all models.
    """
    drawn = [np.arange(takes), *drawn_takes(takes, rng)]
    values = {}
    for model in models:
        resampled = [quantities(model, indices) for indices in drawn]
        values[model] = np.transpose(resampled).copy()

    differences = {}
    for model in models:
        to_first = values[model] - values[models[0]]
        numbers = [to_first[:, 0]]
        if len(drawn) > 1:
            resampled = to_first[:, 1:]
            numbers += percentile_interval(resampled.T)
            numbers.append(resampled.std(axis=1, ddof=1))
        rows = zip(*numbers, strict=True)
        differences[model] = [Difference(*row) for row in rows]
    return differences


def wrench_summary(errors: pd.DataFrame, spread: pd.DataFrame) -> pd.DataFrame:
    """Return mean and greatest error by number of cables from the tables ``wrench_errors`` and
    ``wrench_spread``, and the 95 % interval of the greatest error over the repeats.
    """
    by_agents = errors.groupby("agents")["error"]
    summary = by_agents.agg(["mean", "max"])
    maxima = spread.groupby("agents")["maximum"]
    summary["repeats"] = maxima.size()
    intervals = [percentile_interval(values) for _, values in maxima]
    low, high = np.array(intervals).T
    return summary.assign(max_low=low, max_high=high).reset_index()
