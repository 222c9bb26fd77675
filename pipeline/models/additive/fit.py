"""Estimators of Σ_ω of the additive model: mean sample covariance, or shrunk minus Σ_m."""

from collections.abc import Sequence
from itertools import combinations, combinations_with_replacement
from typing import Literal

import numpy as np
from numpy import ndarray

from pipeline.core import validation
from pipeline.models import steps as base
from pipeline.models.model import without_measurement
from pipeline.models.steps import Estimate, Recorded, Truth, mean_covariance
from pipeline.statistics.takes import takes_moments


@validation.options(kw_only=True)
class Options(base.Options):
    """``estimator``: ``paper`` or ``shrinkage``."""

    estimator: Literal["paper", "shrinkage"]


def estimate(recorded: Recorded, options: Options) -> Estimate:
    """Estimate Σ_ω by the estimator of ``options``; raises ModelDomainError for a single take."""
    if options.estimator == "paper":
        return _estimate(mean_covariance(recorded.noise), {})
    shrunk, intensity = shrunk_covariance(recorded.noise)
    covariance, quiet = without_measurement(shrunk, recorded.measurement)
    diagnostics = {
        "shrinkage_intensity": intensity,
        "axes_without_noise_beyond_the_measurement": quiet,
    }
    return _estimate(covariance, diagnostics)


def truths(
    recorded: Recorded,
    options: Options,
    dispersions: Sequence[float],
) -> list[Truth]:
    """Return the recorded Σ_ω as the known parameters."""
    fit = _estimate(mean_covariance(recorded.noise), {})
    return [Truth("additive", fit.parameters, fit.estimates)]


def _estimate(covariance: ndarray, diagnostics: dict[str, float]) -> Estimate:
    """Return Σ_ω by entry in rad², and the correlations between joints with noise."""
    std = np.sqrt(np.diag(covariance))
    joints = range(len(covariance))
    entries = {}
    for i, j in combinations_with_replacement(joints, 2):
        entries[f"sigma_omega_{i + 1}{j + 1}_rad2"] = covariance[i, j]
    for i, j in combinations(joints, 2):
        product = std[i] * std[j]
        if product > 0:
            entries[f"correlation_omega_{i + 1}{j + 1}"] = covariance[i, j] / product
    parameters = {"kind": "additive", "noise_covariance": covariance.tolist()}
    return Estimate(parameters, entries, diagnostics)


def shrunk_covariance(noise: ndarray) -> tuple[ndarray, float]:
    """(n, n) Σ̂_ω shrunk towards a scaled identity, (1−ρ)Σ̂_ω + ρ·tr Σ̂_ω/n·I in rad², and ρ in [0,
    1]. ρ is the variance of Σ̂_ω over takes divided by its squared distance from the target (Ledoit
    and Wolf, J. Multivariate Analysis 88, 2004). ``noise`` ω is (takes, M, n); raises
    ModelDomainError for a single take.
    """
    mean, _ = takes_moments(noise)
    takes = len(noise)
    centred = noise - mean
    products = np.einsum("tki,tkj->tij", centred, centred)
    by_take = products * takes / ((takes - 1) * noise.shape[1])
    pooled = by_take.mean(axis=0)
    target = np.trace(pooled) / len(pooled) * np.eye(len(pooled))
    distance = np.sum((pooled - target) ** 2)
    variance = np.sum((by_take - pooled) ** 2) / takes**2
    intensity = float(min(variance / distance, 1.0)) if distance > 0 else 1.0
    return (1 - intensity) * pooled + intensity * target, intensity
