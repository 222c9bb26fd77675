"""σ_B of the Wishart model: by moments, by the paper's convex problem, or most likely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pipeline.models.steps import Estimate, Recorded, Truth
from pipeline.models.wishart.decomposition import CONTROL, PARTS, Decomposition, chosen
from pipeline.models.wishart.dispersion import WishartFit, fit_wishart
from pipeline.models.wishart.likelihood import fit_sigma_b
from pipeline.models.wishart.moments import fit_moments
from pipeline.models.wishart.options import ESTIMATORS, Options
from pipeline.randommatrix.wishart import largest_dispersion


def estimate(recorded: Recorded, options: Options) -> Estimate:
    """σ_B by the estimator that ``options`` name; raises what that estimator raises."""
    decomposition = chosen(options, recorded.chain.task, recorded.joints)
    data = recorded.chain, recorded.q, recorded.v, recorded.noise
    if options.estimator == "moments":
        fit, diagnostics = fit_moments(recorded, decomposition), {}
    elif options.estimator == "likelihood":
        fit = fit_sigma_b(*data, recorded.measurement, decomposition)
        diagnostics = {"sigma_b_at_the_end_of_its_interval": fit.at_end}
    else:
        fit = fit_wishart(
            *data,
            decomposition,
            options.floor,
            options.ratio_factor,
            recorded.known_measurement,
        )
        diagnostics = _problems(fit, recorded.v)
    limit = largest_dispersion(len(recorded.chain.task), inverse_moments=2)
    return Estimate(
        _parameters(fit.sigma_b, decomposition),
        {"sigma_b": fit.sigma_b},
        diagnostics | {"sigma_b_limit_of_the_covariance": limit},
        fit,
        fit.from_takes,
    )


def compared(options: Options) -> dict[str, Options]:
    """Every estimator, under the decomposition of ``options`` and under the control."""
    cases = {"": options}
    if options.decomposition != CONTROL.name:
        control = replace(options, decomposition=CONTROL.name, left=None)
        cases[f"control_{CONTROL.name}_"] = control
    return {
        f"{prefix}{{}}_{estimator}": replace(each, estimator=estimator)
        for prefix, each in cases.items()
        for estimator in ESTIMATORS
    }


def _problems(fit: WishartFit, v: np.ndarray) -> dict[str, float]:
    """Numbers of the convex problems of ``fit``; ``v`` (M, m) or (takes, M, m) are commands."""
    moving = np.any(v, axis=-1)
    moving = moving.any(axis=0) if moving.ndim > 1 else moving
    unperturbed = ~fit.perturbations.s.any(axis=(1, 2))
    return {
        "sigma_b_greatest_over_time": fit.dispersions.max(),
        "sigma_b_mean_over_moving_steps": fit.dispersions[moving].sum() / max(moving.sum(), 1),
        "share_of_steps_at_rest": 1 - moving.mean(),
        "weights_ratio_alpha2_over_alpha1_rad": fit.weights[1] / fit.weights[0],
        "noise_at_rest_rms_rad": fit.rest_noise,
        "problems": len(fit.perturbations.bound),
        "problems_without_perturbation": int(np.count_nonzero(unperturbed)),
        "problems_on_the_bound_of_definiteness": int(np.count_nonzero(fit.perturbations.bound)),
    }


def truths(recorded: Recorded, options: Options, dispersions: Sequence[float]) -> list[Truth]:
    """Each of ``dispersions``, whatever was recorded."""
    decomposition = chosen(options, recorded.chain.task, recorded.joints)
    return [
        Truth(f"wishart {sigma_b:g}", _parameters(sigma_b, decomposition), {"sigma_b": sigma_b})
        for sigma_b in dispersions
    ]


def _parameters(sigma_b: float, decomposition: Decomposition) -> dict[str, Any]:
    parts = {part: np.array(getattr(decomposition, part)) for part in PARTS}
    return {"kind": "wishart", "sigma_b": sigma_b, "decomposition": decomposition.name} | {
        part: numbers.tolist() for part, numbers in parts.items() if numbers.ndim
    }
