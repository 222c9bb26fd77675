"""The additive Gaussian model: q_{k+1} = q_k + J(q_k)⁻¹ẋᵈ_kΔt + ω_{k+1}, ω ~ N(0, Σ_ω) (Eq. InvDiffRndm)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.arm.chain import PlanarChain
from pipeline.motion.density import normal_log_density, principal_axes
from pipeline.motion.model import Law
from pipeline.motion.noise import moments


def fit_covariance(noise: np.ndarray) -> np.ndarray:
    """(3, 3) Σ̂_ω = (1/M) Σ_k Σ̂_k in rad², the mean of the sample covariances of ``noise`` ω (takes, M, 3) at each step."""
    return moments(noise)[1].mean(axis=0)


def shrunk_covariance(noise: np.ndarray) -> tuple[np.ndarray, float]:
    """(3, 3) Σ̂_ω shrunk towards a scaled identity, (1−ρ)Σ̂_ω + ρ·tr Σ̂_ω/3·I in rad², and the intensity ρ in [0, 1].

    The estimate of Ledoit and Wolf (J. Multivariate Analysis 88, 2004): ρ is the variance of Σ̂_ω over its squared distance from the
    target. Steps of one take depend on each other, so the variance is that of the mean over takes, which do not. ``noise`` ω
    (takes, M, 3); raises ModelDomainError for a single take.
    """
    mean, _ = moments(noise)
    takes = len(noise)
    centred = noise - mean
    by_take = np.einsum("tki,tkj->tij", centred, centred) * takes / ((takes - 1) * noise.shape[1])
    pooled = by_take.mean(axis=0)
    target = np.trace(pooled) / len(pooled) * np.eye(len(pooled))
    distance = np.sum((pooled - target) ** 2)
    variance = np.sum((by_take - pooled) ** 2) / takes**2
    intensity = float(min(variance / distance, 1.0)) if distance > 0 else 1.0
    return (1 - intensity) * pooled + intensity * target, intensity


def without_measurement(covariance: np.ndarray, measurement: np.ndarray) -> tuple[np.ndarray, int]:
    """(3, 3) what ``covariance`` holds beyond ``measurement`` (3, 3), in rad², and along how many axes that is nothing.

    There the difference would be negative by chance, and is set to zero.
    """
    variances, axes = np.linalg.eigh(covariance - measurement)
    return (axes * np.maximum(variances, 0.0)) @ axes.T, int(np.count_nonzero(variances < 0))


@dataclass(frozen=True)
class AdditiveModel:
    """Eq. (InvDiffRndm): noise of one covariance at every pose and speed, ``noise_covariance`` Σ_ω (3, 3) in rad²; zero is allowed."""

    noise_covariance: np.ndarray

    def __post_init__(self) -> None:
        _ = self._root  # refuses what is not a covariance

    @cached_property
    def _root(self) -> np.ndarray:
        """(3, 3) symmetric square root of Σ_ω: unlike Cholesky's it exists for a singular covariance too."""
        variances, axes = principal_axes(self.noise_covariance)
        return (axes * np.sqrt(variances)) @ axes.T

    def sample(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, int]:
        """One draw of the next joint angles (..., 3) for each of ``q``; nothing is ever clipped."""
        return self.mean(chain, q, v) + rng.standard_normal(q.shape) @ self._root, 0

    def law(self) -> Law:
        """:meth:`sample` compiled."""
        from pipeline.motion.compiled import additive  # here, as it loads the compiler

        return Law(additive.additive, self._root.ravel(), normals=(1, 3))

    def mean(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(..., 3) q + J(q)⁻¹v."""
        return q + np.matvec(chain.inverse_jacobian(q), v)

    def covariance(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(..., 3, 3) Σ_ω, whatever the pose and the step."""
        return np.broadcast_to(self.noise_covariance, (*q.shape, 3))

    def log_density(
        self, chain: PlanarChain, q: np.ndarray, v: np.ndarray, q_next: np.ndarray, measurement: np.ndarray | None = None
    ) -> np.ndarray:
        """(...,) that of N(q + J⁻¹v, Σ_ω + ``measurement``); raises ModelDomainError where that covariance is singular."""
        covariance = self.noise_covariance if measurement is None else self.noise_covariance + measurement
        return normal_log_density(q_next - self.mean(chain, q, v), 0.0, covariance)
