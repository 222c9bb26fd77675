"""σ_B of the Wishart model: options, estimate, and what is looked at beside it: the gap to the
convex problem as printed, and σ̂_B over the weight that the paper leaves open.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any, Literal, Self, get_args

import numpy as np
import pandas as pd
from pydantic import Field, model_validator

from pipeline.core import validation
from pipeline.core.errors import ModelDomainError
from pipeline.models import options as base
from pipeline.models.model import task_step
from pipeline.models.steps import Estimate, Recorded, Truth
from pipeline.models.wishart.decomposition import CONTROL, Decomposition, chosen
from pipeline.models.wishart.estimators import (
    Problems,
    SolvedProblems,
    fit_likelihood,
    fit_moments,
    fit_paper,
)
from pipeline.models.wishart.law import WishartModel
from pipeline.randommatrix.wishart import largest_dispersion

RATIOS = np.geomspace(1e-5, 1e-1, 25)  # α₂/α₁ tried, in rad
TOLERANCE = 1e-3  # of ln of the ratio at which σ̂_B meets the moment estimate
Estimator = Literal["moments", "paper", "likelihood"]


@validation.options(kw_only=True)
class Options(base.Options):
    """``estimator``: ``moments`` (the recorded total variance), ``paper`` (the convex problem on
    every step) or ``likelihood``.
    """

    estimator: Estimator = "moments"
    decomposition: Literal["by_shape", "pivoted_lu", "qr", "qr_transposed", "given"] = "by_shape"
    left: list[list[float]] | None = None  # rows of J₁, of the decomposition given alone
    # of the paper's estimator alone: ε of B⁻¹ ⪰ εI, and the factor on α₂/α₁, which follows from
    # the noise at rest
    floor: Annotated[float, Field(gt=0, lt=1)] = 0.2
    ratio_factor: Annotated[float, Field(gt=0)] = 1.0

    @model_validator(mode="after")
    def _values_that_go_together(self) -> Self:
        if (self.decomposition == "given") != (self.left is not None):
            raise validation.Fault("left", "the decomposition given, and no other, needs left")
        if self.left is not None and any(len(row) != len(self.left) for row in self.left):
            raise validation.Fault("left", "must be square: the rows of J1")
        return self


def estimate(recorded: Recorded, options: Options) -> Estimate:
    """σ_B by the estimator that ``options`` name; raises what that estimator raises."""
    given = recorded, chosen(options, recorded.chain.task, recorded.joints)
    match options.estimator:
        case "moments":
            fit = fit_moments(*given)
        case "likelihood":
            fit = fit_likelihood(*given)
        case "paper":
            fit = fit_paper(*given, options.floor, options.ratio_factor)
    limit = largest_dispersion(len(recorded.chain.task), inverse_moments=2)
    diagnostics = {**fit.diagnostics, "sigma_b_limit_of_the_covariance": limit}
    values = {"sigma_b": fit.sigma_b}
    return Estimate(_parameters(fit.sigma_b, given[1]), values, diagnostics, fit, fit.from_takes)


def compared(options: Options) -> dict[str, Options]:
    """Every estimator, under the decomposition of ``options`` and under the control."""
    cases = {"": options}
    if options.decomposition != CONTROL.name:
        control = replace(options, decomposition=CONTROL.name, left=None)
        cases[f"control_{CONTROL.name}_"] = control
    return {
        f"{prefix}{{}}_{estimator}": replace(each, estimator=estimator)
        for prefix, each in cases.items()
        for estimator in get_args(Estimator)
    }


def truths(recorded: Recorded, options: Options, dispersions: Sequence[float]) -> list[Truth]:
    """Each of ``dispersions``, whatever was recorded."""
    decomposition = chosen(options, recorded.chain.task, recorded.joints)
    return [
        Truth(f"wishart {sigma_b:g}", _parameters(sigma_b, decomposition), {"sigma_b": sigma_b})
        for sigma_b in dispersions
    ]


def _parameters(sigma_b: float, decomposition: Decomposition) -> dict[str, Any]:
    values = {"kind": "wishart", "sigma_b": sigma_b, "decomposition": decomposition.name}
    left = decomposition.left
    return values if left is None else values | {"left": np.array(left).tolist()}


def examined(
    recorded: Recorded,
    options: Options,
    estimate: Estimate | None,
    checks: int,
    rng: np.random.Generator,
) -> tuple[dict[str, float], dict[str, pd.DataFrame]]:
    """The greatest gap between the closed form and (BsampOpt) at ``checks`` of the steps that move,
    and the table ``sigma_b_weights``, of the recorded takes and of as many that are drawn from the
    model of the ``estimate``, where there is one.
    """
    decomposition = chosen(options, recorded.chain.task, recorded.joints)
    try:
        fit = fit_paper(recorded, decomposition, options.floor, options.ratio_factor)
    except ModelDomainError as error:
        print(f"fit: no convex problem is solved: {error}")
        return {}, {}
    metrics = _check(recorded, decomposition, fit.problems, options.floor, checks, rng)
    try:
        moments = fit_moments(recorded, decomposition).sigma_b
    except ModelDomainError:
        return metrics, {}
    takes = {"recorded": recorded}
    if estimate is not None:
        takes["drawn"] = _drawn_from(estimate.model, recorded, rng)
    rows = []
    for source, steps in takes.items():
        problems = Problems.of(steps, decomposition, options.floor)
        curve = np.array([problems.sigma_b(ratio) for ratio in RATIOS])
        rows += [(*pair, "curve", source) for pair in zip(RATIOS, curve, strict=True)]
        meeting = _meeting_ratio(problems, curve, moments)
        if meeting is not None:
            metrics[f"weights_ratio_meeting_the_moments_{source}_rad"] = meeting
            rows.append((meeting, moments, "moments", source))
    used = fit.diagnostics["weights_ratio_alpha2_over_alpha1_rad"]
    rows.append((used, fit.sigma_b, "used", "recorded"))
    table = pd.DataFrame(rows, columns=["ratio", "sigma_b", "point", "source"])
    return metrics, {"sigma_b_weights": table}


def _check(
    recorded: Recorded,
    decomposition: Decomposition,
    solved: SolvedProblems,
    floor: float,
    checks: int,
    rng: np.random.Generator,
) -> dict[str, float]:
    # imported here: CVXPY takes longer to import than most models to fit
    from pipeline.models.convex import perturbation_gap

    n, v = recorded.q.shape[-1], task_step(recorded.chain, recorded.v)
    v = np.broadcast_to(v, (*recorded.q.shape[:2], v.shape[-1])).reshape(-1, v.shape[-1])
    moving = np.flatnonzero(np.any(v, axis=1))
    checked = np.sort(rng.choice(moving, min(checks, len(moving)), replace=False))
    jacobians = recorded.chain.jacobian(recorded.q.reshape(-1, n)[checked])
    steps = v[checked], recorded.noise.reshape(-1, n)[checked]
    objectives = solved.perturbations.objective[checked]
    gap = perturbation_gap(objectives, jacobians, *steps, decomposition, solved.weights, floor)
    return {"convex_problems_checked": len(checked), "convex_check_greatest_relative_gap": gap}


def _drawn_from(model: WishartModel, recorded: Recorded, rng: np.random.Generator) -> Recorded:
    """Steps of the ``model`` from the recorded poses and commands, with measurement noise."""
    from pipeline.models.draws import draw_steps  # here, as it loads the compiler

    q, v = recorded.q, recorded.v
    drawn, _ = draw_steps(model, recorded.chain, q, v, rng)
    measured = rng.multivariate_normal(np.zeros(q.shape[-1]), recorded.measurement, q.shape[:-1])
    return replace(recorded, noise=drawn - q - recorded.chain.nominal_step(q, v) + measured)


def _meeting_ratio(problems: Problems, curve: np.ndarray, sigma_b: float) -> float | None:
    """α₂/α₁ in rad at which the printed problem returns ``sigma_b``, between two of RATIOS whose
    ``curve`` σ̂_B falls through it; None where it does nowhere.
    """
    from scipy.optimize import brentq

    above = curve > sigma_b
    crossings = np.flatnonzero(above[:-1] & ~above[1:])
    if not len(crossings):
        return None
    low, high = np.log(RATIOS[crossings[0] : crossings[0] + 2])
    crossing = brentq(lambda x: problems.sigma_b(np.exp(x)) - sigma_b, low, high, xtol=TOLERANCE)
    return float(np.exp(crossing))
