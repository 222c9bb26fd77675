"""σ_B of the Wishart model: the convex problem on every recorded step, then the dispersion of the
samples of B.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arm.chain import PlanarChain
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.factors import factors
from pipeline.models.wishart.perturbation import (
    Perturbations,
    dispersions,
    fit_perturbations,
    objective_weights,
)


@dataclass(frozen=True)
class WishartFit:
    """σ̂_B and how it came about."""

    sigma_b: float
    dispersions: np.ndarray  # (M,) σ̂_Bk of each step
    perturbations: Perturbations  # of takes × M problems, take by take
    weights: tuple[float, float]  # α₁, α₂
    rest_noise: float  # rad, rms of ‖ω‖ where the command rests


def rest_noise(noise: np.ndarray, v: np.ndarray) -> float:
    """Root mean square of ‖ω‖ in rad over the steps of ``noise`` (takes, M, n) at which the
    commanded step ``v`` (M, n) or (takes, M, n) is zero.
    """
    still = np.broadcast_to(~np.any(v, axis=-1), noise.shape[:-1])
    return float(np.sqrt(np.mean(np.sum(noise[still] ** 2, axis=-1)))) if still.any() else 0.0


def fit_wishart(
    chain: PlanarChain,
    q: np.ndarray,
    v: np.ndarray,
    noise: np.ndarray,
    decomposition: Decomposition,
    floor: float,
    ratio_factor: float = 1.0,
) -> WishartFit:
    """σ̂_B = (1/M) Σ_k σ̂_Bk (Sec. "Motion uncertainty characterization").

    ``q`` (takes, M, n) measured poses in rad before each step, ``v`` (M, n) commanded steps (m, m,
    rad), ``noise`` (takes, M, n) in rad, ``floor`` ε of B⁻¹ ⪰ εI. The weights follow from the noise
    recorded at rest, α₂/α₁ times ``ratio_factor``. Raises ModelDomainError where the motion never
    rests.
    """
    resting = rest_noise(noise, v)
    weights = objective_weights(resting, q.shape[-1], ratio_factor)
    by_step, fits = step_dispersions(chain, q, v, noise, decomposition, weights, floor)
    return WishartFit(float(by_step.mean()), by_step, fits, weights, resting)


def step_dispersions(
    chain: PlanarChain,
    q: np.ndarray,
    v: np.ndarray,
    noise: np.ndarray,
    decomposition: Decomposition,
    weights: tuple[float, float],
    floor: float,
) -> tuple[np.ndarray, Perturbations]:
    """(M,) σ̂_Bk of each step under the given ``weights`` (α₁, α₂), and the perturbations; the
    other arguments as in :func:`fit_wishart`.

    By Eq. (NormStd) over samples of B from Eqs. (BsampOpt) and (const10).
    """
    a, back, _ = factors(chain, q, np.broadcast_to(v, q.shape), decomposition)
    n = q.shape[-1]
    fits = fit_perturbations(
        noise.reshape(-1, n), a.reshape(-1, n), back.reshape(-1, n, n), weights, floor
    )
    return dispersions(fits.s.reshape(*q.shape, n)), fits
