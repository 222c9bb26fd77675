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


def rest_noise(noise: np.ndarray, v: np.ndarray, measurement: np.ndarray | None = None) -> float:
    """Root mean square of ‖ω‖ in rad over the steps of ``noise`` (takes, M, n) at which the
    command ``v``, (M, ·) or (takes, M, ·), is zero; where none is, that of ``measurement`` noise
    Σ_m (n, n), or zero.
    """
    still = np.broadcast_to(~np.any(v, axis=-1), noise.shape[:-1])
    if still.any():
        return float(np.sqrt(np.mean(np.sum(noise[still] ** 2, axis=-1))))
    return 0.0 if measurement is None else float(np.sqrt(np.trace(measurement)))


def fit_wishart(
    chain: PlanarChain,
    q: np.ndarray,
    v: np.ndarray,
    noise: np.ndarray,
    decomposition: Decomposition,
    floor: float,
    ratio_factor: float = 1.0,
    measurement: np.ndarray | None = None,
) -> WishartFit:
    """σ̂_B = (1/M) Σ_k σ̂_Bk (Sec. "Motion uncertainty characterization").

    The weights follow from the noise recorded at rest. Raises ModelDomainError where the motion
    never rests and the noise of its measurement is not known.

    Args:
        chain: of n joints and m task rows.
        q: (takes, M, n) measured poses in rad before each step.
        v: (M, m) or longer, commands.
        noise: (takes, M, n) ω in rad.
        decomposition: of the Jacobian.
        floor: ε of B⁻¹ ⪰ εI.
        ratio_factor: on α₂/α₁.
        measurement: (n, n) Σ_m in rad², of a motion that never rests.
    """
    resting = rest_noise(noise, v, measurement)
    weights = objective_weights(resting, len(chain.task), ratio_factor)
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
    a, back, _ = factors(chain, q, np.broadcast_to(v, (*q.shape[:-1], v.shape[-1])), decomposition)
    n, m = back.shape[-2:]
    fits = fit_perturbations(
        noise.reshape(-1, n), a.reshape(-1, m), back.reshape(-1, n, m), weights, floor
    )
    return dispersions(fits.s.reshape(*q.shape[:-1], m, m)), fits
