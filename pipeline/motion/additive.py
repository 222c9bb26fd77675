"""The additive Gaussian model: q_{k+1} = q_k + J(q_k)⁻¹ẋᵈ_kΔt + ω_{k+1}, ω ~ N(0, Σ_ω) (Eq. InvDiffRndm)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.arm.chain import PlanarChain
from pipeline.errors import ModelDomainError
from pipeline.motion.noise import moments

# what rounding may leave of asymmetry or of a negative eigenvalue, as a share of the largest entry or eigenvalue
TOLERANCE = 1e-12


def fit_covariance(noise: np.ndarray) -> np.ndarray:
    """(3, 3) Σ̂_ω = (1/M) Σ_k Σ̂_k in rad², the mean of the sample covariances of ``noise`` ω (takes, M, 3) at each step."""
    return moments(noise)[1].mean(axis=0)


@dataclass(frozen=True)
class AdditiveModel:
    """Noise of one covariance at every pose and speed, ``noise_covariance`` Σ_ω (3, 3) in rad²; zero is allowed."""

    noise_covariance: np.ndarray

    def __post_init__(self) -> None:
        _ = self._root  # refuses what is not a covariance

    @cached_property
    def _root(self) -> np.ndarray:
        """(3, 3) symmetric square root of Σ_ω: unlike Cholesky's it exists for a singular covariance too."""
        sigma = np.asarray(self.noise_covariance, dtype=float)
        if sigma.shape != (3, 3) or not np.all(np.isfinite(sigma)) or np.abs(sigma - sigma.T).max() > TOLERANCE * np.abs(sigma).max():
            raise ModelDomainError("the noise covariance must be a finite symmetric 3 × 3 matrix", covariance=sigma.tolist())
        values, vectors = np.linalg.eigh(sigma)
        if values[0] < -TOLERANCE * abs(values[-1]):
            raise ModelDomainError("the noise covariance must be positive semidefinite", eigenvalues=values.tolist())
        return (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T

    def sample(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, int]:
        """One draw of the next joint angles (..., 3) for each of ``q``; nothing is ever clipped."""
        return self.mean(chain, q, v) + rng.standard_normal(q.shape) @ self._root, 0

    def mean(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(..., 3) q + J(q)⁻¹v."""
        return q + np.matvec(chain.inverse_jacobian(q), v)

    def covariance(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(..., 3, 3) Σ_ω, whatever the pose and the step."""
        return np.broadcast_to(self.noise_covariance, (*q.shape, 3))
