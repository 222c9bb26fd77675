"""Comparison of the perturbations' closed form with the convex problem as printed, and σ̂_B over
the weight that the paper leaves open.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from pipeline.core.errors import ModelDomainError
from pipeline.models.draws import draw_steps
from pipeline.models.model import task_step
from pipeline.models.steps import Estimate, Recorded
from pipeline.models.wishart.decomposition import Decomposition, chosen
from pipeline.models.wishart.dispersion import Problems, WishartFit, fit_wishart
from pipeline.models.wishart.law import WishartModel
from pipeline.models.wishart.moments import fit_moments
from pipeline.models.wishart.options import Options

RATIOS = np.geomspace(1e-5, 1e-1, 25)  # α₂/α₁ tried, in rad
TOLERANCE = 1e-3  # of ln of the ratio at which σ̂_B meets the moment estimate


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
        fit = fit_wishart(
            recorded.chain,
            recorded.q,
            recorded.v,
            recorded.noise,
            decomposition,
            options.floor,
            options.ratio_factor,
            recorded.known_measurement,
        )
    except ModelDomainError as error:
        print(f"fit: no convex problem is solved: {error}")
        return {}, {}
    metrics = _check(recorded, decomposition, fit, options.floor, checks, rng)
    try:
        moments = fit_moments(recorded, decomposition).sigma_b
    except ModelDomainError:
        return metrics, {}
    takes = {"recorded": recorded}
    if estimate is not None:
        takes["drawn"] = drawn_from(estimate.model, recorded, rng)
    tables = []
    for source, steps in takes.items():
        problems = Problems.of(
            steps.chain, steps.q, steps.v, steps.noise, decomposition, options.floor
        )
        curve = np.array([problems.sigma_b(ratio) for ratio in RATIOS])
        table = pd.DataFrame({"ratio": RATIOS, "sigma_b": curve, "point": "curve"})
        meeting = meeting_ratio(problems, RATIOS, curve, moments)
        if meeting is not None:
            metrics[f"weights_ratio_meeting_the_moments_{source}_rad"] = meeting
            table.loc[len(table)] = (meeting, moments, "moments")
        tables.append(table.assign(source=source))
    used = fit.weights[1] / fit.weights[0]
    tables.append(
        pd.DataFrame(
            {"ratio": [used], "sigma_b": [fit.sigma_b], "point": "used", "source": "recorded"}
        )
    )
    return metrics, {"sigma_b_weights": pd.concat(tables, ignore_index=True)}


def _check(
    recorded: Recorded,
    decomposition: Decomposition,
    fit: WishartFit,
    floor: float,
    checks: int,
    rng: np.random.Generator,
) -> dict[str, float]:
    # imported here: CVXPY takes longer to import than most models to fit
    from pipeline.models.wishart.convex_check import perturbation_gap

    q, v = recorded.q, recorded.v
    v = np.broadcast_to(v, (*q.shape[:2], v.shape[-1])).reshape(-1, v.shape[-1])
    moving = np.flatnonzero(np.any(task_step(recorded.chain, v), axis=1))
    checked = np.sort(rng.choice(moving, min(checks, len(moving)), replace=False))
    gap = perturbation_gap(
        fit.perturbations,
        recorded.chain,
        q.reshape(-1, q.shape[-1]),
        v,
        recorded.noise.reshape(-1, q.shape[-1]),
        decomposition,
        fit.weights,
        floor,
        checked,
    )
    return {"convex_problems_checked": len(checked), "convex_check_greatest_relative_gap": gap}


def drawn_from(model: WishartModel, recorded: Recorded, rng: np.random.Generator) -> Recorded:
    """Steps of the ``model`` from the recorded poses under the recorded commands, with measurement
    noise added.
    """
    q, v = recorded.q, recorded.v
    drawn, _ = draw_steps(model, recorded.chain, q, v, rng)
    measured = rng.multivariate_normal(np.zeros(q.shape[-1]), recorded.measurement, q.shape[:-1])
    return replace(recorded, noise=drawn - q - recorded.chain.nominal_step(q, v) + measured)


def meeting_ratio(
    problems: Problems, ratios: np.ndarray, curve: np.ndarray, sigma_b: float
) -> float | None:
    """α₂/α₁ in rad at which the printed problem returns ``sigma_b``, between two of ``ratios`` (K,)
    whose ``curve`` σ̂_B (K,) falls through it; None where it does nowhere.
    """
    from scipy.optimize import brentq

    above = curve > sigma_b
    crossings = np.flatnonzero(above[:-1] & ~above[1:])
    if not len(crossings):
        return None
    low, high = np.log(ratios[crossings[0] : crossings[0] + 2])
    crossing = brentq(lambda x: problems.sigma_b(np.exp(x)) - sigma_b, low, high, xtol=TOLERANCE)
    return float(np.exp(crossing))
