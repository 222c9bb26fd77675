"""Scores of stated laws by what was observed: proper scores (Gneiting & Raftery 2007), calibration
and sharpness, paired comparisons.

A logarithmic score is a log density at the outcome and best when great, an energy score a distance
and best when small. In every function the last axis holds the n components of an outcome, and what
stands before it are cases, scored one by one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.core.compiled import compiled
from pipeline.core.errors import ModelDomainError
from pipeline.statistics.takes import percentile_interval, student_quantile

NODES, WEIGHTS = np.polynomial.legendre.leggauss(64)


def energy_score(samples: np.ndarray, outcome: np.ndarray) -> np.ndarray:
    """(...,) E‖X − y‖ − ½E‖X − X′‖ for independent X, X′ of the stated law, in the unit of
    ``outcome`` y (..., n).

    Gneiting & Raftery 2007, Eq. (22), with exponent 1, estimated from ``samples`` (S, ..., n). The
    second mean runs over pairs of different samples, so that the estimate is unbiased whatever S
    (Ferro 2014, "fair"); it may therefore be negative. Raises ModelDomainError for a single sample.
    """
    count = len(samples)
    if count < 2:
        raise ModelDomainError("an energy score needs at least two samples", samples=count)
    cases, size = samples.shape[1:-1], samples.shape[-1]
    by_case = np.ascontiguousarray(np.moveaxis(samples.reshape(count, -1, size), 0, 1))
    to_outcome, between = np.zeros((2, len(by_case)))
    _add_distances(
        by_case,
        np.array(np.broadcast_to(outcome, samples.shape[1:])).reshape(-1, size),
        to_outcome,
        between,
    )
    return (to_outcome / count - between / (count * (count - 1))).reshape(cases)


@compiled
def _add_distances(
    samples: np.ndarray, outcome: np.ndarray, to_outcome: np.ndarray, between: np.ndarray
) -> None:
    """Add up the distances of ``samples`` (C, S, n) to ``outcome`` (C, n), and to each other, (C,)
    both, case by case in the cache.
    """
    for case in range(len(samples)):
        members = samples[case]
        for i in range(len(members)):
            squared = 0.0
            for axis in range(outcome.shape[1]):
                squared += (members[i, axis] - outcome[case, axis]) ** 2
            to_outcome[case] += np.sqrt(squared)
            for j in range(i):
                squared = 0.0
                for axis in range(outcome.shape[1]):
                    squared += (members[i, axis] - members[j, axis]) ** 2
                between[case] += np.sqrt(squared)


def normal_energy_score(error: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(...,) the energy score of N(0, ``covariance``) (..., n, n) at ``error`` (..., n), in the
    unit of the error.

    E‖Z‖ of a normal Z = ∫(1 − E exp(−t²‖Z‖²))/t² dt/√π over t > 0, and with the variances λ of Z
    along their axes and its mean m that expectation is Π(1 + 2t²λ)^(−½)·exp(−t²m²/(1 + 2t²λ)): a
    quadrature instead of draws. Raises ModelDomainError where a covariance is not positive
    definite.
    """
    variances, axes = np.linalg.eigh(covariance)
    if not np.all(variances > 0):
        raise ModelDomainError(
            "an energy score needs covariances that are positive definite",
            least=float(variances.min()),
        )
    mean = np.squeeze(np.swapaxes(axes, -1, -2) @ error[..., None], -1)
    return _mean_norm(mean, variances) - _mean_norm(np.zeros_like(mean), 2 * variances) / 2


def _mean_norm(mean: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """(...,) E‖Z‖ of normal Z with independent components, ``mean`` and ``variances`` (..., n)."""
    size = np.sqrt(np.sum(variances + mean**2, axis=-1))
    total = np.zeros_like(size)
    for node, weight in zip((NODES + 1) / 2, WEIGHTS / 2, strict=True):
        # t from 0 to infinity as node/(1 − node), in units of 1/size
        square = (node / (1 - node) / size)[..., None] ** 2
        widened = 1 + 2 * square * variances
        exponent = np.sum(np.log(widened) / 2 + square * mean**2 / widened, axis=-1)
        total -= weight * np.expm1(-exponent) / node**2
    return total * size / np.sqrt(np.pi)


def nees(error: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(...,) normalised estimation error squared eᵀC⁻¹e of ``error`` (..., n) under ``covariance``
    (..., n, n).

    χ² with n degrees of freedom, of mean n, where the error is normal with that covariance; greater
    for a law too sure of itself (Bar-Shalom, Li & Kirubarajan 2001, Sec. 5.4.2). Raises
    ModelDomainError where a covariance is not positive definite.
    """
    try:
        root = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        raise ModelDomainError(
            "a squared error cannot be normalised by a covariance that is not positive definite"
        ) from None
    white = np.linalg.solve(root, error[..., None])[..., 0]
    return np.vecdot(white, white)


def nees_band(cases: int, dimension: int, level: float = 0.95) -> tuple[float, float]:
    """Where the mean NEES of ``cases`` independent errors of ``dimension`` components lies with
    probability ``level``, tails alike.
    """
    tail = (1 - level) / 2
    return _chi_squared(tail, cases * dimension) / cases, _chi_squared(
        1 - tail, cases * dimension
    ) / cases


def _chi_squared(probability: float, degrees: int) -> float:
    """The quantile of χ², from the function that :mod:`scipy.stats` takes it from: importing that
    takes longer than most scores.
    """
    from scipy.special import gammaincinv

    return float(2 * gammaincinv(degrees / 2, probability))


def in_region(squared: np.ndarray, dimension: int, level: float = 0.95) -> np.ndarray:
    """(...,) bool, whether an error of the NEES ``squared`` (...,) lies in the ellipsoid that holds
    ``level`` of a normal law.
    """
    return squared <= _chi_squared(level, dimension)


def log_determinant(covariance: np.ndarray) -> np.ndarray:
    """(...,) ln det of ``covariance`` (..., n, n), in ln rad²ⁿ for angles in rad: sharpness, the
    less the sharper the law.

    Raises ModelDomainError where the determinant is not positive.
    """
    sign, logarithm = np.linalg.slogdet(covariance)
    if np.any(sign <= 0):
        raise ModelDomainError(
            "the determinant of a covariance is not positive",
            cases=int(np.count_nonzero(sign <= 0)),
        )
    return logarithm


def normal_log_score(error: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(...,) log density of N(0, ``covariance``) (..., n, n) at ``error`` (..., n); raises
    ModelDomainError like :func:`nees`.
    """
    return (
        -(
            nees(error, covariance)
            + log_determinant(covariance)
            + error.shape[-1] * np.log(2 * np.pi)
        )
        / 2
    )


def relative_error(curve: np.ndarray, recorded: np.ndarray) -> float:
    """‖curve − recorded‖ / ‖recorded‖ over time, of (K,) values: 0 where the curves agree, 1 where
    ``curve`` is zero.

    Raises ModelDomainError where ``recorded`` is zero throughout.
    """
    size = np.linalg.norm(recorded)
    if size == 0:
        raise ModelDomainError(
            "an error relative to a curve that is zero throughout does not exist",
            values=recorded.size,
        )
    return float(np.linalg.norm(curve - recorded) / size)


class Difference(NamedTuple):
    """A mean difference and the ends of its confidence interval, in the unit of the scores; NaN
    where it does not exist.
    """

    mean: float
    low: float
    high: float


def paired_difference(scores: np.ndarray, reference: np.ndarray) -> Difference:
    """Mean of ``scores`` − ``reference`` (takes,), both of the same takes, with Student's interval
    over the takes.

    Takes are independent and the steps within one are not, so a take counts as one observation. The
    interval does not exist for a single take; nothing does where a score is missing or infinite.
    """
    if not (np.all(np.isfinite(scores)) and np.all(np.isfinite(reference))):
        return Difference(np.nan, np.nan, np.nan)
    difference = scores - reference
    mean, takes = float(difference.mean()), len(difference)
    if takes < 2:
        return Difference(mean, np.nan, np.nan)
    half = float(student_quantile(takes - 1) * difference.std(ddof=1) / np.sqrt(takes))
    return Difference(mean, mean - half, mean + half)


def wrench_summary(errors: pd.DataFrame, spread: pd.DataFrame) -> pd.DataFrame:
    """Mean and greatest error of the study of the tables ``wrench_errors`` and ``wrench_spread`` by
    number of cables, and where 95 % of the repeats have the greatest, which is a random number.
    """
    summary = errors.groupby("agents")["error"].agg(["mean", "max"])
    return summary.join(maxima_interval(spread)).reset_index()


def maxima_interval(spread: pd.DataFrame) -> pd.DataFrame:
    """95 % interval of the greatest error over the repeats of ``wrench_spread``, by ``agents``."""
    ends = {m: percentile_interval(each) for m, each in spread.groupby("agents")["maximum"]}
    table = pd.DataFrame.from_dict(ends, orient="index", columns=["max_low", "max_high"])
    return table.rename_axis("agents")
