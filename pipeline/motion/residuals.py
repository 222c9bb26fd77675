"""Process noise about its own mean at each step, as the likelihoods of the further models take it."""

from __future__ import annotations

import numpy as np

from pipeline.errors import ModelDomainError


def residuals(noise: np.ndarray) -> np.ndarray:
    """(takes, M, 3) in rad: ``noise`` ω (takes, M, 3) minus its mean over the takes at each step, times sqrt(takes/(takes − 1)).

    No model of the step has a mean of its own to give to the mean noise, which is a systematic error of the motion: it is left out of
    every fit, and the factor makes up for the degree of freedom that it takes. So the mean of rrᵀ over all residuals r is exactly the
    Σ̂_ω of :func:`pipeline.motion.additive.fit_covariance`. Raises ModelDomainError for a single take.
    """
    takes = len(noise)
    if takes < 2:
        raise ModelDomainError("the noise about its mean needs at least two takes", takes=takes)
    return np.sqrt(takes / (takes - 1)) * (noise - noise.mean(axis=0))


def pooled_covariance(residual: np.ndarray) -> np.ndarray:
    """(3, 3) mean of rrᵀ in rad² over ``residual`` r (..., 3), the additive model's maximum-likelihood covariance.

    Raises ModelDomainError where it is singular or not finite: the likelihood of a density then has no bound.
    """
    flat = residual.reshape(-1, 3)
    covariance = flat.T @ flat / len(flat)
    scale = np.sqrt(np.diag(covariance))
    if not (np.all(np.isfinite(scale)) and np.all(scale > 0) and np.linalg.eigvalsh(covariance / np.outer(scale, scale))[0] > 1e-12):
        raise ModelDomainError(
            "the recorded noise lies in a plane or is not finite: its density has no maximum-likelihood estimate", std=scale.tolist()
        )
    return covariance


def additive_log_likelihood(residual: np.ndarray) -> float:
    """Mean log density of ``residual`` (..., 3) in nats (rad⁻³) under the additive model fitted to them, −½(3 ln 2π + ln|Σ̂_ω| + 3)."""
    return float(-0.5 * (3 * np.log(2 * np.pi) + np.linalg.slogdet(pooled_covariance(residual))[1] + 3))
