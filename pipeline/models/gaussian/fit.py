"""(α, u) of the Gaussian matrix model: options, estimate, and what is looked at beside it: the
ridge that (α, u) lie on, and the gap of Σ_k to the problem as printed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Annotated, Literal, get_args

import numpy as np
import pandas as pd
from pydantic import Field

from pipeline.core import validation
from pipeline.models import options as base
from pipeline.models.gaussian.estimators import (
    GaussianFit,
    GaussianLikelihood,
    StepMeans,
    fit_distance,
    fit_likelihood,
)
from pipeline.models.model import frobenius, task_step
from pipeline.models.noise import mean_covariance
from pipeline.models.steps import Estimate, Recorded, Truth
from pipeline.statistics.takes import takes_moments

# ũ tried, as shares of the greatest ‖J̲⁺‖: the bound may at most double it
EXTENSIONS = np.linspace(0.005, 1.0, 200)
# fewer, for a likelihood has to be searched over α at each
LIKELY_EXTENSIONS = np.geomspace(0.005, 1.0, 25)
# u of known parameters over the greatest norm of the poses: near enough to bend the noise, and
# within what is searched
BOUND = 1.1
Estimator = Literal["moments", "paper", "likelihood"]


@validation.options(kw_only=True)
class Options(base.Options):
    """``estimator``: ``moments`` (the recorded total variance, then its course over time),
    ``paper`` (the distance of one-step moments, step by step) or ``likelihood``.
    """

    estimator: Estimator = "moments"
    # of the paper's estimator alone: β₁, weight of the mean's error
    beta: Annotated[float, Field(ge=0, lt=1)] = 0.5


def estimate(recorded: Recorded, options: Options) -> Estimate:
    """(α, u) by the estimator that ``options`` name; raises what that estimator raises."""
    if options.estimator == "paper":
        poses, squares = recorded.q.mean(axis=0), _square_speeds(recorded)
        norms = frobenius(recorded.chain.inverse_jacobian(poses, what="mean pose"))
        # of the commands (takes, M, m) of a closed loop the root mean square
        speeds = np.sqrt(squares.reshape(-1, squares.shape[-1]).mean(axis=0))
        fit = fit_distance(
            *takes_moments(recorded.noise),
            speeds,
            norms,
            rows=len(recorded.chain.task),
            beta1=options.beta,
            extensions=EXTENSIONS * norms.max(),
        )
        return _estimate(fit, _mean_square(norms**2, squares))
    means, takes = StepMeans.of(recorded), np.arange(len(recorded.q))
    if options.estimator == "moments":
        fit, from_takes = means.fit(EXTENSIONS, takes), partial(_by_moments, means)
    else:
        likelihood = fit_likelihood(recorded, LIKELY_EXTENSIONS)
        fit, from_takes = likelihood.fit, partial(_by_likelihood, means, likelihood)
    return _estimate(fit, means.mean_square(takes), from_takes)


def _by_moments(means: StepMeans, takes: np.ndarray) -> dict[str, float]:
    fit = means.fit(EXTENSIONS, takes)
    return _values(fit.alpha, fit.u, means.mean_square(takes))


def _by_likelihood(
    means: StepMeans, likelihood: GaussianLikelihood, takes: np.ndarray
) -> dict[str, float]:
    return _values(*likelihood.from_takes(takes), means.mean_square(takes))


def compared(options: Options) -> dict[str, Options]:
    """Every estimator."""
    return {f"{{}}_{each}": replace(options, estimator=each) for each in get_args(Estimator)}


def truths(recorded: Recorded, options: Options, dispersions: Sequence[float]) -> list[Truth]:
    """(α, u) of the recorded mean variance; ``options`` and ``dispersions`` do not matter."""
    squares = frobenius(recorded.chain.inverse_jacobian(recorded.q)) ** 2
    speeds, m = _square_speeds(recorded), len(recorded.chain.task)
    total_variance = np.trace(mean_covariance(recorded.noise))
    u = BOUND * float(np.sqrt(squares.max()))
    alpha = float(np.sqrt(m * total_variance / np.mean((u**2 - squares) * speeds)))
    values = _values(alpha, u, _mean_square(squares, speeds))
    return [Truth("gaussian", {"kind": "gaussian", "alpha": alpha, "u": u}, values)]


def _square_speeds(recorded: Recorded) -> np.ndarray:
    """(..., M) ‖v_k‖²."""
    v = task_step(recorded.chain, recorded.v)
    return np.vecdot(v, v)


def _mean_square(squares: np.ndarray, speeds: np.ndarray) -> float:
    """⟨‖J⁺‖²⟩ of ``squares`` (..., M), weighed by the square of the commanded steps (..., M)."""
    squares, speeds = np.broadcast_arrays(squares, speeds)
    return np.average(squares, weights=speeds)


def _values(alpha: float, u: float, mean_square: float) -> dict[str, float]:
    """(α, u) are hardly told apart; α·sqrt(u² − ⟨‖J⁺‖²⟩) is told well, its square times ‖v‖² being
    the mean variance of the noise.
    """
    return {"u": u, "alpha": alpha, "noise_level": alpha * np.sqrt(u**2 - mean_square)}


def _estimate(fit: GaussianFit, mean_square: float, from_takes=None) -> Estimate:
    diagnostics = {
        "u_unbounded": int(fit.unbounded),
        "extension_of_the_norm": fit.extension,
        "greatest_norm_of_the_inverse_jacobian": fit.u - fit.extension,
        "rms_norm_of_the_inverse_jacobian": np.sqrt(mean_square),
        "objective": fit.objective,
        "extension_at_the_end_of_its_interval": fit.at_end,
    }
    parameters = {"kind": "gaussian", "alpha": fit.alpha, "u": fit.u, "u_unbounded": fit.unbounded}
    values, unsure = _values(fit.alpha, fit.u, mean_square), ("u", "alpha") if fit.at_end else ()
    return Estimate(parameters, values, diagnostics, fit, from_takes, unsure)


def examined(
    recorded: Recorded,
    options: Options,
    estimate: Estimate | None,
    checks: int,
    rng: np.random.Generator,
) -> tuple[dict[str, float], dict[str, pd.DataFrame]]:
    """The table ``ridge``, and the greatest gap between Σ_k and the solution of the log-det problem
    as printed, at ``checks`` of the steps, evenly spread.
    """
    if estimate is None:
        return {}, {}
    # imported here: CVXPY takes longer to import than the model to fit
    from pipeline.models.convex import noise_covariance_gap

    fit = estimate.details
    inverse = recorded.chain.inverse_jacobian(recorded.q.mean(axis=0))
    norms = frobenius(inverse)
    checked = norms[np.linspace(0, len(norms) - 1, min(checks, len(norms))).astype(int)]
    gap = noise_covariance_gap(checked, fit.alpha, fit.u, *inverse.shape[-2:])
    metrics = {"convex_problems_checked": len(checked), "convex_check_greatest_relative_gap": gap}
    u = fit.u - fit.extension + fit.extensions
    mean_square = estimate.diagnostics["rms_norm_of_the_inverse_jacobian"] ** 2
    ridge = {
        "u": u,
        "alpha": fit.alphas,
        "level": fit.alphas * np.sqrt(u**2 - mean_square),
        "excess": fit.objectives - min(fit.objective, fit.objectives.min()),
    }
    return metrics, {"ridge": pd.DataFrame(ridge)}
