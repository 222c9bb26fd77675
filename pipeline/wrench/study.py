"""The numerical study: Σ_S when only bounds on the cable system are known, and how well it then serves fresh systems."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import pandas as pd

from pipeline.errors import ConfigError
from pipeline.wrench.matrix import matrix_model, optimal_sigma_s, wrench_covariance
from pipeline.wrench.parametric import CableSystem, force_covariance


@dataclass(frozen=True)
class Bounds:
    """(low, high) of what characterises a cable; a system draws each cable's values uniformly and independently within them."""

    tension: tuple[float, float]  # T̲, N
    direction: tuple[float, float]  # θ̲, rad
    tension_sd: tuple[float, float]  # σ_T, N
    concentration: tuple[float, float]  # κ (the paper's σ_θ)

    def __post_init__(self) -> None:
        for field in fields(self):
            low, high = getattr(self, field.name)
            if not -np.inf < low <= high < np.inf:
                raise ConfigError(f"wrench bounds: {field.name} must be finite with low ≤ high, found ({low}, {high})", key=field.name)
        if self.tension[0] <= 0 or self.tension_sd[0] < 0 or self.concentration[0] <= 0:
            raise ConfigError("wrench bounds: tension and concentration must be positive, tension_sd not negative")


@dataclass(frozen=True)
class SigmaS:
    """Σ_S averaged over drawn systems."""

    mean: np.ndarray  # (2,) diagonal of Σ_S
    standard_error: np.ndarray  # (2,) of the mean
    clipped: int  # entries of single systems that the bound Σ_S ≥ 0 held


def draw_systems(bounds: Bounds, systems: int, agents: int, rng: np.random.Generator) -> CableSystem:
    """``systems`` cable systems of ``agents`` cables within ``bounds``; every field (systems, agents)."""
    return CableSystem(**{field.name: rng.uniform(*getattr(bounds, field.name), (systems, agents)) for field in fields(bounds)})


def _variances(system: CableSystem) -> np.ndarray:
    """Var(F_x), Var(F_y) of the parametric model in N², (..., 2)."""
    return np.einsum("...ii->...i", force_covariance(system))


def estimate_sigma_s(bounds: Bounds, systems: int, agents: int, rng: np.random.Generator) -> SigmaS:
    """Average of the optimal Σ_S of ``systems`` systems of ``agents`` cables drawn within ``bounds``.

    Raises ConfigError for fewer than two systems (no standard error) or no cable.
    """
    if systems < 2 or agents < 1:
        raise ConfigError(f"wrench study: {systems} systems of {agents} cables; at least 2 systems of at least 1 cable are needed")
    drawn = draw_systems(bounds, systems, agents, rng)
    optimal = optimal_sigma_s(matrix_model(drawn), _variances(drawn))
    return SigmaS(optimal.mean(axis=0), optimal.std(axis=0, ddof=1) / np.sqrt(systems), int(np.sum(optimal == 0)))


def relative_errors(system: CableSystem, sigma_s: np.ndarray) -> np.ndarray:
    """‖diag Cov(W) − Var(F)‖/‖Var(F)‖, (...): matrix model with the diagonal ``sigma_s`` (2,) against the parametric model."""
    covariance = wrench_covariance(matrix_model(system), np.diag(sigma_s))
    variance = _variances(system)
    return np.linalg.norm(np.einsum("...ii->...i", covariance) - variance, axis=-1) / np.linalg.norm(variance, axis=-1)


def sigma_s_row(system_class: str, agents: int, estimate: SigmaS) -> dict[str, object]:
    """One row of the table ``sigma_s``."""
    (s11, s22), (se11, se22) = estimate.mean, estimate.standard_error
    return {"system_class": system_class, "agents": agents, "s11": s11, "s22": s22, "se11": se11, "se22": se22, "clipped": estimate.clipped}


def run_study(
    bounds: Bounds, agents: Sequence[int], systems: int, tests: int, repeats: int, rng: np.random.Generator
) -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    """The tables ``sigma_s``, ``wrench_errors`` and ``wrench_spread`` of the study.

    For each number of cables in ``agents``: Σ_S from ``systems`` systems, its error on ``tests`` fresh ones. The first two tables
    hold the first repeat; the third holds the mean and the maximum error of each of ``repeats``, as one run's maximum is a random number.
    """
    sigma_rows, errors, spread = [], [], []
    for repeat, repeat_rng in enumerate(rng.spawn(repeats)):
        for m, m_rng in zip(agents, repeat_rng.spawn(len(agents)), strict=True):
            estimate = estimate_sigma_s(bounds, systems, m, m_rng)
            error = relative_errors(draw_systems(bounds, tests, m, m_rng), estimate.mean)
            spread.append({"agents": m, "repeat": repeat, "mean": error.mean(), "maximum": error.max()})
            if repeat == 0:
                sigma_rows.append(sigma_s_row("study", m, estimate))
                errors.append(pd.DataFrame({"agents": m, "system": np.arange(tests), "error": error}))
    return pd.DataFrame(sigma_rows), pd.concat(errors, ignore_index=True), pd.DataFrame(spread)
