"""σ_B of the Wishart model: by the paper's convex problem on every step, or most likely."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from pipeline.models.steps import Estimate, Recorded, Truth
from pipeline.models.wishart.decomposition import PARTS, Decomposition, chosen
from pipeline.models.wishart.dispersion import fit_wishart
from pipeline.models.wishart.likelihood import DispersionFit, fit_sigma_b
from pipeline.models.wishart.options import Options


def estimate(recorded: Recorded, options: Options) -> Estimate:
    """σ_B by the estimator that ``options`` name; raises what that estimator raises."""
    decomposition = chosen(options, recorded.chain.task, recorded.joints)
    if options.estimator == "likelihood":
        fit = fit_sigma_b(
            recorded.chain,
            recorded.q,
            recorded.v,
            recorded.noise,
            recorded.measurement,
            decomposition,
        )
        diagnostics = {"sigma_b_at_the_end_of_its_interval": fit.at_end}
        return Estimate(
            _parameters(fit.sigma_b, decomposition), _values(fit.sigma_b), diagnostics, fit
        )
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
    moving = np.any(recorded.v, axis=-1)
    moving = moving.any(axis=0) if moving.ndim > 1 else moving
    unperturbed = ~fit.perturbations.s.any(axis=(1, 2))
    diagnostics = {
        "sigma_b_greatest_over_time": fit.dispersions.max(),
        "sigma_b_mean_over_moving_steps": fit.dispersions[moving].sum() / max(moving.sum(), 1),
        "share_of_steps_at_rest": 1 - moving.mean(),
        "weights_ratio_alpha2_over_alpha1_rad": fit.weights[1] / fit.weights[0],
        "noise_at_rest_rms_rad": fit.rest_noise,
        "problems": len(fit.perturbations.bound),
        "problems_without_perturbation": int(np.count_nonzero(unperturbed)),
        "problems_on_the_bound_of_definiteness": int(np.count_nonzero(fit.perturbations.bound)),
    }
    return Estimate(_parameters(fit.sigma_b, decomposition), _values(fit.sigma_b), diagnostics, fit)


def resampled(found: Estimate) -> Callable[[np.ndarray], dict[str, float]] | None:
    """σ_B from the likelihoods of any of the takes, which one fit takes too long to evaluate anew;
    the measurement noise stays that of all takes. None for the paper's estimator.
    """
    fit = found.details
    if not isinstance(fit, DispersionFit):
        return None
    return partial(_from_takes, fit)


def _from_takes(fit: DispersionFit, takes: np.ndarray) -> dict[str, float]:
    return _values(fit.from_takes(takes))


def truths(recorded: Recorded, options: Options, dispersions: Sequence[float]) -> list[Truth]:
    """Each of ``dispersions``, whatever was recorded."""
    decomposition = chosen(options, recorded.chain.task, recorded.joints)
    return [
        Truth(f"wishart {sigma_b:g}", _parameters(sigma_b, decomposition), _values(sigma_b))
        for sigma_b in dispersions
    ]


def _values(sigma_b: float) -> dict[str, float]:
    return {"sigma_b": sigma_b}


def _parameters(sigma_b: float, decomposition: Decomposition) -> dict[str, Any]:
    parts = {part: np.array(getattr(decomposition, part)) for part in PARTS}
    return {"kind": "wishart", "sigma_b": sigma_b, "decomposition": decomposition.name} | {
        part: numbers.tolist() for part, numbers in parts.items() if numbers.ndim
    }
