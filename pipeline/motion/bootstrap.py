"""Standard errors and intervals of an estimator by the bootstrap over takes (Efron and Tibshirani, 1993, Sec. 6 and 13).

The takes are independent of each other, the steps of a take are not: noise lasts from one step to the next, and each measured pose is
in two of them. So whole takes are drawn with replacement, and the estimator is applied to each such resampling anew, the measurement
noise, the weights and the bounds that it derives from the recordings included. Only where a single fit takes too long for that, which
are the likelihoods of the Wishart model and of the forward form of the Gaussian one, are the likelihoods of the takes resampled in
place of the takes: the measurement noise is then held fixed at that of all takes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from pipeline import schema
from pipeline.errors import ModelDomainError, SolverError
from pipeline.motion.estimation import Estimate, Recorded, estimate, forward_estimate, student_entries
from pipeline.motion.gaussian_forward_fit import ForwardLikelihood
from pipeline.motion.likelihood import DispersionFit
from pipeline.motion.student_fit import StudentFit, fit_student

TAILS = (0.025, 0.975)

Estimator = Callable[[np.ndarray], dict[str, float]]  # numbers of the takes → estimates by name


@dataclass(frozen=True)
class Spread:
    """How far an estimate would vary over recordings of as many takes, and the ends of its 95 % percentile interval."""

    standard_error: float
    low: float
    high: float


def estimator_of_takes(recorded: Recorded, options: schema.Model, found: Estimate) -> Estimator:
    """The estimates of ``options`` from any of the takes of ``recorded``; ``found`` is the estimate from all of them."""
    match found.details:
        case DispersionFit():
            return partial(_from_likelihoods, found.details)
        case ForwardLikelihood():
            return partial(_from_forward_likelihoods, found.details)
        case StudentFit():
            return partial(_student_near, recorded, found.details)
    return partial(_anew, recorded, options)


def _from_likelihoods(fit: DispersionFit, takes: np.ndarray) -> dict[str, float]:
    return {"sigma_b": fit.of(takes)}


def _from_forward_likelihoods(likelihood: ForwardLikelihood, takes: np.ndarray) -> dict[str, float]:
    return forward_estimate(likelihood.of(takes)).estimates


def _student_near(recorded: Recorded, fit: StudentFit, takes: np.ndarray) -> dict[str, float]:
    """Anew too, but for where the search starts, which saves nearly half of its steps."""
    resampled = recorded.of(takes)
    found = fit_student(resampled.noise, resampled.measurement, near=fit)
    return student_entries(found.nu, found.scale)


def _anew(recorded: Recorded, options: schema.Model, takes: np.ndarray) -> dict[str, float]:
    return estimate(recorded.of(takes), options).estimates


def replicate(estimator: Estimator, takes: int, rng: np.random.Generator) -> dict[str, float] | None:
    """The estimates from one resampling of ``takes`` takes; None where it has none, as where one take was drawn every time."""
    try:
        return estimator(rng.integers(takes, size=takes))
    except (ModelDomainError, SolverError):
        return None


def percentiles(values: np.ndarray) -> tuple[float, float]:
    """Ends of the interval of ``values`` (N,) that one further value would lie in with a probability of 95 %, for N ≥ 39."""
    low, high = np.quantile(values, TAILS, method="weibull")
    return float(low), float(high)


def spreads(replicates: list[dict[str, float] | None]) -> tuple[dict[str, Spread], int]:
    """The spread of every estimate that all replicates have, and how many replicates have none; no spread for fewer than two."""
    found = [estimates for estimates in replicates if estimates is not None]
    lost = len(replicates) - len(found)
    if len(found) < 2:
        return {}, lost
    values = {name: np.array([estimates[name] for estimates in found]) for name in found[0] if all(name in other for other in found)}
    return {name: Spread(float(of.std(ddof=1)), *percentiles(of)) for name, of in values.items()}, lost
